"""Recorder: the loop's side of a recording. It copies into the ring buffer and never waits."""

from __future__ import annotations

import base64
import errno
import os
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.compiled.bound import Bound, direct
from bus.frame import FRAME_DTYPE
from bus.transport import Transport
from skin.contact.record import CONTACT
from skin.errors import SkinError
from skin.io.messages.record import described, note
from skin.io.messages.writer import RecordWriter
from skin.io.record.attached import attachments
from skin.io.record.container import require
from skin.io.record.slot import EVENTS, Event, slot_dtype
from skin.io.record.staging import FULL, NO_ROOM, STAGED, Ring, Staged, hand_over, stage, take
from skin.sinks import Ending, WorkerSink
from skin.state import State
from skin.worker import RingBuffer
from topology.files import check_path

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["Recorder"]

RING_S = 2.0
"""Time span of the ring [assumed: a process is not held up for longer]."""
RING_BYTES = 128 << 20
"""Largest ring; for the largest skins it holds less than `RING_S`."""
LEAST_SLOTS = 64
FED, FED_PART, MOVED = map(int, (Event.FED, Event.FED_PART, Event.MOVED))
MODULE = "skin.io.record.process"


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

    Raises
    ------
    LibraryError
        The library of the file format is not installed.
    SkinError
        The file exists, or cannot be written; or the pipeline has had frames before.
    """

    def __init__(
        self,
        file: str | os.PathLike[str],
        pipeline: Pipeline,
        transports: Sequence[Transport] = (),
    ) -> None:
        require("record")
        check_new(file)
        topology, self.file = pipeline.topology, Path(file)
        super().__init__(str(self.file), pipeline)
        if pipeline.now.cycle >= 0 or pipeline.assembler.totals.any():
            raise SkinError(
                f"{self.file}: must be attached before the first frame; got frames before it"
            )
        dtype = slot_dtype(topology, pipeline.contact_capacity)
        most = min(RING_S * topology.cycle_rate_hz, RING_BYTES / dtype.itemsize)
        self._ring = ring = RingBuffer(dtype, max(LEAST_SLOTS, round(most)))
        staged = np.zeros(1, dtype)
        self._writer = RecordWriter(staged, pipeline.contacts, pipeline.assembler.totals)
        of = self._writer.fields
        self._frames = of["frames"][0].view(FRAME_DTYPE).reshape(-1)
        self._event_count, self._frame_count = of["event_count"], of["frame_count"]
        self._events, self._values = of["events"][0], of["event_values"][0]
        into = self._frames, self._events, self._values, self._event_count, self._frame_count
        self._stage, self._stage_part = (
            partial(direct(stage), *into, fed) for fed in (FED, FED_PART)
        )
        self._pose, self._slot = of["pose"][0], staged
        self._lost = of["lost_cycles"], of["lost_frames"]
        self._has_moved, self._is_open = np.zeros(1, bool), np.ones(1, bool)
        places = {name: place for name, (_, place, *_) in (dtype.fields or {}).items()}
        ends = (
            Staged(
                staged.view(np.uint8), self._event_count, self._frame_count, of["has_state"],
                of["contact_count"], *self._lost, self._has_moved,
                (places["frames"], places["contacts"], places["pose"]), CONTACT.itemsize,
            ),
            Ring(
                ring.records.view(np.uint8).reshape(ring.slots, dtype.itemsize), *ring.counters,
                self._is_open,
            ),
        )  # fmt: skip
        self._publish = Bound(hand_over, *ends)
        self._writer.fill_by(take, *ends)
        self._write = self._writer.write
        of["bus_states"][:] = -1
        self._closed = False
        self._report: dict[str, Any] = {}
        self._transports = transports
        if pipeline.poses[0] is not topology.position:
            self.moved(*pipeline.poses)
        self.start(MODULE, ring, _request(self.file, pipeline), "open", niceness=0)

    # -- called by the loop ------------------------------------------------------------------------

    def frames(self, frames: np.ndarray) -> None:
        """Record frames, shape (m,), FRAME_DTYPE, also those that the pipeline will refuse."""
        if (frames.dtype is not FRAME_DTYPE and frames.dtype != FRAME_DTYPE) or frames.ndim != 1:
            return
        done = self._stage(frames)
        if done == FULL:
            self._publish()
        elif done == NO_ROOM:
            self._take_in_parts(frames)

    def _take_in_parts(self, frames: np.ndarray) -> None:
        """Record more frames than a slot holds."""
        left = frames.size
        while left:
            taken = min(left, self._frames.size - int(self._frame_count[0]))
            done = STAGED
            if taken:
                part = frames[frames.size - left :][:taken]
                left -= taken
                done = (self._stage_part if left else self._stage)(part)
            if left or done == FULL:
                self._publish()

    def closing(self, event: Ending, elapsed_ns: int) -> None:
        """See `Sink.closing`."""
        self._add(int(event), elapsed_ns)

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """See `Sink.moved`."""
        pose = self._pose
        pose[:3], pose[3:] = position, np.reshape(rotation, (9, -1))
        self._has_moved[0] = True
        self._add(MOVED, 0)
        if self._event_count[0]:
            self._publish()  # a slot holds one pose

    def state(self, state: State) -> None:
        """See `Sink.state`."""
        if time.monotonic() >= self.look_at:
            self.look()
            note(self._slot, state, self._transports)
        self._write(state)

    def _add(self, event: int, value: int) -> None:
        count = int(self._event_count[0])
        self._events[count], self._values[count] = event, value
        self._event_count[0] = count + 1
        if count + 1 == EVENTS:
            self._publish()

    @property
    def lost_cycles(self) -> int:
        """Cycles that were not recorded."""
        return int(self._lost[0][0])

    @property
    def lost_frames(self) -> int:
        """Frames that were not recorded."""
        return int(self._lost[1][0])

    @property
    def lost(self) -> int:
        """As `lost_cycles`."""
        return self.lost_cycles

    def left_out(self) -> int:
        """Cycles and frames dropped so far."""
        return self.lost_cycles + self.lost_frames

    def described_loss(self) -> str:
        """The same as text."""
        return f"{self.lost_cycles} cycles and {self.lost_frames} frames"

    def described_end(self, status: int) -> str:
        """Why the recording ended: the error of the disk."""
        why = os.strerror(status) if status in errno.errorcode else f"status {status}"
        return (
            f"{self.file}: must be written to the end of the run; got: {why} (what was written "
            "before can be read, the run goes on)"
        )

    def fail(self) -> None:
        """The recording has ended; the loop continues."""
        self._end()
        super().fail()

    def _end(self) -> None:
        """Stop recording: further cycles are dropped and counted."""
        self._closed, self._is_open[0] = True, False

    # -- the end -----------------------------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """Summary of the recording: ``file``; ``cycles``, ``frames``, ``messages`` and ``bytes`` in
        it; ``cpu_s`` of the worker; dropped ``lost_cycles`` and ``lost_frames``; ``failure``."""
        if not self._closed:
            try:
                self._report = self._worker.ask("report")
            except SkinError:
                self.fail()
        return {"file": str(self.file), **self._report, "lost_cycles": self.lost_cycles,
                "lost_frames": self.lost_frames, "failure": self.failure}  # fmt: skip

    def stop(self) -> None:
        """Write the backlog and end the file; may be called twice."""
        if self._closed:
            self._worker.close()
            return
        if self._event_count[0]:
            self._publish()
        try:
            self._report = self._worker.ask("finish")
            self._end()
        except SkinError:
            self.fail()
        self._worker.close()


def check_new(file: str | os.PathLike[str]) -> None:
    """Require a new file in an existing folder.

    Raises
    ------
    SkinError
        It is not; the message has the reason.
    """
    check_path("record", file, SkinError)
    path = Path(file)
    if path.suffix != ".mcap":
        raise SkinError(f"{path}: must end in .mcap; got {path.suffix or 'no suffix'!r}")
    if os.path.lexists(path):
        raise SkinError(f"{path}: must be a new file; got one that is there already")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise SkinError(f"{path}: must be in a folder that exists; got '{folder}'")
    if not os.access(folder, os.W_OK):
        raise SkinError(f"{path}: must be in a folder that can be written; got '{folder}'")


def _request(file: Path, pipeline: Pipeline) -> dict[str, Any]:
    """The worker's request as JSON, with the attachments of the recording."""
    zeros = None
    if pipeline.zeros_file is not None:
        taken_up = Path(pipeline.zeros_file)
        zeros = taken_up.read_bytes() if taken_up.exists() else b""
    files = attachments(pipeline.topology, pipeline.options, pipeline.deadline_s, zeros)
    return {
        "file": str(file.absolute()),
        **described(pipeline.topology),
        "attached": {name: base64.b64encode(data).decode() for name, data in files.items()},
    }
