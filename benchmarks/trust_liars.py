"""Units that lie under a still hold: are they found, and what do they say until then?"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.intervals import rate
from benchmarks.trust_bodies import ramp
from skin.state import INVALID, Status
from tests.fixtures.plant import BX, BZ, FREQUENCY, GEL, Plant, Touch
from tests.fixtures.plant_skin import BAG, QUICK_BAG, REST_S, Player, Skin, skin_of

__all__ = ["KINDS", "liars_still"]

COMES_S, HELD_S, LIES_S, LAST_S = 0.4, 2.0, 5.0, 0.5
DEPTHS_MM, WAYS_MM = (0.4, 1.5), (0.2, 0.9)
OFF_UT, OFF_GEL = 1000.0, 1.05
KINDS = ("honest", "Bx + 1 mT", "Bx at rest", "gel + 5 %", "unit at rest", "gel at its rail")
FOUND = int(INVALID | Status.SATURATED | Status.EXTRAPOLATED)
"""A flag that says that a number is wrong, or a bound."""
SEEN_CYCLES = 25
"""Of the last `LAST_S`, in which a unit that is found is flagged, at least."""


def liars_still(quick: bool, seed: int) -> dict[str, Any]:
    """One unit of a palm that is pressed and sheared all over, and held still, by kind of lie."""
    skin = skin_of("palm", bag=QUICK_BAG if quick else BAG)
    runs = 2 if quick else 10
    return {kind: _row([_run(skin, kind, (seed, run)) for run in range(runs)]) for kind in KINDS}


def _run(skin: Skin, kind: str, seed: tuple[int, int]) -> dict[str, Any]:
    rng = np.random.default_rng((6, *seed, KINDS.index(kind)))
    plant, rate_hz = skin.plant, skin.rate_hz
    unit, angle = int(rng.integers(skin.n)), rng.uniform(-np.pi, np.pi)
    start = round((REST_S + COMES_S + HELD_S) * rate_hz)
    cycles = start + round(LIES_S * rate_hz)
    share = ramp(cycles, rate_hz, REST_S, COMES_S)
    spread = 1.0 + 0.1 * rng.uniform(-1.0, 1.0, skin.n)
    way = rng.uniform(*WAYS_MM) * np.array([np.cos(angle), np.sin(angle)])
    depth = rng.uniform(*DEPTHS_MM) * spread
    moved = way[:, np.newaxis] * np.ones(skin.n)
    touch = Touch(share[:, np.newaxis] * depth, share[:, np.newaxis, np.newaxis] * moved)
    exact = plant.values(touch)
    counts = plant.quantised(plant.noisy(lying(plant, exact, kind, unit, start), rng))
    if kind == "gel at its rail":
        counts[start:, GEL, unit] = plant.rails[1][GEL, unit]
    true = plant.forces(Touch(touch.depth_mm[-1:], touch.moved_mm[-1:]))[0, :, unit]
    flagged = np.zeros(cycles, bool)
    last, off, warm, sigma, contact = round(LAST_S * rate_hz), 0.0, 0.0, None, 0
    states = Player(skin.known, want=None).play(counts)
    for i, state in enumerate(states):
        flagged[i] = (int(state.units.status[unit]) & FOUND) != 0
        if i >= cycles - last:
            off = off + (state.units.force[:, unit] - true) / last
            warm += (float(state.units.temperature[unit]) - 25.0) / last
            contact += int(state.label[unit]) >= 0
            sigma = (
                state.units.force_sigma[:, unit].copy(),
                float(state.units.temperature_sigma[unit]),
            )
    after = np.flatnonzero(flagged[start:])
    kept = bool(flagged[-last:].sum() >= SEEN_CYCLES)
    return {
        "found": kept, "after_s": float(after[0]) / rate_hz if after.size else None,
        "before": bool(flagged[round(REST_S * rate_hz) : start].any()),
        "force_n": float(np.abs(off).max()), "force_sigmas": float(np.max(np.abs(off) / sigma[0])),
        "warm_k": abs(warm), "warm_sigmas": abs(warm) / sigma[1], "in_contact": contact / last,
    }  # fmt: skip


def lying(plant: Plant, exact: np.ndarray, kind: str, unit: int, start: int) -> np.ndarray:
    """What the board of a unit makes of its channels from a cycle on; noise comes on top."""
    rest = plant.values(Touch.none(1, plant.n))[0]
    if kind == "Bx + 1 mT":
        exact[start:, BX, unit] += OFF_UT
    elif kind == "Bx at rest":
        exact[start:, BX, unit] = rest[BX, unit]
    elif kind == "gel + 5 %":
        exact[start:, GEL, unit] *= OFF_GEL
    elif kind == "unit at rest":
        exact[start:, FREQUENCY : BZ + 1, unit] = rest[FREQUENCY : BZ + 1, unit]
    return exact


def _row(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Share that is found and stays so, and the worst of the means that pass without a flag."""
    passed = [run for run in runs if not run["found"]]
    worst = {name: max((run[name] for run in passed), default=0.0)
             for name in ("force_n", "force_sigmas", "warm_k", "warm_sigmas")}  # fmt: skip
    median = {f"median_{name}": float(np.median([run[name] for run in passed])) if passed else 0.0
              for name in worst}  # fmt: skip
    return {
        "found": rate(sum(run["found"] for run in runs), len(runs)),
        "flagged_before": rate(sum(run["before"] for run in runs), len(runs)),
        "in_contact": float(np.mean([run["in_contact"] for run in runs])), **worst, **median,
    }  # fmt: skip
