"""The last minute of snapshots, as the view keeps them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

__all__ = ["History", "Moment", "Pose"]

NOT_KEPT = ("position", "rotation", "work_us", "works")
"""Fields of a snapshot that are taken out as it comes; they stand at its end."""


class Pose(NamedTuple):
    """Where the units are: position, shape (3, n), metre; rotation, shape (3, 3, n)."""

    position: np.ndarray
    rotation: np.ndarray


class Moment(NamedTuple):
    """One snapshot that is kept."""

    record: np.void
    """Fields of `skin.view.snapshot.snapshot_dtype`, but those of `NOT_KEPT`."""
    pose: Pose

    @property
    def time_s(self) -> float:
        """Time stamp of its cycle."""
        return 1e-9 * float(self.record["stamp_ns"])


class History:
    """A ring of snapshots, oldest first.

    Parameters
    ----------
    dtype : dtype
        Of the snapshots that come.
    length : int
        Snapshots that are kept.
    """

    def __init__(self, dtype: np.dtype[Any], length: int) -> None:
        names = [name for name in dtype.names or () if name not in NOT_KEPT]
        kept = np.dtype([(name, dtype[name]) for name in names])
        if names != list(dtype.names or ())[: len(names)]:
            raise ValueError(f"dtype: must have {', '.join(NOT_KEPT)} at its end; got {dtype}")
        self._ring = np.zeros(length, kept)
        self._bytes = self._ring.view(np.uint8).reshape(length, kept.itemsize)
        self._poses: list[Pose | None] = [None] * length
        self._pose, self._moved = Pose(np.zeros((3, 0)), np.zeros((3, 3, 0))), -1
        self.count = 0

    def __len__(self) -> int:
        return min(self.count, len(self._ring))

    def add(self, snapshot: np.void) -> None:
        """Keep one more; of a full ring the oldest goes."""
        if snapshot["moved"] != self._moved:
            self._moved = int(snapshot["moved"])
            self._pose = Pose(snapshot["position"].copy(), snapshot["rotation"].copy())
        at = self.count % len(self._ring)
        self._bytes[at] = np.frombuffer(snapshot, np.uint8, self._bytes.shape[1])
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

    def back(self, seconds: float) -> Moment:
        """The snapshot that many seconds before the newest, or the next later one."""
        stamps = self.values("stamp_ns")
        at = int(np.searchsorted(stamps, stamps[-1] - round(1e9 * seconds)))
        return self[min(at, len(self) - 1)]

    def stretch(self, until: Moment, seconds: float) -> list[Moment]:
        """Snapshots of that many seconds up to a moment, the moment included."""
        stamps = self.values("stamp_ns")
        end = int(until.record["stamp_ns"])
        first, last = np.searchsorted(stamps, [end - round(1e9 * seconds), end])
        return [self[i] for i in range(int(first), min(int(last) + 1, len(self)))]

    @property
    def span_s(self) -> float:
        """Seconds from the oldest to the newest."""
        stamps = self.values("stamp_ns")
        return 1e-9 * float(stamps[-1] - stamps[0]) if stamps.size else 0.0
