"""Compiled code that writes candump logs: frames to lines."""

from __future__ import annotations

import numpy as np
from numba import types

from bus.compiled.jit import compiled, jitable
from bus.frame import (
    BUS_AT,
    CAN_EFF,
    CAN_ERR,
    CAN_RTR,
    ECHO,
    FD_FDF,
    FLAGS_AT,
    LENGTH_AT,
    ORIGIN_AT,
    PAYLOAD,
)  # fmt: skip
from bus.logs.candump_kernels import (
    ABSOLUTE_DIGITS,
    ERROR_LIMIT,
    EXTENDED_LIMIT,
    STANDARD_LIMIT,
    S,
)  # fmt: skip

LINE_BYTES = 256
"""Upper bound of the length of a line: stamp 20, name 64, identifier 9, flags 2, data 128."""
_MICROSECOND, _MICROSECOND_DIGITS = 1000, 6
_NEWLINE, _BLANK, _OPEN, _CLOSE, _POINT, _ZERO, _HASH, _R, _T = b"\n ().0#RT"
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)


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
    p = write_digits(text, p + 1, seconds, ABSOLUTE_DIGITS)
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
        Room for LINE_BYTES a frame.
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
