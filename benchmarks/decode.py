"""Decoding: error beside time, against numpy, the paper written out, and a copy of the bytes.

Everything decodes the same counts, in turn, in one process; times are medians of rounds, and the
fastest round stands beside them: on a machine that others use it is the better measure of the code.
Ratios are medians of rounds, with their 95 % intervals.

`copy` moves as many bytes as the decoder beside it reads and writes but for its calibration, in as
many threads: one, but for `shared`, which has what a decoder takes if not told otherwise. Arrays of
a million units are one cycle, recordings many cycles of 64 units. `numpy` and `paper` have float64,
a calibration for each unit, and neither flags nor lags.

How fast the processor itself is, is told by the bare arithmetic in C (`benchmarks.peers_bare`):
`bare_ratio` is how many times as long a decoder of temperature and force takes, `sine` without the
check of the field, which is the same arithmetic; `bare_ratio_default` that of `field-angle` with
it, which is what a decoder does if not told otherwise, over the same C.
"""

from __future__ import annotations

import functools
import itertools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import topology
from benchmarks.peers_bare import Bare, compiler
from benchmarks.peers_decode import Paper, array_of, counts_of, exact, numpy_decode
from benchmarks.skip import cycles_of
from benchmarks.timing import Timed, ratio, times
from bus.compiled.aligned import zeros
from skin.decode import sharing
from skin.decode.decoder import Decoder
from skin.options import ESTIMATORS
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.state import Reading
from topology import CHANNELS, Topology

