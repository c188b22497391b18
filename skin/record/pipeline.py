"""A pipeline that records what it is given and what comes of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from bus.cycle import RawCycle
from skin.options import Options
from skin.pipeline import Pipeline
from skin.record.attached import attachments
from skin.record.recorder import Recorder, check_new
from skin.record.slot import Event
from skin.state import State
from topology import Topology

__all__ = ["RecordedPipeline"]


class RecordedPipeline(Pipeline):
    """As `skin.pipeline.Pipeline`, recorded.

    Parameters
    ----------
    topology : Topology
    options : Options, optional
    deadline_s : float, optional
    file : path
        A new MCAP file.
    zeros : path, optional
        Zeros that go from run to run; those that are taken up stand in the recording.

    Attributes
    ----------
    recorder : Recorder
        Tells what was recorded, and what was not.
    """

    def __init__(
        self,
        topology: Topology,
        options: Options | None = None,
        *,
        deadline_s: float | None = None,
        file: str | os.PathLike[str],
        zeros: str | os.PathLike[str] | None = None,
    ) -> None:
        check_new(file)
        super().__init__(topology, options, deadline_s=deadline_s)
        taken = None
        if zeros is not None:
            self.take_zeros(zeros)
            taken = Path(zeros).read_bytes() if Path(zeros).exists() else b""
        attached = attachments(topology, self.options, deadline_s, taken)
        self.recorder = Recorder(file, self, attached)
        self._fed, self._take = self.recorder.fed, self.recorder.take

    def feed(self, frames: np.ndarray) -> Iterator[State]:
        """Take frames; see `Pipeline.feed`."""
        if frames.size:
            self._fed(frames)
        return super().feed(frames)

    def expire(self, now_ns: int) -> State | None:
        """The state of the open cycle if its time is over; see `Pipeline.expire`."""
        since_ns = self.assembler.since_ns
        return self._closed(Event.EXPIRED, self.assembler.expire(now_ns), since_ns, now_ns)

    def silence(self, now_ns: int) -> State | None:
        """A state without data where no SYNC comes; see `Pipeline.silence`."""
        since_ns = self.assembler.since_ns
        return self._closed(Event.SILENT, self.assembler.silence(now_ns), since_ns, now_ns)

    def flush(self) -> State | None:
        """The state of what is open at the end; see `Pipeline.flush`."""
        return self._closed(Event.FLUSHED, self.assembler.flush(), None, 0)

    def _closed(
        self, event: Event, cycle: RawCycle | None, since_ns: int | None, now_ns: int
    ) -> State | None:
        """Record what the clock did: closed a cycle, or began to measure its time."""
        starts = since_ns is None and self.assembler.since_ns is not None
        if cycle is not None or starts:
            self.recorder.closing(event, 0 if since_ns is None else now_ns - since_ns)
        return None if cycle is None else self.state(cycle)

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of the units for the cycles to come; see `Pipeline.move`."""
        super().move(position, rotation)
        self.recorder.moved(position, rotation)

    def move_joints(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set joints, and the poses of the units by them; see `Pipeline.move_joints`. They are set
        once more as a replay does, which knows no joints, for the same last bit."""
        super().move_joints(q)
        self.move(*self.poses)

    def step(self, cycle: RawCycle) -> State:
        """The state of a cycle; see `Pipeline.step`."""
        now = super().step(cycle)
        self._take(now)
        return now

    def close(self) -> None:
        """End the recording, and what else a run has to end."""
        try:
            super().close()
        finally:
            self.recorder.close()
