"""Snapshots of a running skin: copied by its loop for the view, 30 times a second at most."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.transport import Transport
from skin.io.messages.record import note, record_dtype
from skin.io.messages.writer import RecordWriter
from skin.state import State, Status
from skin.worker import RingBuffer
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.live import Timing
    from skin.pipeline import Pipeline

__all__ = ["RATE_HZ", "Snapshots", "snapshot_dtype"]

RATE_HZ = 30.0
"""Maximum rate of snapshots: that of an eye [assumed]."""
WORKS = 256
"""Cycles between two snapshots whose working time is recorded: up to 7.6 kHz."""


def snapshot_dtype(topology: Topology, contacts: int) -> np.dtype[Any]:
    """The record of a skin with so many contacts at most, with raw counts, working times in
    microseconds, `moved`, which counts the changes of the poses, and `q`, the joints that they are
    of, NaN where these are unknown. `whole` is 0 where `State.whole` is False."""
    joints = 0 if topology.robot is None else len(topology.robot.joint_names)
    return record_dtype(
        topology,
        contacts,
        (
            ("works", "i8", ()), ("work_us", "f4", (WORKS,)), ("cycles", "i8", ()),
            ("unsent", "i8", ()), ("moved", "i8", ()),
            ("q", "f8", (joints,)),
        ),
        (("counts", "i2", (len(CHANNELS), topology.n)),),
    )  # fmt: skip


class Snapshots:
    """Copies the state of a pipeline into a ring when a snapshot is due.

    A cycle between two snapshots costs two readings of a clock and a number.

    Parameters
    ----------
    ring : RingBuffer
        Of `snapshot_dtype`.
    pipeline : Pipeline
    timing : Timing or None
        Of a live skin.
    transports : sequence of Transport
        Of a live skin.

    Attributes
    ----------
    taken, missed : int
        Snapshots written to the ring, and those dropped because it was full.
    """

    def __init__(
        self,
        ring: RingBuffer,
        pipeline: Pipeline,
        timing: Timing | None,
        transports: Sequence[Transport] = (),
    ) -> None:
        self._record = np.zeros(1, ring.dtype)
        self._writer = RecordWriter(self._record, pipeline.contacts, pipeline.assembler.totals)
        self._transports = transports
        self._ring, self._pipeline, self._timing = ring, pipeline, timing
        self._work_us, self._works, self._cycles = np.zeros(WORKS, np.float32), 0, 0
        self._period_ns, self._due_ns = round(1e9 / RATE_HZ), 0
        self._poses: object = None
        self._moved = 0
        self.taken = self.missed = 0
        self._begin()

    def _begin(self) -> None:
        """A snapshot before the first cycle: poses, and units without frames."""
        record = self._record
        record["status"], record["cycle"], record["whole"] = Status.NEVER, -1, 1
        record["bus_states"] = -1
        claimed = self._ring.claim()
        if claimed is not None:
            self._hand_over(claimed)

    def look(self, state: State) -> bool:
        """Process a cycle; True where a snapshot of it was due."""
        self._cycles += 1
        if self._timing is not None and self._works < WORKS:
            # working time of the cycle before, which includes its own call of this method
            self._work_us[self._works] = 1e-3 * self._timing.work_ns
            self._works += 1
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns
        if self._due_ns <= now_ns:  # late: skipped snapshots are not made up
            self._due_ns = now_ns + self._period_ns
        claimed = self._ring.claim()
        if claimed is None:
            self.missed += 1
            return True
        record = self._record
        self._writer.write(state)
        if state.whole is None:  # not wanted
            record["whole"] = 1
        record["counts"] = self._pipeline.counts
        record["cycles"], record["works"] = self._cycles, self._works
        record["work_us"][0, : self._works] = self._work_us[: self._works]
        record["unsent"] = 0 if self._timing is None else self._timing.unsent
        note(record, state, self._transports)
        self._hand_over(claimed)
        self._works = 0
        self.taken += 1
        return True

    def _hand_over(self, claimed: np.ndarray) -> None:
        """Copy the record into the ring, with the poses where they have changed."""
        poses, record = self._pipeline.poses, self._record
        if poses is not self._poses:
            self._poses = poses
            self._moved += 1
            record["q"] = np.nan if self._pipeline.q is None else self._pipeline.q
            record["pose"][0, :3], record["pose"][0, 3:] = poses[0], poses[1].reshape(9, -1)
        record["moved"] = self._moved
        claimed[:] = record
        self._ring.publish()
