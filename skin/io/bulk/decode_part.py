"""Decodes one log of a job, partition by partition, and reports on it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.errors import BusError
from bus.processors import processors
from skin.blocks.block import Block
from skin.blocks.blocks import blocks_of
from skin.blocks.prefetch import prefetch
from skin.errors import SkinError
from skin.io.bulk.manifest import committed, save_manifest
from skin.io.bulk.write import ArrayPartitions, ParquetPartitions, Writer, clean
from skin.offline import decode_log

if TYPE_CHECKING:
    from skin.io.bulk.job import Job, Part

__all__ = ["decode_part"]

PARTITION_BYTES = 96 << 20
"""Bytes of decoded values per file [assumed]."""
BLOCKS_AHEAD = 2
FOREIGN_SHARE = 0.5
"""Fraction of foreign frames above which a log is of another skin [assumed]."""


def decode_part(job: Job, part: Part, *, threads: bool | None = None) -> dict[str, Any]:
    """Decode a log, or continue where an earlier call of the same job ended.

    The result does not depend on where that was: filters need the log from its beginning, so all of
    it is decoded, and partitions that exist are not written again.

    Parameters
    ----------
    job : Job
    part : Part
    threads : bool, optional
        Whether threads read, decode and write at the same time; if not given, where there is more
        than one processor. On one, threads only take it from each other.

    Returns
    -------
    dict
        Summary of the results; ``error`` is None, or why the log was given up.
    """
    begun = time.monotonic()
    threads = processors() > 1 if threads is None else threads
    before = committed(job, part)
    if before is not None and before.get("complete"):
        return before["summary"] | {"state": "unchanged"}
    kept, tables = (before["partitions"], before["tables"]) if before is not None else ([], [])
    summary: dict[str, Any] = {"log": str(part.log), "key": part.key, "state": "decoded",
                               "error": None}  # fmt: skip
    sums = _Sums(list(kept), list(tables))
    try:
        source, blocks = _source(job, part, threads)  # may raise: before any file is touched
        clean(job, part, len(kept))
        save_manifest(job, part, _manifest(job, part, sums, {}))
        _write(job, part, source, prefetch(blocks, BLOCKS_AHEAD) if threads else blocks, sums)
    except (BusError, SkinError, OSError) as error:
        return summary | sums.totals() | {"state": "failed", "error": _words(error)}
    summary |= sums.totals() | {"counters": asdict(source.counters), "faults": source.faults,
                              "notes": getattr(source, "notes", []),
                              "options": source.pipeline.options.report(),
                              "left_out": getattr(source, "left_out", {}),
                              "damage": getattr(source, "damage", None)}  # fmt: skip
    if part.log.stat().st_size != part.size:
        summary["faults"] = [*summary["faults"], _grown(part)]
    summary["faults"] = [*summary["faults"], *_strange(part, summary, job.topology.name)]
    summary |= {"wall_s": time.monotonic() - begun}
    try:
        save_manifest(job, part, _manifest(job, part, sums, summary, complete=True))
    except OSError as error:  # fails this log only
        return summary | {"state": "failed", "error": _words(error)}
    return summary


def _source(job: Job, part: Part, threads: bool) -> tuple[Any, Iterator[Block]]:
    """The source, which has counters and faults, and its blocks."""
    if part.is_recording:
        from skin.io.record.replay import redecode

        played = redecode(part.log, job.topology, **job.options)
        return played, blocks_of(played, played.pipeline, job.partition_cycles)
    decoded = decode_log(job.topology, part.log, channels=job.channels, **job.of_logs)
    return decoded, decoded.blocks(job.partition_cycles, threads=threads)


def _write(job: Job, part: Part, source: Any, blocks: Iterator[Block], sums: _Sums) -> None:
    """Write blocks into partitions; those that exist are skipped."""
    writer, kept = _writer_of(job, part), len(sums.partitions)
    number = rows = 0
    try:
        for block in blocks:
            most = job.partition_cycles or _partition_cycles(block)
            if rows >= most:
                _commit(job, part, source, sums, (writer, number, rows), kept)
                number, rows = number + 1, 0
            if number < kept:
                writer.skip(block)
            else:
                writer.add(block, number)
            sums.add(block)
            rows += len(block)
        if rows:
            _commit(job, part, source, sums, (writer, number, rows), kept, ends=True)
    finally:
        writer.close()


def _writer_of(job: Job, part: Part) -> Writer:
    """The writer for a job's format."""
    return (ParquetPartitions if job.format == "parquet" else ArrayPartitions)(job, part)


