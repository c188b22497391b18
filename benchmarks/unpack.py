"""Unpacking: frames a second, with the same DBC and the same frames for everybody.

`table` is our kernel, which reads any layout from a table: identifier to frame, bits to counts. It
does not scale them, as the decoder has the scales in its coefficients; `table scaled` does, with
numpy. `assembler` does the rest of the receiver's work as well (order, loss, CRC, validity), and
makes a Python object of each cycle, which with a dozen frames a cycle is most of its time.
`numpy` knows the one layout and slices all frames at once. `cantools` is its `decode_message` as
everybody calls it, for a sample of the frames; `cantools raw` leaves out scales and words.

`cantools_ratio` is `table` to `cantools`, of the layout where it is less; the ratios of like to
like, scaled to scaled and raw to raw, stand beside it. Each is the median over rounds in which
everybody has a turn; time is that of this thread on the processor. All values are compared, those
of cantools with our scaled ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cantools
import numpy as np

from bus import Assembler, FrameBatch, Packer
from bus.assemble.feed import find
from bus.codec_kernels import unpack_frame_python
from bus.compiled.bound import Bound
from bus.compiled.jit import compiled
from bus.dbc import dbc_text
from bus.frame import views
from bus.table import FrameTable
from topology import CHANNELS, Topology, load

SKINS = {"f3t-fd64": "palm", "f3t-classic": "strip"}
FRAMES = 20_000
"""As many as a core's cache holds: frames of a live bus have just been written there."""
TURN_S = 0.01
"""For so long at least everybody repeats what he does, once it has been in the caches."""


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    found = {layout: _measure(load(name), quick) for layout, name in SKINS.items()}
    ratios = ("cantools_ratio", "cantools_scaled_ratio", "cantools_raw_ratio", "numpy_ratio")
    least = {name: min(figures[name] for figures in found.values()) for name in ratios}
    return {**least, "layouts": found}


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'layout':<13}{'':<14}{'frames/s':>12}{'ns/frame':>10}{'x cantools':>12}{'raw':>7}"]
    for layout, found in figures["layouts"].items():
        rates = found["frames_per_s"]
        for name, rate in rates.items():
            lines.append(
                f"{layout:<13}{name:<14}{rate:>12,.0f}{1e9 / rate:>10.1f}"
                f"{rate / rates['cantools']:>12.1f}{rate / rates['cantools raw']:>7.1f}"
            )
        lines.append(
            f"{'':<13}{found['values_compared']} values equal to those of cantools within "
            f"{found['largest_relative_error']:.0e} of their range, all counts to those of numpy"
        )
    return "\n".join(lines)


