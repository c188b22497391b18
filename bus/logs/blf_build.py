"""Compiled code that writes BLF logs: frames to objects; see `bus.logs.blf_kernels`."""

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
    FD_BRS,
    FD_ESI,
    FD_FDF,
    FD_LENGTHS,
    FLAGS_AT,
    LENGTH_AT,
    ORIGIN_AT,
    PAYLOAD,
)  # fmt: skip
from bus.logs.blf_kernels import (
    BRS,
    CAN_ERROR_EXT,
    CAN_FD_MESSAGE,
    CAN_MESSAGE,
    CLASSIC_SIZE,
    EDL,
    ERROR_BYTES,
    ERROR_EXT_SIZE,
    ESI,
    FD_BYTES,
    FD_SIZE,
    FRAME_HEAD,
    IDENTIFIER_BITS,
    MAGIC,
    REMOTE,
    RESOLUTION_NS,
    TX,
)  # fmt: skip

MOST_OBJECT_BYTES = 128
"""Upper bound of the size of an object."""
_LENGTHS = np.array(FD_LENGTHS, np.uint8)


@jitable
def write_number(blob, p, number, size):
    for k in range(size):
        blob[p + k] = (number >> (8 * k)) & 0xFF
    return p + size


@jitable
def build_object(blob, p, words, data, i, start):
    identifier, length = words[i, 1] & 0xFFFF_FFFF, np.int64(data[i, LENGTH_AT])
    flags, bus = np.int64(data[i, FLAGS_AT]), np.int64(data[i, BUS_AT])
    kind, size = CAN_MESSAGE, FRAME_HEAD + CLASSIC_SIZE
    if identifier & CAN_ERR:
        kind, size = CAN_ERROR_EXT, FRAME_HEAD + ERROR_EXT_SIZE
    elif flags & FD_FDF:
        kind, size = CAN_FD_MESSAGE, FRAME_HEAD + FD_SIZE + FD_BYTES
    for k in range(size):
        blob[p + k] = 0
    write_number(blob, p, MAGIC, 4)
    write_number(blob, p + 4, FRAME_HEAD, 2)
    write_number(blob, p + 6, 1, 2)
    write_number(blob, p + 8, size, 4)
    write_number(blob, p + 12, kind, 4)
    write_number(blob, p + 16, RESOLUTION_NS, 4)
    write_number(blob, p + 24, max(words[i, 0] - start, 0), 8)
    c = p + FRAME_HEAD
    write_number(blob, c, bus + 1, 2)
    if kind == CAN_ERROR_EXT:
        blob[c + 10] = min(length, ERROR_BYTES)
        write_number(blob, c + 16, identifier & IDENTIFIER_BITS, 4)
        first, length = c + 24, min(length, ERROR_BYTES)
    else:
        remote = identifier & CAN_RTR and kind == CAN_MESSAGE
        code = 0
        while _LENGTHS[code] < length:
            code += 1
        blob[c + 2] = (TX if data[i, ORIGIN_AT] & ECHO else 0) | (REMOTE if remote else 0)
        blob[c + 3] = code
        write_number(blob, c + 4, identifier & (CAN_EFF | IDENTIFIER_BITS), 4)
        first, length = c + 8, 0 if remote else length
        if kind == CAN_FD_MESSAGE:
            first = c + FD_SIZE
            blob[c + 13] = EDL | (BRS if flags & FD_BRS else 0) | (ESI if flags & FD_ESI else 0)
            blob[c + 14] = length
    for k in range(length):
        blob[first + k] = data[i, PAYLOAD + k]
    return p + size


def build_python(blob, words, data, start):
    """Write frames as objects, one after the other; returns the bytes written.

    Parameters
    ----------
    blob : ndarray, uint8
        Room for MOST_OBJECT_BYTES a frame.
    words, data : ndarray
        Views of the frames; checked to be frames by the caller.
    start : int
        Of the measurement, ns; earlier frames get that time.
    """
    p = 0
    for i in range(words.shape[0]):
        p = build_object(blob, p, words, data, i, start)
    return p


_words_in = types.Array(types.int64, 2, "C", readonly=True)
_data_in = types.Array(types.uint8, 2, "C", readonly=True)
# See `bus.codec_kernels` for the options.
build = compiled(
    build_python,
    [types.int64(types.uint8[::1], _words_in, _data_in, types.int64)],
)
