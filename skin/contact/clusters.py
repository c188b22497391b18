"""Which units touch something, and which of them touch the same thing."""

from __future__ import annotations

from math import isfinite

import numpy as np

from skin.errors import SkinError

__all__ = ["KEEP_SIGMA", "START_SIGMA", "contact_clusters", "neighbour_graph", "start_sigma_for"]

START_SIGMA = 5.0
"""Normal load that starts a contact, in sigmas."""
KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas."""


def contact_clusters(
    load: np.ndarray,
    sigma: np.ndarray | float,
    neighbour_start: np.ndarray,
    neighbour_index: np.ndarray,
    *,
    valid: np.ndarray | None = None,
    touching: np.ndarray | None = None,
    start_sigma: float = START_SIGMA,
    keep_sigma: float = KEEP_SIGMA,
) -> np.ndarray:
    """Join the units that are in contact to clusters, on any neighbour graph.

    A cluster is a connected set of units with more than `keep_sigma` of normal load, at least one
    of which has more than `start_sigma` or was touching before. Shear never makes a contact: stray
    fields read as shear on untouched units. A silent unit belongs to no cluster, but joins its
    neighbours if it was touching when it was last heard, so that one lost frame does not cut a
    contact in two.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, normal to the skin, positive when pressed. NaN is a silent unit.
    sigma : ndarray, shape (n,), or float
        Newton, one-sigma of `load`.
    neighbour_start, neighbour_index : ndarray, shape (n + 1,) and (m,)
        Neighbour graph in compressed rows, symmetric, as in `Topology`.
    valid : ndarray, shape (n,), bool, optional
        Units to be trusted; all if not given.
    touching : ndarray, shape (n,), bool, optional
        Units that were in contact a cycle ago.
    start_sigma, keep_sigma : float
        Gate, with its hysteresis.

    Returns
    -------
    ndarray, shape (n,), int32
        Number of the cluster of each unit, counted from 0 by the first unit; -1 for no contact.

    Examples
    --------
    Five units in a row; the fourth is silent:

    >>> start, index = neighbour_graph(np.arange(5.0) * [[1], [0], [0]], 1.0)
    >>> contact_clusters(np.array([9, 4, 0, np.nan, 6]), 1.0, start, index).tolist()
    [0, 0, -1, -1, 1]
    """
    from skin.contact.cluster_kernels import UNIT_ROWS, join

    load = np.ascontiguousarray(load, np.float64)
    n = load.size
    used = np.isfinite(load) if valid is None else np.isfinite(load) & valid
    units = np.zeros((len(UNIT_ROWS), n + 1), np.int32)
    _, label, _, _, was_touching, *_ = units
    if touching is not None:
        was_touching[:n] = touching
    loads, sigmas = load[np.newaxis], np.array(np.broadcast_to(sigma, (1, n)), np.float64)
    join(
        loads,
        sigmas,
        loads,
        sigmas,
        used,
        packed_graph(n, neighbour_start, neighbour_index),
        float(start_sigma),
        float(keep_sigma),
        units,
    )
    return np.where(used, label[:n], -1)


def packed_graph(n: int, neighbour_start: np.ndarray, neighbour_index: np.ndarray) -> np.ndarray:
    """Check a neighbour graph and return it as the kernels take it, in one array.

    Raises
    ------
    SkinError
        It is no graph of n units: the kernels do not check their indices.
    """
    start = np.ascontiguousarray(neighbour_start, np.int32)
    index = np.ascontiguousarray(neighbour_index, np.int32)
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
    return np.concatenate([start, index])


def neighbour_graph(position: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Neighbour graph of units that lie no further apart than `reach_m`.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre.
    reach_m : float
        Metre, distance of the middles of two units.

    Returns
    -------
    start, index : ndarray, shape (n + 1,) and (m,), int32
        Compressed rows, symmetric and sorted.
    """
    from scipy.spatial import cKDTree

    if not (isfinite(reach_m) and reach_m > 0.0):
        raise SkinError(f"reach_m: must be a positive number of metres; got {reach_m}")
    n = np.shape(position)[1]
    pairs = cKDTree(np.transpose(position)).query_pairs(reach_m * (1 + 1e-9), output_type="ndarray")
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    return start.astype(np.int32), both[:, 1].astype(np.int32)


def start_sigma_for(false_alarms_per_hour: float, n: int, rate_hz: float) -> float:
    """Gate at which noise alone starts no more than so many contacts.

    For white Gaussian noise. At `START_SIGMA` 64 units at 250 Hz start one contact in 3.6 minutes.

    Parameters
    ----------
    false_alarms_per_hour : float
    n : int
        Number of units.
    rate_hz : float
        Cycles a second.

    Returns
    -------
    float
        Sigmas of normal load.

    Examples
    --------
    >>> round(start_sigma_for(1.0, 64, 250.0), 2)
    5.52
    """
    from scipy.special import ndtri

    chance = false_alarms_per_hour / (3600.0 * n * rate_hz)
    if not 0.0 < chance < 0.5:
        raise SkinError(
            "false_alarms_per_hour, n, rate_hz: must leave each unit and cycle a chance between "
            f"0 and 0.5; got {chance:g}"
        )
    return float(-ndtri(chance))
