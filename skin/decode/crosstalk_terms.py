"""Terms of the films, and pairs of a stencil that are computed in one way.

The stray field of a pair is a sum of terms ``c * w * dx^i * dy^j * H^k``, w being the strength of
the film. The terms without c are those of the film alone: they are computed once a film, into rows,
and each row is the product of an earlier one with dx, dy or H.

A stencil has more terms than a live skin needs: the far neighbours' cubic ones are of nanotesla.
Terms are left out, the cheapest in error first, until what is missing reaches a tolerance. The
terms are not orthogonal, so those that stay take over what they can of one that goes: in the metric
of the stencil's own range (`Stencil.gram`) that is a projection, and its error is known exactly.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from bus.compiled.bound import Bound
from skin.decode.crosstalk_kernels import Films
from skin.physics.stencil import Stencil

__all__ = ["FACTORS", "NOT_NEGATIVE", "Part", "Terms", "metric", "terms_of"]

FACTORS = 3
"""The first rows of terms are dx, dy and H; the next three are their products with the weight, and
every further one is the product of an earlier one with one of the first."""
NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end."""
ALL_AROUND = 4
"""Neighbours at one distance, which are displaced alike where a skin is pressed [assumed]."""


class Terms(NamedTuple):
    """Rows of terms, each the product of two earlier ones; shape (k,), int64."""

    parent: np.ndarray
    factor: np.ndarray


class Part(Protocol):
    """Pairs of a stencil that one kernel computes.

    Attributes
    ----------
    pairs : ndarray, shape (p,), int
        Of the stencil; those that are not worth a single term are in, too.
    off : ndarray, shape (p, 3, terms)
        Coefficients that are used minus those of the stencil.
    terms : int
        That are computed for a unit, of all its neighbours together, where pairs share them.
    """

    pairs: np.ndarray
    off: np.ndarray
    terms: int

    def bound(self, films: Films, field_ut: np.ndarray) -> Bound:
        """The kernel that adds the fields of `films` to `field_ut`, shape (3, n)."""
        ...


def terms_of(
    exponents: np.ndarray, filled_up: int = 1
) -> tuple[Terms, dict[tuple[int, int, int], int]]:
    """Rows for terms, and all factors of them, by degree.

    Parameters
    ----------
    exponents : ndarray, shape (terms, 3)
        (i, j, k) of each ``dx^i dy^j H^k``.
    filled_up : int
        Each degree is filled up to a multiple of it with rows that mean nothing.

    Returns
    -------
    terms : Terms
    row : dict of tuple to int
        Row of each (i, j, k).
    """
    needed = {tuple(term) for term in exponents.tolist()} | {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    for degree in range(max(map(sum, needed)), 1, -1):
        needed |= {_divided(term)[0] for term in needed if sum(term) == degree}
    parent, factor, row = [0] * FACTORS, [0] * FACTORS, {}
    for degree in range(1, max(map(sum, needed)) + 1):
        for term in sorted((t for t in needed if sum(t) == degree), reverse=True):
            row[term] = len(parent)
            above, axis = _divided(term)
            parent.append(row.get(above, 0))
            factor.append(axis)
        while (len(parent) - FACTORS) % filled_up:
            parent.append(FACTORS)
            factor.append(0)
    return Terms(np.array(parent), np.array(factor)), row


def _divided(term: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
    """The term that is one factor less, and the factor."""
    axis = max(a for a in range(3) if term[a])
    return tuple(e - (a == axis) for a, e in enumerate(term)), axis


def metric(stencil: Stencil) -> np.ndarray:
    """Gram matrix in which a mean counts several times, shape (terms, terms).

    Errors of neighbours that scatter add up as squares, their means as they are: a pressed
    neighbourhood of four is four times as far off as one of them.
    """
    return stencil.gram + (ALL_AROUND - 1) * np.outer(stencil.mean, stencil.mean)
