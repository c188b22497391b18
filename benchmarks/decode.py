"""Decoding: error beside time, by estimator and type, from 64 units to a million.

All decode the same counts, in turn, in one process; times are medians of rounds, and the fastest
round stands beside them: on a machine that others use it is the better measure of the code. Errors
are the largest of some units against 40 digits (`benchmarks.oracle`). `calibrated` are 4096 units
with a calibration each, with and without the check of the field against its model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.arrays import array_of, counts_of
from benchmarks.oracle import judge
from benchmarks.skip import cycles_of
from benchmarks.timing import times
from skin.decode.decoder import Decoder
from skin.options import DTYPES, ESTIMATORS
from topology import Topology

SIZES = (64, 4096, 65536, 1 << 20)
CALIBRATED = 4096
WANT = {"temperature", "force"}
SAMPLE = 200
"""Units that are judged."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see `table` for what the figures are."""
    sizes = {}
    for n in SIZES[:2] if quick else SIZES:
        sizes[str(n)] = _rows(
            array_of(n, alike=False),
            {f"{dtype} {estimator}": {"dtype": dtype, "estimator": estimator}
             for dtype in DTYPES for estimator in ESTIMATORS}, quick,
        )  # fmt: skip
    calibrated = {
        estimator + name: {"estimator": estimator, "consistency": consistency}
        for estimator in ESTIMATORS
        for name, consistency in (("", False), (", consistency", None))
    }
    return {
        "sizes": sizes,
        "calibrated": _rows(array_of(CALIBRATED, alike=False), calibrated, quick),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'units':>8}  {'decoder':<31}{'ns/unit':>9}{'fastest':>9}{'error N':>10}"
             f"{'error °C':>10}"]  # fmt: skip
    for size, rows in (*figures["sizes"].items(), (CALIBRATED, figures["calibrated"])):
        lines += [
            f"{size:>8}  {name:<31}{row['ns_per_unit']:>9.2f}{row['ns_fastest']:>9.2f}"
            f"{row['error_n']:>10.1e}{row['error_c']:>10.1e}"
            for name, row in rows.items()
        ]
    return "\n".join(lines)


def _rows(skin: Topology, ways: dict[str, dict[str, Any]], quick: bool) -> dict[str, Any]:
    """Time and errors of decoders of one skin that take turns."""
    counts = counts_of(skin)
    units = np.random.default_rng(2).permutation(skin.n)[: SAMPLE // 10 if quick else SAMPLE]
    exact = {name: judge(skin, counts[:, units], units, name).astype(float) for name in ESTIMATORS}
    decoders = {
        name: Decoder(skin, WANT, sweeps=0, ambient=False, **way) for name, way in ways.items()
    }
    errors = {}
    for name, decoder in decoders.items():
        reading, true = decoder(counts), exact[decoder.estimator]
        off_n = np.abs(reading.force[:, units] - true[:3]).max()
        off_c = np.abs(reading.temperature[units] - true[3]).max()
        errors[name] = {"error_n": float(off_n), "error_c": float(off_c)}
    calls = {name: cycles_of(decoder, counts[np.newaxis]) for name, decoder in decoders.items()}
    seconds = times(calls, target_s=0.1 if quick else 0.6)
    return {
        name: {
            "us_per_cycle": 1e6 * seconds[name].median,
            "ns_per_unit": 1e9 * seconds[name].median / skin.n,
            "ns_fastest": 1e9 * seconds[name].fastest / skin.n,
            **errors[name],
        }
        for name in decoders
    }
