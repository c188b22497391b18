"""Stride: many cycles of a pipeline in one compiled call."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bus.assemble.feed import feed
from bus.compiled.bound import Bound
from bus.compiled.chained import addresses, words
from bus.frame import FrameViews
from skin.blocks.gather import Gather
from skin.blocks.stride_kernel import PROGRESS, Assembly, Copies, stride
from skin.contact.model import CYCLE
from skin.contact.record import CONTACT

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["Stride"]


class Stride:
    """Runs the cycle of a pipeline many times, on its own clock and filters, so that the pipeline
    can continue at any cycle.

    Parameters
    ----------
    pipeline : Pipeline
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._progress = np.zeros(1, PROGRESS)

    def ready(self) -> int:
        """Cycles to come that do not need Python; 0: the next one does."""
        pipeline = self._pipeline
        if pipeline.watched or pipeline.cycle.stage is None:
            return 0
        return 1 << 40 if pipeline.zeros is None else pipeline.zeros.idle

    def run(self, row: int, rows: FrameViews, gather: Gather, most: int) -> int:
        """Take frames from a row on, and copy the results.

        Parameters
        ----------
        row : int
        rows : FrameViews
            Read-only, as the assembler's kernel is compiled for.
        gather : Gather
            With room.
        most : int
            Maximum number of cycles.

        Returns
        -------
        int
            Next row.
        """
        pipeline, progress = self._pipeline, self._progress
        cycle, arrays = pipeline.cycle, pipeline.assembler.arrays
        assert cycle.stage is not None
        bound = Bound(feed, row, rows, *arrays)
        place = addresses([bound])
        assert place is not None  # stages are bound
        first, now = gather.count, progress[0]
        now["row"], now["count"], now["contacts"] = row, first, gather.contact_count
        now["most"] = min(gather.capacity, first + most)
        now["contacts_most"] = max(gather.contact_capacity - gather.most_contacts, 0)
        copies = self._copies(gather)
        while stride(cycle.stage, Assembly(place, words(bound), arrays[1].state), copies, progress):
            cycle.renew()
        gather.count, gather.contact_count = int(now["count"]), int(now["contacts"])
        if pipeline.contacts is not None:
            pipeline.contacts.resume()
        if pipeline.zeros is not None:
            pipeline.zeros.idle -= gather.count - first
        return int(now["row"])

    def _copies(self, gather: Gather) -> Copies:
        """Sources and destinations of the copies."""
        sources, stream = gather.sources, self._pipeline.contacts
        rows = [gather.rows[name].ctypes.data for name in sources]
        clock, present, records = np.zeros(1, CYCLE), np.zeros(1, np.int32), 0
        if stream is not None:
            clock, present = stream.data.cycle, stream.data.slots["present"]
            records = stream.records.ctypes.data
        return Copies(
            np.array([array.ctypes.data for array in sources.values()]), np.array(rows),
            np.array([array.nbytes for array in sources.values()]), gather.cycle, gather.stamp_ns,
            gather.overruns, gather.closed_by, gather.contact_start,
            np.array([gather.contacts.ctypes.data, records, CONTACT.itemsize]), clock, present,
            gather.contact_slot,
        )  # fmt: skip
