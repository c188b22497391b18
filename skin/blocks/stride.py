"""Stride: a pipeline's cycles, many in one compiled call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.chained import NOTHING, address, words
from bus.frame import FrameViews
from skin.blocks.gather import CONTACTS, Gather
from skin.blocks.stride_kernel import DONE, STAGES, TIME, Copies, Ends, Stage, stride
from skin.contact.model import CLOCK
from skin.contact.record import CONTACT

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["Stride"]

EMPTY = np.zeros(0, np.int64)
CLOCK_FIELDS = ("period_ns", "now_ns", "elapsed_ns", "overruns", "number", "stamp_ns", "off_ns")
"""Of `skin.clock.Clock`, by the names of TIME."""


class Stride:
    """Runs the stages of a pipeline over many cycles.

    It takes the state of clock and filters from the pipeline before a run and hands it back after,
    so that the pipeline can go on at any cycle by itself.

    Parameters
    ----------
    pipeline : Pipeline
        Which has made its first state.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._time = np.zeros(1, TIME)
        self._kept: list[Any] = []
        self._decode: object = None
        self._stage: Stage | None = None
        self._ends = self._ends_of()

    @staticmethod
    def fits(pipeline: Pipeline) -> bool:
        """Whether nobody has to look at single cycles of this pipeline, ever."""
        contacts = pipeline.contacts
        return not pipeline.watched and (contacts is None or contacts.shocks is None)

    def ready(self) -> int:
        """Cycles to come that need no look from Python; 0: the next one does."""
        pipeline = self._pipeline
        if not self.fits(pipeline) or not self._connect():
            return 0
        zeros = pipeline.zeros
        return zeros.idle if zeros is not None and zeros.active else 1 << 40

    def run(self, row: int, rows: FrameViews, gather: Gather, most: int) -> tuple[int, bool]:
        """Take frames from a row on, and copy what becomes of them.

        Parameters
        ----------
        row : int
        rows : FrameViews
            Not writeable, as the assembler's kernel is compiled for.
        gather : Gather
            With room.
        most : int
            Cycles at most.

        Returns
        -------
        row : int
            To go on from.
        left : bool
            A cycle is assembled and left to the pipeline.
        """
        pipeline, time = self._pipeline, self._time[0]
        assert self._stage is not None
        feed = Bound(_feed(), row, rows, *pipeline.assembler.arrays)
        calls = self._stage.calls
        calls[0] = address(feed)
        stage = self._stage._replace(frame_words=words(feed))
        first = gather.count
        time["row"], time["count"], time["contacts"] = row, first, gather.contact_count
        time["most"] = min(gather.capacity, first + most)
        time["contacts_most"] = max(gather.contact_capacity - CONTACTS, 0)
        self._load()
        done = stride(stage, self._ends, self._copies(gather), self._time)
        self._store()
        gather.count, gather.contact_count = int(time["count"]), int(time["contacts"])
        if pipeline.zeros is not None and pipeline.zeros.active:
            pipeline.zeros.idle -= gather.count - first
        return int(time["row"]), done != DONE

    # -- what is called ----------------------------------------------------------------------------

    def _connect(self) -> bool:
        """Find the stages' addresses, anew where the decoder has other kernels."""
        decoder = self._pipeline.decoder
        decode = decoder.call
        if decode is None or decoder.mode.now is None:
            return False
        if decode is not self._decode:
            self._decode, self._stage = decode, self._stage_of(decode)
        return self._stage is not None

    def _stage_of(self, decode: object) -> Stage | None:
        """The stages; None where one has no address."""
        decoder, contacts = self._pipeline.decoder, self._pipeline.contacts
        called: dict[str, object] = {"decode": decode}
        adding: list[object] = []
        elapsed_s = calm_s = np.zeros(1)
        if decoder.loop is not None:
            stages = decoder.loop.stages
            if stages is None:
                return None
            if (prediction := stages.prediction) is not None:
                called |= {"films": prediction.films, "unknown": prediction.unknown}
                adding = [*prediction.adding]
            if (follow := stages.follow) is not None:
                called["ambient"] = follow.call
                elapsed_s, calm_s = follow.elapsed_s, follow.calm_s
        if decoder.creep is not None:
            called |= dict(zip(("relax_to", "relax_fro"), decoder.creep.calls, strict=True))
        if contacts is not None:
            called["step"] = contacts.bound
        places = {name: address(one) for name, one in called.items()}
        parts = [address(one) for one in adding]
        if any(place is None for place in (*places.values(), *parts)):
            return None
        self._kept = [called, adding]
        return Stage(
            calls=np.array([places.get(name, NOTHING) for name in STAGES]),
            adding=np.array(parts, np.int64).reshape(-1, 2), frame_words=EMPTY,
            assembled=self._pipeline.assembler.arrays[1].state, phase=decoder.mode.phase,
            advance=decoder.mode.advance, elapsed_s=elapsed_s, calm_s=calm_s,
        )  # fmt: skip

    def _ends_of(self) -> Ends:
        """The arrays of the contacts, or others like them."""
        contacts = self._pipeline.contacts
        if contacts is None:
            numbers = np.zeros(1, np.int32)
            return Ends(np.zeros(1, CLOCK), np.zeros(2, np.int64), numbers, numbers)
        data, records, size = contacts.data, contacts.records, CONTACT.itemsize
        places = [records.ctypes.data, size]
        return Ends(data.clock, np.array(places), data.slots.present, contacts.unit_slip)

    def _copies(self, gather: Gather) -> Copies:
        """Where things are copied to."""
        sources = gather.sources
        rows = [gather.rows[name].ctypes.data for name in sources]
        background, loop = np.zeros(3, np.int64), self._pipeline.decoder.loop
        stages = None if loop is None else loop.stages
        if stages is not None and stages.prediction is None:
            into, source = stages.background
            background[:] = into.ctypes.data, source.ctypes.data, into.nbytes
        return Copies(
            np.array([array.ctypes.data for array in sources.values()]), np.array(rows),
            np.array([array.nbytes for array in sources.values()]), background, gather.cycle,
            gather.stamp_ns, gather.overruns, gather.closed_by, gather.contact_start,
            np.array([gather.contacts.ctypes.data]), gather.contact_slot,
        )  # fmt: skip

    # -- the state of clock and filters ------------------------------------------------------------

    def _load(self) -> None:
        """Take it from the pipeline."""
        time, clock, decoder = self._time[0], self._pipeline.clock, self._pipeline.decoder
        for name in CLOCK_FIELDS:
            time[name] = getattr(clock, name)
        time["rate_hz"] = decoder.topology.cycle_rate_hz
        time["aging_missing"] = decoder.aging.missing
        time["creep_last"], time["sweeps"], time["look_every"] = -1, 0, 1
        if (creep := decoder.creep) is not None:
            time["creep_missing"], time["creep_steps"] = creep.missing, creep.steps
            time["creep_last"] = creep.last
        if (loop := decoder.loop) is not None:
            time["look_since_s"], time["look_every"] = loop.looks.since_s, loop.looks.every
            time["sweeps"] = loop.sweeps if loop.crosstalk is not None else 0
            if loop.ambient is not None:
                time["look_period_s"] = loop.ambient.period_s
        decoder.mode.tell(loop is None, True)

    def _store(self) -> None:
        """Hand it back."""
        time, pipeline, decoder = self._time[0], self._pipeline, self._pipeline.decoder
        for name in CLOCK_FIELDS:
            setattr(pipeline.clock, name, int(time[name]))
        decoder.aging.missing = float(time["aging_missing"])
        if (creep := decoder.creep) is not None:
            creep.missing, creep.last = float(time["creep_missing"]), int(time["creep_last"])
        if (loop := decoder.loop) is not None:
            loop.looks.since_s = float(time["look_since_s"])
        decoder.mode.tell(loop is None, True)  # the last sweep of a cycle did not go on
        if pipeline.contacts is not None:
            pipeline.contacts.resume()


def _feed() -> Any:
    from bus.assemble.feed import feed

    return feed
