"""Neighbours: pairs of near points, and the neighbour graph of a skin."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["compressed_rows", "nearest_point", "neighbour_pairs", "pairs_within"]


def _tree(position: np.ndarray) -> Any:
    from scipy.spatial import KDTree  # heavy: not before it is needed

    return KDTree(position.T)


def pairs_within(position: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of points at most `radius` apart.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.
    radius : float
        Metre.

    Returns
    -------
    i, j : ndarray, shape (m,), int64
        Indices of the points, i < j; each pair comes once.
    distance : ndarray, shape (m,), float64
        Metre.
    """
    i, j = _tree(position).query_pairs(radius, output_type="ndarray").T
    return i, j, np.linalg.norm(position[:, i] - position[:, j], axis=0)


def nearest_point(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest other point of each.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.

    Returns
    -------
    distance : ndarray, shape (n,), float64
        Metre; inf for a single point.
    index : ndarray, shape (n,), int64
        n for a single point.
    """
    distance, index = _tree(position).query(position.T, k=2)
    itself = index[:, 0] == np.arange(len(index))  # points in one place come in any order
    return distance[:, 1], np.where(itself, index[:, 1], index[:, 0])


def neighbour_pairs(
    position: np.ndarray, reach: np.ndarray, rigid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours: points of one rigid body, no farther apart than the larger reach of the two.

    Each point is searched with its own reach: with the largest one for all, a single point of a
    wide reach would make pairs of all others.

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
    found = _tree(position).query_ball_point(position.T, reach)
    one = np.repeat(np.arange(len(found)), [len(others) for others in found])
    two = np.concatenate([[], *found]).astype(np.int64)
    pairs = np.stack([np.minimum(one, two), np.maximum(one, two)])
    i, j = np.unique(pairs[:, (one != two) & (rigid[one] == rigid[two])], axis=1)
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
    start = np.searchsorted(row[order], np.arange(n + 1))
    return start.astype(np.int32), column[order].astype(np.int32)
