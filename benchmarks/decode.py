"""Decoding: error beside time, against numpy, the paper written out, and bare arithmetic in C.

Everything decodes the same counts, in turn, in one process; times are medians of rounds, and the
fastest round stands beside them: on a machine that others use it is the better measure of the code.
Ratios are medians of rounds, with their 95 % intervals.

Arrays of a million units are one cycle, recordings many cycles of 64 units. `numpy` and `paper`
have float64, a calibration for each unit, and neither flags nor lags.

How fast the processor itself is, is told by the bare arithmetic in C (`benchmarks.peers_bare`):
`bare_ratio` is how many times as long a decoder of temperature and force takes, `sine` without the
check of the field, which is the same arithmetic; `bare_ratio_default` that of `field-angle` with
it, which is what a decoder does if not told otherwise, over the same C.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import topology
from benchmarks.decode_sides import (
    BARE,
    NINE,
    Side,
    calibrated_sides,
    recording_side,
    sides_of,
)
from benchmarks.peers_decode import exact
from benchmarks.skip import cycles_of
from benchmarks.timing import Timed, ratio, times
from skin.decode.decoder import Decoder
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from topology import Topology

SIZES = (64, 4096, 65536, 1 << 20)
CALIBRATED = 4096
LATTICE = 32
"""Units along an edge of the lattice for cross-talk."""
REFERENCE = "float32 sine per unit"
"""Which decoder the ratios to the peers are for."""
CYCLES = 16384
"""Of a recording."""
SAMPLE = 200


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    sizes = SIZES[:3] if quick else SIZES
    found = {str(n): _size(n, quick) for n in sizes}
    reference = found[str(sizes[0] if len(sizes) == 1 else sizes[1])]
    calibrated, full, recording = _calibrated(quick), _full(quick), _recording(quick)
    return {
        "reference": REFERENCE,
        "sizes": found,
        "numpy_ratio": reference["numpy_ratio"],
        "literal_ratio": reference["literal_ratio"],
        "calibrated": calibrated,
        "ns_per_unit_calibrated": calibrated["sine"]["ns_per_unit"],
        "bare": calibrated.get(BARE, {}).get("ns_per_unit"),
        "bare_ratio": calibrated["sine"].get("bare_ratio"),
        "bare_ratio_default": calibrated["field-angle, consistency"].get("bare_ratio"),
        "recording": recording,
        "full": full,
        "ns_per_unit_full": full["ns_per_unit"],
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'units':>8}  {'decoder':<31}{'ns/unit':>9}{'fastest':>9}{'error N':>10}"
             f"{'error °C':>10}"]  # fmt: skip
    for size, found in figures["sizes"].items():
        live = {
            "temperature, force; alike": found["live"], "default, per unit": found["default"],
        }  # fmt: skip
        for name, row in (found["decoders"] | live).items():
            lines.append(
                f"{size:>8}  {name:<31}{row['ns_per_unit']:>9.2f}{row['ns_fastest']:>9.2f}"
                f"{row['error_n']:>10.1e}{row['error_c']:>10.1e}"
            )
        lines.append(f"{'':>8}  {figures['reference']} is {found['numpy_ratio']:.1f} times as fast "
                     f"as numpy and {found['literal_ratio']:.1f} times as the paper")  # fmt: skip
    row = figures["recording"]
    lines.append(
        f"{row['units']:>8}  {'default, a recording':<31}{row['ns_per_unit']:>9.2f}"
        f"{row['ns_fastest']:>9.2f}{row['error_n']:>10.1e}{row['error_c']:>10.1e}"
        f"   ({row['cycles']} cycles)"
    )
    lines.append(f"{CALIBRATED} units with a calibration each, temperature and force, float32:")
    for name, row in figures["calibrated"].items():
        of_bare = f"{row['bare_ratio']:>9.2f} of bare" if "bare_ratio" in row else ""
        lines.append(f"{'':>8}  {name:<31}{row['ns_per_unit']:>9.2f}{row['ns_fastest']:>9.2f}"
                     f"{row['error_n']:>10.1e}{row['error_c']:>10.1e}{of_bare}")  # fmt: skip
    if figures["bare"] is None:
        lines.append(f"{'':>8}  no C compiler: the bare arithmetic was not measured")
    row = figures["full"]
    lines.append(
        f"{LATTICE**2:>8}  {'angle, sigma, one sweep':<31}{row['ns_per_unit']:>9.2f}"
        f"{row['ns_fastest']:>9.2f}   (without the sweep {row['ns_per_unit_alone']:.2f},"
        f" {100 * row['invalid']:.0f} % invalid)"
    )
    return "\n".join(lines)


def _size(n: int, quick: bool) -> dict:
    sides = sides_of(n)
    units = np.random.default_rng(2).permutation(n)[:SAMPLE]
    errors = _errors(sides, units)
    calls = {name: side.call for name, side in sides.items()}
    seconds = times(calls, target_s=0.15 if quick else 0.6)
    found = {name: _row(seconds[name], n, errors[name]) for name in sides}
    return {
        **{name: found.pop(name) for name in ("live", "default")},
        "decoders": found,
        "numpy_ratio": ratio(seconds["numpy"], seconds[REFERENCE])[0],
        "literal_ratio": ratio(seconds["paper"], seconds[REFERENCE])[0],
    }


def _calibrated(quick: bool) -> dict:
    """Temperature and force of units with a calibration each."""
    sides = calibrated_sides(CALIBRATED)
    errors = _errors(sides, np.random.default_rng(3).permutation(CALIBRATED)[:SAMPLE])
    seconds = times(
        {name: side.call for name, side in sides.items()}, target_s=0.15 if quick else 0.6
    )
    found = {name: _row(seconds[name], CALIBRATED, errors[name]) for name in sides}
    for name in found if BARE in sides else ():
        value, low, high = ratio(seconds[name], seconds[BARE])
        found[name] |= {"bare_ratio": value, "bare_ratio_95": [low, high]}
    return found


def _recording(quick: bool) -> dict:
    """Many cycles of few units in one call."""
    side = recording_side(CYCLES // 16 if quick else CYCLES)
    units = side.skin.n * side.cycles
    (error,) = _errors({"decode": side}, np.arange(side.skin.n)).values()
    seconds = times({"decode": side.call}, target_s=0.3 if quick else 1.2)
    return {
        **_row(seconds["decode"], units, error), "cycles": side.cycles, "units": side.skin.n,
    }  # fmt: skip


def _full(quick: bool) -> dict:
    """`field-angle` with sigma and one sweep of cross-talk, on a lattice of units that touch."""
    skin = _lattice()
    counts = _moved(skin)
    want = NINE | {"sigma"}
    swept = Decoder(skin, want, "field-angle", sweeps=1, ambient=False)
    alone = Decoder(skin, want, "field-angle", sweeps=0, ambient=False)
    runs = {"swept": cycles_of(swept, counts), "alone": cycles_of(alone, counts)}
    seconds = times(runs, target_s=0.15 if quick else 0.6)
    units = skin.n * len(counts)
    return {
        "ns_per_unit": seconds["swept"].median / units * 1e9,
        "ns_fastest": seconds["swept"].fastest / units * 1e9,
        "ns_per_unit_alone": seconds["alone"].median / units * 1e9,
        "invalid": float(np.mean(~swept(counts[-1]).valid)),
    }


def _moved(skin: Topology) -> np.ndarray:
    """Counts while every unit is pressed and dragged its own way, shape (t, c, n)."""
    rng = np.random.default_rng(4)
    truth = Truth.at_rest(skin.n, 25.0)
    truth.depth_mm[:] = rng.uniform(0.2, 1.5, skin.n)
    reach, way = 2.0 * np.sqrt(rng.random(skin.n)), rng.uniform(-np.pi, np.pi, skin.n)
    truth.displacement_mm[:] = reach * np.cos(way), reach * np.sin(way)
    truth.force[2] = Elastic(skin).normal(truth.depth_mm)
    truth.contact[:] = True
    simulator = UnitSimulator(skin, seed=5, field=HalbachField(skin, reach_m=0.05))
    return np.stack([simulator.counts(truth) for _ in range(8)])


def _lattice() -> Topology:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "lattice.toml"
        file.write_text(
            'format = 1\nname = "lattice"\ncycle_rate_hz = 100\n[[buses]]\nname = "main"\n'
            'interface = "memory"\ndata_bitrate = 5_000_000\n'
            '[[patches]]\nname = "lattice"\nkind = "grid"\n'
            f'rows = {LATTICE}\ncolumns = {LATTICE}\npitch_m = 0.012\nbus = "main"\n'
            'layout = "f3t-fd64"\nfirst_id = 0x100\n',
            encoding="utf-8",
        )
        return topology.load(file, allow_overload=True).exact()


def _row(seconds: Timed, n: int, error: dict[str, float]) -> dict[str, float]:
    return {
        "us_per_cycle": seconds.median * 1e6,
        "ns_per_unit": seconds.median / n * 1e9,
        "ns_fastest": seconds.fastest / n * 1e9,
        **error,
    }


def _errors(sides: Mapping[str, Side], units: np.ndarray) -> dict[str, dict[str, float]]:
    """Largest errors of force and temperature in the first cycle of each call that is timed."""

    @functools.cache
    def truth(skin: int, estimator: str) -> np.ndarray:
        one = next(side for side in sides.values() if id(side.skin) == skin)
        return exact(one.skin, one.first, units, estimator)

    found = {}
    for name, side in sides.items():
        told, decoder = side.told(), side.decoder
        first = told[:, 0] if told.ndim == 3 else told
        known = truth(id(side.skin), "sine" if decoder is None else decoder.estimator)
        wrong = np.abs(first[:, units].astype(float) - known[: len(first)])
        found[name] = {"error_n": float(wrong[1:5].max()), "error_c": float(wrong[0].max())}
        if decoder is not None:
            decoder.reset()
    return found
