"""Snapshots of a running skin: copied by its loop for the view, 30 times a second at most."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.transport import Transport
from skin.io.messages.record import RecordWriter, record_dtype
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
    longest working time of a cycle since the last snapshot, µs. `whole` is 0 where `State.whole` is
    False."""
    return record_dtype(topology, contacts, (("cycles", "i8", ()), ("work_us", "f8", ())))


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
        self._writer = RecordWriter(ring.records, pipeline, transports, knows_poses=False)
        self._ring, self._timing = ring, timing
        self._longest_ns = self._cycles = self._due_ns = 0
        self.taken = self.missed = 0
        self._begin()

    def _begin(self) -> None:
        """A snapshot before the first cycle: poses, and units without frames."""
        at = self._ring.claim()
        if at is not None:
            record = self._ring.records[at : at + 1]
            record["status"], record["cycle"], record["whole"] = Status.NEVER, -1, 1
            record["bus_states"] = -1
            self._writer.poses(at)
            self._ring.publish()

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
        at = self._ring.claim()
        if at is None:
            self.missed += 1
            return True
        self._writer.look()
        self._writer.state(at, state)
        self._writer.poses(at)
        record = self._ring.records[at : at + 1]
        if state.whole is None:  # not wanted
            record["whole"] = 1
        record["cycles"], record["work_us"] = self._cycles, 1e-3 * self._longest_ns
        self._ring.publish()
        self._longest_ns = 0
        self.taken += 1
        return True
