"""Which units of a skin stand on flat lattices, and where on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topology import Topology

__all__ = ["Cells", "find_lattices"]

ALIKE_MM = 1e-3
"""Units within this of a lattice stand on it [assumed: far below the tolerances of a skin]."""
EMPTY_SHARE = 3
"""A lattice with more cells than this times its units is none [assumed]."""
LEAST_UNITS = 32
"""Fewer units than these are not worth a lattice [measured]."""


@dataclass(frozen=True, eq=False)
class Cells:
    """A flat lattice: units in rows of cells, with empty ones between the rows.

    Attributes
    ----------
    units : ndarray, shape (q,)
    row, column : ndarray, shape (q,)
    """

    units: np.ndarray
    row: np.ndarray
    column: np.ndarray


def find_lattices(topology: Topology) -> list[Cells]:
    """Flat lattices of a skin: units of one attitude, in one plane, at whole steps of two vectors.

    Patches that continue one lattice are one; a unit is on one lattice at most.
    """
    frames = np.zeros(topology.n, int)
    if topology.patch_frames:
        _, frames = np.unique(np.array(topology.patch_frames)[topology.patch], return_inverse=True)
    height = np.einsum("an,an->n", topology.rotation[:, 2], topology.position)
    attitude = np.vstack([
        frames, 1e3 * height / ALIKE_MM, topology.rotation.reshape(9, -1) / 1e-6
    ])  # fmt: skip
    _, plane = np.unique(np.rint(attitude).astype(np.int64), axis=1, return_inverse=True)
    found = []
    for groups in (plane.ravel(), plane.ravel() * len(topology.patch_names) + topology.patch):
        free = np.ones(topology.n, bool)
        for cells in found:
            free[cells.units] = False
        for group in np.unique(groups[free]):
            units = np.flatnonzero(free & (groups == group))
            cells = _cells(topology, units)
            if cells is not None:
                found.append(cells)
    return found


def _cells(topology: Topology, units: np.ndarray) -> Cells | None:
    """Rows and columns of units of one attitude; None if they stand on no lattice."""
    if units.size < LEAST_UNITS:
        return None
    place = 1e3 * np.einsum(
        "ab,an->bn", topology.rotation[:, :2, units[0]], topology.position[:, units]
    )
    step = np.linalg.norm(place - place[:, :1], axis=0)
    near = np.argsort(step)[1:7]
    between = (place - place[:, :1])[:, near]
    first = between[:, 0]
    across = np.abs(first[0] * between[1] - first[1] * between[0])
    oblique = across > 0.1 * step[near] * step[near[0]]
    if not oblique.any():
        return None
    basis = np.stack([between[:, int(np.argmax(oblique))], first], axis=1)
    steps = np.linalg.solve(basis, place - place[:, :1])
    whole = np.rint(steps)
    if np.abs(basis @ (steps - whole)).max() > ALIKE_MM:
        return None
    row, column = (whole - whole.min(axis=1, keepdims=True)).astype(np.int64)
    along = np.sum((np.diff(row) == 0) & (np.abs(np.diff(column)) == 1))
    if np.sum((np.diff(column) == 0) & (np.abs(np.diff(row)) == 1)) > along:
        row, column = column, row
    if np.sum(np.diff(column) == -1) > np.sum(np.diff(column) == 1):
        column = column.max() - column
    if (row.max() + 1) * (column.max() + 1) > EMPTY_SHARE * units.size:
        return None
    return Cells(units, row, column)
