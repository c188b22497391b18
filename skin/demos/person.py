"""Person: a hand on an object, as a spring and a damper on a moving target, with a tremor.

Its force acts on the object's centre of mass in the engine and is unknown to skin and behaviours.
Acts that hold on (a pull, a take) yield as the object moves; a tap, a bump and a brush do not.
Ranges are those of adult hands [assumed, after Tee et al. 2004 for stiffness and Elble and Koller
1990 for tremor].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from skin.grasp.world import World

__all__ = ["Act", "Hand", "Person", "brush", "bump", "draw_person", "pull", "take", "twist"]

Vector = Sequence[float] | np.ndarray
Course = Callable[[float], float]
"""From time since the begin, second, to a fraction from 0 to 1."""


@dataclass(frozen=True)
class _Trapezoid:
    """Rise, stay and fall, with minimum jerk; seconds."""

    rise_s: float
    hold_s: float
    fall_s: float

    def __call__(self, t: float) -> float:
        if t < self.rise_s:
            return _jerk(t / self.rise_s)
        over_s = t - self.rise_s - self.hold_s
        return 1.0 if over_s <= 0.0 else 1.0 - _jerk(over_s / self.fall_s)


@dataclass(frozen=True)
class _Bell:
    """A half sine to a power."""

    seconds: float
    power: int

    def __call__(self, t: float) -> float:
        return math.sin(math.pi * t / self.seconds) ** self.power


@dataclass(frozen=True)
class _Tried:
    """A fraction of it first, a release, and then all of it."""

    share: float
    tried: _Trapezoid
    waits_s: float
    whole: _Trapezoid

    def __call__(self, t: float) -> float:
        return self.share * self.tried(t) if t < self.waits_s else self.whole(t - self.waits_s)


TURN_NM, TURN_NMS = 0.3, 0.003
"""Rotational stiffness and damping of a holding hand, per radian [assumed: a light pinch]."""

DAMPING = 0.7
"""Damping ratio of a hand with the object [assumed]."""


@dataclass(frozen=True, kw_only=True)
class Person:
    """Properties of a person.

    Attributes
    ----------
    stiffness_n_per_m : float
    tremor_hz, tremor_n : float
        Frequency and amplitude of the physiological tremor; it grows by a fiftieth of the force.
    point_m : tuple of 3 float
        Grip point, from the centre of mass of the object.
    tremor_phase : float
    """

    stiffness_n_per_m: float = 200.0
    tremor_hz: float = 10.0
    tremor_n: float = 0.02
    point_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tremor_phase: float = 0.0


def draw_person(random: np.random.Generator) -> Person:
    """A random person: 60 to 600 N/m, 8 to 12 Hz, up to 8 mm off the middle."""
    return Person(
        stiffness_n_per_m=float(np.exp(random.uniform(np.log(60.0), np.log(600.0)))),
        tremor_hz=float(random.uniform(8.0, 12.0)),
        tremor_n=float(random.uniform(0.005, 0.04)),
        point_m=tuple(random.uniform(-0.008, 0.008, 3).tolist()),
        tremor_phase=float(random.uniform(0.0, 2.0 * math.pi)),
    )


@dataclass(frozen=True, kw_only=True)
class Act:
    """An act of a person.

    Attributes
    ----------
    seconds : float
        Duration; infinite for a hand that stays.
    force_n, moment_nm : ndarray, shape (3,)
        On an object that does not move, frame of the world, times `course`.
    course : callable
    holds : bool
        Whether the hand holds on.
    """

    seconds: float
    force_n: np.ndarray
    course: Course
    moment_nm: np.ndarray
    holds: bool


def pull(force_n: Vector, *, rise_s: float, hold_s: float, fall_s: float) -> Act:
    """Pull, push or press: the target moves by force over stiffness, stays and returns."""
    course = _Trapezoid(rise_s, hold_s, fall_s)
    return Act(seconds=rise_s + hold_s + fall_s, force_n=np.array(force_n, float), course=course,
               moment_nm=np.zeros(3), holds=True)  # fmt: skip


def twist(moment_nm: Vector, *, rise_s: float, hold_s: float, fall_s: float) -> Act:
    """Turn it."""
    course = _Trapezoid(rise_s, hold_s, fall_s)
    return Act(seconds=rise_s + hold_s + fall_s, force_n=np.zeros(3), course=course,
               moment_nm=np.array(moment_nm, float), holds=True)  # fmt: skip


def bump(force_n: Vector, seconds: float) -> Act:
    """A tap or a bump: half a sine."""
    return Act(seconds=seconds, force_n=np.array(force_n, float), moment_nm=np.zeros(3),
               course=_Bell(seconds, 1), holds=False)  # fmt: skip


def brush(force_n: Vector, seconds: float) -> Act:
    """A passing sleeve or finger: rises and falls without a jump."""
    return Act(seconds=seconds, force_n=np.array(force_n, float), moment_nm=np.zeros(3),
               course=_Bell(seconds, 2), holds=False)  # fmt: skip


def take(force_n: Vector, rise_s: float, *, hesitates: float = 0.0, waits_s: float = 0.0) -> Act:
    """Take over: the force rises and stays; a hesitating one bears a fraction first, and lets
    go."""
    tried = _Trapezoid(0.3 * waits_s, 0.4 * waits_s, 0.3 * waits_s)
    course = _Tried(hesitates, tried, waits_s, _Trapezoid(rise_s, math.inf, 1.0))
    return Act(seconds=math.inf, force_n=np.array(force_n, float), course=course,
               moment_nm=np.zeros(3), holds=True)  # fmt: skip


class Hand:
    """Plays the acts of a person on one object of a world.

    Parameters
    ----------
    world : World
    name : str
        Of the object.
    person : Person, optional

    Attributes
    ----------
    force_n, moment_nm : ndarray, shape (3,)
        Force of the person in this cycle, frame of the world; torque about the centre of mass.
    """

    def __init__(self, world: World, name: str, person: Person | None = None) -> None:
        self.world, self.name = world, name
        self.person = Person() if person is None else person
        self.force_n, self.moment_nm = np.zeros(3), np.zeros(3)
        self._index = world.truth.object_names.index(name)
        model = world.scene.plant.model
        mass = float(model.body_mass[world.scene.plant.object_bodies[self._index]])
        most = 0.4 * mass * world.skin.topology.cycle_rate_hz
        critical = 2.0 * math.sqrt(self.person.stiffness_n_per_m * mass)
        self._damping = min(DAMPING * critical, most)
        self._acts: list[tuple[float, Act, np.ndarray, np.ndarray]] = []

    def begin(self, act: Act) -> None:
        """Begin an act now, in addition to those in progress."""
        truth = self.world.truth
        at = truth.position[:, self._index].copy(), truth.rotation[:, :, self._index].copy()
        self._acts.append((self.world.time_s, act, *at))

    def update(self) -> None:
        """Apply the acts to the object; once a cycle."""
        now_s = self.world.time_s
        self._acts = [row for row in self._acts if now_s - row[0] < row[1].seconds]
        force, moment = np.zeros(3), np.zeros(3)
        for begun_s, act, position, rotation in self._acts:
            own, turn = self._one(now_s - begun_s, act, position, rotation)
            force += own
            moment += turn
        self.force_n, self.moment_nm = force, moment
        self.world.push(self.name, force, moment)

    def _one(
        self, time_s: float, act: Act, position: np.ndarray, rotation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and torque of one act."""
        truth, person = self.world.truth, self.person
        share = act.course(time_s)
        force, moment = share * act.force_n, share * act.moment_nm
        arm = truth.rotation[:, :, self._index] @ np.array(person.point_m)
        if act.holds:
            start = position + rotation @ np.array(person.point_m)
            spin, velocity = truth.velocity[3:, self._index], truth.velocity[:3, self._index]
            gone = truth.position[:, self._index] + arm - start
            speed = velocity + np.cross(spin, arm)
            grown = share * person.stiffness_n_per_m
            force = force - grown * gone - self._damping * share * speed + self._tremor(force)
            turned = truth.rotation[:, :, self._index] @ rotation.T
            angle = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0],
                                    turned[1, 0] - turned[0, 1]])  # fmt: skip
            moment = moment - share * (TURN_NM * angle + TURN_NMS * spin)
        return force, moment + np.cross(arm, force)

    def _tremor(self, force: np.ndarray) -> np.ndarray:
        person = self.person
        size = float(np.linalg.norm(force))
        if size == 0.0:
            return np.zeros(3)
        phase = 2.0 * math.pi * person.tremor_hz * self.world.time_s + person.tremor_phase
        sway = np.array([math.sin(phase), math.sin(phase + 2.0), math.sin(phase + 4.0)])
        return min(size, person.tremor_n + 0.02 * size) * sway


def _jerk(x: float) -> float:
    """Minimum jerk from 0 to 1 [Flash and Hogan, 1985]."""
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
