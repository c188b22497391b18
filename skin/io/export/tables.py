"""The tables of a log as files: cycles, contacts and faults, in Parquet, CSV or arrays (.npz)."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from skin.arrow import arrow_for
from skin.blocks import blocks_of
from skin.errors import OptionError, check_choice
from skin.io.export.columns import Values, contacts, cycles, faults
from skin.io.export.provenance import provenance_of
from skin.state import INVALID, Status
from topology.files import Kind, check_over, check_path, marked, whole_file

if TYPE_CHECKING:
    from skin.blocks import Block
    from skin.pipeline import Pipeline
    from skin.state import State
    from topology import Topology

__all__ = ["FORMATS", "Tables", "beside", "report_in", "write_tables"]

TABLES = {
    "faults": "unit,time,until",
    "cycles": "time,cycle,closed_by",
    "contacts": "time,cycle,id",
}
"""The tables of a log, and how their CSV files begin. The last one to take its place is that of
faults, whose metadata say that the log is finished."""
FORMATS = ("parquet", "csv", "npz")
GROUP_BYTES = 96 << 20
"""Bytes of blocks that wait to be written [assumed]."""
MOST_ROWS = 16384
"""Rows of a row group: 64 KiB of a column of float32, beyond which groups become neither smaller
nor faster to write; a reader of one second need not unpack minutes."""
COMPRESSION = "lz4"
"""Compression: a third faster to write than zstd, and 6 % larger, on force and temperature."""
AT_ONCE = 256
"""Rows of a CSV file that are texts at the same time [assumed]."""
REPORT = "report"
FLAGS = tuple(flag for flag in Status if flag & INVALID)


def beside(file: Path) -> dict[str, Path]:
    """Paths of the tables of one log: cycles in `file`, the others next to it."""
    places = {name: file.with_name(f"{file.stem}.{name}{file.suffix}") for name in TABLES}
    return places | {"cycles": file}


def write_tables(
    states: Iterable[State], file: str | os.PathLike[str], pipeline: Pipeline | None = None
) -> int:
    """Write the tables of states: cycles into `file`, and next to it FILE.contacts and FILE.faults.

    Columns: see docs/reference/columns.md. Each file is there when it is complete. Parquet and CSV
    are written as the states come; arrays are kept until the end.

    Parameters
    ----------
    states : iterable of State
        A live skin, `skin.decode_log`, `skin.replay`, …
    file : path
        Ends in .parquet, .csv or .npz.
    pipeline : Pipeline, optional
        That of the states, where they come from another iterator: ``islice(palm, 250)``.

    Returns
    -------
    int
        Cycles. Without any no file is written.

    Raises
    ------
    LibraryError
        pyarrow is not installed, which Parquet needs.
    OSError
        A file cannot be written, or exists and is not such a table.
    """
    check_path("file", file, OptionError)
    source: Pipeline = cast("Any", states).pipeline if pipeline is None else pipeline
    provenance, of_log = (
        provenance_of(source.topology, source.options),
        getattr(states, "blocks", None),
    )
    with ExitStack() as files:
        tables = Tables(beside(Path(file)), source.topology, provenance, files)
        for block in blocks_of(states, source) if of_log is None else of_log():
            tables.add(block)
        tables.finish()
    return tables.cycles


class Tables:
    """The tables of one log, written as its blocks come.

    Parameters
    ----------
    places : mapping of str to Path
        Path of each table; the ending is the format, of `FORMATS`.
    topology : Topology
    provenance : mapping of str to str
        Provenance: metadata of Parquet files, arrays ``_name`` in an .npz; CSV has no place for it.
    files : ExitStack
        Moves the files to their places when it closes; after an error it removes them.

    Attributes
    ----------
    cycles : int
        So far.
    """

    def __init__(
        self, places: Mapping[str, Path], topology: Topology, provenance: Mapping[str, str],
        files: ExitStack,
    ) -> None:  # fmt: skip
        self._places, self._provenance, self._files = places, dict(provenance), files
        self._format = places["cycles"].suffix.removeprefix(".")
        check_choice("format", self._format, FORMATS)
        if self._format == "parquet":
            arrow_for(places["cycles"], "written")
        for table in TABLES:
            check_over(places[table], _kind(table, self._format))
        self._units = np.array(topology.unit_names)
        self._faults = _FaultIntervals(topology)
        self._open: dict[str, _Writer] = {}
        self._waiting: list[Block] = []
        self.cycles = 0

    def add(self, block: Block) -> None:
        """Add the next block."""
        rows = sum(map(len, self._waiting)) + len(block)
        if rows > MOST_ROWS or block.nbytes + sum(b.nbytes for b in self._waiting) > GROUP_BYTES:
            self._flush()
        self._waiting.append(block)
        self._faults.add(block)
        self.cycles += len(block)

    def finish(self, report: Mapping[str, Any] | None = None) -> None:
        """Write what is left, and a report into the metadata of the faults, see `report_in`."""
        self._flush()
        if not self.cycles:
            return
        self._provenance[REPORT] = json.dumps(report, sort_keys=True)
        self._open["faults"].write(faults(self._faults.finished()), self._provenance)
        for writer in self._open.values():
            writer.close()
        for table in TABLES.keys() - self._open.keys():  # of other options
            self._places[table].unlink(missing_ok=True)

    def _flush(self) -> None:
        blocks, self._waiting = self._waiting, []
        if not blocks:
            return
        if not self._open:
            for table in TABLES if blocks[0].contacts is not None else ("faults", "cycles"):
                self._begin(table)
        self._open["cycles"].write(cycles(blocks), self._provenance)
        if "contacts" in self._open:
            self._open["contacts"].write(contacts(blocks), self._provenance)

    def _begin(self, table: str) -> None:
        path, how = self._places[table], dict[str, Any](mode="wb")
        path.parent.mkdir(parents=True, exist_ok=True)
        if self._format == "csv":
            how = {"mode": "w", "newline": "", "encoding": "utf-8"}
        file = self._files.enter_context(whole_file(path, over=_kind(table, self._format), **how))
        writers = {"parquet": _Parquet, "csv": _Csv, "npz": _Arrays}
        self._open[table] = writers[self._format](file, self._units)


def report_in(path: Path, provenance: Mapping[str, str]) -> dict[str, Any] | None:
    """The report of a finished log, in the footer of its Parquet table of faults; None if there is
    none, or one of another provenance."""
    if path.suffix != ".parquet" or not path.is_file():
        return None
    parquet = arrow_for(path, "read").parquet
    try:
        found = parquet.read_schema(path).metadata
        known = {key.decode(): value.decode() for key, value in found.items()}
        report = json.loads(known.pop(REPORT))
    except Exception:  # a damaged file may raise anything
        return None
    return report if known == provenance else None


def _kind(table: str, format: str) -> Kind:
    """The files that a table may replace: the same table, or one of the same format that has its
    provenance."""
    mark = TABLES[table] if format == "csv" else "calibration_sha256"
    return marked(f"a table of {table}", mark.encode(), at_most=1 << 22)


# -- formats ---------------------------------------------------------------------------------------


class _Parquet:
    """Row groups, with the units of measure and the provenance in the metadata."""

    def __init__(self, file: IO[Any], units: np.ndarray) -> None:
        self._file, self._library = file, arrow_for(file.name, "written")
        self._writer: Any = None

    def write(self, values: Iterable[Values], provenance: Mapping[str, str]) -> None:
        arrow, fields, arrays = self._library.arrow, [], []
        for name, unit, column in _columns(values):
            found = arrow.array(column)
            # duckdb rounds stamps with a time zone to microseconds
            is_time = column.dtype.kind == "M"
            notes = {"timezone": "UTC"} if is_time else {"unit": unit} if unit else None
            # a nullable column costs half as much time again, for levels that are all alike
            fields.append(arrow.field(name, found.type, nullable=False, metadata=notes))
            arrays.append(found)
        table = arrow.Table.from_arrays(arrays, schema=arrow.schema(fields, dict(provenance)))
        if self._writer is None:
            self._writer = self._begun(table.schema)
        self._writer.write_table(table)

    def _begun(self, schema: Any) -> Any:
        types = self._library.arrow.types
        return self._library.parquet.ParquetWriter(
            self._file, schema, compression=COMPRESSION,
            use_dictionary=[one.name for one in schema if types.is_string(one.type)],
            use_byte_stream_split=[one.name for one in schema if types.is_floating(one.type)],
            # there are hundreds of units, and queries read all rows of a column
            write_statistics=[one for one in schema.names if "." not in one],
        )  # fmt: skip

    def close(self) -> None:
        self._writer.close()


class _Csv:
    """Numbers with all their digits, stamps as in ISO 8601."""

    def __init__(self, file: IO[Any], units: np.ndarray) -> None:
        self._rows, self._has_head = csv.writer(file), False

    def write(self, values: Iterable[Values], provenance: Mapping[str, str]) -> None:
        names, _, columns = zip(*_columns(values), strict=True)
        if not self._has_head:
            self._rows.writerow(names)
            self._has_head = True
        for first in range(0, len(columns[0]), AT_ONCE):
            texts = [column[first : first + AT_ONCE].astype(str).tolist() for column in columns]
            self._rows.writerows(zip(*texts, strict=True))

    def close(self) -> None:
        """All is written already."""


class _Arrays:
    """One array for each quantity, without pickle; the whole table is kept until it is closed."""

    def __init__(self, file: IO[Any], units: np.ndarray) -> None:
        self._file, self._units, self._provenance = file, units, dict[str, str]()
        self._parts: dict[str, list[np.ndarray]] = {}

    def write(self, values: Iterable[Values], provenance: Mapping[str, str]) -> None:
        self._provenance = dict(provenance)
        for one in values:
            self._parts.setdefault(one.of.name, []).append(one.array())

    def close(self) -> None:
        arrays = {name: np.concatenate(parts) for name, parts in self._parts.items()}
        provenance = {f"_{name}": np.array(text) for name, text in self._provenance.items()}
        np.savez_compressed(
            self._file, allow_pickle=False, **arrays, _units=self._units, **provenance
        )


_Writer = _Parquet | _Csv | _Arrays


def _columns(values: Iterable[Values]) -> Iterator[tuple[str, str, np.ndarray]]:
    for one in values:
        yield from one.columns()


# -- faults ----------------------------------------------------------------------------------------


class _FaultIntervals:
    """Collects the rows of the table of faults from the blocks of a log, in order."""

    def __init__(self, topology: Topology) -> None:
        self._names, self._rows = topology.unit_names, list[tuple[Any, ...]]()
        self._flags = np.zeros(topology.n, np.uint16)
        self._since = np.zeros((2, topology.n), np.int64)
        self._last = np.zeros(2, np.int64)  # cycle and stamp

    def add(self, block: Block) -> None:
        flags = block.units.status & np.uint16(int(INVALID))
        before = np.vstack([self._flags, flags[:-1]])
        at = np.stack([block.cycle, block.stamp_ns])
        for t, i in zip(*np.nonzero(flags != before), strict=True):
            self._end(i, at[:, t - 1] if t else self._last)
            self._flags[i], self._since[:, i] = flags[t, i], at[:, t]
        self._last = at[:, -1]

    def finished(self) -> list[tuple[Any, ...]]:
        """All rows; the intervals that are open end with the log."""
        for i in np.flatnonzero(self._flags):
            self._end(i, self._last)
        return self._rows

    def _end(self, i: Any, last: np.ndarray) -> None:
        if not self._flags[i]:
            return
        words = " ".join(str(flag.name) for flag in FLAGS if int(self._flags[i]) & flag)
        (first_cycle, first_ns), (cycle, stamp_ns) = self._since[:, i].tolist(), last.tolist()
        self._rows.append((self._names[i], first_ns, stamp_ns, first_cycle, cycle, words))
