"""Recorder: the loop's side of a recording. It writes into the ring buffer and never waits."""

from __future__ import annotations

import base64
import errno
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.frame import FRAME_DTYPE
from bus.transport import Transport
from skin.errors import SkinError
from skin.io.messages.record import RecordWriter, described, record_dtype
from skin.io.record.attached import attachments
from skin.io.record.container import require_libraries
from skin.sinks import Ending, WorkerSink
from skin.state import State
from skin.worker import RingBuffer
from topology import Topology
from topology.files import check_path

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["FED", "PART", "Recorder", "slot_dtype"]

RING_S = 2.0
"""Time span of the ring [assumed: a process is not held up for longer]."""
RING_BYTES = 128 << 20
"""Largest ring; for the largest skins it holds less than `RING_S`."""
LEAST_SLOTS = 64
EVENTS = 24
"""Events per slot; further ones go into the next slot."""
SPARE_FRAMES = 8


FED, PART = 0, 4
"""Further events than those of `Ending`, as in ``f3t_msgs/msg/CanFrames``: so many frames, and so
many of a batch that continues with the next event."""


def slot_dtype(topology: Topology, contacts: int) -> np.dtype[Any]:
    """The dtype of a slot of the ring buffer: the inputs of a cycle, its state and new poses.

    Events are in order, each with its value, their frames one after the other. What is beyond the
    counts, and the state and poses where there are none, is left from earlier cycles.
    """
    expected = len(topology.frames) + len(topology.buses)
    frames = expected + expected // 2 + SPARE_FRAMES
    return record_dtype(topology, contacts, (
        ("has_state", "i8", ()), ("event_count", "i8", ()), ("frame_count", "i8", ()),
        ("events", "i8", (EVENTS, 2)), ("frames", "u1", (frames, FRAME_DTYPE.itemsize)),
    ))  # fmt: skip


