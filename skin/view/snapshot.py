"""Snapshots of a running skin: what its loop copies for the view, 30 times a second at most."""

from __future__ import annotations

import time
from dataclasses import astuple, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import FrameCounters
from skin.state import State, Status
from skin.worker import RingBuffer
from topology import CHANNELS

if TYPE_CHECKING:
    from skin.live import Timing
    from skin.pipeline import Pipeline

__all__ = ["CONTACTS", "COUNTERS", "RATE_HZ", "Snapshots", "fill", "snapshot_dtype"]

RATE_HZ = 30.0
"""Snapshots a second, at most: what an eye follows [assumed]."""
CONTACTS = 16
"""Contacts of a snapshot: as many as the stream tells apart; of more, the oldest."""
WORKS = 256
"""Cycles between two snapshots whose working time is told: up to 7.6 kHz."""
COUNTERS = tuple(field.name for field in fields(FrameCounters))
"""Order of the counters of frames."""

OF_CONTACT = ("id", "load", "wrench", "centroid", "normal", "slip", "margin", "flags")
"""What is told of a contact, as its record names it."""


def snapshot_dtype(n: int) -> np.dtype[Any]:
    """The record of a snapshot of n units.

    Metre, newton, newton metre, degree Celsius, microsecond; unit frames for `force` and its
    `sigma` (of the normal component), skin frame for contacts. What is not wanted of the skin is
    NaN. `whole` is False where `State.whole` is, and True where that is not wanted. `moved` counts
    the changes of the poses. What is kept of a snapshot stands first, see
    `skin.view.history.NOT_KEPT`.
    """
    return np.dtype(
        [
            ("cycle", np.int64), ("stamp_ns", np.int64), ("cycles", np.int64),
            ("force", np.float32, (3, n)), ("sigma", np.float32, (n,)),
            ("temperature", np.float32, (n,)), ("test_ratio", np.float32, (n,)),
            ("counts", np.int16, (len(CHANNELS), n)),
            ("status", np.uint16, (n,)), ("label", np.int32, (n,)),
            ("wrench", np.float64, (6,)), ("whole", np.bool_), ("contacts", np.int32),
            ("contact_id", np.int64, (CONTACTS,)), ("contact_load", np.float32, (CONTACTS,)),
            ("contact_wrench", np.float32, (CONTACTS, 6)),
            ("contact_centroid", np.float32, (CONTACTS, 3)),
            ("contact_normal", np.float32, (CONTACTS, 3)),
            ("contact_slip", np.int32, (CONTACTS,)), ("contact_margin", np.float32, (CONTACTS,)),
            ("contact_flags", np.int64, (CONTACTS,)),
            ("counters", np.int64, (len(COUNTERS),)), ("overruns", np.int64),
            ("unsent", np.int64), ("moved", np.int64), ("works", np.int32),
            ("work_us", np.float32, (WORKS,)), ("position", np.float32, (3, n)),
            ("rotation", np.float32, (3, 3, n)),
        ]
    )  # fmt: skip


def fill(record: np.ndarray, state: State) -> None:
    """Copy a state into a snapshot, shape (1,); counts, times and poses are not its own."""
    units, contacts = state.units, state.contacts or ()
    record["cycle"], record["stamp_ns"] = state.cycle, state.stamp_ns
    record["status"] = units.status
    record["counters"] = astuple(state.counters)
    record["overruns"] = state.overruns
    record["force"] = np.nan if units.force is None else units.force
    record["sigma"] = np.nan if units.force_sigma is None else units.force_sigma[2]
    record["temperature"] = np.nan if units.temperature is None else units.temperature
    record["test_ratio"] = np.nan if units.test_ratio is None else units.test_ratio
    record["label"] = -1 if state.label is None else state.label
    record["wrench"] = np.nan if state.wrench is None else state.wrench
    record["whole"] = state.whole is not False
    record["contacts"] = min(len(contacts), CONTACTS)
    for k, contact in enumerate(contacts[:CONTACTS]):
        for name in OF_CONTACT:
            record[f"contact_{name}"][0, k] = contact.record[name]


class Snapshots:
    """Watches a pipeline, and puts a snapshot into a ring when the next one is due.

    A cycle between two snapshots costs two readings of a clock and a number.

    Parameters
    ----------
    ring : RingBuffer
        Of `snapshot_dtype`.
    pipeline : Pipeline
    timing : Timing or None
        Of a live skin.

    Attributes
    ----------
    taken, missed : int
        Snapshots that the ring took, and those for which it had no room.
    """

    def __init__(self, ring: RingBuffer, pipeline: Pipeline, timing: Timing | None) -> None:
        self._ring, self._pipeline, self._timing = ring, pipeline, timing
        self._work_us, self._works, self._cycles = np.zeros(WORKS, np.float32), 0, 0
        self._period_ns, self._due_ns = round(1e9 / RATE_HZ), 0
        self._poses: object = None
        self._moved = 0
        self.taken = self.missed = 0
        self._begin()

    def _begin(self) -> None:
        """A snapshot before the first cycle: poses, and units that were never heard."""
        record = self._ring.claim()
        if record is None:
            return
        record[:] = np.zeros((), record.dtype)
        record["status"], record["cycle"] = Status.NEVER, -1
        for name in ("force", "sigma", "temperature", "test_ratio", "wrench"):
            record[name] = np.nan
        record["label"], record["whole"] = -1, True
        self._pose(record)
        self._ring.publish()

    def look(self, state: State) -> bool:
        """Note a cycle; True where a snapshot was taken of it."""
        self._cycles += 1
        if self._timing is not None and self._works < WORKS:
            # that of the cycle before, which had this look in it
            self._work_us[self._works] = 1e-3 * self._timing.work_ns
            self._works += 1
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns
        if self._due_ns <= now_ns:  # late: no second one to catch up
            self._due_ns = now_ns + self._period_ns
        record = self._ring.claim()
        if record is None:
            self.missed += 1
            return False
        fill(record, state)
        record["counts"] = self._pipeline.counts
        record["cycles"], record["works"] = self._cycles, self._works
        record["work_us"][0, : self._works] = self._work_us[: self._works]
        record["unsent"] = 0 if self._timing is None else self._timing.unsent
        self._pose(record)
        self._ring.publish()
        self._works = 0
        self.taken += 1
        return True

    def _pose(self, record: np.ndarray) -> None:
        """Copy the poses, where they are others than in the snapshot before."""
        poses = self._pipeline.poses
        if poses is not self._poses:
            self._poses = poses
            self._moved += 1
            record["position"], record["rotation"] = poses
        record["moved"] = self._moved
