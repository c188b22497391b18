"""Messages to bytes: CDR as DDS and ROS 2 use it (OMG Common Data Representation, XCDR version 1).

Little-endian; every number is aligned to its size, counted from the end of the four bytes of the
head. Arrays of numbers are copied as a whole, so that a skin of a thousand units costs little more
than one of ten.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skin.messages import FIELDS, NUMBERS, fields_of

__all__ = ["encode"]

HEAD = b"\x00\x01\x00\x00"
"""CDR, little-endian, without options."""
_FORMATS = {
    "bool": "<?", "byte": "<B", "uint8": "<B", "uint16": "<H", "int32": "<i", "uint32": "<I",
    "int64": "<q", "uint64": "<Q", "float32": "<f", "float64": "<d",
}  # fmt: skip


def encode(message: str, values: Mapping[str, Any]) -> bytes:
    """A message as bytes.

    Parameters
    ----------
    message : str
        A name of `skin.messages.FIELDS`.
    values : mapping
        Of each field: a number, a text, a mapping for a message, a sequence for an array.

    Examples
    --------
    >>> encode("builtin_interfaces/msg/Time", {"sec": 1, "nanosec": 2}).hex(" ", 4)
    '00010000 01000000 02000000'
    """
    out = bytearray(HEAD)
    _put(out, message, values)
    return bytes(out)


def _put(out: bytearray, message: str, values: Mapping[str, Any]) -> None:
    for field in fields_of(message):
        value = values[field.name]
        if not field.is_array:
            _put_one(out, field.kind, value)
            continue
        if not field.size:
            _align(out, 4)
            out += struct.pack("<I", len(value))
        _put_array(out, field.kind, value)


def _put_one(out: bytearray, kind: str, value: Any) -> None:
    if kind in FIELDS:
        _put(out, kind, value)
    elif kind == "string":
        text = value.encode()
        _align(out, 4)
        out += struct.pack("<I", len(text) + 1)
        out += text + b"\0"
    else:
        form = _FORMATS[kind]
        _align(out, struct.calcsize(form))
        out += struct.pack(form, value)


def _put_array(out: bytearray, kind: str, values: Sequence[Any] | np.ndarray) -> None:
    if kind not in NUMBERS:
        for value in values:
            _put_one(out, kind, value)
    elif len(values):
        numbers = np.ascontiguousarray(values, NUMBERS[kind])
        _align(out, numbers.itemsize)
        out += numbers.tobytes()


def _align(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - len(HEAD)) % size)
