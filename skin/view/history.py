"""The last minute of snapshots, stored for the view."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

__all__ = ["History", "Moment", "Pose"]

NOT_KEPT = ("works", "work_us", "pose", "padding")
"""Fields of a snapshot that are not stored; they are at its ends."""


class Pose(NamedTuple):
    """Pose of the units: position, shape (3, n), metre; rotation, shape (3, 3, n); and the joints
    that it is of, shape (J,), rad or m, NaN where unknown."""

    position: np.ndarray
    rotation: np.ndarray
    q: np.ndarray = np.zeros(0)


class Moment(NamedTuple):
    """A stored snapshot."""

    record: np.void
    """Fields of `skin.view.snapshot.snapshot_dtype` except those of `NOT_KEPT`."""
    pose: Pose

    @property
    def time_s(self) -> float:
        """Time stamp of its cycle."""
        return 1e-9 * float(self.record["stamp_ns"])


class History:
    """A ring buffer of snapshots, oldest first.

    Parameters
    ----------
    dtype : dtype
        Of the incoming snapshots.
    length : int
        Capacity in snapshots.
    """

    def __init__(self, dtype: np.dtype[Any], length: int) -> None:
        fields: Any = dtype.fields or {}
        names = [name for name in dtype.names or () if name not in NOT_KEPT]
        kept = np.dtype([(name, fields[name][0]) for name in names])
        self._first, last = fields[names[0]][1], fields[names[-1]][1]
        ends: Any = kept.fields
        if last != self._first + ends[names[-1]][1]:
            raise ValueError(f"dtype: must have {', '.join(NOT_KEPT)} at its ends; got {dtype}")
        self._ring = np.zeros(length, kept)
        self._bytes = self._ring.view(np.uint8).reshape(length, kept.itemsize)
        self._poses: list[Pose | None] = [None] * length
        self._pose, self._moved = Pose(np.zeros((3, 0)), np.zeros((3, 3, 0))), -1
        self.count = 0

    def __len__(self) -> int:
        return min(self.count, len(self._ring))

    def add(self, snapshot: np.void) -> None:
        """Store a snapshot; a full ring drops the oldest."""
        if snapshot["moved"] != self._moved:
            self._moved = int(snapshot["moved"])
            pose = snapshot["pose"].astype(np.float32)
            self._pose = Pose(pose[:3], pose[3:].reshape(3, 3, -1), snapshot["q"].copy())
        at = self.count % len(self._ring)
        self._bytes[at] = np.frombuffer(snapshot, np.uint8, self._bytes.shape[1], self._first)
        self._poses[at] = self._pose
        self.count += 1

    def __getitem__(self, i: int) -> Moment:
        """Snapshot i, 0 the oldest, -1 the newest."""
        length = len(self)
        if not -length <= i < length:
            raise IndexError(i)
        at = (self.count - length + i % length) % len(self._ring)
        pose = self._poses[at]
        assert pose is not None
        return Moment(self._ring[at], pose)

    def values(self, name: str, last: int | None = None) -> np.ndarray:
        """A field of all snapshots, or of the `last` ones, oldest first; a copy."""
        length = len(self) if last is None else min(last, len(self))
        return self._ring[name][(self.count - length + np.arange(length)) % len(self._ring)]

    def of_unit(self, name: str, unit: int, last: int) -> np.ndarray:
        """A field of one unit in the `last` snapshots, oldest first, shape (m, …); a copy."""
        length = min(last, len(self))
        at = (self.count - length + np.arange(length)) % len(self._ring)
        return self._ring[name][at, ..., unit]

    def back(self, seconds: float) -> Moment:
        """The snapshot so many seconds before the newest, or the next later one."""
        stamps = self.values("stamp_ns")
        at = int(np.searchsorted(stamps, stamps[-1] - round(1e9 * seconds)))
        return self[min(at, len(self) - 1)]

    def stretch(self, until: Moment, seconds: float) -> list[Moment]:
        """Snapshots of so many seconds up to and including one."""
        stamps = self.values("stamp_ns")
        end = int(until.record["stamp_ns"])
        first, last = np.searchsorted(stamps, [end - round(1e9 * seconds), end])
        return [self[i] for i in range(int(first), min(int(last) + 1, len(self)))]

    @property
    def span_s(self) -> float:
        """Seconds from the oldest to the newest."""
        stamps = self.values("stamp_ns")
        return 1e-9 * float(stamps[-1] - stamps[0]) if stamps.size else 0.0
