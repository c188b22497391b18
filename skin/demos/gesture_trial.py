"""Trials of gestures: a person acts on a held block, and the gestures are recognised by the
skin."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skin.behaviours.gesture import Gesture, GestureParameters, Gestures
from skin.demos.held import held_object, thing_of
from skin.demos.person import Act, Hand, Person, brush, bump, draw_person, pull, twist

__all__ = ["KINDS", "STRENGTHS_N", "Asked", "GestureTrial", "Seen", "asked_kinds", "asked_pulls",
           "asked_story", "match", "run_gestures"]  # fmt: skip

STRENGTHS_N = (0.5, 1.0, 2.0)
"""Of pulls, as in the paper's Fig. 4c."""

PAUSE_S, AFTER_S = 0.45, 0.15
"""Pause between two gestures; time after a gesture's end in which a report is still matched to
it."""

STRONGEST_N = 3.0


class Asked(NamedTuple):
    """A gesture to be performed; the angle is that of `Gesture.angle_rad`, NaN without one."""

    kind: str
    angle_rad: float
    act: Act


class Seen(NamedTuple):
    """Result of a gesture: the report at its end, None without one, and the delay from its begin to
    the first report of its kind."""

    asked: Asked
    began_s: float
    reported: Gesture | None
    first_s: float

    @property
    def is_right(self) -> bool:
        """Whether the kind is right; a push is a pull away from the person."""
        return (
            self.reported is not None
            and self.reported.kind.replace("push", "pull") == self.asked.kind
        )

    @property
    def off_rad(self) -> float:
        """Error of the direction; NaN without a report or without a direction."""
        if self.reported is None or not math.isfinite(self.asked.angle_rad):
            return math.nan
        return math.remainder(self.reported.angle_rad - self.asked.angle_rad, 2.0 * math.pi)


@dataclass
class GestureTrial:
    """Gestures and time courses: newton, skin frame, which is that of the world.

    Attributes
    ----------
    seen : list of Seen
    others : list of Gesture
        Reports without a gesture.
    time_s, force_n, true_n, moment_nm, true_nm : list
        Per cycle: measured and true change of force and torque.
    update_us : list of float
        Microseconds of `Gestures.update`.
    person : Person
    """

    person: Person
    seen: list[Seen] = field(default_factory=list)
    others: list[Gesture] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    force_n: list[list[float]] = field(default_factory=list)
    true_n: list[list[float]] = field(default_factory=list)
    moment_nm: list[list[float]] = field(default_factory=list)
    true_nm: list[list[float]] = field(default_factory=list)
    update_us: list[float] = field(default_factory=list)


def asked_pulls(random: np.random.Generator, strength_n: float) -> list[Asked]:
    """Pulls in eight directions, in random order, each up to 22.5 degrees off."""
    found = []
    for k in random.permutation(8):
        angle = math.radians(45.0 * float(k))
        size = strength_n * float(random.uniform(0.9, 1.1))
        force = size * np.array([0.0, math.cos(angle), math.sin(angle)])
        found.append(Asked("pull", angle, pull(force, **_course(random))))
    return found


def asked_kinds(random: np.random.Generator, each: int = 2) -> list[Asked]:
    """Taps, brushes, presses, pulls and twists, some of each, in random order."""
    found = [_draw(kind, random) for kind in KINDS for _ in range(each)]
    return [found[i] for i in random.permutation(len(found))]


def asked_story(random: np.random.Generator) -> list[Asked]:
    """Eight pulls in order of direction, of 0.8 to 1.6 N, then a tap, a press and a twist (Fig.
    4b)."""
    found = []
    for k in range(8):
        angle = math.remainder(math.radians(45.0 * k), 2.0 * math.pi)
        force = float(random.uniform(0.8, 1.6)) * np.array([0.0, math.cos(angle), math.sin(angle)])
        found.append(Asked("pull", angle, pull(force, rise_s=0.2, hold_s=0.4, fall_s=0.2)))
    tap = bump((0.0, 0.0, -2.0), 0.05)
    press = pull((1.5, 0.0, 0.0), rise_s=0.2, hold_s=0.4, fall_s=0.2)
    turn = twist((0.04, 0.0, 0.0), rise_s=0.2, hold_s=0.4, fall_s=0.2)
    others = [("tap", -math.pi / 2.0, tap), ("press", math.nan, press), ("twist", math.nan, turn)]
    return found + [Asked(*other) for other in others]


KINDS = ("tap", "brush", "press", "pull", "twist")


