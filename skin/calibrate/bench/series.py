"""A recording as it is fitted: counts and reference on one clock, then means of short blocks."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import correlate, correlation_lags

from bus.assemble import Assembler
from bus.boards import Boards, of_boards
from bus.cycle import RawCycle
from bus.logs import buses_of, read
from bus.status import INVALID, Status
from skin.arrow import arrow_for
from skin.calibrate.bench.file import KINDS, QUANTITIES, Recording
from skin.calibrate.fit import PIECES, fit_law, noise_of
from skin.decode.decoder import Decoder
from skin.errors import OptionError, ScanError
from topology import CHANNELS, Topology
from topology.files import open_regular

__all__ = [
    "AXES", "BLOCK_S", "GAP_S", "Alignment", "Blocks", "Counts", "Series", "alone", "decoded",
    "load_series", "read_counts", "read_table", "series_of", "standing", "tared",
]  # fmt: skip

AXES = "xyz"
BLOCK_S = 0.1
"""Length of a block: in it a bench at 2 mm/s goes 0.2 mm, over which the laws are straight to
0.3 µm of a circle of 2 mm [derived]."""
GAP_S = 0.25
"""Longest time without a reading that is no gap [assumed]."""
STANDING = 10
"""Readings at the end of a range that noise does not make [derived: of noise of a count or more
each is there by chance once in three at most, all of ten once in 60 000]."""
SPAN_SHARE = 0.2
"""Of the fall of another unit, below which a unit is not the one that is pressed [assumed]."""
DEGREE = 3
"""Of the polynomial that takes the reference to the counts: a force stiffens [assumed]."""
LEAST_CORRELATION = 0.5
"""Below it the two do not show the same thing [assumed]."""
OF_UNITS = ("patch", "enabled", "position", "rotation", "area", "calibrated", "tared", "scale",
            "offset", "wired")  # fmt: skip
"""Arrays of a topology whose last axis is the unit's."""
FREQUENCY, GEL = CHANNELS.index("frequency"), CHANNELS.index("gel")
UNHEARD = INVALID & ~Status.FROZEN
"""A unit that stands still on the bench is no fault of the bus."""


