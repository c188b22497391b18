"""Compiled code that reads BLF logs: objects to frames.

`words` and `data` are those of `bus.frame.FrameViews`. All numbers of the format are little-endian.
An object begins with "LOBJ", the length of its header, the header's version, its own length and its
type; then come flags and a time stamp, at the same offsets in both versions, and after the header
the content of the type.
"""

from __future__ import annotations

import numpy as np
from numba import from_dtype, types

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
    FLAGS_AT,
    LENGTH_AT,
    ORIGIN_AT,
    PAYLOAD,
)  # fmt: skip
from bus.logs.channels import LEFT_OUT

# Types of objects.
CAN_MESSAGE, CAN_ERROR, CAN_OVERLOAD, LOG_CONTAINER = 1, 2, 3, 10
CAN_ERROR_EXT, CAN_MESSAGE2 = 73, 86
CAN_FD_MESSAGE, CAN_FD_MESSAGE_64, CAN_FD_ERROR_64 = 100, 101, 104
FRAMES = (
    CAN_MESSAGE, CAN_ERROR, CAN_OVERLOAD, CAN_ERROR_EXT, CAN_MESSAGE2, CAN_FD_MESSAGE,
    CAN_FD_MESSAGE_64, CAN_FD_ERROR_64,
)  # fmt: skip
TYPES = 256
"""Types from the last one on share a count."""

STATE = np.dtype(
    [
        (name, np.int64)
        for name in (
            "position",  # of the next object
            "skip",  # remaining bytes of an object that is not a frame
            "count",  # frames in the batch
            "objects",  # read so far
            "start_ns",  # of the measurement
            "channel",  # new channel
        )
    ]
)
"""Position of the reader."""
# Return values of `parse` other than faults.
MORE, FULL, CONTAINER, NEW_CHANNEL = range(4)
SIGNATURE, SIZE, HEADER, SHORT, STAMP, LENGTH = range(-6, 0)
LARGEST_OBJECT = 1 << 16
MOST_PADDING = 8
"""Offsets after an object at which the next one may begin."""
EXPECTED = {
    CONTAINER: "an object other than a container, in a container",
    SIGNATURE: "the beginning of an object, 'LOBJ'",
    SIZE: f"an object of at least 16 bytes, and at most {LARGEST_OBJECT} for a frame",
    HEADER: "a header of at least 32 bytes, within its object",
    SHORT: "an object as long as its type demands",
    STAMP: "a time before the year 2262",
    LENGTH: "at most 64 data bytes",
}
"""Expected content at the place of each fault."""
UNKNOWN = -2
"""Bus of channels that have not appeared yet."""
_OBJECT_HEAD, FRAME_HEAD = 16, 32
MAGIC = int.from_bytes(b"LOBJ", "little")
# Contents of objects, with their required length.
CLASSIC_SIZE, _ERROR_SIZE, ERROR_EXT_SIZE, FD_SIZE, _FD_64_SIZE, _FD_ERROR_64_SIZE = (
    16, 2, 32, 20, 40, 44,
)  # fmt: skip
_TEN_US, _RESOLUTIONS = 1, 3
_TEN_US_NS = 10_000
TX, REMOTE = 0x01, 0x80
EDL, BRS, ESI = 0x1, 0x2, 0x4
_FD_64_REMOTE, _FD_64_EDL, _FD_64_BRS, _FD_64_ESI = 0x10, 0x1000, 0x2000, 0x4000
IDENTIFIER_BITS, _STANDARD = 0x1FFF_FFFF, 0x7FF
# Error classes and details of SocketCAN (linux/can/error.h), and the error code of an SJA 1000.
_BUS_ERROR, _PROTOCOL, _OVERLOAD, _SENDING = 0x80, 0x08, 0x20, 0x80
_PROTOCOL_TYPES = np.array([0x01, 0x02, 0x04, 0x00], np.uint8)  # bit, form, stuff, other
_ECC_VALID, _ECC_RECEIVING, _ECC_PLACE = 1, 0x20, 0x1F
ERROR_BYTES = 8
_CLASSIC_BYTES, FD_BYTES = 8, 64
_MASKS = np.array([(1 << 8 * k) - 1 for k in range(8)] + [-1], np.int64)
"""Masks of as many bytes, from the lowest on."""
_LATEST_NS = (1 << 63) - 1
_NONE, _CUT, _CONTAINER, _OTHER = range(-103, -99)
"""Results of `read_object` other than a frame: nothing, an incomplete object, a container, an
object of another type."""


@jitable
def u16(blob, p):
    # Unsigned offsets, which cannot count from the end, let the compiler merge the loads.
    p = np.uintp(p)
    return np.int64(blob[p]) | np.int64(blob[p + np.uintp(1)]) << 8


@jitable
def u32(blob, p):
    return u16(blob, p) | u16(blob, p + 2) << 16


@jitable
def u64(blob, p):
    return u32(blob, p) | u32(blob, p + 4) << 32