def _measure(topology: Topology, quick: bool) -> dict:
    per_cycle = len(topology.frames)
    cycles = -(-(FRAMES // 2 if quick else FRAMES) // per_cycle)
    counts, records = _frames(topology, cycles)
    unpack = _unpacker(topology, records, cycles)
    slices = _numpy_fd64 if topology.layouts[0].fd else _numpy_classic
    scale, offset = topology.scale[np.newaxis], topology.offset[np.newaxis]

    rng = np.random.default_rng(3)
    sample = rng.choice(records.size, 200 if quick else 2000, replace=False)
    database = cantools.database.load_string(dbc_text(topology), "dbc")
    messages = [(int(r["id"]), r["data"][: r["length"]].tobytes()) for r in records[sample]]

    log, out = _with_syncs(topology, records, cycles), np.zeros(counts.shape)
    runs: dict[str, tuple[Callable[[], object], int]] = {
        "table": (unpack, records.size),
        "table scaled": (
            lambda: np.add(np.multiply(unpack(), scale, out=out), offset, out=out),
            records.size,
        ),
        "assembler": (lambda: _assemble(topology, log, cycles), records.size),
        "numpy": (lambda: slices(topology, records, cycles), records.size),
        "cantools": (lambda: [database.decode_message(*m) for m in messages], len(messages)),
        "cantools raw": (
            lambda: [database.decode_message(*m, False, False) for m in messages],
            len(messages),
        ),
    }
    each: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(3 if quick else 9):
        for name, (call, size) in runs.items():
            each[name].append(_seconds(call) / size)

    def ratio(ours: str, theirs: str) -> float:
        return float(np.median(np.divide(each[theirs], each[ours])))

    wired = topology.wired
    assert (unpack()[:, wired] == counts[:, wired]).all()
    assert (slices(topology, records, cycles)[:, wired] == counts[:, wired]).all()
    physical = counts * scale + offset
    compared, error = _compare(topology, database, physical, sample, messages)
    return {
        "frames": records.size,
        "units": topology.n,
        "frames_per_s": {name: 1 / float(np.median(taken)) for name, taken in each.items()},
        "cantools_ratio": ratio("table", "cantools"),
        "cantools_scaled_ratio": ratio("table scaled", "cantools"),
        "cantools_raw_ratio": ratio("table", "cantools raw"),
        "numpy_ratio": ratio("table", "numpy"),
        "values_compared": compared,
        "largest_relative_error": error,
    }


def _seconds(call: Callable[[], object]) -> float:
    """Processor time of a call, the caches being as it leaves them itself: the mean of a turn."""
    call()
    calls, started = 0, time.thread_time()
    while (passed := time.thread_time() - started) < TURN_S:
        call()
        calls += 1
    return passed / calls


def _frames(topology: Topology, cycles: int) -> tuple[np.ndarray, np.ndarray]:
    """Random counts that fit, and the data frames that carry them.

    Returns
    -------
    counts : ndarray, shape (t, c, n), int16
    records : ndarray, shape (t * f,), FRAME_DTYPE
    """
    rng = np.random.default_rng(1)
    rails = {signal.name: signal.rails for signal in topology.layouts[0].signals}
    counts = np.zeros((cycles, len(CHANNELS), topology.n), np.int16)
    for row, channel in enumerate(CHANNELS):
        if channel in rails:
            low, high = rails[channel]
            counts[:, row] = rng.integers(low, high + 1, (cycles, topology.n))
    pack, batch = Packer(topology), FrameBatch(cycles * len(topology.frames))
    period_ns = round(1e9 / topology.cycle_rate_hz)
    for cycle in range(cycles):
        pack(counts[cycle], batch, sequence=cycle & 0xFF, stamp_ns=(cycle + 1) * period_ns)
    return counts, batch.frames


def _unpack_all_python(views, per_cycle, tables, counts, codes):
    row, one = np.uintp(0), np.uintp(1)
    for cycle in range(counts.shape[0]):
        for _ in range(per_cycle):
            header = views.words[row, one]
            f = find((header >> 56) & 0xFF, header & 0xFFFF_FFFF, tables)
            if f >= 0:
                unpack_frame_python(views.data, row, f, tables, counts[cycle], codes)
            row += one


_unpack_all = compiled(_unpack_all_python, cache=False, allocates=False, forceinline=True)


def _unpacker(topology: Topology, records: np.ndarray, cycles: int) -> Callable[[], np.ndarray]:
    tables = FrameTable(topology).tables
    counts = np.zeros((cycles, len(CHANNELS), topology.n), np.int16)
    codes = np.zeros(topology.n, np.uint8)
    flat = counts.reshape(cycles, -1)
    unpack_all = Bound(_unpack_all, views(records), len(topology.frames), tables, flat, codes)

    def unpack() -> np.ndarray:
        unpack_all()
        return counts

    unpack()
    return unpack


def _with_syncs(topology: Topology, records: np.ndarray, cycles: int) -> np.ndarray:
    """The same log with a SYNC before each cycle."""
    syncs = np.zeros((cycles, 1), records.dtype)
    syncs["id"], syncs["length"] = topology.buses[0].sync_id, 1
    syncs["data"][:, 0, 0] = np.arange(cycles)
    records = records.reshape(cycles, -1)
    syncs["stamp_ns"] = records["stamp_ns"][:, :1]
    return np.concatenate([syncs, records], axis=1).reshape(-1)


def _assemble(topology: Topology, log: np.ndarray, cycles: int) -> None:
    assembler = Assembler(topology)
    assert sum(bool(cycle.valid.all()) for cycle in assembler.feed(log)) == cycles


def _numpy_fd64(topology: Topology, records: np.ndarray, cycles: int) -> np.ndarray:
    """Counts of the fd64 layout, shape (t, c, n), whose frames come in the order of the units."""
    units = records["data"][:, 4:].reshape(cycles, -1, 12)[:, : topology.n]
    counts = np.empty((cycles, len(CHANNELS), topology.n), np.int16)
    counts[:, :5] = units[..., :10].view("<i2").transpose(0, 2, 1)
    counts[:, 5] = units[..., 10].view(np.int8)
    return counts


def _numpy_classic(topology: Topology, records: np.ndarray, cycles: int) -> np.ndarray:
    """Counts of the classic layout, shape (t, c, n)."""
    word = np.ascontiguousarray(records["data"][:, :8]).view("<u8").reshape(cycles, topology.n)
    counts = np.empty((cycles, len(CHANNELS), topology.n), np.int16)
    counts[:, 0] = word & 0xFFF
    counts[:, 1] = word >> 12 & 0x3FFF
    for row, start in ((2, 26), (3, 37), (4, 48)):
        counts[:, row] = (word << (53 - start)).view(np.int64) >> 53
    return counts


def _compare(
    topology: Topology,
    database: cantools.database.can.Database,
    physical: np.ndarray,
    sample: np.ndarray,
    messages: list[tuple[int, bytes]],
) -> tuple[int, float]:
    """Number of values that cantools and we have in common, and their largest difference."""
    per_cycle, layout = len(topology.frames), topology.layouts[0]
    compared, worst = 0, 0.0
    for row, message in zip(sample, messages, strict=True):
        decoded = database.decode_message(*message)
        cycle, f = divmod(int(row), per_cycle)
        for signal in layout.signals:
            unit = topology.frames.units[f, signal.slot]
            if signal.name not in CHANNELS or unit < 0:
                continue
            name = f"{topology.unit_names[unit].replace('/', '_')}_{signal.name}"
            ours = physical[cycle, CHANNELS.index(signal.name), unit]
            span = topology.scale[CHANNELS.index(signal.name), unit] * (1 << signal.length)
            error = abs(decoded[name] - ours) / span
            assert error < 1e-14, f"{name}: must be {decoded[name]}; got {ours}"
            compared, worst = compared + 1, max(worst, error)
    return compared, worst