class Recorder(WorkerSink):
    """Records the inputs and states of a pipeline in a process of its own; attach it before the
    first frame.

    Where that process falls behind, whole cycles are dropped and counted. Where it ends, for
    instance on a full disk, the logger "skin" reports it and the loop continues.

    Parameters
    ----------
    file : path
        A new file.
    pipeline : Pipeline
        Before its first frame.
    transports : sequence of Transport
        Buses whose states are written as well.

    Attributes
    ----------
    lost, lost_frames : int
        Cycles and frames that were not recorded.

    Raises
    ------
    LibraryError
        A library of recordings is not installed.
    SkinError
        The file exists, or cannot be written; or the pipeline has had frames before.
    """

    def __init__(
        self,
        file: str | os.PathLike[str],
        pipeline: Pipeline,
        transports: Sequence[Transport] = (),
    ) -> None:
        require_libraries("record")
        check_new(file)
        topology, self.file = pipeline.topology, Path(file)
        super().__init__(str(self.file), pipeline)
        if pipeline.now.cycle >= 0 or pipeline.assembler.totals.any():
            raise SkinError(
                f"{self.file}: must be attached before the first frame; got frames before it"
            )
        dtype = slot_dtype(topology, pipeline.contact_capacity)
        most = min(RING_S * topology.cycle_rate_hz, RING_BYTES / dtype.itemsize)
        self._ring = RingBuffer(dtype, max(LEAST_SLOTS, round(most)))
        self._writer = RecordWriter(self._ring.records, pipeline, transports)
        self._room = dtype["frames"].shape[0]
        self._events: list[tuple[int, int]] = []  # since the last slot, each with its value
        self._frames: list[np.ndarray] = []  # theirs
        self._count = 0
        self.lost_frames = 0
        self._closed = False
        self._report: dict[str, Any] = {}
        request = _request(self.file, pipeline)
        self.start("skin.io.record.process", self._ring, request, "open", niceness=0)

    # -- called by the loop ------------------------------------------------------------------------

    def frames(self, frames: np.ndarray) -> None:
        """Record frames, shape (m,), FRAME_DTYPE, also those that the pipeline will refuse."""
        if (frames.dtype is not FRAME_DTYPE and frames.dtype != FRAME_DTYPE) or frames.ndim != 1:
            return
        if frames.size + self._count > self._room:
            self._hand_over()
        while frames.size > self._room:
            part, frames = frames[: self._room], frames[self._room :]
            self._take(PART, part)
            self._hand_over()
        self._take(FED, frames)

    def _take(self, event: int, frames: np.ndarray) -> None:
        self._frames.append(frames.copy())
        self._count += frames.size
        self._add(event, frames.size)

    def closing(self, event: Ending, elapsed_ns: int) -> None:
        """See `Sink.closing`."""
        self._add(int(event), elapsed_ns)

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """See `Sink.moved`."""
        self._hand_over()  # with the poses, which hold for what comes after

    def state(self, state: State) -> None:
        """See `Sink.state`."""
        if time.monotonic() >= self.look_at:
            self.look()
            self._writer.look()
        self._hand_over(state)

    def _add(self, event: int, value: int) -> None:
        self._events.append((event, value))
        if len(self._events) == EVENTS:
            self._hand_over()

    def _hand_over(self, state: State | None = None) -> None:
        """Pass events and frames since the last slot, poses and state to the process; where the
        ring is full, count them as lost."""
        at = None if self._closed else self._ring.claim()
        events, count = self._events, self._count
        if at is None:
            self.lost += state is not None
            self.lost_frames += count
        else:
            writer, of = self._writer, self._writer.of
            if state is not None:
                writer.state(at, state, self.lost, self.lost_frames)
            writer.poses(at)
            of["has_state"][at], of["event_count"][at] = state is not None, len(events)
            if events:
                of["events"][at, : len(events)] = events
            of["frame_count"][at], done = count, 0
            for frames in self._frames:
                rows = frames.view(np.uint8).reshape(frames.size, FRAME_DTYPE.itemsize)
                of["frames"][at, done : done + frames.size] = rows
                done += frames.size
            self._ring.publish()
        self._events, self._frames, self._count = [], [], 0

    # -- losses, and the end -----------------------------------------------------------------------

    def described_loss(self) -> str:
        """Cycles and frames dropped so far, as text."""
        return f"{self.lost} cycles and {self.lost_frames} frames"

    def described_end(self, status: int) -> str:
        """Why the recording ended: the error of the disk."""
        why = os.strerror(status) if status in errno.errorcode else f"status {status}"
        return (
            f"{self.file}: must be written to the end of the run; got: {why} (what was written "
            "before can be read, the run goes on)"
        )

    def fail(self) -> None:
        """The recording has ended; the loop continues, and further cycles count as lost."""
        self._closed = True
        super().fail()

    def report(self) -> dict[str, Any]:
        """Summary of the recording: ``file``; ``cycles``, ``frames``, ``messages`` and ``bytes`` in
        it; ``cpu_s`` of the worker; dropped ``lost_cycles`` and ``lost_frames``; ``failure``."""
        self._ask("report")
        return {"file": str(self.file), **self._report, "lost_cycles": self.lost,
                "lost_frames": self.lost_frames, "failure": self.failure}  # fmt: skip

    def stop(self) -> None:
        """Write the backlog and end the file; may be called twice."""
        if self._events:
            self._hand_over()
        self._ask("finish")
        self._closed = True
        self._worker.close()

    def _ask(self, command: str) -> None:
        if not self._closed:
            try:
                self._report = self._worker.ask(command)
            except SkinError:
                self.fail()


def check_new(file: str | os.PathLike[str]) -> None:
    """Require a new file in an existing folder.

    Raises
    ------
    SkinError
        It is not; the message has the reason.
    """
    check_path("record", file, SkinError)
    path = Path(file)
    if os.path.lexists(path):
        raise SkinError(f"{path}: must be a new file; got one that is there already")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise SkinError(f"{path}: must be in a folder that exists; got '{folder}'")
    if not os.access(folder, os.W_OK):
        raise SkinError(f"{path}: must be in a folder that can be written; got '{folder}'")


def _request(file: Path, pipeline: Pipeline) -> dict[str, Any]:
    """The worker's request as JSON, with the attachments of the recording."""
    files = attachments(pipeline.topology, pipeline.options, pipeline.deadline_s)
    return {
        "file": str(file.absolute()),
        **described(pipeline.topology),
        "attached": {name: base64.b64encode(data).decode() for name, data in files.items()},
    }
