"""Partitions of a log: files of many cycles, written atomically."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from skin.arrow import arrow_for
from skin.io.bulk.fault_intervals import FaultIntervals
from skin.io.bulk.job import FORMATS
from skin.io.export.columns import (
    arrays_of,
    contact_arrays,
    contact_columns,
    cycle_columns,
    joined,
)
from skin.io.export.parquet import RowGroups, parquet_writer, table_of
from topology.files import named, whole_file

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from skin.io.bulk.job import Job, Part

__all__ = ["TABLES", "ArrayPartitions", "ParquetPartitions", "Writer", "clean", "drop", "place"]

TABLES = ("cycles", "contacts", "trouble", "states")
"""Folders of the files that there may be."""
PARTITION = re.compile(rf"part-(\d{{5,}})\.({'|'.join(FORMATS)})")
"""Names of partitions: no other file of a folder is removed."""


class Writer(Protocol):
    """Writes the partitions of a log from its blocks, in order.

    Attributes
    ----------
    tables : tuple of str
        Tables that each partition has a file of, of `TABLES`; set with the first partition.
    """

    tables: tuple[str, ...]

    def add(self, block: Block, number: int) -> None:
        """Add a block to a partition."""

    def skip(self, block: Block) -> None:
        """Skip a block of a partition that exists."""

    def commit(self, number: int, *, ends: bool) -> None:
        """Commit the files of a partition; the log `ends` with it."""

    def close(self) -> None:
        """Drop uncommitted files."""


def clean(job: Job, part: Part, keep: int) -> None:
    """Remove all files of a log except its first `keep` partitions."""
    manifest = job.manifest_of(part)
    for file in manifest.parent.glob(f".{manifest.name}.*.part"):
        file.unlink(missing_ok=True)
    for table in TABLES:
        folder = job.folder_of(table, part)
        for file in folder.iterdir() if folder.is_dir() else ():
            own = PARTITION.fullmatch(file.name)
            if own and (int(own[1]) >= keep or own[2] != job.format):
                file.unlink(missing_ok=True)
        for file in folder.glob(".part-*.part") if folder.is_dir() else ():
            file.unlink(missing_ok=True)


def place(job: Job, part: Part, table: str, number: int) -> Path:
    """Path of a partition of a table; makes its folder."""
    folder = job.folder_of(table, part)
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"part-{number:05}.{job.format}"


class _DroppedError(Exception):
    """Makes `topology.files.whole_path` drop a file."""


def drop(files: ExitStack) -> None:
    """Close files of `topology.files.whole_path` and drop them."""
    try:
        files.__exit__(_DroppedError, _DroppedError(), None)
    except (_DroppedError, OSError):
        pass


class ParquetPartitions:
    """Parquet files of large row groups, with hashes in the metadata."""

    def __init__(self, job: Job, part: Part) -> None:
        self.tables: tuple[str, ...] = ()
        self._job, self._part, self._provenance = job, part, job.provenance(part)
        self._library = arrow_for(job.folder, "written")
        self._fault_intervals = FaultIntervals(self._library, job.topology, self._provenance)
        self._faults: list[tuple[Any, ...]] = []
        self._groups, self._number = RowGroups(self._write_group), 0
        self._open: dict[str, Any] = {}
        self._files = ExitStack()

    def add(self, block: Block, number: int) -> None:
        """Add a block; see `Writer`."""
        self._number = number
        self._groups.add(block)
        self._faults += self._fault_intervals.pass_over(block)

    def skip(self, block: Block) -> None:
        """Skip a block; see `Writer`."""
        self._fault_intervals.pass_over(block)

    def commit(self, number: int, *, ends: bool) -> None:
        """Commit the files; see `Writer`."""
        if ends:
            self._faults += self._fault_intervals.end()
        self._groups.flush()
        self._open = {}
        files, self._files = self._files, ExitStack()
        files.close()

    def close(self) -> None:
        """Drop uncommitted files; see `Writer`."""
        files, self._files, self._open = self._files, ExitStack(), {}
        drop(files)

    def _write_group(self, blocks: list[Block]) -> None:
        """Write a row group of each table."""
        columns = {"cycles": cycle_columns(blocks)}
        if blocks[0].contacts is not None:
            columns["contacts"] = contact_columns(blocks)
        self.tables = (*columns, "trouble")
        for name, found in columns.items():
            self._write(name, table_of(self._library, found, self._provenance))
        self._write("trouble", self._fault_intervals.table(self._faults))
        self._faults = []

    def _write(self, name: str, table: Any) -> None:
        path = place(self._job, self._part, name, self._number)
        if name not in self._open:
            file = self._files.enter_context(whole_file(path))
            self._open[name] = self._files.enter_context(
                parquet_writer(self._library, file, table.schema)
            )
        with named(path):
            self._open[name].write_table(table)


class ArrayPartitions:
    """Arrays in .npz files without pickle, with the names of those of a single log."""

    def __init__(self, job: Job, part: Part) -> None:
        self.tables: tuple[str, ...] = ()
        self._job, self._part = job, part
        self._blocks: list[dict[str, dict[str, np.ndarray]]] = []

    def add(self, block: Block, number: int) -> None:
        """Add a block; see `Writer`."""
        found = {"cycles": {"time": block.stamp_ns} | arrays_of(block)}
        if block.contacts is not None:
            at = block.contact_cycle
            head = {"time": block.stamp_ns[at], "cycle": block.cycle[at]}
            found["contacts"] = head | contact_arrays(block.contacts)
        self._blocks.append(found)

    def skip(self, block: Block) -> None:
        """Skip a block; see `Writer`."""

    def commit(self, number: int, *, ends: bool) -> None:
        """Commit the files; see `Writer`."""
        provenance = self._job.provenance(self._part)
        every = {"unit": np.array(self._job.topology.unit_names)}
        every |= {f"_{name}": np.array(value) for name, value in provenance.items()}
        self.tables = tuple(self._blocks[0]) if self._blocks else ()
        for table in self.tables:
            columns = joined([block[table] for block in self._blocks])
            with whole_file(place(self._job, self._part, table, number)) as file:
                np.savez(file, allow_pickle=False, **every, **columns)
        self._blocks = []

    def close(self) -> None:
        """Drop uncommitted files; see `Writer`."""
        self._blocks = []
