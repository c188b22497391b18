"""Numerical stress: float32 and float64 decoders against 40 digits, where it is hardest.

Whole domains of counts, crests, zeros, rails and calibrations at their ends are walked in long
doubles, drawn anew with several seeds; where a decoder is farthest off it is judged with 40 digits.
Forces are held where a reading is valid and no bound (SATURATED). Errors of forces, or at
calibrations whose full scale is, beyond 7.2 N are in shares of that, times 7.2 N. `over_sigma` is
the largest error, in newton as it is, over the sigma that the same reading states.

Then what lasts or is large: a million cycles of every filter, arrays of 1 to 65 536 units.
`slowdown` is the time of a cycle under stress over that of a calm one, by the same decoder's plan,
by turns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.arrays import counts_of
from benchmarks.contact import plate
from benchmarks.oracle import judge, walk
from benchmarks.skip import cycles_of
from benchmarks.stress_lasting import LASTING
from benchmarks.stress_points import is_held, points
from benchmarks.timing import ratio, times
from skin.decode.decoder import Decoder
from skin.options import DTYPES, ESTIMATORS
from skin.physics.elastic import Elastic
from skin.state import Reading
from topology import Topology

SEEDS = {True: (1,), False: (1, 2, 3, 4, 5, 6)}
"""Quick and in full."""
JUDGED = {True: 8, False: 20}
"""Of each case, seed, estimator and type, those that are farthest off by the walk, and farthest in
their own sigma."""
FULL_SCALE_N = 7.2
SHOWN = ("force", "force_sigma", "temperature", "temperature_sigma", "displacement_mm",
         "displacement_sigma_mm", "tangential", "tangential_sigma",
         "theta", "theta_sigma")  # fmt: skip
NONE = ("broken_covariances", "differ_valid", "differ_by_size")
"""What must not be, of what lasts or is large: covariances that are not symmetric and positive,
readings valid in one type alone, values that differ by the size of the array."""
UNITS, CYCLES = 1024, 16
"""Of the cycles that are timed."""
AGES = {"float32": 95.0, "float64": 725.0}
"""Time constants after which a lag of some kelvin is denormal."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the head of this file for what the figures are."""
    rows: dict[str, dict[str, Any]] = {}
    by_seed: dict[str, list[float]] = {dtype: [] for dtype in DTYPES}
    for seed in SEEDS[quick]:
        found = {
            f"{name}, {estimator}": stressed(skin, counts, estimator, JUDGED[quick])
            for name, skin, counts in points(quick, seed)
            for estimator in ESTIMATORS
        }
        for dtype in DTYPES:
            by_seed[dtype].append(max(row[dtype]["error_n"] for row in found.values()))
        rows = {name: _worse(row, rows.get(name)) for name, row in found.items()}
    lasting = {name: of(quick) for name, of in LASTING.items()}
    slow = slowdowns(quick)
    figures: dict[str, Any] = {}
    for dtype in DTYPES:
        longest = [row.get(f"error_n_{dtype}", 0.0) for row in lasting.values()]
        figures |= {
            f"worst_error_n_{dtype}": max(*by_seed[dtype], *longest),
            f"worst_error_n_by_seed_{dtype}": by_seed[dtype],
            f"worst_error_over_sigma_{dtype}": max(r[dtype]["over_sigma"] for r in rows.values()),
        }
    seen = [row["nonfinite"] for row in (*rows.values(), *lasting.values())]
    return {
        **figures,
        "nonfinite_valid": sum(seen),
        **{name: sum(row.get(name, 0) for row in lasting.values()) for name in NONE},
        "slowdown": max(slow.values())[0],
        "slowdown_95": list(max(slow.values())[1:]),
        "rows": rows,
        "lasting": lasting,
        "slowdowns": {name: one[0] for name, one in slow.items()},
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'where arithmetic is hardest':<52}{'float32 N':>11}{'/ sigma':>9}{'float64 N':>11}"]
    for name, row in figures["rows"].items():
        single = row["float32"]
        lines.append(f"{name:<52}{single['error_n']:>11.1e}{single['over_sigma']:>9.0e}"
                     f"{row['float64']['error_n']:>11.1e}")  # fmt: skip
    lines.append(f"\n{'what lasts or is large':<52}{'float32 N':>11}{'float64 N':>11}  seen")
    for name, row in figures["lasting"].items():
        double = f"{row['error_n_float64']:.1e}" if "error_n_float64" in row else "–"
        lines.append(f"{name:<52}{row['error_n_float32']:>11.1e}{double:>11}  {row['seen']}")
    lines.append(f"\n{'time of a cycle over a calm one':<52}")
    lines += [f"{name:<52}{value:>11.2f}" for name, value in figures["slowdowns"].items()]
    lines += [f"{name}: {figures[name]} (target 0)" for name in (*NONE, "nonfinite_valid")]
    return "\n".join(lines)