SIZES = (64, 4096, 65536, 1 << 20)
NINE = {"temperature", "force", "tangential", "theta", "displacement"}
"""The quantities of the peers."""
LIVE = {"temperature", "force"}
CALIBRATED = 4096
LATTICE = 32
"""Units along an edge of the lattice for cross-talk."""
REFERENCE = "float32 sine per unit"
"""Which decoder the ratios to the peers are for."""
BARE = "bare arithmetic in C"
CYCLES, FEW = 16384, 64
"""Of a recording, and its units."""
SAMPLE = 200


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    sizes = SIZES[:3] if quick else SIZES
    found = {str(n): _size(n, quick) for n in sizes}
    largest = found[str(sizes[-1])]
    reference = found[str(sizes[0] if len(sizes) == 1 else sizes[1])]
    calibrated, full, recording = _calibrated(quick), _full(quick), _recording(quick)
    return {
        "reference": REFERENCE,
        "sizes": found,
        "threads": sharing.processors(),
        "copy_floor_ratio": largest["shared"]["copy_floor_ratio"],
        "copy_floor_ratio_default": largest["default"]["copy_floor_ratio"],
        "copy_floor_ratio_recording": recording["copy_floor_ratio"],
        "copy_floor_ratio_one_thread": largest["live"]["copy_floor_ratio"],
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
             f"{'error °C':>10}{'of copy':>9}"]  # fmt: skip
    for size, found in figures["sizes"].items():
        live = {
            "temperature, force; alike": found["live"], "the same, shared": found["shared"],
            "default, per unit, shared": found["default"],
        }  # fmt: skip
        for name, row in (found["decoders"] | live).items():
            share = f"{row['copy_floor_ratio']:.2f}" if "copy_floor_ratio" in row else ""
            lines.append(
                f"{size:>8}  {name:<31}{row['ns_per_unit']:>9.2f}{row['ns_fastest']:>9.2f}"
                f"{row['error_n']:>10.1e}{row['error_c']:>10.1e}{share:>9}"
            )
        lines.append(f"{'':>8}  {figures['reference']} is {found['numpy_ratio']:.1f} times as fast "
                     f"as numpy and {found['literal_ratio']:.1f} times as the paper")  # fmt: skip
    row = figures["recording"]
    lines.append(
        f"{row['units']:>8}  {'default, a recording':<31}{row['ns_per_unit']:>9.2f}"
        f"{row['ns_fastest']:>9.2f}{row['error_n']:>10.1e}{row['error_c']:>10.1e}"
        f"{row['copy_floor_ratio']:>9.2f}   ({row['cycles']} cycles, threads: {row['threads']})"
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
    threads = sharing.processors() if n >= sharing.ENOUGH else 1
    skins = {"per unit": array_of(n, alike=False), "alike": array_of(n, alike=True)}
    counts = {name: counts_of(skin) for name, skin in skins.items()}
    units = np.random.default_rng(2).permutation(n)[:SAMPLE]
    truth = {
        (kind, estimator): exact(skins[kind], counts[kind], units, estimator)
        for kind in skins
        for estimator in ESTIMATORS
    }
    own = skins["per unit"], counts["per unit"]
    paper = Paper(own[0])
    runs: dict[str, Callable[[], object]] = {
        "numpy": lambda: numpy_decode(*own),
        "paper": lambda: paper(own[1]),
    }
    plain = truth["per unit", "sine"]
    errors = {
        "numpy": _errors(numpy_decode(*own)[:, units], plain),
        "paper": _errors(paper(own[1])[:, units], plain),
    }
    sizes = {}
    wanted = [("float64", "sine", "per unit"), ("float32", "sine", "per unit"),
              ("float32", "field-angle", "per unit"), ("float32", "sine", "alike"),
              ("float32", "field-angle", "alike")]  # fmt: skip
    for dtype, estimator, kind in wanted:
        decoder = Decoder(skins[kind], NINE, estimator, dtype=dtype, workers=1)
        raw = counts[kind]
        name = f"{dtype} {estimator} {kind}"
        got = _rows(decoder(raw))[:, units]
        errors[name] = _errors(got, truth[kind, estimator])
        decoder.reset()
        runs[name] = _cycle(decoder, raw)
        sizes[name] = _bytes(decoder)
        runs[f"copy for {name}"] = _copy(sizes[name], 1)
    for name, workers in (("live", 1), ("shared", None)):
        live = Decoder(skins["alike"], LIVE, "sine", consistency=False, workers=workers)
        runs[name] = _cycle(live, counts["alike"])
        runs[f"copy for {name}"] = _copy(_bytes(live), workers or threads)
    usual = Decoder(skins["per unit"], LIVE)
    got = np.stack([*_flat(usual(counts["per unit"]))])[:, units]
    usual_error = _errors(got, truth["per unit", "field-angle"][:4])
    usual.reset()
    runs["default"] = _cycle(usual, counts["per unit"])
    runs["copy for default"] = _copy(_bytes(usual), threads)

    seconds = times(runs, target_s=0.15 if quick else 0.6)
    found = {}
    for name, error in errors.items():
        found[name] = _row(seconds[name], n, error)
        if name in sizes:
            found[name]["bytes_per_unit"] = sizes[name] / n
            found[name] |= _of_copy(seconds, name)
    error = _errors(np.stack([*_flat(live(counts["alike"]))])[:, units], truth["alike", "sine"][:4])
    return {
        "decoders": found,
        **{
            name: {
                **_row(seconds[name], n, wrong),
                "bytes_per_unit": _bytes(decoder) / n,
                **_of_copy(seconds, name),
            }
            for name, decoder, wrong in (
                ("live", live, error),
                ("shared", live, error),
                ("default", usual, usual_error),
            )
        },
        "numpy_ratio": ratio(seconds["numpy"], seconds[REFERENCE])[0],
        "literal_ratio": ratio(seconds["paper"], seconds[REFERENCE])[0],
    }


def _calibrated(quick: bool) -> dict:
    """Temperature and force of units with a calibration each."""
    skin = array_of(CALIBRATED, alike=False)
    counts = counts_of(skin)
    units = np.random.default_rng(3).permutation(CALIBRATED)[:SAMPLE]
    truths = {name: exact(skin, counts, units, name)[:4] for name in ESTIMATORS}
    runs: dict[str, Callable[[], object]] = {}
    errors = {}
    if compiler() is not None:
        bare = Bare(skin)
        runs[BARE] = bare.bind(counts)
        errors[BARE] = _errors(bare(counts)[:, units], truths["sine"])
    for estimator, truth in truths.items():
        for name, options in (("", {"consistency": False}), (", consistency", {}),
                              (", every 8th temperature", {"consistency": False,
                                                           "temperature_every": 8})):  # fmt: skip
            decoder = Decoder(skin, LIVE, estimator, workers=1, **options)
            got = np.stack([*_flat(decoder(counts))])[:, units]
            errors[estimator + name] = _errors(got, truth)
            runs[estimator + name] = _cycle(decoder, counts)
    seconds = times(runs, target_s=0.15 if quick else 0.6)
    found = {name: _row(seconds[name], CALIBRATED, errors[name]) for name in runs}
    for name in found if BARE in runs else ():
        value, low, high = ratio(seconds[name], seconds[BARE])
        found[name] |= {"bare_ratio": value, "bare_ratio_95": [low, high]}
    return found


def _recording(quick: bool) -> dict:
    """Many cycles of few units with a calibration each, by what a decoder does if not told
    otherwise, into new arrays; the copy makes a new array, too."""
    skin = array_of(FEW, alike=False)
    cycles = CYCLES // 16 if quick else CYCLES
    threads = sharing.processors() if cycles * FEW >= sharing.ENOUGH else 1
    counts = np.tile(counts_of(skin), (cycles, 1, 1))
    decoder = Decoder(skin, LIVE)
    got = decoder(counts)
    units = np.arange(FEW)
    truth = exact(skin, counts[0], units, decoder.estimator)[:4]
    error = _errors(np.stack([got.temperature[0], *got.force[0]]), truth)
    decoder.reset()
    moved = cycles * _bytes(decoder)
    seconds = times(
        {"decode": lambda: decoder(counts), "copy for decode": _copy(moved, threads, new=True)},
        target_s=0.3 if quick else 1.2,
    )
    return {
        **_row(seconds["decode"], cycles * FEW, error), **_of_copy(seconds, "decode"),
        "cycles": cycles, "units": FEW, "threads": threads,
    }  # fmt: skip


def _of_copy(seconds: dict[str, Timed], name: str) -> dict:
    """Time of the copy over that of the decoder: 1 where decoding is as fast as copying."""
    value, low, high = ratio(seconds[f"copy for {name}"], seconds[name])
    return {"copy_floor_ratio": value, "copy_floor_ratio_95": [low, high]}


def _flat(reading: Reading) -> tuple[np.ndarray, ...]:
    """Temperature and force."""
    return (reading.temperature, *reading.force)


def _cycle(decoder: Decoder, counts: np.ndarray) -> Callable[[], Reading]:
    """A cycle as a live bus decodes it, in arrays that stay the same."""
    here = zeros(counts.shape, np.int16)
    here[:] = counts
    return decoder.bind(here, zeros(counts.shape[1], np.uint16))


def _full(quick: bool) -> dict:
    """`field-angle` with sigma and one sweep of cross-talk, on a lattice of units that touch."""
    skin = _lattice()
    counts = _moved(skin)
    want = NINE | {"sigma"}
    swept = Decoder(skin, want, "field-angle", sweeps=1)
    alone = Decoder(skin, want, "field-angle", rest_ut=swept.crosstalk.stencil.rest_ut)
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
            'format = 1\nname = "lattice"\n[[buses]]\nname = "main"\ndata_bitrate = 5_000_000\n'
            'cycle_rate_hz = 100\n[[patches]]\nname = "lattice"\nkind = "grid"\n'
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


def _rows(reading: Reading) -> np.ndarray:
    """A reading in the peers' rows."""
    flat = (reading.tangential, reading.theta)
    return np.stack([reading.temperature, *reading.force, *flat, *reading.displacement_mm])


def _errors(rows: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Largest errors of force and temperature."""
    wrong = np.abs(rows.astype(float) - truth)
    return {"error_n": float(wrong[1:5].max()), "error_c": float(wrong[0].max())}


def _bytes(decoder: Decoder) -> int:
    """Bytes that one cycle must read and write: counts, results, flags, and what is remembered.

    Calibration is left out, of which a kernel reads what its plan needs: with one for each unit,
    the copy moves less than the decoder does.
    """
    real = decoder.dtype.itemsize
    results = sum(3 if name in ("force", "displacement") else 1 for name in decoder.plan.quantities)
    memory = 2 * 2 * real if decoder.plan.film_compensation else 0
    each = len(CHANNELS) * 2 + 2 + results * real + 2 + 1 + memory
    return decoder.topology.n * each


def _copy(size: int, threads: int, *, new: bool = False) -> Callable[[], None]:
    """A copy that reads and writes `size` bytes in all, each thread its share; into a `new` array
    each time, or into one that stays."""
    source = np.ones(size // 2, np.uint8)
    kept = np.empty_like(source)
    cuts = np.arange(threads + 1) * source.size // threads
    parts = [slice(*ends) for ends in itertools.pairwise(cuts.tolist())]

    def copy() -> None:
        target = np.empty_like(source) if new else kept
        if threads == 1:
            np.copyto(target, source)
        else:
            sharing.together(
                [functools.partial(np.copyto, target[part], source[part]) for part in parts]
            )

    return copy
