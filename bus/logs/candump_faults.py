"""Faults of a candump log: codes of the kernels, and texts."""

from __future__ import annotations

# Return values of `parse` other than faults.
MORE, FULL = 0, 1
NEW_NAME = -19
(
    STAMP, FRACTION, LATE, CLOSE, NAME, LONG_NAME, IDENTIFIER, STANDARD, EXTENDED, HASH, FLAGS,
    BYTE, MUCH, DLC, RELATIVE, DIRECTION, LENGTH, LINE_END,
) = range(-18, 0)  # fmt: skip
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
    RELATIVE: "an absolute time stamp, as of candump -L or candump -t a",
    DIRECTION: "RX or TX and two flags, as of candump -x",
    LENGTH: "the length in brackets, one digit, or two in a CAN FD frame",
    LINE_END: "the end of the line",
}
"""Expected content at the place of each fault."""
