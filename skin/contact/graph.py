"""Neighbour graphs of units."""

from __future__ import annotations

from math import isfinite

import numpy as np

from skin.contact.model import NeighbourGraph
from skin.errors import SkinError

__all__ = ["checked_graph", "neighbour_graph"]


def checked_graph(
    n: int, neighbour_start: np.ndarray, neighbour_index: np.ndarray
) -> NeighbourGraph:
    """A neighbour graph in the form for kernels.

    Raises
    ------
    SkinError
        It is not a graph of n units; kernels do not check indices.
    """
    start = np.array(neighbour_start, np.int32)
    index = np.array(neighbour_index, np.int32)
    if start.shape != (n + 1,) or start[0] != 0 or np.any(np.diff(start) < 0):
        raise SkinError(
            f"neighbour_start: must be {n + 1} numbers that begin with 0 and do not fall; "
            f"got shape {start.shape}"
        )
    if index.shape != (start[-1],):
        raise SkinError(
            f"neighbour_index: must be {start[-1]} numbers, as neighbour_start says; "
            f"got shape {index.shape}"
        )
    if index.size and not 0 <= index.min() <= index.max() < n:
        raise SkinError(
            f"neighbour_index: must be units 0 to {n - 1}; got {index.min()} to {index.max()}"
        )
    return NeighbourGraph(start, index)


def neighbour_graph(position: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Neighbour graph of units within `reach_m` of each other.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre.
    reach_m : float
        Metre, largest distance between the middles of two units.

    Returns
    -------
    start, index : ndarray, shape (n + 1,) and (m,), int32
        Compressed rows, symmetric and sorted.
    """
    from scipy.spatial import KDTree

    if not (isfinite(reach_m) and reach_m > 0.0):
        raise SkinError(f"reach_m: must be a positive number of metres; got {reach_m}")
    n = np.shape(position)[1]
    pairs = KDTree(np.transpose(position)).query_pairs(reach_m * (1 + 1e-9), output_type="ndarray")
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    return start.astype(np.int32), both[:, 1].astype(np.int32)
