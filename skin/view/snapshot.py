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
from topology import Topology

if TYPE_CHECKING:
    from skin.live import Timing
    from skin.pipeline import Pipeline

__all__ = ["RATE_HZ", "Snapshots", "snapshot_dtype"]

RATE_HZ = 30.0
"""Maximum rate of snapshots: that of an eye [assumed]."""
PERIOD_NS = round(1e9 / RATE_HZ)


def snapshot_dtype(topology: Topology, contacts: int) -> np.dtype[Any]:
    """The record of a skin with so many contacts at most, the number of cycles so far, and the
    longest working time of a cycle since the last snapshot, µs; `moved` counts the changes of the
    poses, and `q` has the joints that they are of, NaN where these are unknown. `whole` is 0 where
    `State.whole` is False."""
    joints = 0 if topology.robot is None else len(topology.robot.joint_names)
    return record_dtype(
        topology,
        contacts,
        (("cycles", "i8", ()), ("work_us", "f8", ()), ("moved", "i8", ()), ("q", "f8", (joints,))),
    )


class Snapshots:
    """Copies the state of a pipeline into a ring when a snapshot is due.

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
        self._record = record = np.zeros(1, ring.dtype)
        self._writer = RecordWriter(record, pipeline.contacts, pipeline.assembler.totals)
        self._transports = transports
        self._ring, self._pipeline, self._timing = ring, pipeline, timing
        self._longest_ns = self._cycles = self._due_ns = self._moved = 0
        self._poses: object = None
        self.taken = self.missed = 0
        # before the first cycle: poses, and units without frames
        record["status"], record["cycle"], record["whole"] = Status.NEVER, -1, 1
        record["bus_states"] = -1
        self._hand_over()

    def look(self, state: State) -> bool:
        """Process a cycle; True where a snapshot of it was due."""
        self._cycles += 1
        if self._timing is not None:  # of the cycle before, which includes its call of this method
            self._longest_ns = max(self._longest_ns, self._timing.work_ns)
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._due_ns += PERIOD_NS
        if self._due_ns <= now_ns:  # late: skipped snapshots are not made up
            self._due_ns = now_ns + PERIOD_NS
        if self._ring.waiting >= self._ring.slots:
            self.missed += 1
            return True
        record = self._record
        self._writer.write(state)
        if state.whole is None:  # not wanted
            record["whole"] = 1
        record["cycles"], record["work_us"] = self._cycles, 1e-3 * self._longest_ns
        note(record, state, self._transports)
        self._hand_over()
        self._longest_ns = 0
        self.taken += 1
        return True

    def _hand_over(self) -> None:
        """Copy the record into the ring, with the poses where they have changed."""
        claimed = self._ring.claim()
        if claimed is None:
            return
        poses, record = self._pipeline.poses, self._record
        if poses is not self._poses:
            self._poses = poses
            self._moved += 1
            record["q"] = np.nan if self._pipeline.q is None else self._pipeline.q
            record["pose"][0, :3], record["pose"][0, 3:] = poses[0], poses[1].reshape(9, -1)
        record["moved"] = self._moved
        claimed[:] = record
        self._ring.publish()
