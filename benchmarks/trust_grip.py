"""Light grips and turning hands: the shear that is felt, and the shear that is not there."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.trust_bodies import ramp
from tests.fixtures.plant import EARTH_UT, Touch, direction, turning
from tests.fixtures.plant_skin import BAG, QUICK_BAG, REST_S, Player, Skin, skin_of

__all__ = ["START_S", "light_grip", "turn", "turned_field"]

LOADS_N = (0.4, 0.5, 0.7, 1.0, 1.5, 3.0)
"""Of a pad of 16 units."""
START_S, SETTLED_S = REST_S + 2.0, 0.5
"""When something touches at first, after the hand may have turned, and has stood still for a
while."""
SHARE = (0.3, 0.6)
GRIP_S, LIFT_S = (0.2, 3.0), (0.3, 1.5)
"""How long the pads need to close, and the object to be lifted: log-uniform."""
REGRIP_S, HOLD_S, GROWN_S, LAST_S = 0.4, 1.5, 2.0, 0.4
"""Gripped harder within; held before and after that; means are over the last."""
TILT = 0.3
"""By which the load of a unit differs from the mean, evenly."""
TURN_RAD_S, TURN_S = 1.0, 12.0


def turned_field(
    cycles: int, rate_hz: float, rad_s: float, span_s: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """The Earth's field, any way it may point, in a hand that turns about any axis from one time to
    another and stands before and after; shape (t, 3)."""
    start, stop = span_s
    angle = rad_s * np.clip(np.arange(cycles) / rate_hz - start, 0.0, stop - start)
    return turning(angle, direction(rng), EARTH_UT * direction(rng))


def middle(values: list[float]) -> dict[str, Any]:
    """Median with the 95 % interval of order statistics, which asks for no distribution; least and
    largest."""
    from scipy.stats import binom

    ordered = np.sort(np.asarray(values, float))
    n = ordered.size
    low = int(binom.ppf(0.025, n, 0.5))
    return {"median": float(np.median(ordered)), "lower": float(ordered[max(low - 1, 0)]),
            "upper": float(ordered[min(n - low, n - 1)]), "least": float(ordered[0]),
            "largest": float(ordered[-1]), "runs": n}  # fmt: skip


# -- grips -----------------------------------------------------------------------------------------


def light_grip(quick: bool, seed: int) -> dict[str, Any]:
    """Felt over true shear of a gripper's two pads."""
    runs, loads = (3, LOADS_N[::3]) if quick else (12, LOADS_N)
    gripper = skin_of("gripper", bag=QUICK_BAG if quick else BAG)
    out: dict[str, Any] = {"grips": {}, "grown": {}}
    for field in (True, False):
        name = "field" if field else "no field"
        for load in loads:
            found = [_grip(gripper, load, (seed, run, round(10 * load)), field)
                     for run in range(runs)]  # fmt: skip
            out["grips"][f"{load:g} N, {name}"] = {"units": middle([each[0] for each in found])}
            if load == loads[0]:
                out["grown"][name] = middle([each[1] for each in found])
    every = [row["units"]["median"] for row in out["grips"].values()]
    ends = [row["units"][end] for row in out["grips"].values() for end in ("least", "largest")]
    out["worst_median"] = {"lower": min(every), "upper": max(every)}
    out["worst"] = [min(ends), max(ends)]
    return out


