"""LogWriter: base class of all writers."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from bus.errors import LogError
from bus.frame import CAN_ERR, CAN_RTR, FD_FDF, FRAME_DTYPE, FrameBatch
from topology.files import named

__all__ = ["PIECE", "LogWriter"]

PIECE = 4096
"""Maximum number of frames per call of `_append`."""
_CLASSIC_BYTES, _FD_BYTES = 8, 64


class LogWriter(ABC):
    """Writes frames to a log file; a context manager that closes it.

    Parameters
    ----------
    path : path
        An existing file is overwritten.

    Attributes
    ----------
    count : int
        Frames written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.count = 0

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *_: object) -> None:
        with named(self.path):
            self.close()

    def write(self, frames: FrameBatch | np.ndarray) -> None:
        """Append frames.

        Parameters
        ----------
        frames : FrameBatch, or ndarray, shape (m,), FRAME_DTYPE

        Raises
        ------
        LogError
            One of them is not a CAN frame, or its bus has no name; none is written then.
        OSError
            The disk is full; it names the file.
        """
        records = frames.frames if isinstance(frames, FrameBatch) else frames
        records = np.ascontiguousarray(records, FRAME_DTYPE)
        self._check(records)
        with named(self.path):
            for first in range(0, records.size, PIECE):
                self._append(records[first : first + PIECE])
        self.count += records.size

    @abstractmethod
    def flush(self) -> None:
        """Pass all data to the operating system, so that they survive a crash of this process."""

    @abstractmethod
    def close(self) -> None:
        """Write the rest and close the file; may be called twice."""

    @abstractmethod
    def _append(self, records: np.ndarray) -> None:
        """Write valid frames, at most `PIECE`."""

    def _check(self, records: np.ndarray) -> None:
        fd = records["flags"] & FD_FDF > 0
        limit = np.where(fd, _FD_BYTES, _CLASSIC_BYTES)
        self._refuse(
            records["length"] > limit, "at most 8 data bytes, or 64 in a CAN FD frame",
            records["length"],
        )  # fmt: skip
        self._refuse(
            fd & (records["id"] & (CAN_RTR | CAN_ERR) > 0), "a data frame where it is a CAN FD one",
            records["id"],
        )  # fmt: skip

    def _refuse(self, wrong: np.ndarray, expected: str, values: np.ndarray) -> None:
        """Raise for the first invalid frame."""
        if wrong.any():
            i = int(wrong.argmax())
            where = f"frame {self.count + i}"
            raise LogError(f"{self.path}: {where}: must be {expected}; got {values[i]}")