def run_gestures(
    seed: int,
    asked: Callable[[np.random.Generator], Sequence[Asked]],
    *,
    parameters: GestureParameters | None = None,
    pace: bool = False,
) -> GestureTrial:
    """Play gestures of one person on one object; the same for the same seed. `pace` limits it to
    real time."""
    random = np.random.default_rng((seed, 41))
    thing, person = thing_of(random), draw_person(random)
    waiting, trial = list(asked(random)), GestureTrial(person)
    begun: list[tuple[float, Asked]] = []
    reports: list[tuple[float, Gesture]] = []
    with held_object(thing, strongest_n=STRONGEST_N, seed=seed, want={"force", "sigma"}) as (
        world,
        _,
        states,
    ):
        gestures, hand = Gestures(world.skin.topology, parameters), Hand(world, thing.name, person)
        start_s = next_s = world.time_s
        next_s += PAUSE_S
        paced_s = time.monotonic()
        for state in states:
            now_s = world.time_s - start_s
            if waiting and world.time_s >= next_s:
                one = waiting.pop(0)
                hand.begin(one.act)
                begun.append((now_s, one))
                next_s = world.time_s + one.act.seconds + PAUSE_S
            elif not waiting and world.time_s >= next_s:
                break
            if pace:
                time.sleep(max(0.0, paced_s + now_s - time.monotonic()))
            begun_ns = time.perf_counter_ns()
            found = gestures.update(state)
            trial.update_us.append(1e-3 * (time.perf_counter_ns() - begun_ns))
            if found is not None:
                reports.append((now_s, found))
            trial.time_s.append(now_s)
            trial.force_n.append(gestures.disturbance.force_n)
            trial.true_n.append(hand.force_n.tolist())
            trial.moment_nm.append(gestures.disturbance.moment_nm)
            trial.true_nm.append(hand.moment_nm.tolist())
            hand.update()
    match(trial, begun, reports)
    return trial


def match(
    trial: GestureTrial, begun: list[tuple[float, Asked]], reports: list[tuple[float, Gesture]]
) -> None:
    """Match reports to gestures."""
    used: set[int] = set()
    for began_s, asked in begun:
        until_s = began_s + asked.act.seconds + AFTER_S
        mine = [(s, g) for s, g in reports if began_s <= s - 1e-9 and g.began_s < until_s
                and s > began_s and g.began_s > began_s - AFTER_S]  # fmt: skip
        ended = [g for _, g in mine if g.ended]
        used.update(id(g) for _, g in mine)
        best = max(ended, key=lambda g: g.duration_s, default=None)
        first_s = next((s - began_s for s, g in mine if best and g.kind == best.kind), math.nan)
        trial.seen.append(Seen(asked, began_s, best, first_s))
    trial.others = [g for _, g in reports if g.ended and id(g) not in used]


def _course(random: np.random.Generator) -> dict[str, float]:
    return {
        "rise_s": float(random.uniform(0.08, 0.4)),
        "hold_s": float(random.uniform(0.1, 0.8)),
        "fall_s": float(random.uniform(0.08, 0.3)),
    }


def _draw(kind: str, random: np.random.Generator) -> Asked:
    """A gesture of a kind, with random strength and direction in the range of hands."""
    angle = float(random.uniform(-math.pi, math.pi))
    across = np.array([0.0, math.cos(angle), math.sin(angle)])
    along = np.array([float(random.choice([-1.0, 1.0])), 0.0, 0.0])
    tilted = across + np.array([0.15 * random.normal(), 0.0, 0.0])
    if kind == "tap":
        is_across = random.random() < 0.5
        force = float(random.uniform(0.8, 4.0)) * (across if is_across else along)
        return Asked(kind, angle if is_across else math.nan,
                     bump(force, float(random.uniform(0.02, 0.07))))  # fmt: skip
    if kind == "brush":
        force = float(random.uniform(0.15, 0.4)) * tilted
        return Asked(kind, angle, brush(force, float(random.uniform(0.05, 0.3))))
    if kind == "press":
        force = float(random.uniform(0.7, 3.0)) * (along + 0.1 * random.normal() * across)
        return Asked(kind, math.nan, pull(force, **_course(random)))
    if kind == "twist":
        axis = random.normal(size=3)
        moment = float(random.uniform(0.02, 0.06)) * axis / np.linalg.norm(axis)
        return Asked(kind, math.nan, twist(moment, **_course(random)))
    force = float(random.uniform(0.5, 2.5)) * tilted
    return Asked(kind, angle, pull(force, **_course(random)))
