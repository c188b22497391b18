"""CDR, the encoding of ROS 2 messages: numbers aligned to their size, texts and lists with a count.

Source: OMG Common Object Request Broker Architecture 3.3, part 2, 9.3; little endian, as XCDR 1.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

__all__ = ["FRAME", "HEAD", "Cdr", "seconds"]

HEAD = b"\0\1\0\0"
"""Encapsulation header: little endian, version 1. Alignment counts from its end."""
FRAME = "skin"
"""Default name of the skin frame."""
LATEST_S = (1 << 31) - 1


def seconds(stamp_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a ROS time.

    Examples
    --------
    >>> seconds(1_500_000_000)
    (1, 500000000)
    """
    whole, rest = divmod(max(0, stamp_ns), 1_000_000_000)
    return min(whole, LATEST_S), rest


class Cdr:
    """A message, written field by field.

    Attributes
    ----------
    raw : bytearray
        Bytes written so far.

    Examples
    --------
    >>> message = Cdr()
    >>> message.text("a").number("d", 1.0)
    12
    >>> bytes(message.raw).hex()
    '000100000200000061000000000000000000f03f'
    """

    def __init__(self) -> None:
        self.raw = bytearray(HEAD)

    def align(self, size: int) -> int:
        """Pad to a multiple of `size`; returns the offset of the next byte."""
        self.raw += bytes(-(len(self.raw) - len(HEAD)) % size)
        return len(self.raw)

    def number(self, kind: str, *values: float) -> int:
        """Append numbers of a kind of `struct`; returns the offset of the first."""
        at = self.align(struct.calcsize(kind))
        self.raw += struct.pack(f"<{len(values)}{kind}", *values)
        return at

    def text(self, text: str) -> Cdr:
        """Append a UTF-8 text."""
        data = text.encode().replace(b"\0", b"") + b"\0"
        self.number("I", len(data))
        self.raw += data
        return self

    def texts(self, texts: Sequence[str]) -> None:
        """Append a list of texts."""
        self.number("I", len(texts))
        for text in texts:
            self.text(text)

    def array(self, values: np.ndarray) -> int:
        """Append a list of numbers, in memory order; returns the offset of the first."""
        self.number("I", values.size)
        at = self.align(values.itemsize) if values.size else len(self.raw)
        self.raw += np.ascontiguousarray(values).tobytes()
        return at

    def header(self, stamp_ns: int, frame: str = FRAME) -> int:
        """Append a std_msgs/Header; returns the offset of its stamp."""
        whole, rest = seconds(stamp_ns)
        at = self.number("i", whole)
        self.number("I", rest)
        self.text(frame)
        return at
