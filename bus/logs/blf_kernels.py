"""All compiled code of BLF logs: objects to frames, and frames to objects.

Each kernel is a plain function and, at the end of the file, one line that compiles it. Frames are
two views of the same records, as in `bus.kernels`: `words`, shape (m, 10), int64, holds the time
stamp in column 0 and the identifier in column 1; `data`, shape (m, 80), uint8, everything byte by
byte. All numbers of the format are little-endian. An object begins with "LOBJ", the length of its
header, the header's version, its own length and its type; then come flags and a time stamp, at the
same places in both versions, and behind the header what the type has to tell.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_ESI, FD_FDF, FRAME_DTYPE
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
"""Of types from the last one on, one count is kept."""

# Places of `state`, from which reading goes on.
POSITION = 0  # of the next object
SKIP = 1  # bytes still to come of an object that is no frame
COUNT = 2  # frames in the batch
OBJECTS = 3  # read so far
START_NS = 4  # of the measurement
CHANNEL = 5  # that is new
STATE_SIZE = 6
# What `parse` returns beside a fault.
MORE, FULL, CONTAINER, NEW_CHANNEL = range(4)
SIGNATURE, SIZE, HEADER, SHORT, STAMP, LENGTH = range(-6, 0)
LARGEST_OBJECT = 1 << 16
MOST_PADDING = 8
"""Places behind an object where the next one may begin."""
MOST_OBJECT_BYTES = 128
"""No object that `build` writes is longer."""
EXPECTED = {
    CONTAINER: "an object other than a container, in a container",
    SIGNATURE: "the beginning of an object, 'LOBJ'",
    SIZE: f"an object of at least 16 bytes, and at most {LARGEST_OBJECT} for a frame",
    HEADER: "a header of at least 32 bytes, within its object",
    SHORT: "an object as long as its type demands",
    STAMP: "a time before the year 2262",
    LENGTH: "at most 64 data bytes",
}
"""What must stand at the place of each fault."""
UNKNOWN = -2
"""Bus of the channels that did not appear yet."""
_OBJECT_HEAD, _FRAME_HEAD = 16, 32
_SIGNATURE = int.from_bytes(b"LOBJ", "little")
# Contents of objects, as long as they have to be.
_CLASSIC_SIZE, _ERROR_SIZE, _ERROR_EXT_SIZE, _FD_SIZE, _FD_64_SIZE, _FD_ERROR_64_SIZE = (
    16, 2, 32, 20, 40, 44,
)  # fmt: skip
_TEN_US, _NS, _RESOLUTIONS = 1, 2, 3
_TEN_US_NS = 10_000
_TX, _REMOTE = 0x01, 0x80
_FD_EDL, _FD_BRS, _FD_ESI = 0x1, 0x2, 0x4
_FD_64_REMOTE, _FD_64_EDL, _FD_64_BRS, _FD_64_ESI = 0x10, 0x1000, 0x2000, 0x4000
_IDENTIFIER, _STANDARD = 0x1FFF_FFFF, 0x7FF
# Error classes and details of SocketCAN (linux/can/error.h), and the error code of an SJA 1000.
_BUS_ERROR, _PROTOCOL, _OVERLOAD, _SENDING = 0x80, 0x08, 0x20, 0x80
_PROTOCOL_TYPES = np.array([0x01, 0x02, 0x04, 0x00], np.uint8)  # bit, form, stuff, other
_ECC_VALID, _ECC_RECEIVING, _ECC_PLACE = 1, 0x20, 0x1F
_ERROR_BYTES = 8
_LENGTHS = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], np.uint8)
_LENGTH_AT, _FLAGS_AT, _ORIGIN_AT, _BUS_AT, _DATA_AT = (
    FRAME_DTYPE.fields[name][1] for name in ("length", "flags", "origin", "bus", "data")
)
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_MASKS = np.array([(1 << 8 * k) - 1 for k in range(8)] + [-1], np.int64)
"""Of as many bytes, from the lowest on."""
_LATEST_NS = (1 << 63) - 1
_CUT, _NONE = -101, -100


def _u16(blob, p):
    # Unsigned places, which cannot count from the end, let the compiler make one load of it all.
    p = np.uintp(p)
    return np.int64(blob[p]) | np.int64(blob[p + np.uintp(1)]) << 8


def _u32(blob, p):
    return u16(blob, p) | u16(blob, p + 2) << 16


def _u64(blob, p):
    return u32(blob, p) | u32(blob, p + 4) << 32


def _find_object(blob, p, end):
    # How many bytes pad an object depends on who wrote it. Returns the place, _CUT or _NONE.
    for k in range(MOST_PADDING):
        if p + k + 4 > end:
            return _CUT
        if u32(blob, p + k) == _SIGNATURE:
            return p + k
    return _NONE


def _put(words, data, i, identifier, length, flags, origin):
    i = np.uintp(i)
    words[i, 1] = identifier
    for k in range(2, words.shape[1]):
        words[i, k] = 0
    data[i, _LENGTH_AT] = length
    data[i, _FLAGS_AT] = flags
    data[i, _ORIGIN_AT] = origin


def _identifier(number):
    # An identifier that only an extended frame can have is one, whatever the file says.
    extended = number & CAN_EFF or number & _IDENTIFIER > _STANDARD
    return number & _IDENTIFIER | (CAN_EFF if extended else 0)


def _read_classic(blob, p, words, data, i):
    flags, length = np.int64(blob[p + 2]), min(np.int64(blob[p + 3]), _CLASSIC_BYTES)
    identifier = identify(u32(blob, p + 4))
    if flags & _REMOTE:
        identifier |= CAN_RTR
    put(words, data, i, identifier, length, 0, ECHO if flags & _TX else 0)
    if not flags & _REMOTE:
        words[i, _DATA_AT // 8] = u64(blob, p + 8) & _MASKS[length]
    return u16(blob, p)


def _read_fd(blob, p, size, words, data, i):
    kind, bits, length = np.int64(blob[p + 2]), np.int64(blob[p + 13]), np.int64(blob[p + 14])
    if length > _FD_BYTES:
        return LENGTH
    if size < _FD_SIZE + length:
        return SHORT
    identifier, flags = identify(u32(blob, p + 4)), 0
    if bits & _FD_EDL:
        flags = FD_FDF | (FD_BRS if bits & _FD_BRS else 0) | (FD_ESI if bits & _FD_ESI else 0)
    elif kind & _REMOTE:
        identifier |= CAN_RTR
        length = min(np.int64(blob[p + 3]), _CLASSIC_BYTES)
    put(words, data, i, identifier, length, flags, ECHO if kind & _TX else 0)
    if not identifier & CAN_RTR:
        for k in range(length):
            data[i, _DATA_AT + k] = blob[p + _FD_SIZE + k]
    return u16(blob, p)


def _read_fd_64(blob, p, size, head, words, data, i):
    length, bits = np.int64(blob[p + 2]), u32(blob, p + 12)
    if length > _FD_BYTES:
        return LENGTH
    # Where less is there than is told, what is missing is 0, as CANoe shows it.
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
            data[i, _DATA_AT + k] = blob[p + _FD_64_SIZE + k]
    return np.int64(blob[p])


def _put_error(words, data, i, valid, code):
    # What the error code of an SJA 1000 tells, in the words of SocketCAN.
    put(words, data, i, CAN_ERR | _BUS_ERROR, _ERROR_BYTES, 0, 0)
    if valid:
        words[i, 1] |= _PROTOCOL
        data[i, _DATA_AT + 2] = _PROTOCOL_TYPES[code >> 6]
        if not code & _ECC_RECEIVING:
            data[i, _DATA_AT + 2] |= _SENDING
        data[i, _DATA_AT + 3] = code & _ECC_PLACE


def _read_error(blob, p, words, data, i):
    # With nothing but an identifier and data it comes from SocketCAN: error class and details.
    told = u32(blob, p + 4) | np.int64(blob[p + 8]) | np.int64(blob[p + 9]) | u32(blob, p + 12)
    if told:
        put_error(words, data, i, u32(blob, p + 4) & _ECC_VALID, np.int64(blob[p + 8]))
        return u16(blob, p)
    kind = u32(blob, p + 16) & _IDENTIFIER
    put(words, data, i, CAN_ERR | (kind if kind else _BUS_ERROR), _ERROR_BYTES, 0, 0)
    for k in range(min(np.int64(blob[p + 10]), _ERROR_BYTES)):
        data[i, _DATA_AT + k] = blob[p + 24 + k]
    return u16(blob, p)


def _read_frame(blob, p, size, head, kind, words, data, i):
    # Returns the channel, or a fault.
    if kind in (CAN_MESSAGE, CAN_MESSAGE2):
        return read_classic(blob, p, words, data, i) if size >= _CLASSIC_SIZE else SHORT
    if kind == CAN_FD_MESSAGE:
        return read_fd(blob, p, size, words, data, i) if size >= _FD_SIZE else SHORT
    if kind == CAN_FD_MESSAGE_64:
        if size < _FD_64_SIZE:
            return SHORT
        return read_fd_64(blob, p, size, head, words, data, i)
    if kind == CAN_ERROR:
        put_error(words, data, i, 0, 0)
        return u16(blob, p) if size >= _ERROR_SIZE else SHORT
    if kind == CAN_ERROR_EXT:
        return read_error(blob, p, words, data, i) if size >= _ERROR_EXT_SIZE else SHORT
    if kind == CAN_FD_ERROR_64:
        if size < _FD_ERROR_64_SIZE:
            return SHORT
        put_error(words, data, i, u16(blob, p + 4) & _ECC_VALID, np.int64(blob[p + 3]))
        return np.int64(blob[p])
    if size < _ERROR_SIZE:
        return SHORT
    put(words, data, i, CAN_ERR | _PROTOCOL, _ERROR_BYTES, 0, 0)
    data[i, _DATA_AT + 2] = _OVERLOAD
    return u16(blob, p)


def _parse(blob, end, buses, left_out, skipped, words, data, state):
    """Read objects into frames until a batch is full or no whole object is left.

    Parameters
    ----------
    blob : ndarray, uint8
    end : int
        Place behind its last byte.
    buses : ndarray, shape (65536,), int16
        Bus of each channel, UNKNOWN or LEFT_OUT.
    left_out : ndarray, shape (65536,), int64
        Counts the frames of each channel left out.
    skipped : ndarray, shape (TYPES,), int64
        Counts the objects of each type that are no frames.
    words, data : ndarray
        Views of the batch.
    state : ndarray, shape (STATE_SIZE,), int64

    Returns
    -------
    int
        MORE, FULL, CONTAINER, NEW_CHANNEL, or a fault of the object at the position.
    """
    position, count, start = state[POSITION], state[COUNT], state[START_NS]
    status = MORE
    while True:
        step = min(state[SKIP], end - position)
        position += step
        state[SKIP] -= step
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
        size, kind = u32(blob, p + 8), u32(blob, p + 12)
        if size < _OBJECT_HEAD:
            status = SIZE
            break
        if kind == LOG_CONTAINER:
            status = CONTAINER
            break
        head, version = u16(blob, p + 4), u16(blob, p + 6)
        if kind not in FRAMES or version not in (1, 2):
            skipped[min(kind, TYPES - 1)] += 1
            state[OBJECTS] += 1
            state[SKIP] = size
            continue
        if size > LARGEST_OBJECT:
            status = SIZE
            break
        if p + size > end:
            break
        if head < _FRAME_HEAD or head > size:
            status = HEADER
            break
        unit = _TEN_US_NS if u32(blob, p + 16) & _RESOLUTIONS == _TEN_US else 1
        stamp = u64(blob, p + 24)
        if stamp < 0 or stamp > (_LATEST_NS - max(start, 0)) // unit:
            status = STAMP
            break
        channel = read_frame(blob, p + head, size - head, head, kind, words, data, count)
        if channel < 0:
            status = channel
            break
        bus = np.int64(buses[channel])
        if bus == UNKNOWN:
            state[CHANNEL] = channel
            status = NEW_CHANNEL
            break
        state[OBJECTS] += 1
        position = p + size
        if bus == LEFT_OUT:
            left_out[channel] += 1
        else:
            words[count, 0] = start + unit * stamp
            data[count, _BUS_AT] = bus
            count += 1
    state[POSITION], state[COUNT] = position, count
    return status


def _write_number(blob, p, number, size):
    for k in range(size):
        blob[p + k] = (number >> (8 * k)) & 0xFF
    return p + size


def _build_object(blob, p, words, data, i, start):
    identifier, length = words[i, 1] & 0xFFFF_FFFF, np.int64(data[i, _LENGTH_AT])
    flags, bus = np.int64(data[i, _FLAGS_AT]), np.int64(data[i, _BUS_AT])
    kind, size = CAN_MESSAGE, _FRAME_HEAD + _CLASSIC_SIZE
    if identifier & CAN_ERR:
        kind, size = CAN_ERROR_EXT, _FRAME_HEAD + _ERROR_EXT_SIZE
    elif flags & FD_FDF:
        kind, size = CAN_FD_MESSAGE, _FRAME_HEAD + _FD_SIZE + _FD_BYTES
    for k in range(size):
        blob[p + k] = 0
    write_number(blob, p, _SIGNATURE, 4)
    write_number(blob, p + 4, _FRAME_HEAD, 2)
    write_number(blob, p + 6, 1, 2)
    write_number(blob, p + 8, size, 4)
    write_number(blob, p + 12, kind, 4)
    write_number(blob, p + 16, _NS, 4)
    write_number(blob, p + 24, max(words[i, 0] - start, 0), 8)
    c = p + _FRAME_HEAD
    write_number(blob, c, bus + 1, 2)
    if kind == CAN_ERROR_EXT:
        blob[c + 10] = min(length, _ERROR_BYTES)
        write_number(blob, c + 16, identifier & _IDENTIFIER, 4)
        first, length = c + 24, min(length, _ERROR_BYTES)
    else:
        remote = identifier & CAN_RTR and kind == CAN_MESSAGE
        code = 0
        while _LENGTHS[code] < length:
            code += 1
        blob[c + 2] = (_TX if data[i, _ORIGIN_AT] & ECHO else 0) | (_REMOTE if remote else 0)
        blob[c + 3] = code
        write_number(blob, c + 4, identifier & (CAN_EFF | _IDENTIFIER), 4)
        first, length = c + 8, 0 if remote else length
        if kind == CAN_FD_MESSAGE:
            first = c + _FD_SIZE
            blob[c + 13] = (
                _FD_EDL | (_FD_BRS if flags & FD_BRS else 0) | (_FD_ESI if flags & FD_ESI else 0)
            )
            blob[c + 14] = length
    for k in range(length):
        blob[first + k] = data[i, _DATA_AT + k]
    return p + size


def _build(blob, words, data, start):
    """Write frames as objects, one after the other; return the bytes written.

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


