"""All compiled code of candump logs: lines to frames, and frames to lines.

Each kernel is a plain function and, at the end of the file, one line that compiles it. Frames are
two views of the same records, as in `bus.kernels`: `words`, shape (m, 10), int64, holds the time
stamp in column 0 and the identifier in column 1; `data`, shape (m, 80), uint8, everything byte by
byte. A kernel that reads a part of a line returns the place behind it, or a fault, less than 0,
whose place is then in `state[START]`. No part of a line holds a newline, and each text ends in one,
so that nothing reads past its end.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_ESI, FD_FDF, FRAME_DTYPE

# Places of `state`, from which reading goes on.
POSITION = 0  # first byte of the next line
LINE = 1  # lines read
COUNT = 2  # frames in the batch
NAMES = 3  # interfaces known
LAST = 4  # interface of the last frame
START, END = 5, 6  # of a new name; START alone, the place of a fault
STATE_SIZE = 7
# What `parse` returns beside a fault.
MORE, FULL = 0, 1
NEW_NAME = -19
(
    STAMP, FRACTION, LATE, CLOSE, NAME, LONG_NAME, IDENTIFIER, STANDARD, EXTENDED, HASH, FLAGS,
    BYTE, MUCH, DLC, RELATIVE, DIRECTION, LENGTH, LINE_END,
) = range(-18, 0)  # fmt: skip
NAME_BYTES = 64
MOST_NAMES = 1024
LINE_BYTES = 256
"""Room that the longest line fits in: stamp 20, name 64, identifier 9, flags 2, data 128."""
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
    RELATIVE: "an absolute time stamp, as of candump -L or candump -t a",
    DIRECTION: "RX or TX and two flags, as of candump -x",
    LENGTH: "the length in brackets, one digit, or two in a CAN FD frame",
    LINE_END: "the end of the line",
}
"""What must stand at the place of each fault."""

_LENGTH_AT, _FLAGS_AT, _ORIGIN_AT, _BUS_AT, _DATA_AT = (
    FRAME_DTYPE.fields[name][1] for name in ("length", "flags", "origin", "bus", "data")
)
_S, _US = 1_000_000_000, 1000
_LATEST_S = (1 << 63) // _S - 1
_STANDARD_LIMIT, _EXTENDED_LIMIT, _ERROR_LIMIT = 0x7FF, 0x1FFF_FFFF, 0x3FFF_FFFF
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_ABSOLUTE_DIGITS, _MICROSECOND_DIGITS = 10, 6
_TAB, _NEWLINE, _RETURN, _BLANK = b"\t\n\r "
_OPEN, _CLOSE, _DASH, _POINT, _ZERO, _HASH, _UNDERSCORE, _QUOTE = b"()-.0#_'"
_SQUARE, _SQUARE_END, _CURLY, _CURLY_END = b"[]{}"
_B, _E, _R, _T, _X, _SMALL_R, _SMALL_T = b"BERTXrt"
_NO_DIGIT = 255
_HEX = np.full(256, _NO_DIGIT, np.uint8)
_HEX[list(b"0123456789ABCDEF")] = range(16)
_HEX[list(b"abcdef")] = range(10, 16)
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_REMOTE = np.frombuffer(b"remote request", np.uint8)
_ERROR = np.frombuffer(b"ERRORFRAME", np.uint8)


def _fault(state, code, place):
    state[START] = place
    return code


def _skip_blanks(text, p):
    while text[p] == _BLANK or text[p] == _TAB:
        p += 1
    return p


def _has_word(text, p, word):
    for i in range(word.size):
        if text[p + i] != word[i]:
            return False
    return True


def _read_stamp(text, p, words, i, state):
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
    first, fraction, unit = p, 0, _S
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
    words[i, 0] = _S * seconds + unit * fraction
    return skip_blanks(text, p + 1)


def _find_name(text, start, end, names, state):
    # That of the frame before first: mostly it is the same.
    length = end - start
    for k in range(-1, state[NAMES]):
        j = state[LAST] if k < 0 else k
        if names[j, length] == 0:
            same = 0
            while same < length and names[j, same] == text[start + same]:
                same += 1
            if same == length:
                state[LAST] = j
                return j
    return -1


def _read_identifier(text, p, words, i, state):
    first, identifier = p, 0
    while p - first < 9:
        digit = np.int64(_HEX[text[p]])
        if digit == _NO_DIGIT:
            break
        identifier = 16 * identifier + digit
        p += 1
    if p - first == 3:
        if identifier > _STANDARD_LIMIT:
            return fault(state, STANDARD, first)
    elif p - first == 8:
        if identifier > _ERROR_LIMIT:
            return fault(state, EXTENDED, first)
        if identifier <= _EXTENDED_LIMIT:
            identifier |= CAN_EFF
    else:
        return fault(state, IDENTIFIER, first)
    words[i, 1] = identifier  # with 0 for everything behind it
    for k in range(2, words.shape[1]):
        words[i, k] = 0
    return p


def _read_short(text, p, words, data, i, state):
    # From '#' on: "#11223344", "#R8", "##5112233", each with " R" or " T" behind it after -x.
    p += 1
    limit = _CLASSIC_BYTES
    if text[p] == _HASH:
        limit = _FD_BYTES
        flags = np.int64(_HEX[text[p + 1]])
        if flags == _NO_DIGIT:
            return fault(state, FLAGS, p + 1)
        data[i, _FLAGS_AT] = (flags & (FD_BRS | FD_ESI)) | FD_FDF
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
            data[i, _DATA_AT + length] = 16 * high + low
            length += 1
            p += 2
    data[i, _LENGTH_AT] = length
    if text[p] == _UNDERSCORE and length == _CLASSIC_BYTES and _HEX[text[p + 1]] != _NO_DIGIT:
        p += 2  # the raw length code, of candump -8
    if text[p] == _BLANK or text[p] == _TAB:
        p = skip_blanks(text, p)
        if text[p] == _T or text[p] == _SMALL_T:
            data[i, _ORIGIN_AT] = ECHO
            p += 1
        elif text[p] == _R or text[p] == _SMALL_R:
            p += 1
    return p


def _read_long(text, p, words, data, i, flags, state):
    # From the identifier on, as candump shows frames to people: "123   [3]  11 22 33".
    p = skip_blanks(text, p)
    closing = _SQUARE_END
    if text[p] == _CURLY:
        closing = _CURLY_END  # the raw length code, of candump -8
    elif text[p] != _SQUARE:
        return fault(state, LENGTH, p)
    first = p + 1
    length = np.int64(_HEX[text[first]])
    if length == _NO_DIGIT or (length > 9 and closing == _SQUARE_END):
        return fault(state, LENGTH, p)
    p = first + 1
    if text[p] != closing:
        digit = np.int64(text[p]) - _ZERO
        if digit < 0 or digit > 9 or text[p + 1] != closing or closing == _CURLY_END:
            return fault(state, LENGTH, first - 1)
        length = 10 * length + digit
        if length > _FD_BYTES:
            return fault(state, MUCH, first)
        flags |= FD_FDF
        p += 1
    elif closing == _CURLY_END:
        length = min(length, _CLASSIC_BYTES)
    elif length > _CLASSIC_BYTES:
        return fault(state, MUCH, first)
    p += 1
    data[i, _LENGTH_AT] = length
    data[i, _FLAGS_AT] = flags if flags & FD_FDF else 0
    q = skip_blanks(text, p)
    if has_word(text, q, _REMOTE):
        words[i, 1] |= CAN_RTR
        return q + _REMOTE.size
    for k in range(length):
        q = skip_blanks(text, p)
        high, low = np.int64(_HEX[text[q]]), 0
        if high != _NO_DIGIT:
            low = np.int64(_HEX[text[q + 1]])
        if q == p or max(high, low) == _NO_DIGIT:
            return fault(state, BYTE, q)
        data[i, _DATA_AT + k] = 16 * high + low
        p = q + 2
    q = skip_blanks(text, p)
    if words[i, 1] & CAN_ERR and has_word(text, q, _ERROR):
        return q + _ERROR.size
    if q > p and text[q] == _QUOTE:
        # The data as characters, of candump -a: as many, and a quotation mark.
        q += length + 1
        for k in range(p, q):
            if text[k] == _NEWLINE:
                return fault(state, LINE_END, p)
        if text[q] == _QUOTE:
            return q + 1
        return fault(state, LINE_END, p)
    return q


def _read_direction(text, p, state):
    # "RX - - " or "TX B E ": returns the flags, or a fault.
    if text[p + 1] != _X or text[p + 2] != _BLANK:
        return fault(state, DIRECTION, p)
    if (text[p + 3] != _DASH and text[p + 3] != _B) or text[p + 4] != _BLANK:
        return fault(state, DIRECTION, p)
    if (text[p + 5] != _DASH and text[p + 5] != _E) or text[p + 6] != _BLANK:
        return fault(state, DIRECTION, p)
    return FD_BRS * np.int64(text[p + 3] == _B) + FD_ESI * np.int64(text[p + 5] == _E)


def _read_line(text, p, names, words, data, i, state):
    opened = p
    p = read_stamp(text, p, words, i, state)
    if p < 0:
        return p
    start = p
    while text[p] > _BLANK:
        p += 1
    if p == start or (text[p] != _BLANK and text[p] != _TAB):
        return fault(state, NAME, start)
    if p - start >= NAME_BYTES:
        return fault(state, LONG_NAME, start)
    if find_name(text, start, p, names, state) < 0:
        state[START], state[END] = start, p
        return NEW_NAME
    p = skip_blanks(text, p)
    flags, origin = 0, 0
    directed = text[p] == _R or text[p] == _T
    if directed:
        flags = read_direction(text, p, state)
        if flags < 0:
            return flags
        origin = ECHO if text[p] == _T else 0
        p = skip_blanks(text, p + 7)
    p = read_identifier(text, p, words, i, state)
    if p < 0:
        return p
    if text[p] == _HASH and not directed:
        return read_short(text, p, words, data, i, state)
    if text[p] != _BLANK and text[p] != _TAB:
        return fault(state, HASH, p)
    for k in range(1, _ABSOLUTE_DIGITS):
        if text[opened + 1 + k] == _POINT:
            return fault(state, RELATIVE, opened)
    data[i, _ORIGIN_AT] = origin
    return read_long(text, p, words, data, i, flags, state)


def _parse(text, end, names, buses, left_out, words, data, state):
    """Read lines into frames until a batch is full or no whole line is left.

    Parameters
    ----------
    text : ndarray, uint8
    end : int
        Place behind the last newline.
    names : ndarray, shape (names, NAME_BYTES), uint8
        Interfaces known, each with zeros behind it.
    buses : ndarray, shape (names,), int64
        Their buses; less than 0 leaves their frames out.
    left_out : ndarray, shape (names,), int64
        Counts those.
    words, data : ndarray
        Views of the batch.
    state : ndarray, shape (STATE_SIZE,), int64

    Returns
    -------
    int
        MORE, FULL, NEW_NAME, or a fault.
    """
    position, count = state[POSITION], state[COUNT]
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
            bus = buses[state[LAST]]
            if bus < 0:
                left_out[state[LAST]] += 1
            else:
                data[count, _BUS_AT] = bus
                count += 1
        position = p + 1
        state[LINE] += 1
    state[POSITION], state[COUNT] = position, count
    return status


def _write_digits(text, p, value, digits):
    for k in range(digits):
        text[p + digits - 1 - k] = _ZERO + value % 10
        value //= 10
    return p + digits


def _write_hex(text, p, value, digits):
    for k in range(digits):
        text[p + k] = _DIGITS[(value >> (4 * (digits - 1 - k))) & 15]
    return p + digits


def _format_frame(text, p, words, data, i, names, lengths, directed):
    seconds, rest = words[i, 0] // _S, words[i, 0] % _S
    text[p] = _OPEN
    p = write_digits(text, p + 1, seconds, _ABSOLUTE_DIGITS)
    text[p] = _POINT
    p = write_digits(text, p + 1, rest // _US, _MICROSECOND_DIGITS)
    text[p], text[p + 1] = _CLOSE, _BLANK
    p += 2
    bus = np.int64(data[i, _BUS_AT])
    for k in range(lengths[bus]):
        text[p + k] = names[bus, k]
    p += lengths[bus]
    text[p] = _BLANK
    identifier = words[i, 1]
    if identifier & CAN_ERR:
        p = write_hex(text, p + 1, identifier & _ERROR_LIMIT, 8)
    elif identifier & CAN_EFF:
        p = write_hex(text, p + 1, identifier & _EXTENDED_LIMIT, 8)
    else:
        p = write_hex(text, p + 1, identifier & _STANDARD_LIMIT, 3)
    text[p] = _HASH
    p += 1
    length, flags = np.int64(data[i, _LENGTH_AT]), np.int64(data[i, _FLAGS_AT])
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
            p = write_hex(text, p, np.int64(data[i, _DATA_AT + k]), 2)
    if directed:
        text[p], text[p + 1] = _BLANK, _T if data[i, _ORIGIN_AT] & ECHO else _R
        p += 2
    text[p] = _NEWLINE
    return p + 1


def _format(text, words, data, names, lengths, directed):
    """Write frames as lines of candump -L; return the bytes written.

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
        Whether R or T ends each line, as of candump -x.
    """
    p = 0
    for i in range(words.shape[0]):
        p = format_frame(text, p, words, data, i, names, lengths, directed)
    return p


_int = types.int64
_ints = types.int64[::1]
_text, _text_in = types.uint8[::1], types.Array(types.uint8, 1, "C", readonly=True)
_words, _words_in = types.int64[:, ::1], types.Array(types.int64, 2, "C", readonly=True)
_data, _data_in = types.uint8[:, ::1], types.Array(types.uint8, 2, "C", readonly=True)
_names = types.uint8[:, ::1]


def _compiled(kernel, *signature):
    # As in `bus.kernels`: nothing allocates or counts references, and kernels go into each other.
    flags = {"error_model": "numpy", "nogil": True, "cache": True}
    return njit(*signature, forceinline=True, _nrt=False, **flags)(kernel)


fault = _compiled(_fault)
skip_blanks = _compiled(_skip_blanks)
has_word = _compiled(_has_word)
read_stamp = _compiled(_read_stamp)
find_name = _compiled(_find_name)
read_identifier = _compiled(_read_identifier)
read_short = _compiled(_read_short)
read_long = _compiled(_read_long)
read_direction = _compiled(_read_direction)
read_line = _compiled(_read_line)
parse = _compiled(_parse, _int(_text_in, _int, _names, _ints, _ints, _words, _data, _ints))
write_digits = _compiled(_write_digits)
write_hex = _compiled(_write_hex)
format_frame = _compiled(_format_frame)
format_frames = _compiled(_format, _int(_text, _words_in, _data_in, _names, _ints, _int))
