"""Numerical stress: float32 and float64 decoders against 40 digits, where it is hardest.

Whole domains of counts, crests, zeros, rails and calibrations at their ends are walked in long
doubles; where a decoder is farthest off it is judged with 40 digits. Forces are held where a
reading is valid and no bound (SATURATED, of which the error stands beside). `condition` is the
largest change of the force, in full scales, over the relative change of what a channel reads;
errors of forces, or at calibrations whose full scale is, beyond 7.2 N are in shares of that, times
7.2 N.

Then what lasts or is large: cross-talk as dense as `skin check` lets through, a million cycles of
every filter, moments about an origin 100 m away, arrays of 1 to 65 536 units. `slowdown` is the
time of a cycle under stress over that of a calm one, by the same decoder's plan, by turns.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.stress_lasting import LASTING
from benchmarks.stress_oracle import judge, walk
from benchmarks.stress_picture import draw
from benchmarks.stress_points import points
from benchmarks.stress_time import slowdowns
from skin.decode.decoder import Decoder
from skin.options import DTYPES, ESTIMATORS
from skin.physics.elastic import Elastic
from skin.state import Reading, Status
from topology import Topology

PICTURE = Path(__file__).parent / "pictures" / "stress.png"
JUDGED = {True: 8, False: 60}
"""Of each case, estimator and type, those that are farthest off by the walk; quick and in full."""
FULL_SCALE_N = 7.2
TARGET_N = {"float32": 2e-5, "float64": 1e-9}
TARGET_SLOWDOWN = 1.5
SHOWN = ("force", "force_sigma", "temperature", "temperature_sigma", "displacement_mm",
         "displacement_sigma_mm", "tangential", "tangential_sigma")  # fmt: skip


class Worst(NamedTuple):
    """What was judged of a case.

    Attributes
    ----------
    error_n, condition : ndarray, shape (m,)
    unit : ndarray, shape (m,), int
    flags : ndarray, shape (m,), uint16
    """

    error_n: np.ndarray
    condition: np.ndarray
    unit: np.ndarray
    flags: np.ndarray


def run(quick: bool) -> dict:
    """Measure, draw the picture; see the head of this file for what the figures are."""
    rows, judged, nonfinite = [], {}, 0
    for name, skin, counts in points(quick):
        for estimator in ESTIMATORS:
            row: dict = {"case": name, "estimator": estimator, "points": skin.n}
            for dtype in DTYPES:
                reading = decode(skin, counts, estimator, dtype)
                nonfinite += count_nonfinite(reading)
                exact = worst(skin, counts, reading, estimator, JUDGED[quick])
                judged.setdefault((name, estimator), {})[dtype] = exact
                row[dtype] = described(skin, counts, reading, exact, estimator)
            rows.append(row)
    lasting = {name: of(quick) for name, of in LASTING.items()}
    times = slowdowns(quick)
    draw(PICTURE, judged)
    figures: dict = {
        f"worst_error_n_{dtype}": max(
            *(row[dtype]["error_n"] for row in rows),
            *(row[f"error_n_{dtype}"] for row in lasting.values()),
        )
        for dtype in DTYPES
    }
    return {
        **figures,
        "nonfinite_valid": nonfinite + sum(row["nonfinite"] for row in lasting.values()),
        "slowdown": max(times.values()),
        "targets": {**TARGET_N, "slowdown": TARGET_SLOWDOWN},
        "rows": rows,
        "lasting": lasting,
        "slowdowns": times,
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'case':<33}{'estimator':<13}{'points':>7}{'valid':>7}{'float32 N':>11}"
             f"{'condition':>11}{'float64 N':>11}{'bounds N':>10}  worst in float32"]  # fmt: skip
    for row in figures["rows"]:
        single, double = row["float32"], row["float64"]
        lines.append(
            f"{row['case']:<33}{row['estimator']:<13}{row['points']:>7}{single['valid']:>7.0%}"
            f"{single['error_n']:>11.1e}{single['condition']:>11.1e}{double['error_n']:>11.1e}"
            f"{single['bound_error_n']:>10.0e}  {single['flags']} at {single['counts']}"
        )
    lines.append(f"\n{'what lasts or is large':<52}{'float32 N':>11}{'float64 N':>11}  seen")
    for name, row in figures["lasting"].items():
        lines.append(
            f"{name:<52}{row['error_n_float32']:>11.1e}{row['error_n_float64']:>11.1e}"
            f"  {row['seen']}"
        )
    lines.append(f"\n{'time of a cycle over a calm one':<52}")
    lines += [f"{name:<52}{ratio:>11.2f}" for name, ratio in figures["slowdowns"].items()]
    targets = figures["targets"]
    lines.append(
        f"\nworst where valid: float32 {figures['worst_error_n_float32']:.1e} N (target "
        f"{targets['float32']:.0e}), float64 {figures['worst_error_n_float64']:.1e} N (target "
        f"{targets['float64']:.0e}); valid and not finite: {figures['nonfinite_valid']} (target "
        f"0); slowdown {figures['slowdown']:.2f} (target {targets['slowdown']:g})"
    )
    return "\n".join(lines)


def decode(skin: Topology, counts: np.ndarray, estimator: str, dtype: str) -> Reading:
    """The first cycle after a start; the field is not held against its model, so that no reading is
    left out for it."""
    return Decoder(skin, estimator=estimator, dtype=dtype, consistency=False)(counts)


def is_held(reading: Reading) -> np.ndarray:
    """Readings that are valid and no bounds, shape (n,)."""
    return reading.valid & (reading.status & int(Status.SATURATED) == 0)


def count_nonfinite(reading: Reading) -> int:
    """Values of valid units that are NaN or infinite."""
    return sum(
        int((~np.isfinite(getattr(reading, name)[..., reading.valid])).sum()) for name in SHOWN
    )


def full_scale_n(skin: Topology) -> np.ndarray:
    """Largest calibrated force of each unit, at least `FULL_SCALE_N`, shape (n,)."""
    p = skin.parameters
    reach = np.maximum(p["tangential_max_mm"], p["field_angle_max_mm"])
    depth = p["normal_max_n"] / p["normal_stiff_n_per_hz"] / p["frequency_slope_hz_per_mm"]
    along = np.abs(Elastic(skin).tangential(reach, depth))
    return np.maximum(np.maximum(p["normal_max_n"], along), FULL_SCALE_N)


def worst(skin: Topology, counts: np.ndarray, reading: Reading, estimator: str, most: int) -> Worst:
    """Judge the units that are farthest off: half of them bounds, if so many are."""
    units = np.flatnonzero(reading.valid)
    largest_n = np.abs(reading.force[:, units]).max(axis=0).astype(np.float64)
    share = FULL_SCALE_N / np.fmax(largest_n, full_scale_n(skin)[units])
    told = walk(skin, counts[:, units], units, estimator)
    off = np.abs(reading.force[:, units] - told).max(axis=0) * share
    off = np.where(np.isfinite(off), off, np.inf)
    held = is_held(reading)[units]
    chosen = np.concatenate([
        part[np.argsort(off[part], kind="stable")[-most:]]
        for part in (np.flatnonzero(held), np.flatnonzero(~held))
    ])  # fmt: skip
    units = units[chosen]
    some = counts[:, units]
    exact = judge(skin, some, units, estimator)
    error_n = np.abs(reading.force[:, units] - exact).max(axis=0) * share[chosen]
    return Worst(
        error_n.astype(np.float64),
        condition(skin, some, units, estimator),
        units,
        reading.status[units],
    )


def condition(skin: Topology, counts: np.ndarray, units: np.ndarray, estimator: str) -> np.ndarray:
    """Largest change of the force over the relative change of what a channel reads, full scales."""
    found = np.zeros(units.size)
    full_n = full_scale_n(skin)[units]
    for channel in range(counts.shape[0]):
        more, less = (counts.astype(np.int64) for _ in range(2))
        more[channel] += 1
        less[channel] -= 1
        change = walk(skin, more, units, estimator) - walk(skin, less, units, estimator)
        scale, offset = skin.scale[channel, units], skin.offset[channel, units]
        reads = np.abs(counts[channel] + offset / scale)
        slope = 0.5 * np.abs(change).max(axis=0).astype(np.float64) * reads / full_n
        found = np.fmax(found, slope)
    return found


def described(
    skin: Topology, counts: np.ndarray, reading: Reading, exact: Worst, estimator: str
) -> dict:
    """What the worst readings of a case say."""
    held = is_held(reading)
    which = held[exact.unit]
    row = {"valid": float(held.mean()), "error_n": 0.0, "condition": 0.0, "flags": "none",
           "counts": []}  # fmt: skip
    if which.any():
        at = int(np.argmax(np.where(which, exact.error_n, -1.0)))
        unit = int(exact.unit[at])
        row |= {
            "error_n": float(exact.error_n[at]),
            "condition": float(exact.condition[which].max()),
            "flags": str(Status(int(exact.flags[at])).name or "no flag"),
            "counts": counts[:, unit].tolist(),
        }
    bounds = exact.error_n[~which]
    return row | {"bound_error_n": float(bounds.max()) if bounds.size else 0.0}
