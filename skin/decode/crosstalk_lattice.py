"""Cross-talk on a flat lattice, all of whose units share the coefficients of an offset.

The films stand in padded rows of cells, so that a neighbour is a constant number of cells away and
the cell beyond the edge is empty. A term of all neighbours of one offset is then one shifted,
contiguous load and one coefficient: `GROUP` of them, of any offsets, are added up in
registers for three axes at once.

Sums have a constant pitch: it is what shows the compiler that loads and stores do not overlap.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import LINE, zeros
from bus.compiled.bound import Bound
from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.crosstalk_cells import Cells
from skin.decode.crosstalk_kernels import Films
from skin.decode.crosstalk_terms import FACTORS, NOT_NEGATIVE, Terms, metric, terms_of
from skin.physics.stencil import Stencil
from skin.physics.stray import powers

__all__ = ["Lattice", "LatticeData", "LatticeModel", "lattice", "lattice_python", "prune_terms"]

BLOCK = 192
"""Cells that are added up, or skipped, together: a constant, not a count, is what the compiler
makes the most of."""
GROUP = 8
"""Terms that are added up in registers."""
ALIKE_SHARE = 1e-6
"""Largest difference of coefficients, as a share of the largest, of pairs that share them
[assumed: above rounding, below what two units differ by]."""


class Runs(NamedTuple):
    """Units that follow each other in consecutive cells of one block; shape (r,), int64."""

    unit: np.ndarray  # the first one
    cell: np.ndarray  # its cell
    length: np.ndarray


class LatticeModel(NamedTuple):
    """A flat lattice."""

    runs: Runs
    first_run: np.ndarray  # (blocks + 1,) int64, of each block of cells, and their number
    cells: int  # a multiple of BLOCK
    halo: int  # largest offset in cells; rows begin and end with that many empty ones
    pitch: int  # cells from row to row
    terms: Terms
    place: np.ndarray  # (g * GROUP,) int64: where each term of the first cell's neighbours stands
    coefficients: np.ndarray  # (g * 3 * GROUP,), axis by axis within a group


class LatticeData(NamedTuple):
    """What is read, what is added to, and what is kept."""

    films: Films
    field_ut: np.ndarray  # (3, n), added to
    rows: np.ndarray  # (k * pitch,) terms; cells without a unit are zero and stay so
    sums: np.ndarray  # (3 * BLOCK,) scratch
    active: np.ndarray  # (blocks,) bool: which have a film that has moved
    was_active: np.ndarray  # the same in the cycle before


@jitable(inline=True)
def _take_over(model, data, block):
    """Copy the films of a block into its cells; whether one of them has moved."""
    runs, films, rows = model.runs, data.films, data.rows
    nothing = rows.dtype.type(0.0)
    moved = 0
    for r in range(model.first_run[block], model.first_run[block + 1]):
        unit = runs.unit[r] & NOT_NEGATIVE
        cell = (model.halo + runs.cell[r]) & NOT_NEGATIVE
        count = runs.length[r]
        for i in range(count):
            rows[cell + i] = films.dx_mm[unit + i]
        cell = (cell + model.pitch) & NOT_NEGATIVE
        for i in range(count):
            rows[cell + i] = films.dy_mm[unit + i]
        cell = (cell + model.pitch) & NOT_NEGATIVE
        for i in range(count):
            rows[cell + i] = films.depth_mm[unit + i]
        cell = (cell + model.pitch) & NOT_NEGATIVE
        for i in range(count):
            rows[cell + i] = films.weight[unit + i]
        for i in range(count):
            moved |= films.weight[unit + i] != nothing
    return moved != 0


@jitable(inline=True)
def _multiply(model, rows, block):
    """All terms of the films of a block."""
    start, pitch = model.halo + block * BLOCK, model.pitch
    # the weight stands where dx times weight will: H, dy and dx, in this order
    weight = (FACTORS * pitch + start) & NOT_NEGATIVE
    for k in range(FACTORS - 1, -1, -1):
        of = (k * pitch + start) & NOT_NEGATIVE
        to = ((FACTORS + k) * pitch + start) & NOT_NEGATIVE
        for i in range(BLOCK):
            rows[to + i] = rows[of + i] * rows[weight + i]
    for k in range(2 * FACTORS, model.terms.parent.size):
        of = (model.terms.parent[k] * pitch + start) & NOT_NEGATIVE
        by = (model.terms.factor[k] * pitch + start) & NOT_NEGATIVE
        to = (k * pitch + start) & NOT_NEGATIVE
        for i in range(BLOCK):
            rows[to + i] = rows[of + i] * rows[by + i]


@jitable(inline=True)
def _sum_terms(place, c, rows, sums, start):
    """Sums over the terms of all neighbours of the cells from `start` on, a block of them."""
    nothing = sums.dtype.type(0.0)
    for i in range(3 * BLOCK):
        sums[i] = nothing
    for g in range(place.size // GROUP):
        k = (g * GROUP) & NOT_NEGATIVE
        r0, r1 = (place[k] + start) & NOT_NEGATIVE, (place[k + 1] + start) & NOT_NEGATIVE
        r2, r3 = (place[k + 2] + start) & NOT_NEGATIVE, (place[k + 3] + start) & NOT_NEGATIVE
        r4, r5 = (place[k + 4] + start) & NOT_NEGATIVE, (place[k + 5] + start) & NOT_NEGATIVE
        r6, r7 = (place[k + 6] + start) & NOT_NEGATIVE, (place[k + 7] + start) & NOT_NEGATIVE
        k *= 3
        x0, x1, x2, x3 = c[k], c[k + 1], c[k + 2], c[k + 3]
        x4, x5, x6, x7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
        k += GROUP
        y0, y1, y2, y3 = c[k], c[k + 1], c[k + 2], c[k + 3]
        y4, y5, y6, y7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
        k += GROUP
        z0, z1, z2, z3 = c[k], c[k + 1], c[k + 2], c[k + 3]
        z4, z5, z6, z7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
        for i in range(BLOCK):
            m0, m1, m2, m3 = rows[r0 + i], rows[r1 + i], rows[r2 + i], rows[r3 + i]
            m4, m5, m6, m7 = rows[r4 + i], rows[r5 + i], rows[r6 + i], rows[r7 + i]
            # from left to right, so that each is one multiplication and addition
            x, y, z = sums[i], sums[i + BLOCK], sums[i + 2 * BLOCK]
            x = x + x0 * m0 + x1 * m1 + x2 * m2 + x3 * m3
            y = y + y0 * m0 + y1 * m1 + y2 * m2 + y3 * m3
            z = z + z0 * m0 + z1 * m1 + z2 * m2 + z3 * m3
            sums[i] = x + x4 * m4 + x5 * m5 + x6 * m6 + x7 * m7
            sums[i + BLOCK] = y + y4 * m4 + y5 * m5 + y6 * m6 + y7 * m7
            sums[i + 2 * BLOCK] = z + z4 * m4 + z5 * m5 + z6 * m6 + z7 * m7


def lattice_python(model, data):
    """Add the stray fields within one flat lattice.

    Parameters
    ----------
    model : LatticeModel
    data : LatticeData
    """
    assume_noalias()
    active, was_active, runs = data.active, data.was_active, model.runs
    for b in range(active.size):
        was_active[b] = active[b]
        active[b] = _take_over(model, data, b)
        if active[b] or was_active[b]:
            _multiply(model, data.rows, b)
    for b in range(active.size):
        start = b * BLOCK
        first = max(start - model.halo, 0) // BLOCK
        last = min(start + BLOCK - 1 + model.halo, model.cells - 1) // BLOCK
        near = False
        for a in range(first, last + 1):
            near |= active[a]
        if not near:
            continue
        _sum_terms(model.place, model.coefficients, data.rows, data.sums, start)
        for r in range(model.first_run[b], model.first_run[b + 1]):
            unit = runs.unit[r] & NOT_NEGATIVE
            for axis in range(3):
                of = (axis * BLOCK + runs.cell[r] - start) & NOT_NEGATIVE
                for i in range(runs.length[r]):
                    data.field_ut[axis, unit + i] += data.sums[of + i]


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
        blocks = self.model.first_run.size - 1
        self._scratch = (
            zeros(self.model.terms.parent.size * self.model.pitch, dtype),
            zeros(3 * BLOCK, dtype), np.zeros(blocks, bool), np.zeros(blocks, bool),
        )  # fmt: skip

    def bound(self, films: Films, field_ut: np.ndarray) -> Bound:
        """See `Part`."""
        return Bound(lattice, self.model, LatticeData(films, field_ut, *self._scratch))


def _model(
    cells: Cells, steps: np.ndarray, exponents: np.ndarray, kept: np.ndarray, stays: np.ndarray,
    dtype: np.dtype,
) -> LatticeModel:  # fmt: skip
    """Where everything stands, from the offsets, shape (2, o), and `prune_terms` of their terms."""
    wide = int(cells.column.max()) + 1 + int(np.abs(steps[1]).max(initial=0))
    furthest = int(np.abs(steps[0] * wide + steps[1]).max(initial=0))
    halo = furthest + -furthest % (LINE // dtype.itemsize)
    count = wide * (int(cells.row.max()) + 1)
    count += -count % BLOCK
    pitch = count + 2 * halo
    terms, row = terms_of(exponents[stays.any(axis=0)])
    # terms by the row of cells that they come from: what is near in memory is used together
    slots = sorted((steps[0, o], row[tuple(exponents[p].tolist())], steps[1, o], o, p)
                   for o, p in np.argwhere(stays))  # fmt: skip
    size = len(slots) + -len(slots) % GROUP
    place, values = np.full(size, halo, np.int64), np.zeros((size, 3))
    for slot, (r, term, c, o, p) in enumerate(slots):
        place[slot] += term * pitch + r * wide + c
        values[slot] = kept[o, :, p]
    groups = values.reshape(-1, GROUP, 3).transpose(0, 2, 1)
    runs, first_run = _runs(cells.units, cells.row * wide + cells.column, count)
    return LatticeModel(
        runs, first_run, count, halo, pitch, terms, place,
        np.ascontiguousarray(groups, dtype).reshape(-1),
    )  # fmt: skip


def _shared(cells: Cells, stencil: Stencil, pairs: np.ndarray, step: np.ndarray) -> bool:
    """Whether all units so far apart are pairs, with the same coefficients."""
    stands = set(zip(cells.row.tolist(), cells.column.tolist(), strict=True))
    if len(pairs) != sum((r + step[0], c + step[1]) in stands for r, c in stands):
        return False
    kinds = np.unique(stencil.kind[pairs])
    values = stencil.coefficients[kinds]
    return bool(np.ptp(values, axis=0).max() <= ALIKE_SHARE * np.abs(values).max())


def _runs(units: np.ndarray, at: np.ndarray, cells: int) -> tuple[Runs, np.ndarray]:
    """Stretches that go on in units and cells, and the first one of each block of cells."""
    order = np.argsort(at)
    units, at = units[order], at[order]
    block = at // BLOCK
    go_on = (np.diff(units) == 1) & (np.diff(at) == 1) & (np.diff(block) == 0)
    first = np.concatenate([[0], np.flatnonzero(~go_on) + 1])
    length = np.diff(np.append(first, units.size))
    first_run = np.searchsorted(block[first], np.arange(cells // BLOCK + 1))
    return Runs(*(each.astype(np.int64) for each in (units[first], at[first], length))), first_run


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
