"""Neighbours: pairs of near points, and the neighbour graph of a skin.

All of it is one sweep: the points are ordered along a slanted line, and each is compared with the
next, the next but one and so on, until the gap along the line alone is too large. On a surface this
takes about n^1.5 comparisons, all of them in numpy, with memory for a few rows of n.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

__all__ = ["compressed_rows", "nearest_distance", "neighbour_pairs", "pairs_within"]

# No row, column or diagonal of a regular patch is perpendicular to this line: few points share a
# gap.
_LINE = np.array([0.8017, 0.5153, 0.3029])


def _ordered(position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    along = _LINE @ position / np.linalg.norm(_LINE)
    order = np.argsort(along, kind="stable")
    return order, along[order], np.ascontiguousarray(position[:, order])


def pairs_within(
    position: np.ndarray, radius: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Pairs of points at most `radius` apart, in batches.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.
    radius : float
        Metre.

    Yields
    ------
    i, j : ndarray, shape (m,), int64
        Indices of the points, i < j; each pair comes once.
    distance : ndarray, shape (m,), float64
        Metre.
    """
    order, along, points = _ordered(position)
    first = np.arange(order.size)
    for step in range(1, order.size):
        first = first[: np.searchsorted(first, order.size - step)]
        first = first[along[first + step] - along[first] <= radius]
        if first.size == 0:
            return
        distance = np.linalg.norm(points[:, first + step] - points[:, first], axis=0)
        near = distance <= radius
        if near.any():
            a, b = order[first[near]], order[first[near] + step]
            yield np.minimum(a, b), np.maximum(a, b), distance[near]


def nearest_distance(position: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest other one; inf for a single point.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.

    Returns
    -------
    ndarray, shape (n,), float64
    """
    order, along, points = _ordered(position)
    best = np.full(order.size, np.inf)
    for sign in (1, -1):
        here = np.arange(order.size)
        for step in range(1, order.size):
            other = here + sign * step
            inside = (other >= 0) & (other < order.size)
            here, other = here[inside], other[inside]
            open_ = np.abs(along[other] - along[here]) < best[here]
            here, other = here[open_], other[open_]
            if here.size == 0:
                break
            distance = np.linalg.norm(points[:, other] - points[:, here], axis=0)
            best[here] = np.minimum(best[here], distance)
    nearest = np.empty_like(best)
    nearest[order] = best
    return nearest


def neighbour_pairs(
    position: np.ndarray, reach: np.ndarray, rigid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours: points of one rigid body, nearer than the larger reach of the two.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.
    reach : ndarray, shape (n,), float64
        Metre; 1.5 times the distance of nearest neighbours in the unit's patch.
    rigid : ndarray, shape (n,), int
        Number of the rigid body (frame) that carries the unit.

    Returns
    -------
    i, j : ndarray, shape (m,), int64
        Each pair once, i < j.
    """
    pairs = [
        np.stack([i, j])[:, (rigid[i] == rigid[j]) & (distance <= np.maximum(reach[i], reach[j]))]
        for i, j, distance in pairs_within(position, float(np.max(reach, initial=0.0)))
    ]
    i, j = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
    return i, j


def compressed_rows(n: int, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs as a symmetric graph in compressed rows.

    Returns
    -------
    start : ndarray, shape (n + 1,), int32
    index : ndarray, shape (2 m,), int32
        Neighbours of unit k, ascending: ``index[start[k]:start[k + 1]]``.
    """
    row, column = np.concatenate([i, j]), np.concatenate([j, i])
    order = np.lexsort((column, row))
    start = np.zeros(n + 1, np.int32)
    np.cumsum(np.bincount(row, minlength=n), out=start[1:])
    return start, column[order].astype(np.int32)
