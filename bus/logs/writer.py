"""LogWriter: frames as lines of candump -L."""

from __future__ import annotations

import gzip
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bus.errors import LogError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.logs.formats import suffix_of
from topology.files import named

__all__ = ["LogWriter"]

_PIECE = 4096
"""Frames that are formatted at once."""
_NAME_BYTES = 64
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_SECOND, _MICROSECOND = 1_000_000_000, 1000


class LogWriter:
    """Writes the same bytes as candump -L; a context manager that closes it.

    Stamps are truncated to 1 µs. The log does not distinguish sent frames from
    received ones, as that of candump -L does not.

    Parameters
    ----------
    path : path
        Ends in .log, or in .log.gz and is compressed; an existing file is overwritten.
    channels : sequence of str, optional
        Name of the interface of each bus; by default can0, can1, …

    Attributes
    ----------
    count : int
        Frames written.

    Raises
    ------
    LogError
        Another suffix.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        channels: Sequence[str] | None = None,
    ) -> None:
        packed = suffix_of(path, (".log", ".log.gz")) == ".log.gz"
        self.path = Path(path)
        self.count = 0
        names = [f"can{i}" for i in range(256)] if channels is None else list(channels)
        self._names = names
        for i, name in enumerate(names):
            encoded = name.encode()
            if not 0 < len(encoded) < _NAME_BYTES or min(encoded) <= ord(" "):
                raise ValueError(
                    f"channels[{i}]: must be a name of 1 to {_NAME_BYTES - 1} bytes without "
                    f"blanks; got {name!r}"
                )
        with named(self.path):
            self._file = gzip.open(self.path, "wb") if packed else self.path.open("wb")

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
            for first in range(0, records.size, _PIECE):
                lines = self._lines(records[first : first + _PIECE])
                self._file.write("".join(lines).encode())
        self.count += records.size

    def close(self) -> None:
        """Write the rest and close the file; may be called twice."""
        self._file.close()

    def _lines(self, records: np.ndarray) -> Iterator[str]:
        """Frames as lines of candump -L."""
        payload = records["data"].tobytes()
        names = ("stamp_ns", "id", "length", "flags", "bus")
        columns = (records[name].tolist() for name in names)
        for i, (stamp, can_id, length, flags, bus) in enumerate(zip(*columns, strict=True)):
            if can_id & (CAN_ERR | CAN_EFF):
                identifier = f"{can_id & (0x3FFF_FFFF if can_id & CAN_ERR else 0x1FFF_FFFF):08X}"
            else:
                identifier = f"{can_id & 0x7FF:03X}"
            data = payload[_FD_BYTES * i : _FD_BYTES * i + length].hex().upper()
            if flags & FD_FDF:
                data = f"#{flags & 15:X}{data}"
            elif can_id & CAN_RTR:
                data = f"R{length or ''}"
            seconds, rest = divmod(stamp, _SECOND)
            time = f"{seconds:010d}.{rest // _MICROSECOND:06d}"
            yield f"({time}) {self._names[bus]} {identifier}#{data}\n"

    def _check(self, records: np.ndarray) -> None:
        """Raise for the first frame that is none."""
        fd = records["flags"] & FD_FDF > 0
        limit = np.where(fd, _FD_BYTES, _CLASSIC_BYTES)
        for wrong, expected, name in (
            (records["length"] > limit, "at most 8 data bytes, or 64 in a CAN FD frame", "length"),
            (fd & (records["id"] & (CAN_RTR | CAN_ERR) > 0),
             "a data frame where it is a CAN FD one", "id"),
            (records["bus"] >= len(self._names),
             f"of a bus with a name, below {len(self._names)}", "bus"),
            (records["stamp_ns"] < 0, "of a time since 1970", "stamp_ns"),
        ):  # fmt: skip
            if wrong.any():
                i = int(wrong.argmax())
                where = f"frame {self.count + i}"
                raise LogError(f"{self.path}: {where}: must be {expected}; got {records[name][i]}")
