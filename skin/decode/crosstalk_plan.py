"""How cross-talk is computed on a given skin: what stands where, and which terms are worth it.

A stencil has more terms than a live skin needs: the far neighbours' cubic ones are of nanotesla.
Terms are left out, the cheapest in error first, until what is missing reaches a tolerance. The
terms are not orthogonal, so those that stay take over what they can of one that goes: in the metric
of the stencil's own range (`Stencil.gram`) that is a projection, and its error is known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bus.compiled.aligned import LINE, zeros
from skin.decode import crosstalk_kernels as k
from skin.decode.crosstalk_cells import Cells
from skin.physics.stencil import Stencil
from skin.physics.stray import powers

__all__ = ["Lattice", "Scattered", "Table", "worth_it"]

ALIKE_SHARE = 1e-6
"""Largest difference of coefficients, as a share of the largest, of pairs that share them."""
ALL_AROUND = 4
"""Neighbours at one distance."""


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of terms, each the product of two earlier ones.

    Attributes
    ----------
    parent, factor : ndarray, shape (k,), int64
        See `crosstalk_kernels.lattice_python`.
    row : dict of tuple to int
        Row of each term (i, j, k) of ``dx^i dy^j H^k``.
    """

    parent: np.ndarray
    factor: np.ndarray
    row: dict[tuple[int, int, int], int]

    @classmethod
    def of(cls, terms: np.ndarray, filled_up: int = 1) -> Table:
        """Rows for `terms`, and whatever they are products of, by degree.

        Each degree is filled up to a multiple of `filled_up` with rows that mean nothing.
        """
        needed = {tuple(int(e) for e in term) for term in terms}
        needed |= {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
        for degree in range(max(map(sum, needed)), 1, -1):
            needed |= {_parent(term)[0] for term in needed if sum(term) == degree}
        parent, factor, row = [0] * k.FACTORS, [0] * k.FACTORS, {}
        for degree in range(1, max(map(sum, needed)) + 1):
            for term in sorted((t for t in needed if sum(t) == degree), reverse=True):
                row[term] = len(parent)
                above, axis = _parent(term)
                parent.append(row.get(above, 0))
                factor.append(axis)
            while (len(parent) - k.FACTORS) % filled_up:
                parent.append(k.FACTORS)
                factor.append(0)
        return cls(np.array(parent), np.array(factor), row)


def _parent(term: tuple[int, int, int]) -> tuple[tuple[int, int, int], int]:
    """The term that is one factor less, and the factor."""
    axis = max(a for a in range(3) if term[a])
    return tuple(e - (a == axis) for a, e in enumerate(term)), axis


def _metric(stencil: Stencil) -> np.ndarray:
    """Gram matrix in which a mean counts several times.

    Errors of neighbours that scatter add up as squares, their means as they are: a pressed
    neighbourhood of four is four times as far off as one of them.
    """
    return stencil.gram + (ALL_AROUND - 1) * np.outer(stencil.mean, stencil.mean)


def worth_it(
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


def by_degree(coefficients: np.ndarray, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the best polynomials of every lower degree, and what each misses.

    Parameters
    ----------
    coefficients : ndarray, shape (m, 3, terms)
    gram : ndarray, shape (terms, terms)

    Returns
    -------
    lower : ndarray, shape (d + 1, m, 3, terms)
        Of degree 0, which is nothing, to the full one.
    missing : ndarray, shape (d + 1, m)
        Mean square, summed over the axes.
    """
    count = gram.shape[0]
    ends = [end for end in (0, 3, 9, 19, 34) if end <= count]
    lower = np.zeros((len(ends), *coefficients.shape))
    missing = np.zeros((len(ends), len(coefficients)))
    for d, end in enumerate(ends):
        onto = np.linalg.solve(gram[:end, :end], gram[:end]) if end else np.zeros((0, count))
        lower[d, :, :, :end] = coefficients @ onto.T
        off = lower[d] - coefficients
        missing[d] = np.einsum("map,pq,maq->m", off, gram, off)
    return lower, np.maximum(missing, 0.0)


class Lattice:
    """The pairs of one flat lattice, as `crosstalk_kernels.lattice` takes them.

    Parameters
    ----------
    cells : Cells
    stencil : Stencil
    unit : ndarray, shape (m,)
        Of each pair of the stencil.
    tolerance_ut : float
    dtype : dtype

    Attributes
    ----------
    pairs : ndarray of int
        Pairs of the stencil that are in.
    off : ndarray, shape (p, 3, terms)
        Coefficients that are used minus those of the stencil, of each of these pairs.
    terms : int
        That are computed for a unit, of all its neighbours together.
    """

    def __init__(
        self, cells: Cells, stencil: Stencil, unit: np.ndarray, tolerance_ut: float, dtype: np.dtype
    ) -> None:
        here = np.full(stencil.n, -1)
        here[cells.units] = np.arange(cells.units.size)
        both = np.flatnonzero((here[unit] >= 0) & (here[stencil.neighbour] >= 0))
        at, by = here[unit[both]], here[stencil.neighbour[both]]
        steps = np.stack([cells.row[by] - cells.row[at], cells.column[by] - cells.column[at]])
        offsets, which = np.unique(steps, axis=1, return_inverse=True)
        which = which.ravel()
        shared = [o for o in range(offsets.shape[1])
                  if _shared(cells, stencil, both[which == o], offsets[:, o])]  # fmt: skip
        inside = np.isin(which, shared)
        self.pairs = both[inside]
        first = [int(both[which == o][0]) for o in shared]
        full = stencil.coefficients[stencil.kind[np.array(first, int)]]
        strongest = float(stencil.strength[cells.units].max())
        left, stays = worth_it(full, _metric(stencil), tolerance_ut / strongest)
        self.off = (left - full)[np.searchsorted(shared, which[inside])]
        self.terms = int(stays.sum())

        columns = int(cells.column.max()) + 1
        steps = offsets[:, shared]
        wide = columns + int(np.abs(steps[1]).max(initial=0))
        furthest = int(np.abs(steps[0] * wide + steps[1]).max(initial=0))
        self.halo = furthest + -furthest % (LINE // np.dtype(dtype).itemsize)
        count = wide * (int(cells.row.max()) + 1)
        self.cells = count + -count % k.BLOCK
        self.pitch = self.cells + 2 * self.halo
        self.runs, self.begin = _runs(cells.units, cells.row * wide + cells.column, self.cells)
        exponents = powers(stencil.degree)
        table = Table.of(exponents[stays.any(axis=0)])
        self.parent, self.factor = table.parent, table.factor
        # terms by the row of cells that they come from: what is near in memory is used together
        slots = sorted((steps[0, o], table.row[tuple(map(int, exponents[p]))], steps[1, o], o, p)
                       for o, p in np.argwhere(stays))  # fmt: skip
        empty = -len(slots) % k.GROUP
        cell = [row * self.pitch + self.halo + r * wide + c for r, row, c, _, _ in slots]
        self.cells_of = np.array(cell + [self.halo] * empty, np.int64)
        values = np.zeros((len(slots) + empty, 3))
        values[: len(slots)] = [left[o, :, p] for *_, o, p in slots] or np.zeros((0, 3))
        groups = values.reshape(-1, k.GROUP, 3).transpose(0, 2, 1)
        self.coefficients = np.ascontiguousarray(groups, dtype).reshape(-1)
        self.rows = zeros(self.parent.size * self.pitch, dtype)
        self.tile = zeros(3 * k.BLOCK, dtype)
        self.active = np.zeros((2, self.begin.size - 1), bool)

    @property
    def arguments(self) -> tuple:
        """Of the kernel, between `sources` and `out`."""
        return (
            self.runs, self.begin, self.cells, self.halo, self.pitch, self.parent, self.factor,
            self.cells_of, self.coefficients, self.rows, self.tile, self.active,
        )  # fmt: skip


def _shared(cells: Cells, stencil: Stencil, pairs: np.ndarray, step: np.ndarray) -> bool:
    """Whether all units so far apart are pairs, with the same coefficients."""
    stands = set(zip(cells.row.tolist(), cells.column.tolist(), strict=True))
    if len(pairs) != sum((r + step[0], c + step[1]) in stands for r, c in stands):
        return False
    kinds = np.unique(stencil.kind[pairs])
    values = stencil.coefficients[kinds]
    return bool(np.ptp(values, axis=0).max() <= ALIKE_SHARE * np.abs(values).max())


def _runs(units: np.ndarray, at: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Stretches that go on in units and cells, and the first one of each block of cells.

    Returns
    -------
    runs : ndarray, shape (r, 3), int64
        First unit, first cell and length, by cell.
    begin : ndarray, shape (blocks + 1,), int64
    """
    order = np.argsort(at)
    units, at = units[order], at[order]
    block = at // k.BLOCK
    go_on = (np.diff(units) == 1) & (np.diff(at) == 1) & (np.diff(block) == 0)
    first = np.concatenate([[0], np.flatnonzero(~go_on) + 1])
    length = np.diff(np.concatenate([first, [units.size]]))
    runs = np.stack([units[first], at[first], length], axis=1).astype(np.int64)
    begin = np.searchsorted(block[first], np.arange(-(-cells // k.BLOCK) + 1))
    return runs, begin.astype(np.int64)


class Scattered:
    """Pairs with coefficients of their own, as `crosstalk_kernels.scattered` takes them.

    Parameters
    ----------
    pairs : ndarray of int
        Pairs of the stencil.
    stencil : Stencil
    unit : ndarray, shape (m,)
        Of each pair of the stencil.
    tolerance_ut : float
    dtype : dtype

    Attributes
    ----------
    pairs, off
        As of `Lattice`; pairs that are not worth a single term are in, too.
    """

    def __init__(
        self, pairs: np.ndarray, stencil: Stencil, unit: np.ndarray, tolerance_ut: float,
        dtype: np.dtype,
    ) -> None:  # fmt: skip
        kinds, which = np.unique(stencil.kind[pairs], return_inverse=True)
        lower, missing = by_degree(stencil.coefficients[kinds], _metric(stencil))
        strength = stencil.strength[stencil.neighbour[pairs]]
        each = missing[:, which] * strength**2
        degree = _degrees(each, unit[pairs], stencil.n, 3.0 * tolerance_ut**2)
        self.pairs = pairs
        self.off = lower[degree, which] - stencil.coefficients[kinds][which]

        levels = np.arange(1, max(int(degree.max()), 1) + 1)
        exponents = powers(int(levels[-1]))
        table = Table.of(exponents, filled_up=k.QUAD)
        self.parent, self.factor = table.parent, table.factor
        ends = [max(row for term, row in table.row.items() if sum(term) == d) for d in levels]
        self.orders = np.array([0, *((end - k.FACTORS) // k.QUAD + 1 for end in ends)])
        self.start, self.receiver, chosen = _by_film(pairs, stencil, unit, degree)
        film = stencil.neighbour[pairs[chosen]]
        self.reached = np.zeros((stencil.n, levels.size), np.int64)
        np.add.at(self.reached, film, degree[chosen, np.newaxis] >= levels)
        rows = np.zeros((chosen.size, 3, self.orders[-1] * k.QUAD))
        used = [table.row[tuple(map(int, e))] - k.FACTORS for e in exponents]
        rows[:, :, used] = lower[degree[chosen], which[chosen], :, : len(used)]
        self.place = np.zeros(stencil.n, np.int64)
        parts, length = [], 0
        for j in range(stencil.n):
            self.place[j] = length
            mine = rows[self.start[j] : self.start[j + 1]]
            for d in range(levels.size):
                some = mine[: self.reached[j, d], :, self.orders[d] * k.QUAD :]
                some = some[:, :, : (self.orders[d + 1] - self.orders[d]) * k.QUAD]
                parts.append(some.transpose(2, 0, 1).reshape(-1))
                length += parts[-1].size
        self.coefficients = np.concatenate([*parts, np.zeros(1)]).astype(dtype)
        self.terms = zeros(self.parent.size * k.LANES, dtype)
        most = int(np.diff(self.start).max(initial=0))
        self.tile = zeros(3 * most + 1, dtype)

    @property
    def arguments(self) -> tuple:
        """Of the kernel, between `sources` and `out`."""
        return (
            self.parent, self.factor, self.orders, self.start, self.receiver, self.reached,
            self.place, self.coefficients, self.terms, self.tile,
        )  # fmt: skip


def _by_film(
    pairs: np.ndarray, stencil: Stencil, unit: np.ndarray, degree: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compressed rows of the units that feel each film, highest degree first, and their order."""
    film = stencil.neighbour[pairs]
    order = np.lexsort((unit[pairs], -degree, film))
    order = order[degree[order] > 0]
    start = np.concatenate([[0], np.cumsum(np.bincount(film[order], minlength=stencil.n))])
    return start.astype(np.int32), unit[pairs[order]].astype(np.int32), order


def _degrees(each: np.ndarray, unit: np.ndarray, n: int, tolerance: float) -> np.ndarray:
    """Lowest degree of every pair so that no unit misses more than `tolerance` in mean square.

    Parameters
    ----------
    each : ndarray, shape (d + 1, m)
        Mean square that each pair misses at each degree.
    """
    thresholds = np.unique(each)
    low, high = 0, thresholds.size
    while low < high:
        middle = (low + high) // 2
        chosen = _lowest(each, thresholds[middle])
        left = np.take_along_axis(each, chosen[np.newaxis], axis=0)[0]
        if np.bincount(unit, left, minlength=n).max(initial=0.0) <= tolerance:
            low = middle + 1
        else:
            high = middle
    return _lowest(each, thresholds[low - 1] if low else 0.0)


def _lowest(each: np.ndarray, threshold: float) -> np.ndarray:
    """First degree at which a pair misses no more than the threshold; the full one if none."""
    within = each <= threshold
    within[-1] = True
    return np.argmax(within, axis=0)