def _grip(skin: Skin, load_n: float, seed: tuple[int, ...], field: bool) -> tuple[float, float]:
    """Felt over true shear of the units at the end of the hold, and after the grip has grown to the
    largest load."""
    rng = np.random.default_rng((1, *seed))
    plant, rate = skin.plant, skin.rate_hz
    way = direction(rng)
    in_plane = np.einsum("abn,a->bn", plant.topology.rotation[:, :2], way)
    in_plane /= np.linalg.norm(in_plane, axis=0)
    grip_s, lift_s = (float(np.exp(rng.uniform(*np.log(span)))) for span in (GRIP_S, LIFT_S))
    each = load_n / 16.0 * _uneven(rng, plant.topology.patch)
    most = LOADS_N[-1] / load_n
    seconds = START_S + grip_s + lift_s + HOLD_S + GROWN_S
    cycles = round(seconds * rate)
    closed = ramp(cycles, rate, START_S, grip_s)
    begin = START_S + grip_s + lift_s + HOLD_S
    grown = 1.0 + (most - 1.0) * ramp(cycles, rate, begin, REGRIP_S)
    depth = plant.depth_at(each * (closed * grown)[:, np.newaxis])
    lifted = ramp(cycles, rate, START_S + grip_s, lift_s)
    length = plant.length_at(rng.uniform(*SHARE) * each * lifted[:, np.newaxis])
    touch = Touch(depth, length[:, np.newaxis] * in_plane)
    world = None
    if field:
        # the hand has turned since the tare; what it does once all units touch, nobody can know
        span = REST_S, START_S - SETTLED_S
        world = turned_field(cycles, rate, TURN_RAD_S, span, rng)
    true = plant.forces(touch)
    last = round(LAST_S * rate)
    spans = {
        "hold": (round(begin * rate) - last, round(begin * rate)),
        "end": (cycles - last, cycles),
    }
    felt = dict.fromkeys(spans, 0.0)
    states = Player(skin.known, want={"wrench", "contacts"}).play(
        plant.counts(touch, rng, world_ut=world)
    )
    for i, state in enumerate(states):
        for name, (start, stop) in spans.items():
            if start <= i < stop:
                felt[name] += _along(state.units.force, in_plane) / last
    expected = {name: _along(true[stop - 1], in_plane) for name, (_, stop) in spans.items()}
    return felt["hold"] / expected["hold"], felt["end"] / expected["end"]


def _uneven(rng: np.random.Generator, patch: np.ndarray) -> np.ndarray:
    """Shares of a load, mean 1 on each pad."""
    share = 1.0 + TILT * rng.uniform(-1.0, 1.0, patch.size)
    for pad in np.unique(patch):
        share[patch == pad] /= share[patch == pad].mean()
    return share


def _along(force: np.ndarray, way: np.ndarray) -> float:
    """Sum over units of the tangential force along a direction in each unit's plane."""
    return float(np.nansum(force[:2] * way))


# -- turns -----------------------------------------------------------------------------------------


def turn(quick: bool, seed: int) -> dict[str, Any]:
    """Shear of an untouched palm while the hand turns."""
    palm = skin_of("palm", bag=QUICK_BAG if quick else BAG)
    return {"untouched": _untouched(palm, 2 if quick else 9, seed)}


def _untouched(skin: Skin, runs: int, seed: int) -> dict[str, Any]:
    """Errors, mN, of single readings; means over runs with what they differ by."""
    rows = []
    for run in range(runs):
        rng = np.random.default_rng((3, seed, run))
        rest, cycles = round(REST_S * skin.rate_hz), round(TURN_S * skin.rate_hz)
        world = turned_field(
            rest + cycles, skin.rate_hz, TURN_RAD_S, (REST_S, REST_S + TURN_S), rng
        )
        counts = skin.plant.counts(Touch.none(rest + cycles, skin.n), rng, world_ut=world)
        shear, total, touched = np.zeros((cycles, 2, skin.n)), np.zeros((cycles, 2)), 0
        for i, state in enumerate(Player(skin.known, want={"wrench", "contacts"}).play(counts)):
            if i >= rest:
                shear[i - rest] = 1e3 * state.units.force[:2]
                total[i - rest] = shear[i - rest].sum(axis=1)
                touched += bool(state.contacts)
        sides, sums = np.hypot(shear[:, 0], shear[:, 1]), np.hypot(*total.T)
        rows.append({
            "unit_rms_mn": np.sqrt(np.mean(sides**2)), "unit_p95_mn": np.percentile(sides, 95.0),
            "sum_rms_mn": np.sqrt(np.mean(sums**2)), "sum_p95_mn": np.percentile(sums, 95.0),
            "contacts": touched / cycles,
        })  # fmt: skip
    return {key: _mean([row[key] for row in rows]) for key in rows[0]}


def _mean(values: list[float]) -> dict[str, float]:
    """Mean over runs and half of its 95 % interval."""
    from scipy.stats import t

    n = len(values)
    half = t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n) if n > 1 else np.nan
    return {"mean": float(np.mean(values)), "interval": float(half), "runs": n}