@dataclass(frozen=True, eq=False)
class Counts:
    """Counts of all units of a skin over t cycles.

    Attributes
    ----------
    time_s : ndarray, shape (t,)
    counts : ndarray, shape (t, c, n), int16
    heard : ndarray, shape (t, n), bool
        Whether the counts of a unit are of this cycle.
    serials : dict of str to str
        Units to the serial numbers that their boards say, where the log has heartbeats.
    """

    time_s: np.ndarray
    counts: np.ndarray
    heard: np.ndarray
    serials: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Series:
    """A recording of the units that it names, m of them, on the clock of the counts.

    Attributes
    ----------
    units : tuple of int, length m
        Indices in the topology.
    counts : Counts
        Of the whole skin.
    kind : ndarray, shape (t,), int
        Index of `KINDS` of each cycle; -1 between segments.
    segment : ndarray, shape (t,), int
        Number of the segment; -1 between them.
    force, displacement : ndarray, shape (3, t)
        Newton, millimetre, unit frame; NaN where it was not measured. Zero in the tare.
    temperature : ndarray, shape (t,)
        Degree Celsius; NaN where it was not measured.
    alignment : Alignment
    faults : tuple of str
        What is wrong with the reference table itself.
    hash : str
        SHA-256 of both files.
    """

    units: tuple[int, ...]
    counts: Counts
    kind: np.ndarray
    segment: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    temperature: np.ndarray
    alignment: Alignment
    faults: tuple[str, ...]
    hash: str

    def blocks(self, topology: Topology, unit: int, seconds: float = BLOCK_S) -> Blocks:
        """Means of blocks of some time, of one unit; of single cycles if the time is 0."""
        heard = self.counts.heard[:, unit] & (self.segment >= 0)
        at = np.flatnonzero(heard)
        number = np.floor(self.counts.time_s[at] / seconds).astype(np.int64) if seconds else at
        fresh = np.diff(number, prepend=-1) != 0
        fresh |= np.diff(self.segment[at], prepend=-1) != 0
        start = np.flatnonzero(fresh)
        size = np.diff(np.append(start, at.size))
        scale, offset = topology.scale[:, unit], topology.offset[:, unit]
        values = scale * self.counts.counts[at, :, unit] + offset

        def mean(rows: np.ndarray) -> np.ndarray:
            return np.add.reduceat(rows, start, axis=-1) / size

        return Blocks(
            mean(self.counts.time_s[at]), size, self.kind[at][start], self.segment[at][start],
            mean(values.T), mean(self.force[:, at]), mean(self.displacement[:, at]),
            mean(self.temperature[at]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means of b blocks of one unit.

    Attributes
    ----------
    time_s : ndarray, shape (b,)
    size : ndarray, shape (b,), int
        Cycles of each.
    kind, segment : ndarray, shape (b,), int
        As of `Series`.
    values : ndarray, shape (c, b)
        Physical values of the channels.
    force, displacement : ndarray, shape (3, b)
    temperature : ndarray, shape (b,)
    """

    time_s: np.ndarray
    size: np.ndarray
    kind: np.ndarray
    segment: np.ndarray
    values: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    temperature: np.ndarray

    def of(self, *kinds: str) -> Blocks:
        """The blocks of segments of these kinds."""
        return self.where(np.isin(self.kind, [KINDS.index(kind) for kind in kinds]))

    def thinned(self, most: int) -> Blocks:
        """As many blocks at most, evenly taken from all of them."""
        every = -(-len(self) // most) or 1
        return self.where(np.arange(len(self)) % every == 0)

    def where(self, chosen: np.ndarray) -> Blocks:
        """The blocks chosen by a mask, shape (b,)."""
        return Blocks(*(values[..., chosen] for values in vars(self).values()))

    def __len__(self) -> int:
        return self.size.size


def load_series(
    topology: Topology, recording: Recording, folder: Path,
    channels: Mapping[str, str] | None = None,
) -> Series:  # fmt: skip
    """Read the files of a recording and bring them on one clock; `channels` as of `buses_of`.

    Raises
    ------
    ScanError
        A table lacks a column or has no numbers; the clocks cannot be brought together.
    bus.LogError
        As of `bus.logs.read`.
    """
    paths = [folder / name for name in (recording.counts, recording.reference) if name]
    counts = read_counts(topology, paths[0], channels)
    columns = _reference(paths[1], recording) if recording.reference else {}
    units = [topology.index(name) for name in recording.units]
    if not counts.heard[:, units].any():
        raise ScanError(f"{paths[0]}: must have counts of {', '.join(recording.units)}; got none")
    return series_of(topology, recording, counts, columns, (str(paths[-1]), hash_of(paths)))


def series_of(
    topology: Topology, recording: Recording, counts: Counts, columns: dict[str, np.ndarray],
    source: tuple[str, str],
) -> Series:  # fmt: skip
    """Counts and reference on one clock.

    Parameters
    ----------
    topology : Topology
    recording : Recording
        Its units and segments.
    counts : Counts
    columns : dict of str to ndarray, shape (r,)
        Quantities of the reference, of `QUANTITIES`, in s, N, mm, °C; finite. None: there is no
        reference, and its clock is that of the counts.
    source : tuple of str
        Name of the reference in messages, and hash of the data.

    Raises
    ------
    ScanError
        The clocks cannot be brought together.
    """
    units = tuple(topology.index(name) for name in recording.units)
    told = Alignment(0.0, 0.0, 0.0, 0.0, 0.0)
    if columns:
        told = _aligned(topology, counts, columns, units, source[0])
    at = told.reference_time(counts.time_s)
    kind, segment = np.full(at.size, -1), np.full(at.size, -1)
    for number, each in enumerate(recording.segments):
        inside = (at >= each.start_s) & (at < each.end_s)
        kind[inside], segment[inside] = KINDS.index(each.kind), number
    rest = kind == KINDS.index("tare")

    def vector(name: str) -> np.ndarray:
        rows = np.full((3, at.size), np.nan)
        for axis, letter in enumerate(AXES):
            if (given := columns.get(f"{name}_{letter}")) is not None:
                rows[axis] = np.interp(at, columns["time"], given, left=np.nan, right=np.nan)
                if rest.any():
                    rows[axis] -= np.nanmedian(rows[axis, rest])
        return rows

    warm = np.full(at.size, np.nan)
    if "temperature" in columns:
        warm = np.interp(at, columns["time"], columns["temperature"], left=np.nan, right=np.nan)
    return Series(units, counts, kind, segment, vector("force"), vector("displacement"), warm,
                  told, tuple(_faults_of(columns, recording, source[0])), source[1])  # fmt: skip


def _faults_of(columns: dict[str, np.ndarray], recording: Recording, name: str) -> Iterator[str]:
    """Gaps of the reference within segments, and forces that stand at the end of their range."""
    if not columns:
        return
    time = columns["time"]
    step = np.diff(time)
    limit = max(GAP_S, 5.0 * float(np.median(step)))
    for at in np.flatnonzero(step > limit):
        if any(s.start_s < time[at + 1] and time[at] < s.end_s for s in recording.segments):
            yield (f"{name}: time: must go on without a gap above {limit:.2g} s; got none from "
                   f"{time[at]:.2f} to {time[at + 1]:.2f} s")  # fmt: skip
    for letter in AXES:
        values = columns.get(f"force_{letter}")
        if values is not None and (run := standing(values)) is not None:
            yield (
                f"{name}: force_{letter}: must not stand at the end of its range; got "
                f"{values[run[0]]:.4g} N in {run[1]} rows from {time[run[0]]:.2f} s on"
            )


def standing(values: np.ndarray) -> tuple[int, int] | None:
    """Where values first stand at their highest or lowest for longer than noise allows: start and
    length of the run, or None. A channel that mostly stands still anyway has no noise to
    judge by."""
    if np.mean(np.diff(values) == 0.0) > 0.5:
        return None
    for end in (values.max(), values.min()):
        at_end = np.concatenate([[0], values == end, [0]]).astype(np.int8)
        edges = np.flatnonzero(np.diff(at_end)).reshape(-1, 2)
        longest = edges[np.argmax(edges[:, 1] - edges[:, 0])]
        if longest[1] - longest[0] >= STANDING:
            return int(longest[0]), int(longest[1] - longest[0])
    return None


def hash_of(paths: list[Path]) -> str:
    """SHA-256 of files, one after the other."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            hashlib.file_digest(file, lambda: digest)
    return digest.hexdigest()


def _reference(path: Path, recording: Recording) -> dict[str, np.ndarray]:
    """Columns of the reference by quantity, in s, N, mm, °C; rows without a time are left out."""
    table, found = read_table(path), {}
    for name, column in (recording.columns or {}).items():
        if column.column not in table:
            wrong = OptionError.unknown(name, column.column, table)
            raise ScanError(f"{path}:1: {wrong}")
        scale = QUANTITIES[name][column.unit] if column.unit else 1.0
        factor, shift = scale if isinstance(scale, tuple) else (scale, 0.0)
        sign = -1.0 if column.reversed else 1.0
        found[name] = sign * (factor * table[column.column] + shift)
    time = found["time"]
    back = np.flatnonzero(np.diff(time[np.isfinite(time)]) <= 0.0)
    if back.size:
        raise ScanError(
            f"{path}: row {back[0] + 3}: time: must rise from row to row; got "
            f"{time[np.isfinite(time)][back[0] + 1]:.6g} s again or earlier"
        )
    whole = np.isfinite(np.stack(list(found.values()))).all(axis=0)
    if whole.sum() < 2:
        raise ScanError(f"{path}: must have rows with all its columns; got {int(whole.sum())}")
    return {name: values[whole] for name, values in found.items()}


def _aligned(
    topology: Topology, counts: Counts, columns: dict[str, np.ndarray], units: tuple[int, ...],
    path: str,
) -> Alignment:  # fmt: skip
    """By what moves most plainly in both: depth, normal force, else temperature."""
    channel = FREQUENCY
    for name in ("displacement_z", "force_z", "temperature"):
        if name in columns:
            channel = GEL if name == "temperature" else FREQUENCY
            break
    else:
        raise ScanError(
            f"{path}: must have displacement_z, force_z or temperature, by which the clocks are "
            f"brought together; got {', '.join(columns)}"
        )
    heard = counts.heard[:, units].all(axis=1)
    if channel == FREQUENCY:
        _check_pressed(topology, counts, units)
    moved = counts.counts[heard][:, channel, units] * topology.scale[channel, units]
    try:
        return align(counts.time_s[heard], moved.mean(axis=1), columns["time"], columns[name])
    except ScanError as error:
        raise ScanError(f"{path}: {name}: {error}") from None


def _check_pressed(topology: Topology, counts: Counts, units: tuple[int, ...]) -> None:
    """Refuse a recording in which another unit than those named is pressed."""
    low, high = np.percentile(counts.counts[:, FREQUENCY], [0.5, 99.5], axis=0)
    fall_hz = (high - low) * topology.scale[FREQUENCY] * counts.heard.any(axis=0)
    most, own = int(np.argmax(fall_hz)), float(fall_hz[list(units)].max())
    if most not in units and own < SPAN_SHARE * fall_hz[most]:
        names = ", ".join(topology.unit_names[unit] for unit in units)
        raise ScanError(
            f"units: must be those that the bench presses; got {names}, whose frequency "
            f"moves by {own:.0f} Hz, while that of {topology.unit_names[most]} falls by "
            f"{fall_hz[most]:.0f} Hz: are they exchanged?"
        )


def read_counts(
    topology: Topology, path: Path, channels: Mapping[str, str] | None = None
) -> Counts:
    """Counts of a log of the bus, or of a table; `channels` as of `bus.logs.buses_of`.

    A table has a column ``time_s`` and, for each unit and channel, one named ``palm/r3c4 bx``.

    Raises
    ------
    ScanError, bus.LogError
        As of `load_series`.
    """
    suffix = path.suffix.lower()
    if suffix == ".parquet" or (suffix == ".csv" and "time_s" in head_of(path)):
        return _table_of_counts(topology, path)
    assembler, cycles, boards = Assembler(topology), [], Boards(topology)

    def keep(cycle: RawCycle | None) -> None:
        if cycle is not None:
            cycles.append((cycle.stamp_ns, cycle.counts.copy(), cycle.status.copy()))

    log = read(path, buses=buses_of(topology, path, channels))
    for batch in log:
        batch.frames["origin"] = 0
        boards.hear(batch.frames, np.zeros(len(batch.frames)))
        for cycle in assembler.feed(batch.frames):
            keep(cycle)
    keep(assembler.flush())
    if log.lacking and log.left_out:
        raise ScanError(log.lacking)
    if not cycles:
        raise ScanError(f"{path}: must have cycles of {topology.name!r}; got none")
    stamps, counts, status = map(np.stack, zip(*cycles, strict=True))
    time_s, heard = 1e-9 * (stamps - stamps[0]), status & UNHEARD == 0
    return Counts(time_s, counts, heard, of_boards(topology, boards))


def _table_of_counts(topology: Topology, path: Path) -> Counts:
    table = read_table(path)
    known = {f"{unit} {channel}": (c, u) for u, unit in enumerate(topology.unit_names)
             for c, channel in enumerate(CHANNELS)}  # fmt: skip
    if "time_s" not in table:
        raise ScanError(f"{path}:1: must have a column time_s; got {', '.join(table)[:80]}")
    time = table.pop("time_s")
    counts = np.full((time.size, len(CHANNELS), topology.n), np.nan)
    for name, values in table.items():
        if name not in known:
            raise ScanError(f"{path}:1: {OptionError.unknown('column', name, known)}")
        counts[(slice(None), *known[name])] = values
    heard = (np.isfinite(counts) | ~topology.wired).all(axis=1) & np.isfinite(time)[:, np.newaxis]
    limits = np.iinfo(np.int16)
    whole = np.clip(np.nan_to_num(counts), limits.min, limits.max).astype(np.int16)
    return Counts(time, whole, heard)


# -- one unit -------------------------------------------------------------------------------------


def alone(topology: Topology, unit: int) -> Topology:
    """The skin of one unit alone, to decode its counts without the others'."""
    units = topology.frames.units
    sliced = {name: getattr(topology, name)[..., unit : unit + 1] for name in OF_UNITS}
    none = np.zeros(0, np.int32)
    return replace(
        topology, **sliced, unit_names=(topology.unit_names[unit],),
        parameters={k: v[..., unit : unit + 1] for k, v in topology.parameters.items()},
        frames=replace(topology.frames, units=np.where(units == unit, 0, -1)),
        neighbour_start=np.zeros(2, np.int32), neighbour_index=none,
    )  # fmt: skip


def tared(topology: Topology, series: Series) -> Topology:
    """The skin with the rest frequencies of a recording's units from its tare, where it has one."""
    rest = series.kind == KINDS.index("tare")
    if not rest.any():
        return topology
    units = list(series.units)
    scale, offset = (v[FREQUENCY, units] for v in (topology.scale, topology.offset))
    parameters = {name: values.copy() for name, values in topology.parameters.items()}
    counts = series.counts.counts[rest][:, FREQUENCY, units]
    parameters["frequency_rest_hz"][units] = scale * counts.mean(axis=0) + offset
    return replace(topology, parameters=parameters)


def decoded(topology: Topology, series: Series, unit: int, creep: bool = True) -> Any:
    """All cycles of a recording as one unit by itself decodes them, or a skin of one unit. Of all
    quantities, so that one kernel is compiled for all steps of a calibration."""
    one = topology if topology.n == 1 else alone(topology, unit)
    decoder = Decoder(one, dtype="float64", creep=creep, sweeps=0, ambient=False)
    return decoder(np.ascontiguousarray(series.counts.counts[:, :, unit : unit + 1]))


# -- clocks ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Alignment:
    """The reference's clock by that of the counts: ``reference = t + lag + drift (t - mid)``.

    Attributes
    ----------
    lag_s, lag_sigma_s : float
        In the middle of the recording.
    drift_ppm, drift_sigma_ppm : float
    mid_s : float
        Middle of the recording, clock of the counts.
    """

    lag_s: float
    lag_sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    mid_s: float

    def reference_time(self, time_s: np.ndarray) -> np.ndarray:
        """Times on the clock of the counts, by that of the reference."""
        return time_s + self.lag_s + 1e-6 * self.drift_ppm * (time_s - self.mid_s)


def align(
    time_s: np.ndarray, counts: np.ndarray, reference_s: np.ndarray, reference: np.ndarray
) -> Alignment:
    """Find lag and drift between the clocks of two recordings of the same motion.

    The lag is found to a sample by cross-correlation, then with the drift by a fit on the counts
    themselves, a polynomial of the reference being free.

    Parameters
    ----------
    time_s, counts : ndarray, shape (t,)
        What the units say: a frequency, say. Finite; times rise.
    reference_s, reference : ndarray, shape (r,)
        What goes with it: a depth or a force.

    Raises
    ------
    ScanError
        The two have nothing in common.
    """
    step = max(float(np.median(np.diff(time_s))), float(np.median(np.diff(reference_s))))
    grids = [np.arange(t[0], t[-1], step) for t in (time_s, reference_s)]
    if min(map(len, grids)) < 2 * PIECES:
        raise ScanError(
            f"recording: must be {2 * PIECES * step:.3g} s or longer to be aligned; got "
            f"{min(np.ptp(time_s), np.ptp(reference_s)):.3g} s"
        )
    left, right = (
        _standard(np.interp(grid, t, v))
        for grid, t, v in zip(grids, (time_s, reference_s), (counts, reference), strict=True)
    )
    likeness = np.abs(correlate(right, left, mode="full"))
    shift = correlation_lags(len(right), len(left))[int(np.argmax(likeness))]
    lag_s = float(grids[1][0] - grids[0][0] + shift * step)
    mid, wanted, scaled = (
        0.5 * float(time_s[0] + time_s[-1]),
        _standard(counts),
        _standard(reference),
    )

    def missed(p: dict[str, Any]) -> np.ndarray:
        at = time_s + p["lag"] + 1e-6 * p["drift"] * (time_s - mid)
        powers = np.vander(np.interp(at, reference_s, scaled), DEGREE + 1)
        return wanted - powers @ np.linalg.lstsq(powers, wanted, rcond=None)[0]

    noise = max(noise_of(wanted), 1e-6)
    fit = fit_law(lambda p: [missed(p) / noise], {"lag": (lag_s, 10.0 * step), "drift": (0.0, 1e3)})
    found = dict(zip(fit.names, fit.values.tolist(), strict=True))
    correlation = float(np.sqrt(max(1.0 - np.var(missed(found)), 0.0)))
    if correlation < LEAST_CORRELATION:
        raise ScanError(
            "reference: must go with the counts (a correlation of "
            f"{LEAST_CORRELATION:g} or more) at some lag; got {correlation:.2f} at best"
        )
    (lag_sigma_s, drift_sigma), lag_s = fit.sigma.tolist(), found["lag"]
    return Alignment(lag_s, lag_sigma_s, found["drift"], drift_sigma, mid)


def _standard(values: np.ndarray) -> np.ndarray:
    """Without mean, of variance 1."""
    moved = values - values.mean()
    return moved / max(float(moved.std()), 1e-30)


# -- tables ---------------------------------------------------------------------------------------


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table by name, each shape (t,), float64; an empty cell is NaN.

    Parameters
    ----------
    path : Path
        ``.parquet``, or CSV: comma, decimal point, names in the first line.

    Raises
    ------
    ScanError
        A cell that is no number, with its line and column; two columns of one name; no rows.
    LibraryError
        Parquet without pyarrow.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path)
    head = head_of(path)
    if len(set(head)) < len(head):
        twice = next(name for name in head if head.count(name) > 1)
        raise ScanError(f"{path}:1: {twice}: must be a column of its own; got two of that name")
    with open_regular(path) as raw:
        rows = csv.reader(io.TextIOWrapper(raw, "utf-8-sig", errors="replace", newline=""))
        next(rows, None)
        cells = [_numbers(f"{path}:{rows.line_num}", head, row) for row in rows if row]
    if not cells:
        raise ScanError(f"{path}: must have rows below its head; got none")
    return dict(zip(head, np.array(cells, float).T, strict=True))


def _numbers(where: str, head: list[str], row: list[str]) -> list[float]:
    if len(row) != len(head):
        raise ScanError(f"{where}: must have {len(head)} cells; got {len(row)}")
    found = []
    for name, cell in zip(head, row, strict=True):
        try:
            found.append(float(cell) if cell.strip() else np.nan)
        except ValueError:
            raise ScanError(f"{where}: {name}: must be a number; got {cell[:40]!r}") from None
    return found


def head_of(path: Path) -> list[str]:
    """Names in the first line of a CSV file."""
    with open_regular(path) as raw:
        first = raw.readline(1 << 16).decode("utf-8-sig", errors="replace")
    return [name.strip() for name in next(csv.reader([first]), [])]


def _read_parquet(path: Path) -> dict[str, np.ndarray]:
    """Columns of a Parquet file by name, float64; NaN where a cell is empty.

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    ScanError
        The file is damaged, or a column holds no numbers.
    """
    arrow, parquet = arrow_for(path, "read")
    try:
        table = parquet.read_table(path)
    except (arrow.ArrowException, OSError) as error:
        raise ScanError(f"{path}: must be a Parquet file; got: {error}") from None
    found = {}
    for name in table.column_names:
        try:
            found[name] = table.column(name).cast(arrow.float64()).to_numpy()
        except arrow.ArrowException as error:
            raise ScanError(f"{path}: column {name!r}: must be numbers; got: {error}") from None
    return found
