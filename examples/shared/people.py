"""People: a hand on an object, as a spring and a damper on a moving target, with a tremor.

Its force acts on the object's centre of mass in the engine; skin and behaviours do not know it.
Acts that hold on (a pull, a take) yield as the object moves; a tap, a bump and a brush do not.
Ranges are those of adult hands [assumed, after Tee et al. 2004 for stiffness and Elble and Koller
1990 for tremor].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from skin.sim import GraspObject

__all__ = ["Act", "Hand", "Person", "brush", "bump", "draw_block", "draw_person", "knots_between",
           "loads_at", "pull", "take"]  # fmt: skip

Vector = Sequence[float] | np.ndarray

TURN_NM, TURN_NMS = 0.3, 0.003
"""Rotational stiffness and damping of a holding hand, per radian [assumed: a light pinch]."""
DAMPING = 0.7
"""Damping ratio of a hand with the object [assumed]."""
KNOT_S = (0.2, 0.6)
"""Duration of the transition from one of several pulls to the next [assumed]."""


class Person(NamedTuple):
    """A hand: its stiffness, its tremor, whose amplitude grows by a fiftieth of the force, and its
    grip point, from the centre of mass of the object."""

    stiffness_n_per_m: float = 200.0
    tremor_hz: float = 10.0
    tremor_n: float = 0.02
    tremor_phase: float = 0.0
    point_m: tuple[float, ...] = (0.0, 0.0, 0.0)


def draw_person(random: np.random.Generator) -> Person:
    """A random person: 60 to 600 N/m, 8 to 12 Hz, up to 8 mm off the middle."""
    stiffness = float(np.exp(random.uniform(np.log(60.0), np.log(600.0))))
    hz, newton = float(random.uniform(8.0, 12.0)), float(random.uniform(0.005, 0.04))
    point_m = tuple(random.uniform(-0.008, 0.008, 3).tolist())
    return Person(stiffness, hz, newton, float(random.uniform(0.0, 2.0 * math.pi)), point_m)


def draw_block(random: np.random.Generator) -> GraspObject:
    """A block that stands on the floor between the pads, 80 to 300 g."""
    return GraspObject(
        name="block", size_m=(float(random.uniform(0.014, 0.026)), 0.024, 0.03),
        mass_kg=float(random.uniform(0.08, 0.3)), friction=float(random.uniform(0.6, 0.9)),
    )  # fmt: skip


class Act(NamedTuple):
    """An act of a person: force and torque on an object that does not move, frame of the world,
    times `course`, a function of the seconds since its begin; a hand may hold on."""

    seconds: float
    force_n: np.ndarray
    moment_nm: np.ndarray
    course: Callable[[float], float]
    holds: bool


def pull(
    force_n: Vector = (0.0, 0.0, 0.0), moment_nm: Vector = (0.0, 0.0, 0.0), *,
    rise_s: float, hold_s: float, fall_s: float,
) -> Act:  # fmt: skip
    """Pull, push, press or twist: the hand's target moves by force over stiffness, stays and
    returns."""
    force, moment = np.array(force_n, float), np.array(moment_nm, float)
    course = partial(_trapezoid, rise_s, hold_s, fall_s)
    return Act(rise_s + hold_s + fall_s, force, moment, course, True)


def bump(force_n: Vector, seconds: float) -> Act:
    """A tap or a bump: half a sine."""
    return Act(seconds, np.array(force_n, float), np.zeros(3), partial(_bell, seconds, 1), False)


def brush(force_n: Vector, seconds: float) -> Act:
    """A passing sleeve or finger: rises and falls without a jump."""
    return Act(seconds, np.array(force_n, float), np.zeros(3), partial(_bell, seconds, 2), False)


def take(force_n: Vector, rise_s: float, *, hesitates: float = 0.0, waits_s: float = 0.0) -> Act:
    """Take over: the force rises and stays; a hesitating one bears a fraction first, and lets
    go."""
    course = partial(_tried, rise_s, hesitates, waits_s)
    return Act(math.inf, np.array(force_n, float), np.zeros(3), course, True)


def _trapezoid(rise_s: float, hold_s: float, fall_s: float, t: float) -> float:
    """Rise, stay and fall, with minimum jerk [Flash and Hogan, 1985]."""
    over_s = t - rise_s - hold_s
    x = t / rise_s if t < rise_s else 1.0 - min(max(over_s / fall_s, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def _bell(seconds: float, power: int, t: float) -> float:
    return math.sin(math.pi * t / seconds) ** power


def _tried(rise_s: float, share: float, waits_s: float, t: float) -> float:
    if t < waits_s:
        return share * _trapezoid(0.3 * waits_s, 0.4 * waits_s, 0.3 * waits_s, t)
    return _trapezoid(rise_s, math.inf, 1.0, t - waits_s)


class Hand:
    """Plays the acts of a person on the one object of a world; `force_n` and `moment_nm` are those
    of this cycle, frame of the world, about the centre of mass."""

    def __init__(self, world: Any, person: Person | None = None) -> None:
        self.person = person = Person() if person is None else person
        self._world = world
        (self._name,) = world.truth.object_names
        self.force_n, self.moment_nm = np.zeros(3), np.zeros(3)
        mass_kg = world.scene.plant.model.body(self._name).mass[0]
        critical = 2.0 * math.sqrt(person.stiffness_n_per_m * mass_kg)
        most = 0.4 * mass_kg * world.skin.topology.cycle_rate_hz
        self._damping = min(DAMPING * critical, most)
        self._acts: list[tuple[float, Act, np.ndarray, np.ndarray]] = []

    def begin(self, act: Act) -> None:
        """Begin an act now, in addition to those in progress."""
        truth = self._world.truth
        at = truth.position[:, 0].copy(), truth.rotation[:, :, 0].copy()
        self._acts.append((self._world.time_s, act, *at))

    def update(self) -> None:
        """Apply the acts to the object; once a cycle."""
        now_s = self._world.time_s
        self._acts = [row for row in self._acts if now_s - row[0] < row[1].seconds]
        self.force_n, self.moment_nm = np.zeros(3), np.zeros(3)
        for begun_s, act, position, rotation in self._acts:
            force, moment = self._one(now_s - begun_s, act, position, rotation)
            self.force_n, self.moment_nm = self.force_n + force, self.moment_nm + moment
        self._world.push(self._name, self.force_n, self.moment_nm)

    def _one(
        self, time_s: float, act: Act, position: np.ndarray, rotation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Force and torque of one act."""
        truth, person = self._world.truth, self.person
        share, now = act.course(time_s), truth.rotation[:, :, 0]
        force, moment = share * act.force_n, share * act.moment_nm
        arm = now @ np.array(person.point_m)
        if act.holds:
            gone = truth.position[:, 0] + arm - position - rotation @ np.array(person.point_m)
            spin = truth.velocity[3:, 0]
            speed = truth.velocity[:3, 0] + np.cross(spin, arm)
            tremor = self._tremor(force)
            force = force - share * (person.stiffness_n_per_m * gone + self._damping * speed)
            force += tremor
            turn = now @ rotation.T
            angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0],
                                    turn[1, 0] - turn[0, 1]])  # fmt: skip
            moment = moment - share * (TURN_NM * angle + TURN_NMS * spin)
        return force, moment + np.cross(arm, force)

    def _tremor(self, force: np.ndarray) -> np.ndarray:
        person, size = self.person, float(np.linalg.norm(force))
        phase = 2.0 * math.pi * person.tremor_hz * self._world.time_s + person.tremor_phase
        sway = np.sin(phase + np.array([0.0, 2.0, 4.0]))
        return min(size, person.tremor_n + 0.02 * size) * sway


def knots_between(random: np.random.Generator, begin_s: float, end_s: float) -> list[float]:
    """Times between which loads change, from `begin_s` to `end_s`."""
    knots = [begin_s]
    while knots[-1] < end_s - 2 * KNOT_S[0]:
        knots.append(min(knots[-1] + float(random.uniform(*KNOT_S)), end_s - KNOT_S[0]))
    return [*knots, end_s]


def loads_at(knots_s: np.ndarray, loads: np.ndarray, time_s: float) -> tuple[float, float, float]:
    """Two forces and a torque, shape (3, k), by half cosines between k knots; 0 outside."""
    if not knots_s[0] < time_s < knots_s[-1]:
        return 0.0, 0.0, 0.0
    k = int(np.searchsorted(knots_s, time_s)) - 1
    share = (time_s - knots_s[k]) / (knots_s[k + 1] - knots_s[k])
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    y, z, turn = (loads[:, k] + share * (loads[:, k + 1] - loads[:, k])).tolist()
    return y, z, turn
