"""Partitions of a log: files of many cycles, each there whole or not at all."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from skin.arrow import arrow_for
from skin.bulk.tables import Tables, contact_columns, cycle_columns
from topology.files import named, whole_file

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from skin.bulk.job import Job, Part

__all__ = ["TABLES", "Writer", "clean", "drop", "place", "writer_of"]

TABLES = ("cycles", "contacts", "trouble", "states")
"""Folders of the files that there may be."""
COMPRESSION = "lz4"
"""A third faster to write than zstd, and 6 % larger, on force and temperature."""
DICTIONARY = ("closed_by", "slip", "unit", "flags")


class Writer(Protocol):
    """Writes the partitions of a log, whose blocks come in their order.

    Attributes
    ----------
    tables : tuple of str
        Of which each partition has a file, of `TABLES`; known with the first block.
    """

    tables: tuple[str, ...]

    def add(self, block: Block, number: int) -> None:
        """Add a block to a partition."""

    def skip(self, block: Block) -> None:
        """Pass over a block of a partition that is there already."""

    def commit(self, number: int, *, ends: bool) -> None:
        """Let the files of a partition take their places; the log `ends` with it."""

    def close(self) -> None:
        """Drop what was not committed."""


def writer_of(job: Job, part: Part) -> Writer:
    """The writer of a job's format."""
    if job.format == "mcap":
        from skin.bulk.message_partitions import MessagePartitions

        return MessagePartitions(job, part)
    return (ParquetPartitions if job.format == "parquet" else ArrayPartitions)(job, part)


def clean(job: Job, part: Part, keep: int) -> None:
    """Remove what an earlier run has left of a log, but for its first partitions."""
    manifest = job.manifest_of(part)
    for file in manifest.parent.glob(f".{manifest.name}.*.part"):
        file.unlink(missing_ok=True)
    for table in TABLES:
        folder = job.folder_of(table, part)
        for file in folder.glob("part-*") if folder.is_dir() else ():
            if int(file.name[5:10]) >= keep or file.suffix != f".{job.format}":
                file.unlink(missing_ok=True)
        for file in folder.glob(".part-*.part") if folder.is_dir() else ():
            file.unlink(missing_ok=True)


def place(job: Job, part: Part, table: str, number: int) -> Path:
    """Where a partition of a table is to be; its folder is made."""
    folder = job.folder_of(table, part)
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"part-{number:05}.{job.format}"


class _DroppedError(Exception):
    """Ends files that are not to take their places."""


def drop(files: ExitStack) -> None:
    """Close files of `topology.files.whole_path` so that none takes its place."""
    try:
        files.__exit__(_DroppedError, _DroppedError(), None)
    except (_DroppedError, OSError):
        pass


class ParquetPartitions:
    """Parquet files: a row group for each block, and hashes in the metadata."""

    def __init__(self, job: Job, part: Part) -> None:
        self.tables: tuple[str, ...] = ()
        self._job, self._part = job, part
        self._library = arrow_for(job.folder, "written")
        self._tables = Tables(self._library, job.topology, job.told(part))
        self._open: dict[str, Any] = {}
        self._files = ExitStack()

    def add(self, block: Block, number: int) -> None:
        """Add a block; see `Writer`."""
        tables = self._tables.of(block)
        self.tables = tuple(tables)
        for name, table in tables.items():
            self._write(name, table, number)

    def skip(self, block: Block) -> None:
        """Pass over a block; see `Writer`."""
        self._tables.skip(block)

    def commit(self, number: int, *, ends: bool) -> None:
        """Let the files take their places; see `Writer`."""
        if ends:
            self._write("trouble", self._tables.end(), number)
        self._open = {}
        files, self._files = self._files, ExitStack()
        files.close()

    def close(self) -> None:
        """Drop what was not committed; see `Writer`."""
        files, self._files, self._open = self._files, ExitStack(), {}
        drop(files)

    def _write(self, name: str, table: Any, number: int) -> None:
        path = place(self._job, self._part, name, number)
        if name not in self._open:
            file = self._files.enter_context(whole_file(path))
            floats = [one.name for one in table.schema if self._library.arrow.types.is_floating(
                one.type)]  # fmt: skip
            self._open[name] = self._files.enter_context(
                self._library.parquet.ParquetWriter(
                    file, table.schema, compression=COMPRESSION,
                    use_dictionary=[one for one in DICTIONARY if one in table.schema.names],
                    use_byte_stream_split=floats,
                    # of units there are hundreds, and what is asked of them is asked of all rows
                    write_statistics=[one for one in table.schema.names if "." not in one],
                )
            )  # fmt: skip
        with named(path):
            self._open[name].write_table(table)


class ArrayPartitions:
    """Arrays in .npz files without pickle, named as the columns of the tables, but for the units:
    these are arrays of shape (t, …, n)."""

    def __init__(self, job: Job, part: Part) -> None:
        self.tables: tuple[str, ...] = ()
        self._job, self._part = job, part
        self._blocks: list[dict[str, dict[str, np.ndarray]]] = []

    def add(self, block: Block, number: int) -> None:
        """Add a block; see `Writer`."""
        names = tuple(f"{name}." for name in block.topology.unit_names)
        cycles = {one.name: one.values for one in cycle_columns(block)
                  if not one.name.startswith(names)}  # fmt: skip
        for name in (
            "force", "force_sigma", "temperature", "temperature_sigma", "test_ratio", "status",
            "valid",
        ):  # fmt: skip
            if (values := getattr(block.units, name)) is not None:
                cycles[name] = values
        self._blocks.append({"cycles": cycles})
        if block.contacts is not None:
            cycles["contact"] = block.contact_of_units
            self._blocks[-1]["contacts"] = {
                one.name: one.values for one in contact_columns(block)
            }  # fmt: skip

    def skip(self, block: Block) -> None:
        """Pass over a block; see `Writer`."""

    def commit(self, number: int, *, ends: bool) -> None:
        """Let the files take their places; see `Writer`."""
        units = np.array(self._job.topology.unit_names)
        told = self._job.told(self._part)
        self.tables = tuple(self._blocks[0]) if self._blocks else ()
        for table in self.tables:
            columns = {
                name: np.concatenate([block[table][name] for block in self._blocks])
                for name in self._blocks[0][table]
            }  # fmt: skip
            with whole_file(place(self._job, self._part, table, number)) as file:
                every = {"unit": units} | columns | {f"_{k}": np.array(v) for k, v in told.items()}
                np.savez(file, allow_pickle=False, **every)
        self._blocks = []

    def close(self) -> None:
        """Drop what was not committed; see `Writer`."""
        self._blocks = []
