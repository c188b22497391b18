"""FrameBatch: frames as one structured array, the same from a live bus, a log and the simulator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = [
    "CAN_EFF",
    "CAN_ERR",
    "CAN_RTR",
    "ECHO",
    "FD_BRS",
    "FD_ESI",
    "FD_FDF",
    "FD_LENGTHS",
    "FRAME_DTYPE",
    "FrameBatch",
    "FrameViews",
    "as_bytes",
    "as_words",
    "views",
]

CAN_EFF = 0x8000_0000
"""Bit of `id`: 29-bit identifier."""
CAN_RTR = 0x4000_0000
"""Bit of `id`: remote frame."""
CAN_ERR = 0x2000_0000
"""Bit of `id`: error frame; the lower bits are the error class."""

FD_BRS = 1
"""Bit of `flags`: data phase at the second bit rate."""
FD_ESI = 2
"""Bit of `flags`: the sender is error-passive."""
FD_FDF = 4
"""Bit of `flags`: CAN FD frame."""
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data bytes of a CAN FD frame by its length code."""
ECHO = 1
"""Bit of `origin`: this host sent the frame itself."""

FRAME_DTYPE = np.dtype(
    [
        ("stamp_ns", "<i8"),
        ("id", "<u4"),
        ("length", "u1"),
        ("flags", "u1"),
        ("origin", "u1"),
        ("bus", "u1"),
        ("data", "u1", (64,)),
    ]
)
"""One frame, 80 bytes. From `id` on it is the kernel's `struct canfd_frame`, byte for byte, so that
`recvmmsg` can write into a batch; `origin` and `bus` are in that struct's two reserved bytes. Bytes
of `data` past `length` are undefined."""
LENGTH_AT, FLAGS_AT, ORIGIN_AT, BUS_AT, PAYLOAD = 12, 13, 14, 15, 16
"""Offsets of these fields in a record; PAYLOAD is that of the first data byte."""
_WORDS = np.dtype((np.int64, FRAME_DTYPE.itemsize // 8))
_BYTES = np.dtype((np.uint8, FRAME_DTYPE.itemsize))


class FrameBatch:
    """A buffer of frames that is filled, read and cleared without allocation.

    Parameters
    ----------
    capacity : int
        Maximum number of frames.

    Attributes
    ----------
    records : ndarray, shape (capacity,), FRAME_DTYPE
        The buffer itself; the first `count` records are valid.
    count : int
        Number of valid frames.
    """

    __slots__ = ("count", "records")

    def __init__(self, capacity: int = 1024) -> None:
        self.records = np.zeros(capacity, FRAME_DTYPE)
        self.count = 0

    def __len__(self) -> int:
        return self.count

    @property
    def capacity(self) -> int:
        """Number of frames that fit."""
        return self.records.size

    @property
    def room(self) -> int:
        """Number of frames that still fit."""
        return self.records.size - self.count

    @property
    def frames(self) -> np.ndarray:
        """View of the valid records, shape (count,)."""
        return self.records[: self.count]

    def clear(self) -> None:
        """Remove all frames."""
        self.count = 0

    def append(
        self,
        can_id: int,
        data: bytes,
        *,
        stamp_ns: int = 0,
        flags: int = 0,
        origin: int = 0,
        bus: int = 0,
    ) -> None:
        """Add one frame.

        Raises
        ------
        IndexError
            The batch is full.
        ValueError
            More than 64 bytes of data.
        """
        if len(data) > 64:
            raise ValueError(f"data: must be at most 64 bytes; got {len(data)}")
        if self.count == self.records.size:
            raise IndexError(f"batch is full ({self.records.size} frames)")
        record = self.records[self.count]
        record["stamp_ns"] = stamp_ns
        record["id"] = can_id
        record["length"] = len(data)
        record["flags"] = flags
        record["origin"] = origin
        record["bus"] = bus
        record["data"][: len(data)] = np.frombuffer(data, np.uint8)
        self.count += 1

    def extend(self, records: np.ndarray) -> int:
        """Copy as many of `records` as fit; returns their number."""
        taken = min(self.room, records.size)
        self.records[self.count : self.count + taken] = records[:taken]
        self.count += taken
        return taken

    def merge(self) -> None:
        """Sort the frames of several buses, received one bus after the other, by time.

        The order of each bus stays as it is, even where its stamps step back.
        """
        frames = self.frames
        stamps = frames["stamp_ns"].copy()
        if (stamps[1:] >= stamps[:-1]).all():
            return
        for bus in np.unique(frames["bus"]):
            mine = frames["bus"] == bus
            stamps[mine] = np.maximum.accumulate(stamps[mine])
        frames[:] = frames[np.argsort(stamps, kind="stable")]


class FrameViews(NamedTuple):
    """Two views of the same m records, for kernels."""

    words: np.ndarray
    """Shape (m, 10), int64: column 0 is the time stamp; column 1 holds identifier, length, flags,
    origin and bus, from the lowest byte up; the others hold the data."""
    data: np.ndarray
    """Shape (m, 80), uint8: everything byte by byte."""


def views(records: np.ndarray) -> FrameViews:
    """Views of FRAME_DTYPE records, shape (m,), contiguous."""
    return FrameViews(as_words(records), as_bytes(records))


def as_words(records: np.ndarray) -> np.ndarray:
    """View of FRAME_DTYPE records, shape (m,), contiguous, as int64, shape (m, 10)."""
    return records.view(_WORDS)


def as_bytes(records: np.ndarray) -> np.ndarray:
    """View of FRAME_DTYPE records, shape (m,), contiguous, as uint8, shape (m, 80)."""
    return records.view(_BYTES)
