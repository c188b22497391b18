"""Vectors of three numbers in kernels, and rotations that are rows of nine."""

from __future__ import annotations

from bus.compiled.jit import jitable

__all__ = ["add", "dot", "turned", "turned_back"]


@jitable
def turned(rotation, row, v):
    """R v, of a rotation that is a row of nine."""
    r = rotation[row]
    return (r[0] * v[0] + r[1] * v[1] + r[2] * v[2], r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
            r[6] * v[0] + r[7] * v[1] + r[8] * v[2])  # fmt: skip


@jitable
def turned_back(rotation, row, v):
    """R^T v."""
    r = rotation[row]
    return (r[0] * v[0] + r[3] * v[1] + r[6] * v[2], r[1] * v[0] + r[4] * v[1] + r[7] * v[2],
            r[2] * v[0] + r[5] * v[1] + r[8] * v[2])  # fmt: skip


@jitable
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jitable
def add(a, b, share):
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]
