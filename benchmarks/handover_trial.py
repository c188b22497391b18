"""Trials of handovers: people take a block out of a gripper, or only touch it while it is carried.

The truth's moment of a take is when the hand bears half of the weight and goes on to, until the
block is released: then it is securely grasped.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from shared.gripper import held
from shared.people import Act, Hand, Person, brush, bump, draw_block, draw_person, take
from skin.behaviours.handover import Handover, Phase
from skin.sim.grasping.world import World

__all__ = ["Carry", "Take", "run_carry", "run_take"]

SECURE = 0.5
"""Share of the weight that the hand bears."""

GIVE_UP_S = 1.5
"""After the hand bears it: what is not recognised until then is not at all."""

AFTER_S = 0.4
"""After the release, in which the block must stay in the hand."""

LOST_M = 0.05
STRONGEST_N = 4.0
WANT = frozenset({"force", "sigma"})


@dataclass
class Take:
    """One take.

    Attributes
    ----------
    person : Person
    weight_n, hesitates, rise_s : float
    secure_s, taken_s : float
        When the hand bears it, and when that was recognised; NaN for never.
    moved_m : float
        How far the block is off where it was, after the release.
    why : str
        The decision.
    time_s, true_support, update_us : list of float
        Cycle by cycle; the last is what `Handover.update` took, microseconds.
    """

    person: Person
    weight_n: float
    hesitates: float
    rise_s: float
    secure_s: float = math.nan
    taken_s: float = math.nan
    moved_m: float = math.nan
    why: str = ""
    time_s: list[float] = field(default_factory=list)
    true_support: list[float] = field(default_factory=list)
    update_us: list[float] = field(default_factory=list)

    @property
    def latency_s(self) -> float:
        """From the truth's moment; NaN where it was not recognised, or before."""
        return self.taken_s - self.secure_s

    @property
    def too_early(self) -> bool:
        """Whether it was released while the hand did not bear it."""
        return self.taken_s == self.taken_s and not self.taken_s >= self.secure_s

    @property
    def recognised(self) -> bool:
        """Whether it was recognised, and the block stayed in the hand."""
        return self.taken_s >= self.secure_s and self.moved_m < LOST_M


def run_take(seed: int) -> Take:
    """Let one person take one block; the same for the same seed."""
    random = np.random.default_rng((seed, 43))
    thing, person = draw_block(random), draw_person(random)
    weight_n = 9.81 * thing.mass_kg
    hesitates = float(random.uniform(0.1, 0.35)) if random.random() < 0.4 else 0.0
    waits_s = float(random.uniform(0.3, 0.8)) if hesitates else 0.0
    rise_s = float(random.uniform(0.1, 0.7))
    share, side = float(random.uniform(0.8, 1.3)), float(random.uniform(0.0, 0.6))
    heading = float(random.uniform(-math.pi, math.pi))
    wanted = share * weight_n * np.array(
        [0.5 * side * math.cos(heading), side * math.sin(heading), 1.0]
    )  # fmt: skip
    acts = _before(random)
    acts.append((0.9, take(wanted, rise_s, hesitates=hesitates, waits_s=waits_s)))
    trial = Take(person, weight_n, hesitates, rise_s)
    until_s = 0.9 + waits_s + rise_s + GIVE_UP_S
    with held(thing, strongest_n=STRONGEST_N, seed=seed, want=WANT) as (world, control, states):
        handover = Handover(world.skin.topology)
        handover.give()
        hand, start_s = Hand(world, person), world.time_s
        before = world.truth.position[:, 0].copy()
        for state in states:
            now_s = world.time_s - start_s
            while acts and now_s >= acts[0][0]:
                hand.begin(acts.pop(0)[1])
            _note(trial, now_s, hand)
            begun_ns = time.perf_counter_ns()
            phase = handover.update(state)
            trial.update_us.append(1e-3 * (time.perf_counter_ns() - begun_ns))
            if phase == Phase.TAKEN and math.isnan(trial.taken_s):
                trial.taken_s, trial.why = now_s, str(handover.decisions[-1])
                control.release()
                until_s = now_s + AFTER_S
            hand.update()
            if now_s >= until_s:
                break
        trial.moved_m = float(np.linalg.norm(world.truth.position[:, 0] - before))
    trial.secure_s = _secure(trial)
    return trial


