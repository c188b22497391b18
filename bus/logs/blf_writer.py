"""BlfWriter: frames as objects in compressed containers of a BLF file."""

from __future__ import annotations

import contextlib
import os
import zlib
from datetime import datetime, timedelta

import numpy as np

from bus.frame import as_bytes, as_words
from bus.logs import blf_build
from bus.logs.blf import CONTAINER_HEAD, DEFLATED, EPOCH, FILE_HEAD
from bus.logs.blf_kernels import LOG_CONTAINER
from bus.logs.writer import PIECE, LogWriter

__all__ = ["BlfWriter"]

HEAD_BYTES = 144
CONTAINER_BYTES = 128 * 1024
"""Largest uncompressed contents of a container, as in Vector's tools."""
FORMAT = (2, 6, 8, 1)
_MS = 1_000_000


class BlfWriter(LogWriter):
    """Writes CAN and CAN FD frames and error frames as CANoe, CANalyzer and python-can read them.

    Bus 0 is channel 1. The measurement begins at the earliest stamp of the first frames written,
    truncated to 1 ms; a later frame with an earlier stamp gets that of the beginning, since the
    format has no negative times. The totals in the file's head are written on closing; a file
    without them can still be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(path)
        self._start_ns: int | None = None
        self._stop_ns = 0
        self._unpacked_bytes = HEAD_BYTES
        self._blob = np.empty(PIECE * blf_build.MOST_OBJECT_BYTES, np.uint8)
        self._objects = bytearray()
        self._file = self.path.open("wb")
        try:
            self._write_head()
        except OSError:
            with contextlib.suppress(OSError):
                self._file.close()
            raise

    def flush(self) -> None:
        while self._objects:
            self._write_container()
        self._file.flush()

    def close(self) -> None:
        if self._file.closed:
            return
        try:
            self.flush()
            self._write_head()
        finally:
            self._file.close()

    def _append(self, records: np.ndarray) -> None:
        stamps = records["stamp_ns"]
        if self._start_ns is None:
            self._start_ns = int(stamps.min()) // _MS * _MS
            self._stop_ns = self._start_ns
        self._stop_ns = max(self._stop_ns, int(stamps.max()))
        size = blf_build.build(self._blob, as_words(records), as_bytes(records), self._start_ns)
        self._objects += self._blob[:size].data
        while len(self._objects) >= CONTAINER_BYTES:
            self._write_container()

    def _write_container(self) -> None:
        """Write the buffered objects as a container."""
        contents = self._objects[:CONTAINER_BYTES]
        del self._objects[:CONTAINER_BYTES]
        packed = zlib.compress(contents)
        size = CONTAINER_HEAD.size + len(packed)
        self._file.write(
            CONTAINER_HEAD.pack(b"LOBJ", 16, 1, size, LOG_CONTAINER, DEFLATED, len(contents))
        )
        self._file.write(packed)
        # This padding, and not up to a multiple of 4, is what all readers accept.
        self._file.write(bytes(size % 4))
        self._unpacked_bytes += CONTAINER_HEAD.size + len(contents)

    def _write_head(self) -> None:
        """Write the file's head with the current totals, and return to the end."""
        end = max(HEAD_BYTES, self._file.tell())
        dates = _to_date(self._start_ns or 0), _to_date(self._stop_ns)
        head = FILE_HEAD.pack(
            b"LOGG", HEAD_BYTES, 0, 0, 0, 0, *FORMAT, end, self._unpacked_bytes, self.count, 0,
            *dates[0], *dates[1],
        )  # fmt: skip
        self._file.seek(0)
        self._file.write(head.ljust(HEAD_BYTES, b"\0"))
        self._file.seek(end)


def _to_date(stamp_ns: int) -> tuple[int, ...]:
    """A time since 1970 as a SYSTEMTIME, truncated to 1 ms."""
    date: datetime = EPOCH + timedelta(milliseconds=stamp_ns // _MS)
    return (
        date.year, date.month, date.isoweekday() % 7, date.day,
        date.hour, date.minute, date.second, date.microsecond // 1000,
    )  # fmt: skip
