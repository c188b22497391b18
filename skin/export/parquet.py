"""States as one Parquet table: a row for each cycle, a column for each quantity of each unit."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.arrow import Arrow, arrow_for
from skin.errors import OptionError
from skin.export.columns import CONTACT_FIELDS, Block, blocks_of, contact_rows
from topology.files import Kind, check_over, check_path, whole_file

if TYPE_CHECKING:
    from skin.options import Options
    from skin.state import State
    from topology import Topology

__all__ = ["StateTable", "write_parquet"]

GROUP_BYTES = 32 << 20
"""Of values that wait until a row group is written [assumed]."""
MOST_ROWS = 8192
"""Of a row group: a reader that wants one second need not unpack minutes [assumed]."""


def _is_table(path: Path) -> bool:
    from pyarrow import parquet

    return b"skin" in (parquet.read_schema(path).metadata or {})


TABLE = Kind("a table of states", _is_table)


def write_parquet(states: Iterable[State], file: str | os.PathLike[str], topology: Topology) -> int:
    """Write states to a Parquet file, whole or not at all; row groups are written as they fill.

    Columns: ``time`` (of the SYNC, UTC), ``cycle``; of each unit ``<unit>.fx``, ``.fy``, ``.fz``,
    ``.temperature``, each with ``_sigma``, ``.test_ratio``, ``.status``, ``.valid`` and
    ``.contact`` (identity, 0 for none); ``wrench.fx`` … ``wrench.mz`` and ``centroid.x`` …;
    ``coverage``; ``contacts``, a list of structs. Units of measure are in the metadata of the
    columns (``unit``). What is not in `want` has no column. The metadata of the file name the
    ``skin`` and the ``options`` of `skin.options.Options` as JSON, where `states` has a `pipeline`.

    Parameters
    ----------
    states : iterable of State
        A live skin, `skin.decode_log`, …
    file : path
    topology : Topology
        Names the units.

    Returns
    -------
    int
        Rows. Without any state there is no file.

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    OSError
        The file cannot be written, or is no table of states.
    """
    check_path("file", file, OptionError)
    with ExitStack() as files:
        options = getattr(getattr(states, "pipeline", None), "options", None)
        table = StateTable(Path(file), topology, files, options)
        for state in states:
            table.add(state)
        table.finish()
    return table.rows


class StateTable:
    """A Parquet file of states that come one by one.

    Parameters
    ----------
    path : Path
    topology : Topology
    files : ExitStack
        The file is open until it ends: then it is whole, or gone after an error.
    options : Options, optional
        By which the states were decoded, for the metadata of the file.

    Attributes
    ----------
    rows : int
        Written so far, and waiting.
    """

    def __init__(
        self, path: Path, topology: Topology, files: ExitStack, options: Options | None = None
    ) -> None:
        self._path, self._topology, self._files = path, topology, files
        self._metadata = {"skin": topology.name}
        if options is not None:
            self._metadata["options"] = json.dumps(options.report(), sort_keys=True)
        self._library: Arrow = arrow_for(path, "written")
        check_over(path, TABLE)
        self._group: _Group | None = None
        self.rows = 0

    def add(self, state: State) -> None:
        """Add a row."""
        if self._group is None:
            self._group = _Group(self._library, list(blocks_of(self._topology, state)), state)
            file = self._files.enter_context(whole_file(self._path, over=TABLE))
            schema = self._group.schema(self._metadata)
            self._writer = self._files.enter_context(
                self._library.parquet.ParquetWriter(
                    file, schema, compression="zstd",
                    use_dictionary=self._group.texts, use_byte_stream_split=self._group.floats,
                )
            )  # fmt: skip
        if self._group.is_full:
            self._flush()
        self._group.add(state)
        self.rows += 1

    def finish(self) -> None:
        """Write what waits."""
        if self._group is not None:
            self._flush()

    def _flush(self) -> None:
        assert self._group is not None
        self._writer.write_table(self._group.table())


class _Group:
    """Rows that wait to be written."""

    def __init__(self, library: Arrow, blocks: list[Block], state: State) -> None:
        self._library, self._blocks = library, blocks
        row_bytes = sum(len(block.names) * block.dtype.itemsize for block in blocks)
        capacity = int(np.clip(GROUP_BYTES // row_bytes, 16, MOST_ROWS))
        self._stamps, self._cycles = np.empty((2, capacity), np.int64)
        self._values = [np.empty((len(block.names), capacity), block.dtype) for block in blocks]
        self._closed_by: list[str] = []
        self._contacts: list[list[dict[str, Any]]] | None = None if state.contacts is None else []

    @property
    def is_full(self) -> bool:
        """Whether no row has room."""
        return len(self._closed_by) == self._stamps.size

    def add(self, state: State) -> None:
        """Copy a state."""
        at = len(self._closed_by)
        self._stamps[at], self._cycles[at] = state.stamp_ns, state.cycle
        for block, values in zip(self._blocks, self._values, strict=True):
            values[:, at] = block.values(state)
        if self._contacts is not None:
            self._contacts.append(contact_rows(state))
        self._closed_by.append(str(state.closed_by))

    def table(self) -> Any:
        """The rows as a table; none wait afterwards."""
        arrow, count = self._library.arrow, len(self._closed_by)
        types = {field.name: field.type for field in self._schema}
        arrays = [
            arrow.array(self._stamps[:count], types["time"]),
            arrow.array(self._cycles[:count]),
            arrow.array(self._closed_by, types["closed_by"]),
        ]
        for values in self._values:
            arrays += [arrow.array(column[:count]) for column in values]
        if self._contacts is not None:
            arrays.append(arrow.array(self._contacts, types["contacts"]))
            self._contacts.clear()
        self._closed_by.clear()
        return arrow.Table.from_arrays(arrays, schema=self._schema)

    @property
    def floats(self) -> list[str]:
        """Columns that pack well byte by byte."""
        return [name for block in self._blocks if block.dtype.kind == "f" for name in block.names]

    @property
    def texts(self) -> list[str]:
        """Columns of few words."""
        return ["closed_by", "contacts.list.element.slip"]

    def schema(self, metadata: dict[str, str]) -> Any:
        """Names, types and units of the columns."""
        arrow = self._library.arrow
        fields = [
            # with a time zone, duckdb would round to microseconds
            arrow.field("time", arrow.timestamp("ns"), metadata={"timezone": "UTC"}),
            arrow.field("cycle", arrow.int64()),
            arrow.field("closed_by", arrow.string()),
        ]
        for block in self._blocks:
            kind = arrow.from_numpy_dtype(block.dtype)
            fields += [
                _field(arrow, name, kind, unit)
                for name, unit in zip(block.names, block.units, strict=True)
            ]
        if self._contacts is not None:
            of_contact = arrow.struct(
                [
                    _field(
                        arrow, one.name,
                        _kind(arrow, one.kind), one.unit,
                    )
                    for one in CONTACT_FIELDS
                ]
            )  # fmt: skip
            fields.append(arrow.field("contacts", arrow.list_(of_contact)))
        self._schema = arrow.schema(fields, metadata=metadata)
        return self._schema


def _kind(arrow: Any, name: str) -> Any:
    return arrow.from_numpy_dtype(np.dtype(name)) if name else arrow.string()


def _field(arrow: Any, name: str, kind: Any, unit: str) -> Any:
    return arrow.field(name, kind, metadata={"unit": unit} if unit else None)