_int = types.int64
_ints = types.int64[::1]
_blob, _blob_in = types.uint8[::1], types.Array(types.uint8, 1, "C", readonly=True)
_words, _words_in = types.int64[:, ::1], types.Array(types.int64, 2, "C", readonly=True)
_data, _data_in = types.uint8[:, ::1], types.Array(types.uint8, 2, "C", readonly=True)


def _compiled(kernel, *signature):
    # As in `bus.kernels`: nothing allocates or counts references, and kernels go into each other.
    flags = {"error_model": "numpy", "nogil": True, "cache": True}
    return njit(*signature, forceinline=True, _nrt=False, **flags)(kernel)


u16 = _compiled(_u16)
u32 = _compiled(_u32)
u64 = _compiled(_u64)
find_object = _compiled(_find_object)
put = _compiled(_put)
identify = _compiled(_identifier)
read_classic = _compiled(_read_classic)
read_fd = _compiled(_read_fd)
read_fd_64 = _compiled(_read_fd_64)
put_error = _compiled(_put_error)
read_error = _compiled(_read_error)
read_frame = _compiled(_read_frame)
parse = _compiled(
    _parse, _int(_blob_in, _int, types.int16[::1], _ints, _ints, _words, _data, _ints)
)
write_number = _compiled(_write_number)
build_object = _compiled(_build_object)
build = _compiled(_build, _int(_blob, _words_in, _data_in, _int))
