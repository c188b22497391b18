"""The kernel that fills the record of a cycle from the arrays of a pipeline.

The record has a few thousand bytes. Copying array by array, the interpreter would take longer than
the copies; here one call copies them all. Its arguments are plain bytes, so that one compiled
function serves any skin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable

__all__ = ["Contacts", "Numbers", "copy", "fill", "fill_python"]


class Numbers(NamedTuple):
    """Scalars of a state."""

    given: np.ndarray
    """Time stamp, number of the cycle, whether it is whole, contacts beyond the capacity,
    contacts, int64, shape (5,)."""
    fields: tuple[np.ndarray, ...]
    """Fields of the record for the first four, int64, shape (1,)."""


class Contacts(NamedTuple):
    """Records of contacts, and their place in the record."""

    present: np.ndarray
    """Indices of the records, oldest first, int64, shape (s // 2,)."""
    records: np.ndarray
    """Bytes, shape (s, size)."""
    count: np.ndarray
    """Field of the record: number of contacts, int32, shape (1,)."""
    copies: np.ndarray
    """Field of the record, bytes, shape (k, size)."""


@jitable
def copy(given, into, first, last):
    """Copy bytes `first` to `last`, to the same offsets."""
    for i in range(first, last):
        into[i] = given[i]


@jitable
def fill_python(numbers, given, fields, contacts):
    """Copy scalars and arrays of a state into their fields, and its contacts."""
    for k in range(len(numbers.fields)):
        numbers.fields[k][0] = numbers.given[k]
    contacts.count[0] = numbers.given[len(numbers.fields)]
    for k in range(len(given)):
        copy(given[k], fields[k], 0, given[k].size)
    for k in range(contacts.count[0]):
        copy(contacts.records[contacts.present[k]], contacts.copies[k], 0, contacts.copies.shape[1])


fill = compiled(fill_python, allocates=False)
