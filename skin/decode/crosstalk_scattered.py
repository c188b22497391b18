"""Cross-talk of pairs that have coefficients of their own, on curved and irregular skins.

The coefficients stand by film, lanes being (pair, axis), and a film that has not moved is not
looked at. Each pair has a polynomial of the lowest degree with which no unit misses more than the
tolerance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.bound import Bound
from bus.compiled.jit import compiled, jitable
from skin.decode.crosstalk_kernels import Films
from skin.decode.crosstalk_terms import FACTORS, NOT_NEGATIVE, Terms, metric, terms_of
from skin.physics.stencil import Stencil
from skin.physics.stray import powers

__all__ = ["Scattered", "ScatteredData", "ScatteredModel", "by_degree", "scattered",
           "scattered_python"]  # fmt: skip

LANES = 16
"""Films that are looked at together."""
QUAD = 4
"""Terms that are added up in registers."""


class ScatteredModel(NamedTuple):
    """Pairs with coefficients of their own."""

    terms: Terms  # by degree, each degree filled up to whole QUADs
    orders: np.ndarray  # (d + 1,) int64, first QUAD of each degree, and their number
    start: np.ndarray  # (n + 1,) int32, compressed rows: units near a film, highest degree first
    receiver: np.ndarray  # (m,) int32
    reached: np.ndarray  # (n, d) int64, how many of them have that degree
    place: np.ndarray  # (n,) int64, where the coefficients of a film begin
    coefficients: np.ndarray  # by film, degree, QUAD and term: three axes of each unit that has it


class ScatteredData(NamedTuple):
    """What is read, what is added to, and scratch."""

    films: Films
    field_ut: np.ndarray  # (3, n), added to
    rows: np.ndarray  # (k * LANES,) terms, scratch
    sums: np.ndarray  # units times axes of the film that most units are near to, scratch


@jitable(inline=True)
def _film_terms(terms, films, rows, first, count):
    """All terms of the next few films."""
    for j in range(count):
        x, y, h = films.dx_mm[first + j], films.dy_mm[first + j], films.depth_mm[first + j]
        weight = films.weight[first + j]
        rows[j] = x
        rows[LANES + j] = y
        rows[2 * LANES + j] = h
        rows[FACTORS * LANES + j] = x * weight
        rows[(FACTORS + 1) * LANES + j] = y * weight
        rows[(FACTORS + 2) * LANES + j] = h * weight
    for k in range(2 * FACTORS, terms.parent.size):
        of = (terms.parent[k] * LANES) & NOT_NEGATIVE
        by = (terms.factor[k] * LANES) & NOT_NEGATIVE
        to = (k * LANES) & NOT_NEGATIVE
        for j in range(LANES):
            rows[to + j] = rows[of + j] * rows[by + j]


def scattered_python(model, data):
    """Add the stray fields of pairs that have coefficients of their own, film by film.

    Parameters
    ----------
    model : ScatteredModel
    data : ScatteredData
    """
    coefficients, orders, reached = model.coefficients, model.orders, model.reached
    weight, rows, sums = data.films.weight, data.rows, data.sums
    nothing = rows.dtype.type(0.0)
    n = weight.size
    for block in range((n + LANES - 1) // LANES):
        first = (block * LANES) & NOT_NEGATIVE
        count = min(LANES, n - first)
        moved = 0
        for j in range(count):
            moved |= weight[first + j] != nothing
        if not moved:
            continue
        _film_terms(model.terms, data.films, rows, first, count)
        for j in range(count):
            film = first + j
            pairs = model.start[film + 1] - model.start[film]
            if weight[film] == nothing or pairs == 0:
                continue
            for i in range(3 * pairs):
                sums[i] = nothing
            at = model.place[film]
            for d in range(reached.shape[1]):
                lanes = 3 * reached[film, d]
                for g in range(orders[d], orders[d + 1] if lanes else orders[d]):
                    k = ((FACTORS + g * QUAD) * LANES + j) & NOT_NEGATIVE
                    m0, m1 = rows[k], rows[k + LANES]
                    m2, m3 = rows[k + 2 * LANES], rows[k + 3 * LANES]
                    c0, c1 = at & NOT_NEGATIVE, (at + lanes) & NOT_NEGATIVE
                    c2, c3 = (at + 2 * lanes) & NOT_NEGATIVE, (at + 3 * lanes) & NOT_NEGATIVE
                    for i in range(lanes):
                        sums[i] += (m0 * coefficients[c0 + i] + m1 * coefficients[c1 + i]
                                    + m2 * coefficients[c2 + i]
                                    + m3 * coefficients[c3 + i])  # fmt: skip
                    at += QUAD * lanes
            for p in range(pairs):
                unit = model.receiver[model.start[film] + p]
                for axis in range(3):
                    data.field_ut[axis, unit] += sums[3 * p + axis]


scattered = compiled(scattered_python, fastmath={"contract"}, allocates=False)


class Scattered:
    """Pairs with coefficients of their own: a `Part`.

    Parameters
    ----------
    pairs : ndarray of int
        Pairs of the stencil.
    stencil : Stencil
    tolerance_ut : float
        See `CrossTalk`.
    dtype : dtype
    """

    terms = 0

    def __init__(
        self, pairs: np.ndarray, stencil: Stencil, tolerance_ut: float, dtype: np.dtype
    ) -> None:
        unit, film = stencil.unit[pairs], stencil.neighbour[pairs]
        kinds, which = np.unique(stencil.kind[pairs], return_inverse=True)
        lower, missing = by_degree(stencil.coefficients[kinds], metric(stencil))
        missing = missing[:, which] * stencil.strength[film] ** 2
        degree = _degrees(missing, unit, stencil.n, 3.0 * tolerance_ut**2)
        self.pairs = pairs
        self.off = lower[degree, which] - stencil.coefficients[kinds][which]

        levels = np.arange(1, max(int(degree.max()), 1) + 1)
        exponents = powers(int(levels[-1]))
        terms, row = terms_of(exponents, filled_up=QUAD)
        ends = [max(r for term, r in row.items() if sum(term) == d) for d in levels]
        orders = np.array([0, *((end - FACTORS) // QUAD + 1 for end in ends)])
        # by film, highest degree first
        chosen = np.lexsort((unit, -degree, film))
        chosen = chosen[degree[chosen] > 0]
        near = np.bincount(film[chosen], minlength=stencil.n)
        start = np.append(0, np.cumsum(near)).astype(np.int32)
        reached = np.zeros((stencil.n, levels.size), np.int64)
        np.add.at(reached, film[chosen], degree[chosen, np.newaxis] >= levels)
        rows = np.zeros((chosen.size, 3, orders[-1] * QUAD))
        used = [row[tuple(term)] - FACTORS for term in exponents.tolist()]
        rows[:, :, used] = lower[degree[chosen], which[chosen], :, : len(used)]
        place, coefficients = _by_film(rows, start, reached, orders * QUAD)
        self.model = ScatteredModel(
            terms, orders, start, unit[chosen].astype(np.int32), reached, place,
            coefficients.astype(dtype),
        )  # fmt: skip
        most = int(near.max(initial=0))
        self._scratch = zeros(terms.parent.size * LANES, dtype), zeros(3 * most + 1, dtype)

    def bound(self, films: Films, field_ut: np.ndarray) -> Bound:
        """See `Part`."""
        return Bound(scattered, self.model, ScatteredData(films, field_ut, *self._scratch))


def _by_film(
    rows: np.ndarray, start: np.ndarray, reached: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where the coefficients of each film begin, and all of them: degree by degree, term by term.

    Parameters
    ----------
    rows : ndarray, shape (p, 3, terms)
        Of each pair, as `start` has them.
    ends : ndarray, shape (d + 1,)
        First term of each degree, and their number.
    """
    place, parts, size = np.zeros(start.size - 1, np.int64), [], 0
    for film in range(place.size):
        place[film] = size
        mine = rows[start[film] : start[film + 1]]
        for d, count in enumerate(reached[film]):
            parts.append(mine[:count, :, ends[d] : ends[d + 1]].transpose(2, 0, 1).reshape(-1))
            size += parts[-1].size
    return place, np.concatenate([*parts, np.zeros(1)])


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
