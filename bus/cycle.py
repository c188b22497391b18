"""RawCycle: the counts of all units at one SYNC, with what is known about each."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

__all__ = ["ClosedBy", "FrameCounters", "RawCycle"]


class ClosedBy(StrEnum):
    """What ended a cycle."""

    COMPLETE = "complete"
    SYNC = "sync"
    DEADLINE = "deadline"
    END = "end"
    """The log or the caller ended it."""


@dataclass
class FrameCounters:
    """Frames by what became of them, since the assembler was made.

    Every received frame is counted once, in exactly one of these but `lost`, which counts frames
    that never came.
    """

    data: int = 0
    """Data frames taken."""
    sync: int = 0
    heartbeat: int = 0
    configuration: int = 0
    """What another host told boards to do; this host's own that came back are echoes."""
    late: int = 0
    """Data frames of a cycle that was closed already."""
    repeated: int = 0
    """The same sequence number a second time."""
    torn: int = 0
    """Frames of units whose other frames of the cycle never came."""
    short: int = 0
    """Wrong length, or a classic frame where CAN FD is due (and the reverse)."""
    foreign: int = 0
    """Identifiers that the topology does not know."""
    remote: int = 0
    error: int = 0
    """Error frames of the controller."""
    crc: int = 0
    """Data frames that failed their CRC."""
    echo: int = 0
    """Frames of this host's own that came back."""
    lost: int = 0
    """Gaps in the sequence numbers."""
    controller_overflow: int = 0
    """Error frames that report a full controller (counted in `error` too)."""


WRONG_FRAMES = ("lost", "late", "repeated", "torn", "short", "crc", "foreign", "error")
"""Fields of `FrameCounters` that count something wrong: what tables and messages warn of."""


@dataclass
class RawCycle:
    """One cycle over all units. The arrays are the assembler's own, valid until its next cycle.

    Attributes
    ----------
    number : int
        SYNC number, counted on from the first one without wrapping.
    stamp_ns : int
        Time stamp of the SYNC, or of the first frame where there is none.
    closed_by : ClosedBy
        What ended the cycle.
    counts : ndarray, shape (c, n), int16
        Raw channels (`topology.CHANNELS`); a unit that is missing keeps its last counts.
    valid : ndarray, shape (n,), bool
        Fresh, whole and healthy: no flag of `bus.status.INVALID`.
    status : ndarray, shape (n,), uint16
        `bus.status.Status` flags.
    age : ndarray, shape (n,), int32
        Cycles since the last good reading, 0 for this one, -1 for never.
    sequence : ndarray, shape (n,), uint8
        Last sequence number of the frame that carries the unit.
    fault_code : ndarray, shape (n,), uint8
        The unit's own status field.
    counters : FrameCounters
        Totals up to this cycle.
    stuck : ndarray, shape (n,), uint8
        Bit c: channel c stands still, by which the unit is FROZEN; see `bus.assemble.still`.
    sampled_ns : ndarray, shape (n,), int64
        Time stamp of when each unit took what it shows: that of the SYNC of its bus, or, without
        SYNC, of its frame; -1 for never.
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
    counters: FrameCounters = field(default_factory=FrameCounters)
    stuck: np.ndarray = field(default_factory=lambda: np.zeros(0, np.uint8))
    sampled_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
