"""Decoding: error beside time, against numpy, the paper written out, and a copy of the bytes.

Everything decodes the same counts to the same nine quantities, in turn, in one process; times are
medians. `copy` moves as many bytes as the decoder reads and writes for that calibration and type.
Peers have float64, a calibration for each unit, and neither flags nor lags.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.peers_decode import ROWS, Paper, array_of, counts_of, exact, numpy_decode
from skin.decode import kernels
from skin.decode.coefficients import Coefficients
from skin.decode.decoder import Decoder
from skin.state import Reading
from topology import Topology

SIZES = (64, 1024, 65536, 1 << 20)
REFERENCE = "float32 per unit"
"""Which decoder the ratios to the peers are for."""
SAMPLE = 200


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    sizes = SIZES[:3] if quick else SIZES
    return {"reference": REFERENCE, "sizes": {str(n): _size(n, quick) for n in sizes}}


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'units':>8}  {'decoder':<20}{'us/cycle':>10}{'ns/unit':>9}{'error N':>10}"
             f"{'error °C':>10}{'x copy':>8}"]  # fmt: skip
    for size, found in figures["sizes"].items():
        for name, row in found["decoders"].items():
            copies = f"{row['copy_floor_ratio']:.1f}" if "copy_floor_ratio" in row else ""
            lines.append(
                f"{size:>8}  {name:<20}{row['us_per_cycle']:>10.2f}{row['ns_per_unit']:>9.2f}"
                f"{row['error_n']:>10.1e}{row['error_c']:>10.1e}{copies:>8}"
            )
        lines.append(f"{'':>8}  {figures['reference']} is {found['numpy_ratio']:.1f} times as fast "
                     f"as numpy and {found['literal_ratio']:.1f} times as the paper")  # fmt: skip
    return "\n".join(lines)


def _size(n: int, quick: bool) -> dict:
    skins = {"per unit": array_of(n, alike=False), "alike": array_of(n, alike=True)}
    counts = {name: counts_of(skin) for name, skin in skins.items()}
    units = np.random.default_rng(2).permutation(n)[:SAMPLE]
    truth = {name: exact(skins[name], counts[name], units) for name in skins}

    own = skins["per unit"], counts["per unit"]
    paper = Paper(own[0])
    runs: dict[str, Callable[[], object]] = {
        "numpy": lambda: numpy_decode(*own),
        "paper": lambda: paper(own[1]),
    }
    errors = {
        "numpy": _errors(numpy_decode(*own)[:, units], truth["per unit"]),
        "paper": _errors(paper(own[1])[:, units], truth["per unit"]),
    }
    sizes = {}
    for dtype in ("float64", "float32"):
        for kind, skin in skins.items():
            decoder = Decoder(skin, dtype=dtype)
            raw = counts[kind]
            name = f"{dtype} {kind}"
            errors[name] = _errors(_rows(decoder(raw))[:, units], truth[kind])
            decoder.reset()
            runs[name] = lambda decoder=decoder, raw=raw: decoder(raw)
            sizes[name] = _bytes(skin, dtype)
            runs[f"copy for {name}"] = _copy(sizes[name])

    seconds = _times(runs, target_s=0.15 if quick else 0.6)
    found = {}
    for name, error in errors.items():
        row = {"us_per_cycle": seconds[name] * 1e6, "ns_per_unit": seconds[name] / n * 1e9, **error}
        if name in sizes:
            row["bytes_per_unit"] = sizes[name] / n
            row["copy_floor_ratio"] = seconds[name] / seconds[f"copy for {name}"]
        found[name] = row
    return {
        "decoders": found,
        "numpy_ratio": seconds["numpy"] / seconds[REFERENCE],
        "literal_ratio": seconds["paper"] / seconds[REFERENCE],
        "copy_floor_ratio": found[REFERENCE]["copy_floor_ratio"],
    }


def _rows(reading: Reading) -> np.ndarray:
    """A reading in the peers' rows."""
    flat = (reading.tangential, reading.theta)
    return np.stack([reading.temperature, *reading.force, *flat, *reading.displacement_mm])


def _errors(rows: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Largest errors of force and temperature."""
    wrong = np.abs(rows.astype(float) - truth)
    return {"error_n": float(wrong[1:5].max()), "error_c": float(wrong[0].max())}


def _bytes(skin: Topology, dtype: str) -> int:
    """Bytes that one cycle must read and write.

    Counts and flags in, results and flags out, the calibration, and what is remembered, in and out.
    """
    real = np.dtype(dtype).itemsize
    coefficients = Coefficients.of(skin, np.dtype(dtype))
    counts_and_flags = kernels.CHANNELS * 2 + 2
    results_and_flags = len(ROWS) * real + 2 + 1
    memory = 2 * kernels.STATE_ROWS * real
    calibration = coefficients.values.nbytes + coefficients.limits.nbytes
    return skin.n * (counts_and_flags + results_and_flags + memory) + calibration


def _copy(size: int) -> Callable[[], None]:
    """A copy that reads and writes `size` bytes in all."""
    source = np.ones(size // 2, np.uint8)
    target = np.empty_like(source)
    return lambda: np.copyto(target, source)


def _times(runs: dict[str, Callable[[], object]], target_s: float) -> dict[str, float]:
    """Median seconds of each, taken in turn, so that a slow spell of the machine hits all."""
    repeats = {}
    for name, call in runs.items():
        call()
        started = time.perf_counter()
        call()
        once = max(time.perf_counter() - started, 1e-7)
        repeats[name] = max(1, min(2000, round(target_s / 15 / once)))
    samples = {name: [] for name in runs}
    for _ in range(15):
        for name, call in runs.items():
            started = time.perf_counter()
            for _ in range(repeats[name]):
                call()
            samples[name].append((time.perf_counter() - started) / repeats[name])
    return {name: float(np.median(values)) for name, values in samples.items()}
