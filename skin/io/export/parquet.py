"""Parquet tables from blocks or states: a row for each cycle."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from skin.arrow import Arrow, arrow_for
from skin.contact.record import QUANTITIES
from skin.errors import OptionError
from skin.io.export.columns import Column, block_of, columns_of, cycle_columns, in_words
from topology.files import Kind, check_over, check_path, whole_file

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from skin.options import Options
    from skin.state import State
    from topology import Topology

__all__ = ["BlockTable", "RowGroups", "parquet_writer", "table_of", "write_parquet"]

STATES = 256
"""States per block, where they come one by one [assumed]."""
GROUP_BYTES = 96 << 20
"""Bytes of blocks that wait for a row group [assumed]."""
MOST_ROWS = 16384
"""Rows of a row group: 64 KiB of a column of float32, beyond which groups become neither smaller
nor faster to write; a reader of one second need not unpack minutes."""
COMPRESSION = "lz4"
"""Compression: a third faster to write than zstd, and 6 % larger, on force and temperature."""
DICTIONARY = ("closed_by", "slip", "unit", "flags")


def _is_table(path: Path) -> bool:
    from pyarrow import parquet

    return b"skin" in (parquet.read_schema(path).metadata or {})


TABLE = Kind("a table of states", _is_table)


def write_parquet(states: Iterable[State], file: str | os.PathLike[str], topology: Topology) -> int:
    """Write states to a Parquet file, atomically; row groups are written as they fill.

    Columns: see docs/reference/columns.md. A row is a cycle; ``contacts`` is a list of structs.
    Units of measure are in the metadata of the columns (``unit``). Quantities that are not wanted
    have no column. The metadata of the file contain the ``skin`` and, where `states` has a
    `pipeline`, the ``options`` of `skin.options.Options` as JSON.

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
        Rows. Without any state no file is written.

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    OSError
        The file cannot be written, or exists and is not a table of states.
    """
    check_path("file", file, OptionError)
    rows = 0
    with ExitStack() as files:
        options = getattr(getattr(states, "pipeline", None), "options", None)
        table = BlockTable(Path(file), topology, files, options)
        for block in _blocks(states, topology):
            table.add(block)
            rows += len(block)
        table.finish()
    return rows


def _blocks(states: Iterable[State], topology: Topology) -> Iterator[Block]:
    """States as blocks."""
    coming = iter(states)
    while some := list(islice(coming, STATES)):
        yield block_of(topology, some)


class RowGroups:
    """Consecutive blocks, kept until they make a row group.

    Parameters
    ----------
    write : function
        Writes blocks as a row group.
    """

    def __init__(self, write: Callable[[list[Block]], None]) -> None:
        self._write = write
        self._blocks: list[Block] = []

    def add(self, block: Block) -> None:
        """Add a block; those before are written where it would be too many."""
        blocks = [*self._blocks, block]
        too_many = sum(map(len, blocks)) > MOST_ROWS
        if too_many or sum(one.nbytes for one in blocks) > GROUP_BYTES:
            self.flush()
        self._blocks.append(block)

    def flush(self) -> None:
        """Write the blocks that are left."""
        if self._blocks:
            self._write(self._blocks)
            self._blocks = []


class BlockTable:
    """A Parquet file, written block by block: a row for each cycle.

    Parameters
    ----------
    path : Path
    topology : Topology
    files : ExitStack
        Closes the file; after an error it is removed.
    options : Options, optional
        Those by which the blocks were decoded, for the metadata.
    """

    def __init__(
        self, path: Path, topology: Topology, files: ExitStack, options: Options | None = None
    ) -> None:
        self._path, self._files = path, files
        self._metadata = {"skin": topology.name}
        if options is not None:
            self._metadata["options"] = json.dumps(options.report(), sort_keys=True)
        self._library: Arrow = arrow_for(path, "written")
        check_over(path, TABLE)
        self._writer: Any = None
        self._groups = RowGroups(self._write)

    def add(self, block: Block) -> None:
        """Add rows."""
        self._groups.add(block)

    def finish(self) -> None:
        """Write the buffered rows as a row group."""
        self._groups.flush()

    def _write(self, blocks: list[Block]) -> None:
        """Write a row group."""
        table = table_of(self._library, cycle_columns(blocks), self._metadata)
        if blocks[0].contacts is not None:
            table = self._with_contacts(table, blocks)
        if self._writer is None:
            file = self._files.enter_context(whole_file(self._path, over=TABLE))
            self._writer = self._files.enter_context(
                parquet_writer(self._library, file, table.schema)
            )
        self._writer.write_table(table)

    def _with_contacts(self, table: Any, blocks: list[Block]) -> Any:
        """The table with a column of lists of contacts."""
        arrow = self._library.arrow
        records = [block.contacts for block in blocks]
        found = table_of(self._library, columns_of(QUANTITIES, records), {})
        arrays = [column.combine_chunks() for column in found.columns]
        structs = arrow.StructArray.from_arrays(arrays, fields=list(found.schema))
        counts = [np.diff(block.contact_start) for block in blocks]
        starts = arrow.array(np.cumsum(np.concatenate([[0], *counts]), dtype=np.int32))
        return table.append_column("contacts", arrow.ListArray.from_arrays(starts, structs))


def table_of(library: Arrow, columns: Iterable[Column], metadata: dict[str, str]) -> Any:
    """Columns as a pyarrow table, with their units of measure. No value is null, and the schema
    says so: a nullable column costs half as much time again, for levels that are all alike."""
    arrow, fields, arrays = library.arrow, [], []
    for one in columns:
        values = arrow.array(in_words(one.of, one.values))
        # duckdb rounds stamps with a time zone to microseconds
        is_time = one.values.dtype.kind == "M"
        notes = {"timezone": "UTC"} if is_time else {"unit": one.unit} if one.unit else None
        fields.append(arrow.field(one.name, values.type, nullable=False, metadata=notes))
        arrays.append(values)
    return arrow.Table.from_arrays(arrays, schema=arrow.schema(fields, metadata))


def parquet_writer(library: Arrow, file: IO[Any], schema: Any) -> Any:
    """Writer of tables with this schema into a file."""
    is_floating = library.arrow.types.is_floating
    floats = [one.name for one in schema if is_floating(one.type)]
    words = [name for name in DICTIONARY if name in schema.names]
    if "contacts" in schema.names:
        of_contact = schema.field("contacts").type.value_type
        floats += [f"contacts.list.element.{one.name}" for one in of_contact
                   if is_floating(one.type)]  # fmt: skip
        words.append("contacts.list.element.slip")
    return library.parquet.ParquetWriter(
        file, schema, compression=COMPRESSION, use_dictionary=words, use_byte_stream_split=floats,
        # there are hundreds of units, and queries read all rows of a column
        write_statistics=[one for one in schema.names if "." not in one],
    )  # fmt: skip
