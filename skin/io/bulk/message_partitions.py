"""Partitions as MCAP files for Foxglove, with the messages of states of a recording."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np

from skin.contact.record import CONTACT
from skin.io.bulk.write import drop, place
from skin.io.messages.record import COUNTERS, described
from skin.io.record.attached import decoded_attachments
from skin.io.record.container import Container, require
from skin.io.record.process import SlotsToMessages, attach
from skin.io.record.slot import slot_dtype
from skin.options import MOST_CONTACTS
from topology.files import named, whole_path

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from skin.io.bulk.job import Job, Part

__all__ = ["MessagePartitions"]

LIBRARY = "f3t-skin"
OF_UNITS = ("status", "force", "force_sigma", "temperature", "test_ratio")


class MessagePartitions:
    """MCAP files with the topics of a recording, without frames; see
    `skin.io.bulk.write.Writer`."""

    def __init__(self, job: Job, part: Part) -> None:
        require(str(job.folder))
        self.tables: tuple[str, ...] = ("states",)
        self._job, self._part = job, part
        self._described = described(job.topology)
        self._attached = decoded_attachments(job.topology, job.provenance(part))
        self._slots = np.zeros(1, slot_dtype(job.topology, MOST_CONTACTS))  # of any options
        for name in (*OF_UNITS[1:], "wrench"):
            self._slots[name] = np.nan  # quantities that are not wanted
        self._slots["contact"] = self._slots["bus_states"] = -1
        self._slots["has_state"] = 1
        self._counters = np.zeros(len(COUNTERS), np.int64)
        self._open: tuple[Container, SlotsToMessages] | None = None
        self._files = ExitStack()

    def add(self, block: Block, number: int) -> None:
        """Add a block; see `Writer`."""
        if self._open is None:
            self._open = self._begin(number, int(block.stamp_ns[0]))
        file, written = self._open
        slot = self._slots[0]
        with named(place(self._job, self._part, "states", number)):
            for t in range(len(block)):
                self._fill(block, t)
                written.write(slot)
            file.flush()
        self.skip(block)

    def skip(self, block: Block) -> None:
        """Skip a block; see `Writer`."""
        self._counters = block.totals[-1].copy()

    def commit(self, number: int, *, ends: bool) -> None:
        """Commit the file; see `Writer`."""
        assert self._open is not None
        with named(place(self._job, self._part, "states", number)):
            self._open[0].finish()
        self._open = None
        files, self._files = self._files, ExitStack()
        files.close()

    def close(self) -> None:
        """Drop an uncommitted file; see `Writer`."""
        files, self._files, self._open = self._files, ExitStack(), None
        drop(files)

    def _begin(self, number: int, stamp_ns: int) -> tuple[Container, SlotsToMessages]:
        """A new file and its message writer. Its stamps are those of the log, so that it is
        identical whenever it is written."""
        path = place(self._job, self._part, "states", number)
        file = Container(self._files.enter_context(whole_path(path)), LIBRARY)
        self._files.callback(file.close)
        for name, data in self._attached.items():
            attach(file, name, data, max(0, stamp_ns))
        return file, SlotsToMessages(file, self._described, self._counters)

    def _fill(self, block: Block, t: int) -> None:
        """Fill the slot from a cycle of a block, as the recorder does."""
        slots = self._slots
        slots["stamp_ns"], slots["cycle"] = block.stamp_ns[t], block.cycle[t]
        slots["counters"] = block.totals[t]
        for name in OF_UNITS:
            values = getattr(block.units, name)
            if values is not None:
                slots[name] = values[t]
        if block.whole is not None:
            slots["whole"], slots["untracked"] = block.whole[t], block.untracked[t]
        if block.wrench is not None:
            slots["wrench"] = block.wrench[t]
        if block.label is not None:
            slots["contact"] = block.label[t]
        if block.contacts is not None:
            first, end = block.contact_start[t : t + 2].tolist()
            slots["contact_count"] = count = end - first
            raw = block.contacts[first:end].view(np.uint8).reshape(count, CONTACT.itemsize)
            slots["contacts"][0, :count] = raw
