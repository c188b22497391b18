"""Trials for slip detectors: bodies that press, slide and turn on skins, drawn from families.

The detector fits one rigid motion to the displacements of units that stick. The trials know nothing
of that: see `benchmarks.slip_play`. What units see of it is for `benchmarks.slip_seen`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.slip_families import FAMILIES, Family
from benchmarks.slip_play import (
    FIRST,
    GROSS,
    ONSET,
    PITCH_M,
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

__all__ = [
    "FAMILIES", "FEW", "FIRST", "GROSS", "KINDS", "ONSET", "PITCH_M", "RATE_HZ", "SKINS", "Plan",
    "Trial", "play", "skin_of", "stage",
]  # fmt: skip

KINDS = ("slip", "hold", "modulation")
FEW, BEARS_N = (3, 5), 0.05
"""Units that bear load where they are few, and what counts as load."""
MIXED = 0.5
"""Share of the variance of friction that is smooth over the face, where it is spread."""
SMOOTH_PITCHES = 2.0
"""Length over which that part changes, pitches of the skin."""


def stage(seed: int, kind: str, number: int, *, family: str = "base", few: bool = False) -> Trial:
    """Draw and play trial `number` of its kind and family; each is the same every time.

    At least six units bear load; where `few` is wanted, three to five.

    Plans are drawn until the truth is of the kind: a slip reaches a tenth of the load; of what is
    held, less than `FIRST` has slipped at any time.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), number, few])
    ranges = FAMILIES[family]
    while True:
        plan = _drawn(rng, kind, ranges)
        units = int((pressed(plan, plan.depth_mm)[0] > BEARS_N).sum())
        if not (FEW[0] <= units <= FEW[1] if few else units > FEW[1]):
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
    skin = skin_of(skin_name, family.pitch_m)
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
    changes: dict[str, object] = {
        "rate_hz": family.rate_hz, "pitch_m": family.pitch_m, "longest_s": family.longest_s,
    }  # fmt: skip
    if family.spread:
        kinetic = plan.kinetic / plan.friction
        spread = _spread(rng, skin_of(plan.skin, plan.pitch_m).position, family)
        changes["friction"] = plan.friction.mean() * spread
        changes["kinetic"] = kinetic * changes["friction"]
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


def _spread(rng: np.random.Generator, position: np.ndarray, family: Family) -> np.ndarray:
    """Friction of each face over its mean, shape (n,): lognormal, never negative."""
    gap = np.linalg.norm(position[:, :, np.newaxis] - position[:, np.newaxis], axis=0)
    near = np.exp(-0.5 * (gap / (SMOOTH_PITCHES * family.pitch_m)) ** 2)
    values, vectors = np.linalg.eigh(near)
    smooth = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(values.size))
    own = rng.standard_normal(values.size)
    together = np.sqrt(MIXED) * smooth + np.sqrt(1.0 - MIXED) * own
    return np.exp(family.spread * together - 0.5 * family.spread**2)
