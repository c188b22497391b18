"""Compiled code that reads candump logs: lines to frames.

`words` and `data` are those of `bus.frame.FrameViews`. A function that reads a part of a line
returns the offset of its end, or a fault, less than 0, whose place is then in `state["start"]`. No
part of a line contains a newline, and each text ends in one, so that nothing reads past its end.
"""

from __future__ import annotations

import numpy as np
from numba import from_dtype, types

from bus.compiled.jit import compiled, jitable
from bus.frame import (
    BUS_AT,
    CAN_EFF,
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

# Return values of `parse` other than faults.
MORE, FULL, NEW_NAME = 0, 1, -16
(
    STAMP, FRACTION, LATE, CLOSE, NAME, LONG_NAME, IDENTIFIER, STANDARD, EXTENDED, HASH, FLAGS,
    BYTE, MUCH, DLC, LINE_END,
) = range(-15, 0)  # fmt: skip
NAME_BYTES = 64
EXPECTED = {
    STAMP: "'(' and a time stamp in seconds, as of candump -L",
    FRACTION: "'.' and 1 to 9 digits",
    LATE: "a time before the year 2262",
    CLOSE: "')' and a blank",
    NAME: "the name of an interface and a blank",
    LONG_NAME: f"a name of less than {NAME_BYTES} bytes",
    IDENTIFIER: "an identifier of 3 or 8 hexadecimal digits",
    STANDARD: "an identifier of at most 7FF",
    EXTENDED: "an identifier of at most 1FFFFFFF, or up to 3FFFFFFF of an error frame",
    HASH: "'#' and the data, as of candump -L",
    FLAGS: "the flags of a CAN FD frame, one hexadecimal digit",
    BYTE: "two hexadecimal digits of a data byte",
    MUCH: "at most 8 data bytes, or 64 in a CAN FD frame",
    DLC: "a length of 0 to 8",
    LINE_END: "the end of the line",
}
"""Expected content at the place of each fault."""
STATE = np.dtype(
    [
        (name, np.int64)
        for name in (
            "position",  # first byte of the next line
            "line",  # lines read
            "count",  # frames in the batch
            "names",  # interfaces known
            "last",  # interface of the last frame
            "start",  # of a new name, or the place of a fault
            "end",  # of a new name
        )
    ]
)
"""Position of the reader."""
MOST_NAMES = 1024

S = 1_000_000_000
"""Nanoseconds of a second."""
_LATEST_S = (1 << 63) // S - 1
STANDARD_LIMIT, EXTENDED_LIMIT, ERROR_LIMIT = 0x7FF, 0x1FFF_FFFF, 0x3FFF_FFFF
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_TAB, _NEWLINE, _RETURN, _BLANK = b"\t\n\r "
_OPEN, _CLOSE, _POINT, _ZERO, _HASH, _UNDERSCORE = b"().0#_"
_DELETE = 127
_R, _T, _SMALL_R, _SMALL_T = b"RTrt"
_NO_DIGIT = 255
_HEX = np.full(256, _NO_DIGIT, np.uint8)
_HEX[list(b"0123456789ABCDEF")] = range(16)
_HEX[list(b"abcdef")] = range(10, 16)


@jitable
def fault(state, code, place):
    state["start"] = place
    return code


@jitable
def skip_blanks(text, p):
    while text[p] == _BLANK or text[p] == _TAB:
        p += 1
    return p


@jitable
def read_stamp(text, p, words, i, state):
    if text[p] != _OPEN:
        return fault(state, STAMP, p)
    p += 1
    first, seconds = p, 0
    while True:
        digit = np.int64(text[p]) - _ZERO
        if digit < 0 or digit > 9:
            break
        seconds = 10 * seconds + digit
        if seconds > _LATEST_S:
            return fault(state, LATE, first)
        p += 1
    if p == first:
        return fault(state, STAMP, p)
    if text[p] != _POINT:
        return fault(state, FRACTION, p)
    p += 1
    first, fraction, unit = p, 0, S
    while unit > 1:
        digit = np.int64(text[p]) - _ZERO
        if digit < 0 or digit > 9:
            break
        fraction = 10 * fraction + digit
        unit //= 10
        p += 1
    if p == first:
        return fault(state, FRACTION, p)
    if text[p] != _CLOSE or (text[p + 1] != _BLANK and text[p + 1] != _TAB):
        return fault(state, CLOSE, p)
    words[i, 0] = S * seconds + unit * fraction
    return skip_blanks(text, p + 1)


@jitable
def find_name(text, start, end, names, state):
    # The interface of the frame before first: it is usually the same.
    length = end - start
    for k in range(-1, state["names"]):
        j = state["last"] if k < 0 else k
        if names[j, length] == 0:
            same = 0
            while same < length and names[j, same] == text[start + same]:
                same += 1
            if same == length:
                state["last"] = j
                return j
    return -1


@jitable
def read_identifier(text, p, words, i, state):
    first, identifier = p, 0
    while p - first < 9:
        digit = np.int64(_HEX[text[p]])
        if digit == _NO_DIGIT:
            break
        identifier = 16 * identifier + digit
        p += 1
    if p - first == 3:
        if identifier > STANDARD_LIMIT:
            return fault(state, STANDARD, first)
    elif p - first == 8:
        if identifier > ERROR_LIMIT:
            return fault(state, EXTENDED, first)
        if identifier <= EXTENDED_LIMIT:
            identifier |= CAN_EFF
    else:
        return fault(state, IDENTIFIER, first)
    words[i, 1] = identifier  # with 0 for everything behind it
    for k in range(2, words.shape[1]):
        words[i, k] = 0
    return p


@jitable
def read_short(text, p, words, data, i, state):
    # From '#' on: "#11223344", "#R8", "##5112233", each with " R" or " T" behind it after -x.
    p += 1
    limit = _CLASSIC_BYTES
    if text[p] == _HASH:
        limit = _FD_BYTES
        flags = np.int64(_HEX[text[p + 1]])
        if flags == _NO_DIGIT:
            return fault(state, FLAGS, p + 1)
        data[i, FLAGS_AT] = (flags & (FD_BRS | FD_ESI)) | FD_FDF
        p += 2
    length = 0
    if limit == _CLASSIC_BYTES and (text[p] == _R or text[p] == _SMALL_R):
        words[i, 1] |= CAN_RTR
        p += 1
        if _HEX[text[p]] != _NO_DIGIT:
            length = np.int64(_HEX[text[p]])
            if length > _CLASSIC_BYTES:
                return fault(state, DLC, p)
            p += 1
    else:
        while True:
            high = np.int64(_HEX[text[p]])
            if high == _NO_DIGIT:
                break
            low = np.int64(_HEX[text[p + 1]])
            if low == _NO_DIGIT:
                return fault(state, BYTE, p)
            if length == limit:
                return fault(state, MUCH, p)
            data[i, PAYLOAD + length] = 16 * high + low
            length += 1
            p += 2
    data[i, LENGTH_AT] = length
    if text[p] == _UNDERSCORE and length == _CLASSIC_BYTES and _HEX[text[p + 1]] != _NO_DIGIT:
        p += 2  # the raw length code, of candump -8
    if text[p] == _BLANK or text[p] == _TAB:
        p = skip_blanks(text, p)
        if text[p] == _T or text[p] == _SMALL_T:
            data[i, ORIGIN_AT] = ECHO
            p += 1
        elif text[p] == _R or text[p] == _SMALL_R:
            p += 1
    return p


@jitable
def read_line(text, p, names, words, data, i, state):
    p = read_stamp(text, p, words, i, state)
    if p < 0:
        return p
    start = p
    while text[p] > _BLANK and text[p] < _DELETE:
        p += 1
    if p == start or (text[p] != _BLANK and text[p] != _TAB):
        return fault(state, NAME, start)
    if p - start >= NAME_BYTES:
        return fault(state, LONG_NAME, start)
    if find_name(text, start, p, names, state) < 0:
        state["start"], state["end"] = start, p
        return NEW_NAME
    p = skip_blanks(text, p)
    p = read_identifier(text, p, words, i, state)
    if p < 0:
        return p
    if text[p] != _HASH:
        return fault(state, HASH, p)
    return read_short(text, p, words, data, i, state)


def parse_python(text, end, names, buses, left_out, words, data, states):
    """Read lines into frames until a batch is full or no complete line is left.

    Parameters
    ----------
    text : ndarray, uint8
    end : int
        Offset after the last newline.
    names : ndarray, shape (names, NAME_BYTES), uint8
        Known interfaces, padded with zeros.
    buses : ndarray, shape (names,), int64
        Their buses; less than 0 leaves their frames out.
    left_out : ndarray, shape (names,), int64
        Counts of those.
    words, data : ndarray
        Views of the batch.
    states : ndarray, shape (1,), STATE

    Returns
    -------
    int
        MORE, FULL, NEW_NAME, or a fault of `EXPECTED`.
    """
    state = states[0]
    position, count = state["position"], state["count"]
    status = MORE
    while position < end:
        if count == words.shape[0]:
            status = FULL
            break
        p = skip_blanks(text, position)
        blank = text[p] == _NEWLINE or text[p] == _RETURN
        if not blank:
            p = read_line(text, p, names, words, data, count, state)
            if p < 0:
                status = p
                break
            p = skip_blanks(text, p)
        if text[p] == _RETURN:
            p += 1
        if text[p] != _NEWLINE:
            status = fault(state, LINE_END, p)
            break
        if not blank:
            bus = buses[state["last"]]
            if bus < 0:
                left_out[state["last"]] += 1
            else:
                data[count, BUS_AT] = bus
                count += 1
        position = p + 1
        state["line"] += 1
    state["position"], state["count"] = position, count
    return status


_ints, _words, _data = types.int64[::1], types.int64[:, ::1], types.uint8[:, ::1]
_states = from_dtype(STATE)[::1]
# See `bus.codec_kernels` for the options.
parse = compiled(
    parse_python,
    [types.int64(types.uint8[::1], types.int64, _data, _ints, _ints, _words, _data, _states)],
)