def _before(random: np.random.Generator) -> list[tuple[float, Act]]:
    """What a hand does as it comes near: it knocks at the block, or brushes over it."""
    acts: list[tuple[float, Act]] = []
    if random.random() < 0.5:
        acts.append((0.35, _bump(random, 2.0)))
    if random.random() < 0.5:
        acts.append((0.55, _brush(random)))
    return acts


def _note(trial: Take, now_s: float, hand: Hand) -> None:
    trial.time_s.append(now_s)
    trial.true_support.append(float(hand.force_n[2]) / trial.weight_n)


def _secure(trial: Take) -> float:
    """When the hand began to bear the block until it was released, or until the end."""
    time_s, support = np.array(trial.time_s), np.array(trial.true_support)
    if trial.taken_s == trial.taken_s:
        support = support[time_s <= trial.taken_s]
    below = np.flatnonzero(support < SECURE)
    first = int(below[-1]) + 1 if below.size else 0
    return float(time_s[first]) if first < support.size else math.nan


@dataclass
class Carry:
    """A way on which nobody takes anything.

    Attributes
    ----------
    seconds : float
    bumps, brushes, tugs : int
    released : list of str
        Decisions to release, each of them false.
    """

    seconds: float = 0.0
    bumps: int = 0
    brushes: int = 0
    tugs: int = 0
    released: list[str] = field(default_factory=list)


def run_carry(seed: int, seconds: float) -> Carry:
    """Carry a block up and down, with something that touches it every second."""
    random = np.random.default_rng((seed, 44))
    thing, person = draw_block(random), draw_person(random)
    carry = Carry(seconds)
    with held(thing, strongest_n=STRONGEST_N, seed=seed, want=WANT) as (world, _, states):
        handover = Handover(world.skin.topology)
        handover.give()
        hand, start_s = Hand(world, person), world.time_s
        next_s, home_m = 0.4, world.joints.targets["lift"]
        swing_m, swing_s = random.uniform(0.01, 0.05), random.uniform(0.8, 2.0)
        for state in states:
            now_s = world.time_s - start_s
            if now_s >= next_s:
                next_s = now_s + 0.2 + float(random.exponential(0.8))
                hand.begin(_touch(carry, random, 9.81 * thing.mass_kg))
            _swing(world, home_m, swing_m * 0.5 * (1.0 - math.cos(math.pi * now_s / swing_s)))
            if handover.update(state) == Phase.TAKEN:
                carry.released.append(str(handover.decisions[-1]))
                handover.give()
            hand.update()
            if now_s >= seconds:
                break
    return carry


def _swing(world: World, home_m: float, height_m: float) -> None:
    world.joints["lift"] = home_m + float(height_m)


def _touch(carry: Carry, random: np.random.Generator, weight_n: float) -> Act:
    """A bump, a brush, or a hand that goes along, bears up to 35 % and lets go."""
    kind = random.random()
    if kind < 0.45:
        carry.bumps += 1
        return _bump(random, 5.0)
    if kind < 0.85:
        carry.brushes += 1
        return _brush(random)
    carry.tugs += 1
    share = float(random.uniform(0.1, 0.35))
    seconds = float(random.uniform(0.2, 0.8))
    course = take((0.0, 0.0, share * weight_n), 1.0, hesitates=1.0, waits_s=seconds)
    return course._replace(seconds=seconds, holds=False)


def _bump(random: np.random.Generator, most_n: float) -> Act:
    """Any direction, 0.5 N to `most_n`, 20 to 80 ms."""
    way = random.normal(size=3)
    force = float(random.uniform(0.5, most_n)) * way / np.linalg.norm(way)
    return bump(force, float(random.uniform(0.02, 0.08)))


def _brush(random: np.random.Generator) -> Act:
    """Sideways, up to 25 degrees up or down, 0.1 to 0.5 N, 50 to 300 ms."""
    angle, tilt = random.uniform(-math.pi, math.pi), math.radians(random.uniform(-25.0, 25.0))
    way = np.array([math.cos(angle) * math.cos(tilt), math.sin(angle) * math.cos(tilt),
                    math.sin(tilt)])  # fmt: skip
    return brush(float(random.uniform(0.1, 0.5)) * way, float(random.uniform(0.05, 0.3)))
