"""LogWriter: frames as lines of candump -L."""

from __future__ import annotations

import gzip
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numba import types

from bus.compiled.jit import compiled, jitable
from bus.errors import LogError
from bus.frame import (
    BUS_AT,
    CAN_EFF,
    CAN_ERR,
    CAN_RTR,
    ECHO,
    FD_FDF,
    FLAGS_AT,
    FRAME_DTYPE,
    LENGTH_AT,
    ORIGIN_AT,
    PAYLOAD,
    FrameBatch,
    as_bytes,
    as_words,
)
from bus.logs.candump_kernels import (
    ERROR_LIMIT,
    EXTENDED_LIMIT,
    NAME_BYTES,
    STANDARD_LIMIT,
    S,
)  # fmt: skip
from topology.files import named

__all__ = ["LogWriter"]

_PIECE = 4096
"""Frames that are formatted at once."""
_LINE_BYTES = 256
"""Upper bound of the length of a line: stamp 20, name 64, identifier 9, flags 2, data 128."""
_SECOND_DIGITS, _MICROSECOND_DIGITS, _MICROSECOND = 10, 6, 1000
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_NEWLINE, _BLANK, _OPEN, _CLOSE, _POINT, _ZERO, _HASH, _R, _T = b"\n ().0#RT"
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)


class LogWriter:
    """Writes the same bytes as candump -L, or candump -L -x; a context manager that closes it.

    Stamps are truncated to 1 µs. Without `directed` the log does not distinguish sent frames from
    received ones, as that of candump -L does not.

    Parameters
    ----------
    path : path
        An existing file is overwritten; compressed if it ends in .gz.
    channels : sequence of str, optional
        Name of the interface of each bus; by default can0, can1, …
    directed : bool
        Whether R (received) or T (sent) ends each line.

    Attributes
    ----------
    count : int
        Frames written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        channels: Sequence[str] | None = None,
        directed: bool = False,
    ) -> None:
        self.path = Path(path)
        self.count = 0
        names = [f"can{i}" for i in range(256)] if channels is None else list(channels)
        self._names = np.zeros((len(names), NAME_BYTES), np.uint8)
        self._lengths = np.zeros(len(names), np.int64)
        for i, name in enumerate(names):
            encoded = name.encode()
            if not 0 < len(encoded) < NAME_BYTES or min(encoded) <= ord(" "):
                raise ValueError(
                    f"channels[{i}]: must be a name of 1 to {NAME_BYTES - 1} bytes without "
                    f"blanks; got {name!r}"
                )
            self._names[i, : len(encoded)] = np.frombuffer(encoded, np.uint8)
            self._lengths[i] = len(encoded)
        self._directed = int(directed)
        self._text = np.empty(_PIECE * _LINE_BYTES, np.uint8)
        packed = self.path.suffix.lower() == ".gz"
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
                piece = records[first : first + _PIECE]
                size = format_frames(
                    self._text, as_words(piece), as_bytes(piece), self._names, self._lengths,
                    self._directed,
                )  # fmt: skip
                self._file.write(self._text[:size].data)
        self.count += records.size

    def flush(self) -> None:
        """Pass all data to the operating system, so that they survive a crash of this process."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest and close the file; may be called twice."""
        self._file.close()

    def _check(self, records: np.ndarray) -> None:
        """Raise for the first frame that is none."""
        fd = records["flags"] & FD_FDF > 0
        limit = np.where(fd, _FD_BYTES, _CLASSIC_BYTES)
        for wrong, expected, name in (
            (records["length"] > limit, "at most 8 data bytes, or 64 in a CAN FD frame", "length"),
            (fd & (records["id"] & (CAN_RTR | CAN_ERR) > 0),
             "a data frame where it is a CAN FD one", "id"),
            (records["bus"] >= self._lengths.size,
             f"of a bus with a name, below {self._lengths.size}", "bus"),
            (records["stamp_ns"] < 0, "of a time since 1970", "stamp_ns"),
        ):  # fmt: skip
            if wrong.any():
                i = int(wrong.argmax())
                where = f"frame {self.count + i}"
                raise LogError(f"{self.path}: {where}: must be {expected}; got {records[name][i]}")


@jitable
def write_digits(text, p, value, digits):
    for k in range(digits):
        text[p + digits - 1 - k] = _ZERO + value % 10
        value //= 10
    return p + digits


@jitable
def write_hex(text, p, value, digits):
    for k in range(digits):
        text[p + k] = _DIGITS[(value >> (4 * (digits - 1 - k))) & 15]
    return p + digits


@jitable
def format_frame(text, p, words, data, i, names, lengths, directed):
    seconds, rest = words[i, 0] // S, words[i, 0] % S
    text[p] = _OPEN
    p = write_digits(text, p + 1, seconds, _SECOND_DIGITS)
    text[p] = _POINT
    p = write_digits(text, p + 1, rest // _MICROSECOND, _MICROSECOND_DIGITS)
    text[p], text[p + 1] = _CLOSE, _BLANK
    p += 2
    bus = np.int64(data[i, BUS_AT])
    for k in range(lengths[bus]):
        text[p + k] = names[bus, k]
    p += lengths[bus]
    text[p] = _BLANK
    identifier = words[i, 1]
    if identifier & CAN_ERR:
        p = write_hex(text, p + 1, identifier & ERROR_LIMIT, 8)
    elif identifier & CAN_EFF:
        p = write_hex(text, p + 1, identifier & EXTENDED_LIMIT, 8)
    else:
        p = write_hex(text, p + 1, identifier & STANDARD_LIMIT, 3)
    text[p] = _HASH
    p += 1
    length, flags = np.int64(data[i, LENGTH_AT]), np.int64(data[i, FLAGS_AT])
    if flags & FD_FDF:
        text[p], text[p + 1] = _HASH, _DIGITS[flags & 15]
        p += 2
    if identifier & CAN_RTR and not flags & FD_FDF:
        text[p] = _R
        p += 1
        if length:
            text[p] = _DIGITS[length]
            p += 1
    else:
        for k in range(length):
            p = write_hex(text, p, np.int64(data[i, PAYLOAD + k]), 2)
    if directed:
        text[p], text[p + 1] = _BLANK, _T if data[i, ORIGIN_AT] & ECHO else _R
        p += 2
    text[p] = _NEWLINE
    return p + 1


def format_frames_python(text, words, data, names, lengths, directed):
    """Write frames as lines of candump -L; returns the bytes written.

    Parameters
    ----------
    text : ndarray, uint8
        Room for _LINE_BYTES a frame.
    words, data : ndarray
        Views of the frames; checked to be frames by the caller.
    names : ndarray, shape (buses, NAME_BYTES), uint8
    lengths : ndarray, shape (buses,), int64
        Bytes of each name.
    directed : int
        Whether R or T ends each line, as with candump -x.
    """
    p = 0
    for i in range(words.shape[0]):
        p = format_frame(text, p, words, data, i, names, lengths, directed)
    return p


_words_in = types.Array(types.int64, 2, "C", readonly=True)
_data_in = types.Array(types.uint8, 2, "C", readonly=True)
_names, _lengths = types.uint8[:, ::1], types.int64[::1]
# See `bus.codec_kernels` for the options.
format_frames = compiled(
    format_frames_python,
    [types.int64(types.uint8[::1], _words_in, _data_in, _names, _lengths, types.int64)],
)