@jitable
def find_object(blob, p, end):
    # The padding of an object depends on its writer. Returns the offset, _CUT or _NONE.
    for k in range(MOST_PADDING):
        if p + k + 4 > end:
            return _CUT
        if u32(blob, p + k) == MAGIC:
            return p + k
    return _NONE


@jitable
def put(words, data, i, identifier, length, flags, origin):
    i = np.uintp(i)
    words[i, 1] = identifier
    for k in range(2, words.shape[1]):
        words[i, k] = 0
    data[i, LENGTH_AT] = length
    data[i, FLAGS_AT] = flags
    data[i, ORIGIN_AT] = origin


@jitable
def identify(number):
    # An identifier that only an extended frame can have is one, independent of the file.
    extended = number & CAN_EFF or number & IDENTIFIER_BITS > _STANDARD
    return number & IDENTIFIER_BITS | (CAN_EFF if extended else 0)


@jitable
def read_classic(blob, p, words, data, i):
    flags, length = np.int64(blob[p + 2]), min(np.int64(blob[p + 3]), _CLASSIC_BYTES)
    identifier = identify(u32(blob, p + 4))
    if flags & REMOTE:
        identifier |= CAN_RTR
    put(words, data, i, identifier, length, 0, ECHO if flags & TX else 0)
    if not flags & REMOTE:
        words[i, PAYLOAD // 8] = u64(blob, p + 8) & _MASKS[length]
    return u16(blob, p)


@jitable
def read_fd(blob, p, size, words, data, i):
    kind, bits, length = np.int64(blob[p + 2]), np.int64(blob[p + 13]), np.int64(blob[p + 14])
    if length > FD_BYTES:
        return LENGTH
    if size < FD_SIZE + length:
        return SHORT
    identifier, flags = identify(u32(blob, p + 4)), 0
    if bits & EDL:
        flags = FD_FDF | (FD_BRS if bits & BRS else 0) | (FD_ESI if bits & ESI else 0)
    elif kind & REMOTE:
        identifier |= CAN_RTR
        length = min(np.int64(blob[p + 3]), _CLASSIC_BYTES)
    put(words, data, i, identifier, length, flags, ECHO if kind & TX else 0)
    if not identifier & CAN_RTR:
        for k in range(length):
            data[i, PAYLOAD + k] = blob[p + FD_SIZE + k]
    return u16(blob, p)


@jitable
def read_fd_64(blob, p, size, head, words, data, i):
    length, bits = np.int64(blob[p + 2]), u32(blob, p + 12)
    if length > FD_BYTES:
        return LENGTH
    # Data beyond the given length are 0, as in CANoe.
    more = np.int64(blob[p + 35])
    there = (min(size, more - head) if more else size) - _FD_64_SIZE
    identifier, flags = identify(u32(blob, p + 4)), 0
    if bits & _FD_64_EDL:
        flags = FD_FDF | (FD_BRS if bits & _FD_64_BRS else 0) | (FD_ESI if bits & _FD_64_ESI else 0)
    elif bits & _FD_64_REMOTE:
        identifier |= CAN_RTR
        length = min(np.int64(blob[p + 1]), _CLASSIC_BYTES)
    put(words, data, i, identifier, length, flags, ECHO if blob[p + 34] else 0)
    if not identifier & CAN_RTR:
        for k in range(min(length, there)):
            data[i, PAYLOAD + k] = blob[p + _FD_64_SIZE + k]
    return np.int64(blob[p])


@jitable
def put_error(words, data, i, valid, code):
    # The error code of an SJA 1000, converted to SocketCAN.
    put(words, data, i, CAN_ERR | _BUS_ERROR, ERROR_BYTES, 0, 0)
    if valid:
        words[i, 1] |= _PROTOCOL
        data[i, PAYLOAD + 2] = _PROTOCOL_TYPES[code >> 6]
        if not code & _ECC_RECEIVING:
            data[i, PAYLOAD + 2] |= _SENDING
        data[i, PAYLOAD + 3] = code & _ECC_PLACE


@jitable
def read_error(blob, p, words, data, i):
    # Without other fields it comes from SocketCAN: error class and details.
    described = u32(blob, p + 4) | np.int64(blob[p + 8]) | np.int64(blob[p + 9]) | u32(blob, p + 12)
    if described:
        put_error(words, data, i, u32(blob, p + 4) & _ECC_VALID, np.int64(blob[p + 8]))
        return u16(blob, p)
    kind = u32(blob, p + 16) & IDENTIFIER_BITS
    put(words, data, i, CAN_ERR | (kind if kind else _BUS_ERROR), ERROR_BYTES, 0, 0)
    for k in range(min(np.int64(blob[p + 10]), ERROR_BYTES)):
        data[i, PAYLOAD + k] = blob[p + 24 + k]
    return u16(blob, p)


@jitable
def read_frame(blob, p, size, head, kind, words, data, i):
    # Returns the channel, or a fault.
    if kind in (CAN_MESSAGE, CAN_MESSAGE2):
        return read_classic(blob, p, words, data, i) if size >= CLASSIC_SIZE else SHORT
    if kind == CAN_FD_MESSAGE:
        return read_fd(blob, p, size, words, data, i) if size >= FD_SIZE else SHORT
    if kind == CAN_FD_MESSAGE_64:
        if size < _FD_64_SIZE:
            return SHORT
        return read_fd_64(blob, p, size, head, words, data, i)
    if kind == CAN_ERROR:
        put_error(words, data, i, 0, 0)
        return u16(blob, p) if size >= _ERROR_SIZE else SHORT
    if kind == CAN_ERROR_EXT:
        return read_error(blob, p, words, data, i) if size >= ERROR_EXT_SIZE else SHORT
    if kind == CAN_FD_ERROR_64:
        if size < _FD_ERROR_64_SIZE:
            return SHORT
        put_error(words, data, i, u16(blob, p + 4) & _ECC_VALID, np.int64(blob[p + 3]))
        return np.int64(blob[p])
    if size < _ERROR_SIZE:
        return SHORT
    put(words, data, i, CAN_ERR | _PROTOCOL, ERROR_BYTES, 0, 0)
    data[i, PAYLOAD + 2] = _OVERLOAD
    return u16(blob, p)


@jitable
def read_object(blob, p, end, words, data, i, state):
    # Returns the channel, a fault, or another result.
    size, kind = u32(blob, p + 8), u32(blob, p + 12)
    if size < _OBJECT_HEAD:
        return SIZE
    if kind == LOG_CONTAINER:
        return _CONTAINER
    head, version = u16(blob, p + 4), u16(blob, p + 6)
    if kind not in FRAMES or version not in (1, 2):
        return _OTHER
    if size > LARGEST_OBJECT:
        return SIZE
    if p + size > end:
        return _CUT
    if head < FRAME_HEAD or head > size:
        return HEADER
    start, unit = state["start_ns"], 1
    if u32(blob, p + 16) & _RESOLUTIONS == _TEN_US:
        unit = _TEN_US_NS
    if find_object(blob, p + size, end) == _NONE:
        return SIGNATURE  # its own length may be wrong, and its content that of the next one
    stamp = u64(blob, p + 24)
    if stamp < 0 or stamp > (_LATEST_NS - max(start, 0)) // unit:
        return STAMP
    words[i, 0] = start + unit * stamp
    return read_frame(blob, p + head, size - head, head, kind, words, data, i)


def parse_python(blob, end, buses, left_out, skipped, words, data, states):
    """Read objects into frames until a batch is full or no complete object is left.

    Parameters
    ----------
    blob : ndarray, uint8
    end : int
        Offset of its end.
    buses : ndarray, shape (65536,), int16
        Bus of each channel, UNKNOWN or LEFT_OUT.
    left_out : ndarray, shape (65536,), int64
        Counts the frames of each channel left out.
    skipped : ndarray, shape (TYPES,), int64
        Counts the objects of each type other than frames.
    words, data : ndarray
        Views of the batch.
    states : ndarray, shape (1,), STATE

    Returns
    -------
    int
        MORE, FULL, CONTAINER, NEW_CHANNEL, or a fault of the object at the position.
    """
    state, status = states[0], MORE
    position, count = state["position"], state["count"]
    while True:
        step = min(state["skip"], end - position)
        position += step
        state["skip"] -= step
        p = find_object(blob, position, end)
        if p == _NONE:
            status = SIGNATURE
            break
        if p == _CUT or p + _OBJECT_HEAD > end:
            break
        if count == words.shape[0]:
            status = FULL
            break
        position = p
        size = u32(blob, p + 8)
        channel = read_object(blob, p, end, words, data, count, state)
        if channel == _OTHER:
            skipped[min(u32(blob, p + 12), TYPES - 1)] += 1
            state["objects"] += 1
            state["skip"] = size
            continue
        if channel == _CUT:
            break
        if channel < 0:
            status = CONTAINER if channel == _CONTAINER else channel
            break
        bus = np.int64(buses[channel])
        if bus == UNKNOWN:
            state["channel"] = channel
            status = NEW_CHANNEL
            break
        state["objects"] += 1
        position = p + size
        if bus == LEFT_OUT:
            left_out[channel] += 1
        else:
            data[count, BUS_AT] = bus
            count += 1
    state["position"], state["count"] = position, count
    return status


_int, _ints = types.int64, types.int64[::1]
_blob_in = types.Array(types.uint8, 1, "C", readonly=True)
_words, _data = types.int64[:, ::1], types.uint8[:, ::1]
_states = from_dtype(STATE)[::1]
# See `bus.codec_kernels` for the options.
parse = compiled(
    parse_python,
    [_int(_blob_in, _int, types.int16[::1], _ints, _ints, _words, _data, _states)],
)
