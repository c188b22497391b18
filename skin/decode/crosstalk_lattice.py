"""Cross-talk on a flat lattice, all of whose units share the coefficients of an offset.

The films stand in padded rows of cells, so that a neighbour is a constant number of cells away and
the cell beyond the edge is empty. A term of all neighbours of one offset is then one shifted,
contiguous load and one coefficient. The sums of a block of cells stay in registers while the terms
are added up; those that come from blocks where no film has moved are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.bound import Bound
from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.crosstalk_cells import Cells
from skin.decode.crosstalk_kernels import Films
from skin.decode.crosstalk_terms import FACTORS, NOT_NEGATIVE, Terms, metric, terms_of
from skin.physics.stencil import Stencil
from skin.physics.stray import powers

__all__ = ["Lattice", "LatticeData", "LatticeModel", "lattice", "lattice_python", "prune_terms"]

BLOCK = 48
"""Cells that are added up, or skipped, together: a constant, so that their sums for three axes stay
in registers [tuned on `benchmarks contact`]."""
AT_ONCE = 2
"""Terms of films that are multiplied together."""
ALIKE_SHARE = 1e-6
"""Largest difference of coefficients, as a share of the largest, of pairs that share them
[assumed: above rounding, below what two units differ by]."""


class Runs(NamedTuple):
    """Units that follow each other in consecutive cells; shape (r,), int64."""

    unit: np.ndarray  # the first one
    cell: np.ndarray  # its cell in a row
    length: np.ndarray


class LatticeModel(NamedTuple):
    """A flat lattice."""

    runs: Runs
    halo: int  # blocks at both ends of a row that stay empty
    pitch: int  # cells from row to row
    terms: Terms
    first_term: np.ndarray  # (2 * halo + 1,) int64: those from here on come from a block and the
    # next one, the first of them `halo` blocks back
    place: np.ndarray  # (t,) int64: where each term of the neighbours of cell 0 stands
    coefficients: np.ndarray  # (t, 3)


class LatticeData(NamedTuple):
    """What is read, what is added to, and what is kept."""

    films: Films
    field_ut: np.ndarray  # (3, n), added to
    rows: np.ndarray  # ((k + 1) * pitch,) terms, then the weight; empty cells stay zero
    sums: tuple[np.ndarray, ...]  # x, y, z, (pitch,) each, scratch
    active: np.ndarray  # (blocks,) bool: which have a film that has moved
    was_active: np.ndarray  # the same in the cycle before


@jitable(inline=True)
def _take_over(model, films, rows):
    """Copy the films into their cells."""
    runs, pitch = model.runs, model.pitch
    for r in range(runs.unit.size):
        unit, length = runs.unit[r] & NOT_NEGATIVE, runs.length[r]
        cell = runs.cell[r] & NOT_NEGATIVE
        for i in range(length):
            rows[cell + i] = films.dx_mm[unit + i]
        cell = (cell + pitch) & NOT_NEGATIVE
        for i in range(length):
            rows[cell + i] = films.dy_mm[unit + i]
        cell = (cell + pitch) & NOT_NEGATIVE
        for i in range(length):
            rows[cell + i] = films.depth_mm[unit + i]
        cell = (cell + (model.terms.parent.size - 2) * pitch) & NOT_NEGATIVE
        for i in range(length):
            rows[cell + i] = films.weight[unit + i]


@jitable(inline=True)
def _has_moved(rows, weight):
    """Whether a film of a block has moved, whose weights stand from `weight` on."""
    nothing = rows.dtype.type(0.0)
    moved = 0
    for i in range(BLOCK):
        moved |= rows[weight + i] != nothing
    return moved != 0


@jitable(inline=True)
def _multiply(terms, rows, pitch, start):
    """All terms of the films of a block."""
    parent, factor = terms
    for k in range(FACTORS, parent.size, AT_ONCE):
        to = (k * pitch + start) & NOT_NEGATIVE
        of = (parent[k] * pitch + start) & NOT_NEGATIVE
        by = (factor[k] * pitch + start) & NOT_NEGATIVE
        to_1 = (to + pitch) & NOT_NEGATIVE
        of_1 = (parent[k + 1] * pitch + start) & NOT_NEGATIVE
        by_1 = (factor[k + 1] * pitch + start) & NOT_NEGATIVE
        _products((rows, rows, rows), (to, of, by), (to_1, of_1, by_1))


@jitable(inline=True)
def _products(rows, one, other):
    """Two products, so that the compiler makes vectors of the loop before it unrolls it."""
    assume_noalias()  # two rows that are written, and those that are read
    (out, out_1, of), (to, left, right), (to_1, left_1, right_1) = rows, one, other
    for i in range(BLOCK):
        out[to + i] = of[left + i] * of[right + i]
        out_1[to_1 + i] = of[left_1 + i] * of[right_1 + i]


@jitable(inline=True)
def _add_terms(model, rows, sums, first, last, start):
    """Add terms of neighbours to the sums of the cells from `start` on, a block of them."""
    assume_noalias()
    place, coefficients, (x_ut, y_ut, z_ut) = model.place, model.coefficients, sums
    for t in range(first, last):
        at = (place[t] + start) & NOT_NEGATIVE
        x, y, z = coefficients[t, 0], coefficients[t, 1], coefficients[t, 2]
        for i in range(BLOCK):
            term = rows[at + i]
            x_ut[start + i] += x * term
            y_ut[start + i] += y * term
            z_ut[start + i] += z * term


def lattice_python(model, data):
    """Add the stray fields within one flat lattice.

    Parameters
    ----------
    model : LatticeModel
    data : LatticeData
    """
    assume_noalias()
    rows, pitch, active, was_active = data.rows, model.pitch, data.active, data.was_active
    first_term, weight = model.first_term, model.terms.parent.size * pitch
    _take_over(model, data.films, rows)
    for b in range(model.halo, active.size - model.halo):
        start = (b * BLOCK) & NOT_NEGATIVE
        was_active[b] = active[b]
        active[b] = _has_moved(rows, (weight + start) & NOT_NEGATIVE)
        if active[b] or was_active[b]:
            _multiply(model.terms, rows, pitch, start)
    for axis in range(3):
        data.sums[axis][:] = 0.0
    for b in range(model.halo, active.size - model.halo):
        for step in range(2 * model.halo):
            of = b - model.halo + step
            if active[of] or active[of + 1]:
                first, last = first_term[step], first_term[step + 1]
                _add_terms(model, rows, data.sums, first, last, (b * BLOCK) & NOT_NEGATIVE)
    for r in range(model.runs.unit.size):
        unit, cell = model.runs.unit[r] & NOT_NEGATIVE, model.runs.cell[r] & NOT_NEGATIVE
        for axis in range(3):
            for i in range(model.runs.length[r]):
                data.field_ut[axis, unit + i] += data.sums[axis][cell + i]


lattice = compiled(lattice_python, fastmath={"contract"}, allocates=False)


class Lattice:
    """The pairs of one flat lattice: a `Part`.

    Parameters
    ----------
    cells : Cells
    stencil : Stencil
    tolerance_ut : float
        See `CrossTalk`.
    dtype : dtype
    """

    def __init__(
        self, cells: Cells, stencil: Stencil, tolerance_ut: float, dtype: np.dtype
    ) -> None:
        here = np.full(stencil.n, -1)
        here[cells.units] = np.arange(cells.units.size)
        unit = stencil.unit
        both = np.flatnonzero((here[unit] >= 0) & (here[stencil.neighbour] >= 0))
        at, by = here[unit[both]], here[stencil.neighbour[both]]
        steps = np.stack([cells.row[by] - cells.row[at], cells.column[by] - cells.column[at]])
        offsets, which = np.unique(steps, axis=1, return_inverse=True)
        which = which.ravel()
        shared = [o for o in range(offsets.shape[1])
                  if _shared(cells, stencil, both[which == o], offsets[:, o])]  # fmt: skip
        inside = np.isin(which, shared)
        self.pairs = both[inside]
        first = np.array([both[which == o][0] for o in shared], int)
        full = stencil.coefficients[stencil.kind[first]]
        strongest = float(stencil.strength[cells.units].max())
        kept, stays = prune_terms(full, metric(stencil), tolerance_ut / strongest)
        self.off = (kept - full)[np.searchsorted(shared, which[inside])]
        self.terms = int(stays.sum())
        self.model = _model(cells, offsets[:, shared], powers(stencil.degree), kept, stays, dtype)
        pitch = self.model.pitch
        self._scratch = (
            zeros((self.model.terms.parent.size + 1) * pitch, dtype),
            tuple(zeros(pitch, dtype) for _ in range(3)),
            np.zeros(pitch // BLOCK, bool), np.zeros(pitch // BLOCK, bool),
        )  # fmt: skip

    def bound(self, films: Films, field_ut: np.ndarray) -> Bound:
        """See `Part`."""
        return Bound(lattice, self.model, LatticeData(films, field_ut, *self._scratch))


def _model(
    cells: Cells, steps: np.ndarray, exponents: np.ndarray, kept: np.ndarray, stays: np.ndarray,
    dtype: np.dtype,
) -> LatticeModel:  # fmt: skip
    """Where everything stands, from the offsets, shape (2, o), and `prune_terms` of their terms."""
    steps, kept, stays = steps[:, worth := stays.any(axis=1)], kept[worth], stays[worth]
    wide = int(cells.column.max()) + 1 + int(np.abs(steps[1]).max(initial=0))
    distance = steps[0] * wide + steps[1]
    halo = int(np.abs(distance).max(initial=0)) // BLOCK + 1
    pitch = (2 * halo + -(-wide * (int(cells.row.max()) + 1) // BLOCK)) * BLOCK
    terms, row = terms_of(exponents[stays.any(axis=0)], AT_ONCE)
    terms.parent[FACTORS : 2 * FACTORS] = terms.parent.size  # the weight
    # by distance: what is near in memory is used together, and skipped together
    slots = np.argwhere(stays)[np.argsort(distance[np.nonzero(stays)[0]], kind="stable")]
    where = distance[slots[:, 0]]
    term = [row[tuple(exponents[p].tolist())] for p in slots[:, 1]]
    return LatticeModel(
        runs=_runs(cells.units, halo * BLOCK + cells.row * wide + cells.column),
        halo=halo, pitch=pitch, terms=terms,
        first_term=np.searchsorted(where, BLOCK * np.arange(-halo, halo + 1)),
        place=np.array(term, np.int64) * pitch + where,
        coefficients=np.ascontiguousarray(kept[slots[:, 0], :, slots[:, 1]], dtype),
    )  # fmt: skip


def _shared(cells: Cells, stencil: Stencil, pairs: np.ndarray, step: np.ndarray) -> bool:
    """Whether all units so far apart are pairs, with the same coefficients."""
    stands = set(zip(cells.row.tolist(), cells.column.tolist(), strict=True))
    if len(pairs) != sum((r + step[0], c + step[1]) in stands for r, c in stands):
        return False
    kinds = np.unique(stencil.kind[pairs])
    values = stencil.coefficients[kinds]
    return bool(np.ptp(values, axis=0).max() <= ALIKE_SHARE * np.abs(values).max())


def _runs(units: np.ndarray, at: np.ndarray) -> Runs:
    """Stretches that go on in units and cells."""
    order = np.argsort(at)
    units, at = units[order], at[order]
    go_on = (np.diff(units) == 1) & (np.diff(at) == 1)
    first = np.concatenate([[0], np.flatnonzero(~go_on) + 1])
    length = np.diff(np.append(first, units.size))
    return Runs(*(each.astype(np.int64) for each in (units[first], at[first], length)))


def prune_terms(
    coefficients: np.ndarray, gram: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Leave out terms until the root mean square of what is missing, per axis, is the tolerance.

    Parameters
    ----------
    coefficients : ndarray, shape (o, 3, terms)
        Of all neighbours of a unit.
    gram : ndarray, shape (terms, terms)
    tolerance : float

    Returns
    -------
    coefficients : ndarray, shape (o, 3, terms)
        Of the terms that stay, zero for the others.
    stays : ndarray, shape (o, terms), bool
    """
    left = coefficients.copy()
    inverse = np.repeat(np.linalg.inv(gram)[np.newaxis], len(left), axis=0)
    stays = np.ones((len(left), gram.shape[0]), bool)
    missing = 0.0
    price = np.sum(left**2, axis=1) / np.einsum("opp->op", inverse)
    while stays.any():
        o, p = np.unravel_index(int(np.argmin(price)), price.shape)
        if missing + price[o, p] > 3.0 * tolerance**2:
            break
        missing += price[o, p]
        column = inverse[o, :, p] / inverse[o, p, p]
        left[o] -= np.outer(left[o, :, p], column)
        inverse[o] -= np.outer(inverse[o, :, p], column)
        stays[o, p] = False
        left[o, :, ~stays[o]] = 0.0
        alive = np.flatnonzero(stays[o])
        price[o] = np.inf
        price[o, alive] = np.sum(left[o][:, alive] ** 2, axis=0) / inverse[o, alive, alive]
    return left, stays
