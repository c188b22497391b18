"""Trials for slip detectors: bodies that press, slide and turn on skins, drawn from families.

The detector fits one rigid motion to the displacements of units that stick. The trials know nothing
of that: see `benchmarks.slip_play`. What units see of it is for `benchmarks.slip_seen`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.slip_play import (
    FIRST,
    ONSET,
    RATE_HZ,
    SKINS,
    Plan,
    Trial,
    play,
    pressed,
    reached_mm,
    skin_of,
    turned,
)  # fmt: skip
from skin.physics.elastic import Elastic
from skin.sim.mechanics.body import Body
from skin.sim.mechanics.rays import CYLINDER

__all__ = ["FAMILIES", "KINDS", "stage"]

KINDS = ("slip", "hold", "modulation")
FEWEST, BEARS_N = 6, 0.05
"""Units that bear load, and what counts as load."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Ranges from which trials are drawn; ends of even draws, in logarithm for speeds and rates.

    Trials of the same number of two families are of the same draws, so that they differ by what
    the families do, unless one draw does not suit a family and the next one is taken.

    Attributes
    ----------
    far_mm : tuple of float
        How far full slip drags the farthest face.
    from_touch : bool
        A body that is tilted comes down from where it first touches; else from where it would if
        it were not tilted, which presses more.
    speed_mm_s : tuple of float
        Of the fastest face in contact.
    longest_s : float
        After which a trial ends.
    coarse_s : float
        Step of the first look for where slip begins.
    compliance_mm_per_n : float
        How far the object's surface yields under the force of one unit.
    rate_hz : float
    roll : tuple of float
        Share of its way that a round body rolls; no other body where that is not 0.
    shake_mm, shake_hz : tuple of float
        Amplitude and frequency at which the body shakes along the skin.
    """

    far_mm: tuple[float, float] = (0.4, 2.2)
    from_touch: bool = False
    speed_mm_s: tuple[float, float] = (0.5, 10.0)
    longest_s: float = 6.0
    coarse_s: float = 4.0 / RATE_HZ
    compliance_mm_per_n: float = 0.0
    rate_hz: float = RATE_HZ
    roll: tuple[float, float] = (0.0, 0.0)
    shake_mm: tuple[float, float] = (0.0, 0.0)
    shake_hz: tuple[float, float] = (5.0, 50.0)


FAMILIES = {
    "base": Family(),
    "light": Family(far_mm=(0.1, 0.4), from_touch=True),
    "soft": Family(compliance_mm_per_n=1.0),
    "fast": Family(speed_mm_s=(10.0, 50.0), coarse_s=0.002),
    "100 Hz": Family(rate_hz=100.0),
    "rolling": Family(roll=(0.3, 0.8)),
    "shaking": Family(shake_mm=(0.01, 0.05), coarse_s=0.002),
}
"""By name; the ranges are [assumed]. Light is a grip that does not want to hurt."""


def stage(seed: int, kind: str, number: int, *, family: str = "base") -> Trial:
    """Draw and play trial `number` of its kind and family; each is the same every time.

    At least `FEWEST` units bear load.

    Plans are drawn until the truth is of the kind: a slip reaches a tenth of the load; of what is
    held, less than `FIRST` has slipped at any time.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), number, 0])
    ranges = FAMILIES[family]
    while True:
        plan = _drawn(rng, kind, ranges)
        units = int((pressed(plan, plan.depth_mm)[0] > BEARS_N).sum())
        if units < FEWEST:
            continue
        if kind == "slip":
            trial = play(plan)
            if trial.share[trial.moving].max() >= ONSET:
                return trial
            continue
        coarse = play(replace(plan, kind="slip", modulation=0.0), until=FIRST, dt_s=ranges.coarse_s)
        slipped = coarse.moving & (coarse.share >= FIRST)
        if slipped.any():
            reach_mm = coarse.travel_mm[np.argmax(slipped)]
            trial = play(replace(plan, farthest_mm=rng.uniform(0.1, 0.9) * reach_mm))
            if trial.share[trial.moving].max() < FIRST:
                return trial


