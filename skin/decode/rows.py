"""Rows of numbers of all units, as the stages of the kernel see them: from a block's first unit on.

Places are unsigned, so that the compiler knows that none counts from the end of the array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable

__all__ = ["Rows", "read", "rows_of", "write"]


class Rows(NamedTuple):
    """Rows of a cycle.

    Attributes
    ----------
    values : ndarray, shape (r * n,)
    units : uintp
        n, from one row to the next.
    first : uintp
        Place of lane 0 in row 0.
    """

    values: np.ndarray
    units: np.unsignedinteger
    first: np.unsignedinteger


@jitable
def rows_of(values, first):
    """Rows of an array of shape (r, n), from a unit on."""
    return Rows(values.reshape(values.size), np.uintp(values.shape[1]), np.uintp(first))


@jitable
def read(rows, row, lane):
    """The number of a lane in a row."""
    return rows.values[rows.first + np.uintp(row) * rows.units + np.uintp(lane)]


@jitable
def write(rows, row, lane, value):
    """Set the number of a lane in a row."""
    rows.values[rows.first + np.uintp(row) * rows.units + np.uintp(lane)] = value
