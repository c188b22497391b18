"""Numerical stress: float32 and float64 decoders against 40 digits, where it is hardest.

Whole domains of counts, crests, zeros, rails and calibrations at their ends are walked in long
doubles, drawn anew with several seeds; where a decoder is farthest off it is judged with 40 digits.
Forces are held where a reading is valid and no bound (SATURATED, of which the error stands beside).
`condition` is the largest change of the force, in full scales, over the relative change of what a
channel reads; errors of forces, or at calibrations whose full scale is, beyond 7.2 N are in shares
of that, times 7.2 N. `over_sigma` is the largest error, in newton as it is, over the sigma that
the same reading states.

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
from benchmarks.stress_points import AT_ENDS, is_held, points
from benchmarks.stress_time import slowdowns
from skin.decode.decoder import Decoder
from skin.options import DTYPES, ESTIMATORS
from skin.physics.elastic import Elastic
from skin.state import Reading, Status
from topology import Topology

PICTURE = Path(__file__).parent / "pictures" / "stress.png"
SEEDS = {True: (1, 2, 3), False: (1, 2, 3, 4, 5, 6)}
"""Quick and in full."""
JUDGED = {True: 8, False: 20}
"""Of each case, seed, estimator and type, those that are farthest off by the walk, and farthest in
their own sigma."""
FULL_SCALE_N = 7.2
TARGET_N = {"float32": 2e-5, "float64": 1e-9}
TARGET_SLOWDOWN = 1.5
SHOWN = ("force", "force_sigma", "temperature", "temperature_sigma", "displacement_mm",
         "displacement_sigma_mm", "tangential", "tangential_sigma",
         "theta", "theta_sigma")  # fmt: skip


NONE = {
    "broken_covariances": "covariances not symmetric or not positive",
    "differ_valid": "readings valid in one type alone",
    "differ_by_size": "values that differ by the size of the array",
}
"""What must not be, of what lasts or is large."""


class Worst(NamedTuple):
    """What was judged of a case.

    Attributes
    ----------
    error_n, over_sigma, condition : ndarray, shape (m,)
    unit : ndarray, shape (m,), int
    flags : ndarray, shape (m,), uint16
    """

    error_n: np.ndarray
    over_sigma: np.ndarray
    condition: np.ndarray
    unit: np.ndarray
    flags: np.ndarray


def run(quick: bool) -> dict:
    """Measure, draw the picture; see the head of this file for what the figures are."""
    found: dict[tuple[str, str], list[dict]] = {}
    judged: dict[tuple[str, str], dict[str, list[Worst]]] = {}
    for seed in SEEDS[quick]:
        for name, skin, counts in points(quick, seed):
            for estimator in ESTIMATORS:
                row, exact = stressed(skin, counts, estimator, JUDGED[quick])
                found.setdefault((name, estimator), []).append(row)
                kept = judged.setdefault((name, estimator), {dtype: [] for dtype in DTYPES})
                for dtype in DTYPES:
                    kept[dtype].append(exact[dtype])
    rows = [
        {"case": name, "estimator": estimator, **over_seeds(each)}
        for (name, estimator), each in found.items()
    ]
    lasting = {name: of(quick) for name, of in LASTING.items()}
    times = slowdowns(quick)
    draw(PICTURE, judged)
    figures: dict = {}
    for dtype in DTYPES:
        walked = [row[dtype] for row in rows]
        figures |= {
            f"worst_error_n_{dtype}": max(
                *(row["error_n"] for row in walked),
                *(row.get(f"error_n_{dtype}", 0.0) for row in lasting.values()),
            ),
            f"worst_error_n_by_seed_{dtype}": [
                max(errors) for errors in zip(*(row["by_seed_n"] for row in walked), strict=True)
            ],
            f"worst_error_over_sigma_{dtype}": max(row["over_sigma"] for row in walked),
            f"worst_bound_error_n_{dtype}": max(row["bound_error_n"] for row in walked),
        }
    seen = (*(row["nonfinite"] for row in rows), *(row["nonfinite"] for row in lasting.values()))
    return {
        **figures,
        "nonfinite_valid": sum(seen),
        **{name: sum(row.get(name, 0) for row in lasting.values()) for name in NONE},
        "slowdown": max(times.values())[0],
        "slowdown_95": list(max(times.values())[1:]),
        "seeds": list(SEEDS[quick]),
        "held_at_ends": {
            r["estimator"]: r["float32"]["held"] for r in rows if r["case"] == AT_ENDS
        },
        "targets": {**TARGET_N, "slowdown": TARGET_SLOWDOWN},
        "rows": rows,
        "lasting": lasting,
        "slowdowns": {name: one[0] for name, one in times.items()},
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'case':<33}{'estimator':<13}{'points':>7}{'valid':>7}{'float32 N':>11}"
             f"{'/ sigma':>9}{'condition':>11}{'float64 N':>11}{'bounds N':>10}"
             "  worst in float32"]  # fmt: skip
    for row in figures["rows"]:
        single, double = row["float32"], row["float64"]
        lines.append(
            f"{row['case']:<33}{row['estimator']:<13}{row['points']:>7}{single['valid']:>7.0%}"
            f"{single['error_n']:>11.1e}{single['over_sigma']:>9.0e}{single['condition']:>11.1e}{double['error_n']:>11.1e}"
            f"{single['bound_error_n']:>10.0e}  {single['flags']} at {single['counts']}"
        )
    lines.append(f"\n{'what lasts or is large':<52}{'float32 N':>11}{'float64 N':>11}  seen")
    for name, row in figures["lasting"].items():
        double = f"{row['error_n_float64']:.1e}" if "error_n_float64" in row else "–"
        lines.append(f"{name:<52}{row['error_n_float32']:>11.1e}{double:>11}  {row['seen']}")
    lines.append(f"\n{'time of a cycle over a calm one':<52}")
    lines += [f"{name:<52}{ratio:>11.2f}" for name, ratio in figures["slowdowns"].items()]
    lines.append(f"\nworst of the {len(figures['seeds'])} seeds, where valid")
    for dtype in DTYPES:
        each = " ".join(f"{error:.1e}" for error in figures[f"worst_error_n_by_seed_{dtype}"])
        lines.append(
            f"{dtype}: {figures[f'worst_error_n_{dtype}']:.1e} N (target "
            f"{figures['targets'][dtype]:.0e}), by seed {each}; over the reading's own sigma "
            f"{figures[f'worst_error_over_sigma_{dtype}']:.0e}; "
            f"of bounds {figures[f'worst_bound_error_n_{dtype}']:.1e} N"
        )
    held = ", ".join(f"{n} by {estimator}" for estimator, n in figures["held_at_ends"].items())
    lines.append(f"units at ends that are held: {held}")
    lines += [f"{text}: {figures[name]} (target 0)" for name, text in NONE.items()]
    lines.append(
        f"valid and not finite: {figures['nonfinite_valid']} (target 0); slowdown "
        f"{figures['slowdown']:.2f} (target {figures['targets']['slowdown']:g})"
    )
    return "\n".join(lines)


def stressed(
    skin: Topology, counts: np.ndarray, estimator: str, most: int
) -> tuple[dict, dict[str, Worst]]:
    """A case of one seed by one estimator: its row, and what was judged by type."""
    told = walk(skin, counts, np.arange(skin.n), estimator)
    row, judged = {"points": skin.n, "nonfinite": 0}, {}
    for dtype in DTYPES:
        reading = decode(skin, counts, estimator, dtype)
        judged[dtype] = worst(skin, counts, reading, estimator, told, most)
        row["nonfinite"] += count_nonfinite(reading)
        row[dtype] = described(counts, reading, judged[dtype])
    return row, judged


def over_seeds(rows: list[dict]) -> dict:
    """One row of those of all seeds: the worst of each figure; points and valid of the least."""
    one = {"points": rows[0]["points"], "nonfinite": sum(row["nonfinite"] for row in rows)}
    for dtype in DTYPES:
        each = [row[dtype] for row in rows]
        most = {name: max(row[name] for row in each)
                for name in ("over_sigma", "condition", "bound_error_n")}  # fmt: skip
        least = {name: min(row[name] for row in each) for name in ("valid", "held")}
        errors = [row["error_n"] for row in each]
        one[dtype] = each[int(np.argmax(errors))] | most | least | {"by_seed_n": errors}
    return one


def decode(skin: Topology, counts: np.ndarray, estimator: str, dtype: str) -> Reading:
    """The first cycle after a start; the field is not held against its model, so that no reading is
    left out for it."""
    return Decoder(
        skin, estimator=estimator, dtype=dtype, consistency=False, sweeps=0, ambient=False
    )(counts)


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


def worst(
    skin: Topology,
    counts: np.ndarray,
    reading: Reading,
    estimator: str,
    told: np.ndarray,
    most: int,
) -> Worst:
    """Judge the units that are farthest off `told`, in newton and in their own sigma: as many that
    are bounds as are not, if so many are."""
    units = np.flatnonzero(reading.valid)
    largest_n = np.abs(reading.force[:, units]).max(axis=0).astype(np.float64)
    share = FULL_SCALE_N / np.fmax(largest_n, full_scale_n(skin)[units])
    away = np.abs(reading.force[:, units] - told[:, units])
    sigma = reading.force_sigma[:, units].astype(np.float64)
    held = is_held(reading)[units]
    farthest = []
    for off in (away.max(axis=0) * share, (away / sigma).max(axis=0)):
        order = np.argsort(np.where(np.isfinite(off), off, np.inf), kind="stable")
        farthest += [order[held[order]][-most:], order[~held[order]][-most:]]
    chosen = np.unique(np.concatenate(farthest))
    units = units[chosen]
    some = counts[:, units]
    away = np.abs(reading.force[:, units] - judge(skin, some, units, estimator))
    return Worst(
        (away.max(axis=0) * share[chosen]).astype(np.float64),
        (away / sigma[:, chosen]).max(axis=0).astype(np.float64),
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


def described(counts: np.ndarray, reading: Reading, exact: Worst) -> dict:
    """What the worst readings of a case say."""
    held = is_held(reading)
    which = held[exact.unit]
    row = {"valid": float(held.mean()), "held": int(held.sum()), "error_n": 0.0, "over_sigma": 0.0,
           "condition": 0.0, "flags": "none", "counts": []}  # fmt: skip
    if which.any():
        at = int(np.argmax(np.where(which, exact.error_n, -1.0)))
        unit = int(exact.unit[at])
        row |= {
            "error_n": float(exact.error_n[at]),
            "over_sigma": float(exact.over_sigma[which].max()),
            "condition": float(exact.condition[which].max()),
            "flags": str(Status(int(exact.flags[at])).name or "no flag"),
            "counts": counts[:, unit].tolist(),
        }
    bounds = exact.error_n[~which]
    return row | {"bound_error_n": float(bounds.max()) if bounds.size else 0.0}