def _drawn(rng: np.random.Generator, kind: str, family: Family) -> Plan:
    skin_name = str(rng.choice(list(SKINS), p=[0.5, 0.25, 0.25]))
    skin = skin_of(skin_name)
    rolls = family.roll[1] > 0.0
    shape = rng.choice(["sphere", "cylinder"] if rolls else ["sphere", "cylinder", "plate"])
    soft = {"compliance_mm_per_n": family.compliance_mm_per_n}
    if shape == "sphere":
        radius = np.exp(rng.uniform(np.log(0.05), np.log(1.0)))
        body, height = Body.sphere(radius, **soft), radius
    elif shape == "cylinder":
        radius = np.exp(rng.uniform(np.log(0.03), np.log(0.5)))
        body, height = Body.cylinder(radius, rng.uniform(0.04, 0.2), **soft), radius
    else:
        body, height = Body.plate(*rng.uniform(0.03, 0.09, 2), **soft), 0.0
    middle = np.append(rng.uniform(-0.012, 0.012, 2), height)
    yaw = rng.uniform(-np.pi, np.pi)
    lean = turned((np.eye(3), middle), np.array([0.0, 0.0, 1.0]), yaw)
    tilt_about = np.append(rng.standard_normal(2), 0.0)
    foot = np.append(middle[:2], 0.0)
    lean = turned(lean, tilt_about, np.radians(rng.uniform(0.0, 1.5)), about=foot)
    coefficient = rng.uniform(0.3, 0.9)
    friction = coefficient * (1.0 + 0.03 * rng.standard_normal(skin.n))
    way = rng.choice(["slide", "both", "spin"], p=[0.55, 0.3, 0.15])
    turn = 0.0 if way == "slide" else rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15)
    plan = Plan(
        kind=kind, skin=skin_name, body=body, lean=lean, depth_mm=1.0, friction=friction,
        kinetic=rng.uniform(0.8, 1.0) * friction,
        modulus_pa=np.inf if rng.random() < 0.15 else np.exp(rng.uniform(np.log(3e5), np.log(2e6))),
        press_s=rng.uniform(0.15, 0.5),
        speed_mm_s=np.exp(rng.uniform(*np.log(family.speed_mm_s))),
        heading_rad=rng.uniform(-np.pi, np.pi), turn_rad_per_mm=turn,
        pivot_m=tuple(middle[:2] + rng.uniform(-0.012, 0.012, 2)), slide=float(way != "spin"),
        modulation=rng.uniform(0.1, 0.3) if kind == "modulation" else 0.0,
        modulation_hz=np.exp(rng.uniform(np.log(0.5), np.log(5.0))),
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    # How deep: until full slip drags some face as far as wanted.
    far_mm = rng.uniform(*family.far_mm)
    plan = _of_family(rng, plan, family, yaw)
    low, high = 0.02, 6.0 * (1.0 + family.compliance_mm_per_n)
    for _ in range(20):
        depth = 0.5 * (low + high)
        load_n, own_mm = pressed(plan, depth)
        drag_mm = Elastic(skin).displacement(plan.friction * load_n, own_mm)
        deep = drag_mm.max() > far_mm or own_mm.max() > 2.0
        low, high = (low, depth) if deep else (depth, high)
    return replace(plan, depth_mm=low)


def _of_family(rng: np.random.Generator, plan: Plan, family: Family, yaw: float) -> Plan:
    """The plan with what only its family has; nothing more is drawn where it has nothing."""
    changes: dict[str, object] = {"rate_hz": family.rate_hz, "longest_s": family.longest_s}
    if family.from_touch:
        rotation, place = plan.lean
        lift_mm = max(reached_mm(plan).max(), 0.0)
        changes["lean"] = rotation, place + np.array([0.0, 0.0, 1e-3 * lift_mm])
    if family.roll[1]:
        radius = plan.body.size[0]
        changes["roll_per_m"] = rng.uniform(*family.roll) / radius
        changes["turn_rad_per_mm"], changes["slide"] = 0.0, 1.0
        if plan.body.kind == CYLINDER:
            # a cylinder rolls about its own axis
            changes["heading_rad"] = yaw + 0.5 * np.pi * rng.choice([-1.0, 1.0])
    if family.shake_mm[1]:
        changes["shake_mm"] = rng.uniform(*family.shake_mm)
        changes["shake_hz"] = np.exp(rng.uniform(*np.log(family.shake_hz)))
        changes["shake_rad"] = rng.uniform(-np.pi, np.pi)
    return replace(plan, **changes)