def stressed(skin: Topology, counts: np.ndarray, estimator: str, most: int) -> dict[str, Any]:
    """A case of one seed by one estimator, by type: the first cycle after a start; the field is not
    held against its model, so that no reading is left out for it."""
    walked = walk(skin, counts, np.arange(skin.n), estimator)[:3]
    row: dict[str, Any] = {"nonfinite": 0}
    for dtype in DTYPES:
        reading = Decoder(
            skin, estimator=estimator, dtype=dtype, consistency=False, sweeps=0, ambient=False
        )(counts)
        row["nonfinite"] += sum(
            int((~np.isfinite(getattr(reading, name)[..., reading.valid])).sum()) for name in SHOWN
        )
        row[dtype] = worst(skin, counts, reading, estimator, walked, most)
    return row


def worst(
    skin: Topology, counts: np.ndarray, reading: Reading, estimator: str, walked: np.ndarray,
    most: int,
) -> dict[str, float]:  # fmt: skip
    """Judge the units that are valid, no bounds, and farthest off what was walked: in newton, and
    in their own sigma."""
    units = np.flatnonzero(is_held(reading))
    if not units.size:
        return {"error_n": 0.0, "over_sigma": 0.0}
    largest_n = np.abs(reading.force[:, units]).max(axis=0).astype(np.float64)
    share = FULL_SCALE_N / np.fmax(largest_n, full_scale_n(skin)[units])
    away = np.abs(reading.force[:, units] - walked[:, units])
    sigma = reading.force_sigma[:, units].astype(np.float64)
    farthest = []
    for off in (away.max(axis=0) * share, (away / sigma).max(axis=0)):
        order = np.argsort(np.where(np.isfinite(off), off, np.inf), kind="stable")
        farthest.append(order[-most:])
    chosen = np.unique(np.concatenate(farthest))
    units = units[chosen]
    exact = judge(skin, counts[:, units], units, estimator)[:3]
    away = np.abs(reading.force[:, units] - exact)
    return {
        "error_n": float((away.max(axis=0) * share[chosen]).max()),
        "over_sigma": float((away / sigma[:, chosen]).max()),
    }


def full_scale_n(skin: Topology) -> np.ndarray:
    """Largest calibrated force of each unit, at least `FULL_SCALE_N`, shape (n,)."""
    p = skin.parameters
    reach = np.maximum(p["tangential_max_mm"], p["field_angle_max_mm"])
    depth = p["normal_max_n"] / p["normal_stiff_n_per_hz"] / p["frequency_slope_hz_per_mm"]
    along = np.abs(Elastic(skin).tangential(reach, depth))
    return np.maximum(np.maximum(p["normal_max_n"], along), FULL_SCALE_N)


def _worse(one: dict[str, Any], other: dict[str, Any] | None) -> dict[str, Any]:
    """The worst of two seeds."""
    if other is None:
        return one
    found: dict[str, Any] = {"nonfinite": one["nonfinite"] + other["nonfinite"]}
    for dtype in DTYPES:
        found[dtype] = {name: max(one[dtype][name], other[dtype][name]) for name in one[dtype]}
    return found


def slowdowns(quick: bool) -> dict[str, tuple[float, float, float]]:
    """Ratio of every kind of stress, by type, and the ends of its 95 % interval; decoders of one
    plan, by turns in one process."""
    skin, target_s = plate(UNITS), 0.05 if quick else 0.5
    ratios = {}
    for dtype in DTYPES:
        runs = cases(skin, dtype)
        seconds = times(runs, target_s)
        calm = seconds.pop("calm")
        ratios |= {f"{name}, {dtype}": ratio(s, calm) for name, s in seconds.items()}
    return ratios


def cases(skin: Topology, dtype: str) -> dict[str, Callable[[], None]]:
    """A call for each kind of stress that decodes `CYCLES` cycles; "calm" is none."""
    rng = np.random.default_rng(1)
    calm = np.stack([counts_of(skin, seed=seed) for seed in range(CYCLES)])
    whole = rng.integers(-32768, 32768, calm.shape).astype(np.int16)
    nothing = calm.copy()
    nothing[:, 2:5] = rng.integers(-1, 2, nothing[:, 2:5].shape)
    crest = calm.copy()
    crest[:, 2:4] = np.clip(2.0 * crest[:, 2:4], -32768, 32767)
    rails = np.where(rng.random(calm.shape) < 0.5, np.int16(-32768), calm)
    still = np.broadcast_to(calm[:1], calm.shape)
    runs = {
        name: cycles_of(Decoder(skin, dtype=dtype, sweeps=0, ambient=False), counts)
        for name, counts in (("calm", calm), ("any counts", whole), ("no field", nothing),
                             ("beyond the crest", crest), ("rails", rails))
    }  # fmt: skip
    return runs | {"denormal lags": cycles_of(aged(skin, dtype, calm), still)}


def aged(skin: Topology, dtype: str, counts: np.ndarray) -> Decoder:
    """A decoder whose lags behind the gel have shrunk to denormal numbers."""
    decoder = Decoder(skin, dtype=dtype, sweeps=0, ambient=False)
    decoder(counts[1])
    decoder(counts[0])
    longest_s = float(skin.parameters["film_lag_s"].max())
    decoder(counts[0], elapsed_s=AGES[dtype] * longest_s)
    return decoder
