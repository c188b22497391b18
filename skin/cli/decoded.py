"""Files of a decoded log: units, wrench, contacts and events, as tables or as arrays."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.contact.record import CONTACT, QUANTITIES, Event, SlipState
from skin.io.export.columns import (
    CLOSED,
    CYCLES,
    HEAD,
    READINGS,
    Column,
    arrays_of,
    columns_of,
    contact_arrays,
    in_words,
    joined,
    suffix,
)
from skin.io.export.parquet import BlockTable
from topology.files import Kind, check_over, open_regular, whole_file
from topology.files import arrays_of as files_of

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from skin.options import Options
    from topology import Topology

__all__ = ["Events", "writer_for"]

TABLES = {
    "": ("units", "time_s", "unit", "fz_n"),
    ".wrench": ("wrench", "time_s", "fz_n", "mz_nm", "contacts"),
    ".contacts": ("contacts", "time_s", "contact", "load_n"),
    ".events": ("events", "time_s", "contact", "event"),
}
"""The tables of a log: what stands between the name and ".csv", what its rows are, and columns by
which it is known again."""
ARRAYS = files_of("arrays of a decoded log", "time_s", "unit", "wrench", "event_contact")
LONGEST_HEAD = 1 << 12
"""Bytes of the first line of a table [assumed]."""
AT_ONCE = 64
"""Cycles whose units are made texts at once [assumed]."""


@contextmanager
def writer_for(
    path: Path | None, topology: Topology, options: Options
) -> Iterator[Callable[[Block], None]]:
    """A function that takes every block; the files are there at the end, if there was any block.

    Parameters
    ----------
    path : Path or None
        Ends in .csv, .npz or .parquet; None: nothing is written.
    topology : Topology
    options : Options
        By which the blocks are decoded: arrays have them as JSON (``_options``), a Parquet file in
        its metadata; a table of CSV has no place for them.
    """
    if path is None:
        yield lambda block: None
        return
    with ExitStack() as files:
        kinds = {".csv": _Tables, ".npz": _Arrays, ".parquet": BlockTable}
        written = kinds[path.suffix](path, topology, files, options)
        yield written.add
        written.finish()


class Events:
    """What happens to contacts, from one cycle to the next."""

    def __init__(self) -> None:
        self._slip: dict[int, str] = {}

    def of(self, block: Block) -> Iterator[tuple[int, int, str]]:
        """Index of the cycle, identity, and event: born, resumed, merged, split, ended, stick,
        incipient, gross."""
        found, starts = block.contacts, block.contact_start.tolist()
        rows = list(zip(*(found[name].tolist() for name in ("id", "event", "slip")), strict=True))
        for t, (first, end) in enumerate(pairwise(starts)):
            present = {}
            for identity, event, slip in rows[first:end]:
                for one in Event(event):
                    yield t, identity, str(one.name).lower()
                present[identity] = word = SlipState(slip).name.lower()
                if word not in ("unknown", self._slip.get(identity)):
                    yield t, identity, word
            for identity in sorted(self._slip.keys() - present.keys()):
                yield t, identity, "ended"
            self._slip = present


class _Tables:
    """Four CSV files, written as the blocks come."""

    def __init__(self, path: Path, topology: Topology, files: ExitStack, _options: Options) -> None:
        self._path, self._names, self._files = path, list(topology.unit_names), files
        self._start_ns: int | None = None
        self._open: dict[str, Callable[[Iterable[Sequence[Any]]], object]] = {}
        self._events = Events()
        for part in TABLES:
            check_over(*self._place(part))

    def add(self, block: Block) -> None:
        if self._start_ns is None:
            self._start_ns = int(block.stamp_ns[0])
        times = [f"{1e-9 * at:.6f}" for at in (block.stamp_ns - self._start_ns).tolist()]
        for first in range(0, len(block), AT_ONCE):
            self._units(block, slice(first, first + AT_ONCE), times[first : first + AT_ONCE])
        counts = map(str, np.diff(block.contact_start).tolist())
        columns = list(columns_of((HEAD[1], CLOSED, *CYCLES), [block]))
        self._write(".wrench", ["time_s", *map(_head, columns), "contacts"],
                    [times, *map(_texts, columns), counts])  # fmt: skip
        columns = list(columns_of(QUANTITIES, [block.contacts]))
        heads = ["contact" if one.name == "id" else _head(one) for one in columns]
        self._write(".contacts", ["time_s", *heads],
                    [[times[t] for t in block.contact_cycle], *map(_texts, columns)])  # fmt: skip
        events = [(times[t], identity, event) for t, identity, event in self._events.of(block)]
        self._write(".events", ["time_s", "contact", "event"], zip(*events, strict=True))

    def _units(self, block: Block, at: slice, times: list[str]) -> None:
        """A row for each cycle and unit of some cycles."""
        n = len(self._names)
        columns = []
        for one in READINGS:
            if (values := one.values(block)) is not None:
                rows = values[at].reshape(len(times), -1, n).transpose(1, 0, 2)
                columns += [Column(name, unit, row.reshape(-1), one)
                            for (name, unit), row in zip(one.heads, rows, strict=True)]  # fmt: skip
        heads = ["time_s", "unit", *map(_head, columns)]
        stamps = [time_s for time_s in times for _ in range(n)]
        self._write("", heads, [stamps, self._names * len(times), *map(_texts, columns)])

    def finish(self) -> None:
        """All is written already."""

    def _place(self, part: str) -> tuple[Path, Kind]:
        """The file of a table, and what it may be written over: the same table."""
        name, *known = TABLES[part]

        def is_one(path: Path) -> bool:
            with open_regular(path) as file:
                heads = file.readline(LONGEST_HEAD).decode("ascii").rstrip("\r\n").split(",")
            return heads[0] == known[0] and {*known} <= {*heads}

        place = self._path.with_name(f"{self._path.stem}{part}.csv")
        return place, Kind(f"a table of {name}", is_one)

    def _write(self, part: str, heads: list[str], columns: Iterable[Iterable[Any]]) -> None:
        """Add rows to a table, given as columns."""
        if part not in self._open:
            path, own = self._place(part)
            file = self._files.enter_context(
                whole_file(path, "w", over=own, newline="", encoding="utf-8")
            )
            rows = csv.writer(file)
            rows.writerow(heads)
            self._open[part] = rows.writerows
        self._open[part](zip(*columns, strict=True))


class _Arrays:
    """One file of arrays, written at the end."""

    def __init__(self, path: Path, topology: Topology, _files: ExitStack, options: Options) -> None:
        self._path, self._names = path, topology.unit_names
        self._options = json.dumps(options.report(), sort_keys=True)
        self._cycles: list[dict[str, np.ndarray]] = []
        self._contacts = [{"cycle": np.zeros(0, np.int64)} | contact_arrays(np.zeros(0, CONTACT))]
        self._count = 0
        self._events, self._happened = Events(), []
        check_over(path, ARRAYS)

    def add(self, block: Block) -> None:
        stamps = block.stamp_ns.tolist()
        self._happened += [(stamps[t], *event) for t, *event in self._events.of(block)]
        self._contacts.append(
            {"cycle": self._count + block.contact_cycle} | contact_arrays(block.contacts)
        )
        self._cycles.append({"stamp_ns": block.stamp_ns} | arrays_of(block))
        self._count += len(block)

    def finish(self) -> None:
        if not self._cycles:
            return
        arrays: dict[str, Any] = joined(self._cycles)
        stamps = arrays.pop("stamp_ns")
        start = int(stamps[0])
        arrays |= {f"contact_{name}": values for name, values in joined(self._contacts).items()}
        with whole_file(self._path, over=ARRAYS) as file:
            np.savez_compressed(
                file,
                time_s=(stamps - start) * 1e-9,
                unit=np.array(self._names),
                _options=np.array(self._options),
                **arrays,
                event_time_s=np.array([1e-9 * (at - start) for at, _, _ in self._happened]),
                event_contact=np.array([one for _, one, _ in self._happened], np.int64),
                event=np.array([event for _, _, event in self._happened], str),
            )


def _head(column: Column) -> str:
    return column.name + suffix(column.unit)


def _texts(column: Column) -> list[Any]:
    """Values as texts, or as integers."""
    values = in_words(column.of, column.values)
    if values.dtype.kind == "f":
        return [f"{value:.{column.of.decimals}f}" for value in values.tolist()]
    return (values.astype(np.int8) if values.dtype == bool else values).tolist()