def _commit(
    job: Job, part: Part, source: Any, sums: _Sums, done: tuple[Any, int, int], kept: int, *,
    ends: bool = False,
) -> None:  # fmt: skip
    """Commit a partition, and record it in the manifest."""
    writer, number, rows = done
    if number < kept:
        return
    writer.commit(number, ends=ends)
    sums.partitions.append(rows)
    sums.tables = list(writer.tables)
    summary = sums.totals() | {"read_bytes": getattr(source, "read_bytes", 0)}
    save_manifest(job, part, _manifest(job, part, sums, summary))


def _manifest(
    job: Job, part: Part, sums: _Sums, summary: dict[str, Any], complete: bool = False
) -> dict[str, Any]:
    return {"told": job.provenance(part), "partitions": sums.partitions, "tables": sums.tables,
            "complete": complete, "summary": summary}  # fmt: skip


def _partition_cycles(block: Block) -> int:
    """Cycles per file."""
    arrays = [getattr(block.units, name) for name in type(block.units).__slots__]
    row_bytes = sum(one.nbytes for one in arrays if one is not None) / len(block)
    return max(1, round(PARTITION_BYTES / row_bytes))


def _words(error: Exception) -> str:
    """An error as a message; an error of writing has the file and the reason."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error) or type(error).__name__


def _grown(part: Part) -> str:
    now = part.log.stat().st_size
    return (f"{part.log}: must keep its size while it is read; got {now} bytes after {part.size}: "
            "decode it again for the rest")  # fmt: skip


def _strange(part: Part, summary: dict[str, Any], name: str) -> Iterator[str]:
    """Signs that a log is of another skin."""
    counters = summary["counters"]
    frames = sum(counters.values()) - counters["lost"] - counters["controller_overflow"]
    foreign = counters["foreign"] + counters["short"]
    if frames and (foreign > FOREIGN_SHARE * frames or not counters["data"]):
        yield (f"{part.log}: must be a log of the skin {name!r}; got {foreign} foreign frames "
               f"of {frames}, and {counters['data']} of its units")  # fmt: skip
    elif not summary["cycles"]:
        yield f"{part.log}: must hold cycles of the skin {name!r}; got none"


class _Sums:
    """Totals over all blocks."""

    def __init__(self, partitions: list[int], tables: list[str]) -> None:
        self.partitions, self.tables = partitions, tables
        self.cycles = self.valid = self.readings = self.contacts = self.slips = self.frames = 0
        self.first_ns = self.last_ns = None
        self.overruns = 0

    def add(self, block: Block) -> None:
        """Count a block."""
        self.cycles += len(block)
        self.valid += int(np.count_nonzero(block.units.valid))
        self.readings += len(block) * int(block.topology.feels.sum())
        self.overruns = int(block.overruns[-1])
        self.frames = int(block.totals[-1].sum())
        if self.first_ns is None:
            self.first_ns = int(block.stamp_ns[0])
        self.last_ns = int(block.stamp_ns[-1])
        if block.contacts is not None:
            found = block.contacts
            self.contacts += int(np.count_nonzero(found["event"] & 1))
            began = (found["onset_ns"] != 0) & (found["onset_ns"] == found["seen_ns"])
            self.slips += int(np.count_nonzero(began))

    def totals(self) -> dict[str, Any]:
        """The totals, by name."""
        return {
            "cycles": self.cycles, "frames": self.frames, "cycles_missing": self.overruns,
            "valid_share": self.valid / self.readings if self.readings else None,
            "contacts": self.contacts, "slips": self.slips, "partitions": len(self.partitions),
            "first_ns": self.first_ns, "last_ns": self.last_ns,
        }  # fmt: skip
