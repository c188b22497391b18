"""Recorder: the loop's end of a recording. It copies into the ring buffer and never waits."""

from __future__ import annotations

import base64
import errno
import logging
import os
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.compiled.bound import Bound, direct
from bus.frame import FRAME_DTYPE
from bus.transport import Transport
from skin.contact.record import CONTACT
from skin.errors import SkinError
from skin.messages.record import described, note
from skin.record.container import require
from skin.record.slot import EVENTS, Event, SlotWriter, slot_dtype
from skin.record.staging import FULL, NO_ROOM, STAGED, Ring, Staged, hand_over, stage
from skin.state import State
from skin.worker import RingBuffer, Worker
from topology import Topology
from topology.files import check_path

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["Recorder", "check_new"]

RING_S = 2.0
"""Time that the ring holds [assumed: a process is not held up for longer]."""
RING_BYTES = 128 << 20
"""Largest ring; of the largest skins it holds less than `RING_S`."""
LEAST_SLOTS = 64
LOOK_S = 0.5
"""Between two looks at the worker and the buses."""
FED, FED_PART, MOVED = map(int, (Event.FED, Event.FED_PART, Event.MOVED))
MODULE = "skin.record.process"

_log = logging.getLogger("skin")


class Recorder:
    """Records what a pipeline is given and what comes of it, in a process of its own.

    Where that process falls behind, whole cycles are left out and counted; where it ends, since the
    disk is full for instance, the logger "skin" says so, and the loop goes on.

    Parameters
    ----------
    file : path
        A new file.
    pipeline : Pipeline
        Before its first cycle.
    attached : mapping of str to bytes
        Files that go into the recording.

    Attributes
    ----------
    failure : str or None
        Why the recording has ended before the loop; None if it has not.

    Raises
    ------
    LibraryError
        The library of the file format is not installed.
    SkinError
        The file is there already, or cannot be written.
    """

    def __init__(
        self, file: str | os.PathLike[str], pipeline: Pipeline, attached: Mapping[str, bytes]
    ) -> None:
        require("record")
        check_new(file)
        topology = pipeline.topology
        self.file = Path(file)
        dtype = slot_dtype(topology)
        self._rate_hz = topology.cycle_rate_hz
        most = min(RING_S * self._rate_hz, RING_BYTES / dtype.itemsize)
        self._ring = ring = RingBuffer(dtype, max(LEAST_SLOTS, round(most)))
        staged = np.zeros(1, dtype)
        self._writer = SlotWriter(staged, pipeline.contacts, pipeline.assembler.totals)
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
        self._writer.hand_over(*ends)
        self._write = self._writer.write
        of["bus_states"][:] = -1
        self._told = 0
        self.failure: str | None = None
        self._closed = False
        self._report: dict[str, Any] = {}
        self._transports: Sequence[Transport] = ()
        self._look_at = 0.0
        self._worker = Worker(
            MODULE, self._ring, _request(self.file, topology, attached), niceness=0
        )
        try:
            self._worker.ask("open")
        except BaseException:
            self._worker.close()
            raise

    def watch(self, transports: Sequence[Transport]) -> None:
        """Write down the states of these buses, too."""
        self._transports = transports

    # -- what the loop does ------------------------------------------------------------------------

    def fed(self, frames: np.ndarray) -> None:
        """The pipeline is given frames, shape (m,), FRAME_DTYPE; others it will refuse."""
        if (frames.dtype is not FRAME_DTYPE and frames.dtype != FRAME_DTYPE) or frames.ndim != 1:
            return
        done = self._stage(frames)
        if done == FULL:
            self._publish()
        elif done == NO_ROOM:
            self._fed_in_parts(frames)

    def _fed_in_parts(self, frames: np.ndarray) -> None:
        """More frames than the slot has room for."""
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

    def closing(self, event: Event, elapsed_ns: int) -> None:
        """The caller's clock, or the end, closes a cycle that is `elapsed_ns` old."""
        self._add(int(event), elapsed_ns)

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """The units have new poses, of shapes (3, n) and (3, 3, n)."""
        pose = self._pose
        pose[:3], pose[3:] = position, np.reshape(rotation, (9, -1))
        self._has_moved[0] = True
        self._add(MOVED, 0)
        if self._event_count[0]:
            self._publish()  # a slot has room for one pose

    def take(self, state: State) -> None:
        """This state has come of it."""
        if (now := time.monotonic()) >= self._look_at:
            self._look_at = now + LOOK_S
            self._look(state)
        self._write(state)

    def _add(self, event: int, value: int) -> None:
        count = int(self._event_count[0])
        self._events[count], self._values[count] = event, value
        self._event_count[0] = count + 1
        if count + 1 == EVENTS:
            self._publish()

    @property
    def lost_cycles(self) -> int:
        """Cycles that were left out of the recording."""
        return int(self._lost[0][0])

    @property
    def lost_frames(self) -> int:
        """Frames that were left out of the recording."""
        return int(self._lost[1][0])

    def _look(self, state: State) -> None:
        """See whether the worker is there, and tell what was lost; note what diagnostics have."""
        if self._closed:
            return
        if not self._worker.alive:
            self._fail()
            return
        if self.lost_cycles + self.lost_frames > self._told:
            self._told = self.lost_cycles + self.lost_frames
            _log.warning("%s: %s", self.file, self._left_out())
        note(self._slot, state, self._transports)

    def _left_out(self) -> str:
        return (
            f"must keep up with {self._rate_hz:g} cycles a second; left out {self.lost_cycles} "
            f"cycles and {self.lost_frames} frames so far"
        )

    def _fail(self) -> None:
        """The recording is over; the loop goes on."""
        self._end()
        status = self._worker.status or 0
        why = os.strerror(status) if status in errno.errorcode else f"status {status}"
        self.failure = (
            f"{self.file}: must be written to the end of the run; got: {why} (what was written "
            "before can be read, the run goes on)"
        )
        _log.warning("%s", self.failure)

    def _end(self) -> None:
        """Take no more: what comes is left out, and counted."""
        self._closed, self._is_open[0] = True, False

    # -- the end -----------------------------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """What was recorded: ``file``; ``cycles``, ``frames``, ``messages`` and ``bytes`` in it;
        ``cpu_s`` that the worker took; ``lost_cycles`` and ``lost_frames`` that were left out;
        ``failure``."""
        if not self._closed:
            try:
                self._report = self._worker.ask("report")
            except SkinError:
                self._fail()
        return {"file": str(self.file), **self._report, "lost_cycles": self.lost_cycles,
                "lost_frames": self.lost_frames, "failure": self.failure}  # fmt: skip

    def close(self) -> None:
        """Write what is left and end the file; closing twice is fine."""
        if self._closed:
            self._worker.close()
            return
        if self._event_count[0]:
            self._publish()
        try:
            self._report = self._worker.ask("finish")
            self._end()
        except SkinError:
            self._fail()
        self._worker.close()


def check_new(file: str | os.PathLike[str]) -> None:
    """Refuse a recording that is there already, and a folder that is not.

    Raises
    ------
    SkinError
        With the reason.
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


def _request(file: Path, topology: Topology, attached: Mapping[str, bytes]) -> dict[str, Any]:
    """What the worker is told, as JSON."""
    return {
        "file": str(file.absolute()),
        **described(topology),
        "attached": {name: base64.b64encode(data).decode() for name, data in attached.items()},
    }
