"""RawCycle: the counts of all units at one SYNC, with their status."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

__all__ = ["ClosedBy", "FrameCounters", "RawCycle"]


class ClosedBy(StrEnum):
    """Reasons for the end of a cycle."""

    COMPLETE = "complete"
    SYNC = "sync"
    DEADLINE = "deadline"
    END = "end"
    """The log or the caller ended it."""


@dataclass
class FrameCounters:
    """Counts of frames by outcome, since the assembler was made.

    Every received frame is counted once, in exactly one of these; `lost` counts frames that never
    came.
    """

    data: int = 0
    """Data frames taken."""
    sync: int = 0
    heartbeat: int = 0
    configuration: int = 0
    """Commands of another host to boards."""
    late: int = 0
    """Data frames of a cycle that was already closed."""
    repeated: int = 0
    """Repeated sequence numbers."""
    torn: int = 0
    """Frames of incomplete sets of a unit."""
    short: int = 0
    """Wrong length, or a classic frame where CAN FD is due (and the reverse)."""
    foreign: int = 0
    """Unknown identifiers."""
    remote: int = 0
    error: int = 0
    """Error frames of the controller."""
    crc: int = 0
    """Data frames that failed their CRC."""
    echo: int = 0
    """This host's own frames that returned."""
    lost: int = 0
    """Gaps in the sequence numbers. Where these are those of SYNC, a cycle whose SYNC did not come
    is no gap: nobody was asked. Periods that a host left out are overruns of the skin."""
    controller_overflow: int = 0
    """Error frames that report a full controller (counted in `error` too)."""


WRONG_FRAMES = ("lost", "late", "repeated", "torn", "short", "crc", "foreign", "error")
"""Fields of `FrameCounters` that are faults, which tables and messages report."""


@dataclass
class RawCycle:
    """One cycle over all units. The arrays are the assembler's own, valid until its next cycle.

    Attributes
    ----------
    number : int
        SYNC number, unwrapped.
    stamp_ns : int
        Time stamp of the SYNC, or of the first frame where there is none.
    closed_by : ClosedBy
        Reason for the end of the cycle.
    counts : ndarray, shape (c, n), int16
        Raw channels (`topology.CHANNELS`); a missing unit keeps its last counts.
    valid : ndarray, shape (n,), bool
        Fresh, complete and healthy: no flag of `bus.status.INVALID`.
    status : ndarray, shape (n,), uint16
        `bus.status.Status` flags.
    age : ndarray, shape (n,), int32
        Cycles since the last good reading, 0 for this one, -1 for never.
    sequence : ndarray, shape (n,), uint8
        Last sequence number of the frame that carries the unit.
    fault_code : ndarray, shape (n,), uint8
        The unit's own status field.
    totals : ndarray, shape (15,), int64
        Counts of frames by outcome up to this cycle, in the order of `FrameCounters`.
    stuck : ndarray, shape (n,), uint8
        Bit c: channel c is stuck, so the unit is FROZEN; see `bus.assemble.stuck_channels`.
    sampled_ns : ndarray, shape (n,), int64
        Time stamp of the values of each unit: that of the SYNC of its bus or, without SYNC, of its
        frame; -1 for never.
    """

    number: int
    stamp_ns: int
    closed_by: ClosedBy
    counts: np.ndarray
    valid: np.ndarray
    status: np.ndarray
    age: np.ndarray
    sequence: np.ndarray
    fault_code: np.ndarray
    totals: np.ndarray = field(default_factory=lambda: np.zeros(15, np.int64))
    stuck: np.ndarray = field(default_factory=lambda: np.zeros(0, np.uint8))
    sampled_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def counters(self) -> FrameCounters:
        """`totals` by name."""
        return FrameCounters(*self.totals.tolist())
