"""Wrench and centre of pressure of any forces, contact or not: the plain sums of plain arrays."""

from __future__ import annotations

import numpy as np

__all__ = ["centroid", "wrench"]


def wrench(
    force: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    valid: np.ndarray | None = None,
    origin: np.ndarray | None = None,
) -> np.ndarray:
    """Resultant force and moment of n forces.

    Parameters
    ----------
    force : ndarray, shape (3, n)
        Newton, each in its unit's frame.
    position : ndarray, shape (3, n)
        Metre, common frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the common frame.
    valid : ndarray, shape (n,), bool, optional
        Units to sum; all if not given.
    origin : ndarray, shape (3,), optional
        Metre; the point about which the moment is taken, the origin of the common frame if not
        given.

    Returns
    -------
    ndarray, shape (6,), float64
        Force in newton and moment in newton metre, common frame.

    Examples
    --------
    >>> push = np.array([[0.0], [0.0], [2.0]])
    >>> at = np.array([[0.1], [0.0], [0.0]])
    >>> wrench(push, at, np.eye(3)[:, :, np.newaxis]).tolist()
    [0.0, 0.0, 2.0, 0.0, -0.2, 0.0]
    """
    about = np.zeros(3) if origin is None else np.asarray(origin, float)
    used = np.ones(np.shape(force)[1], bool) if valid is None else valid
    return _total(used, force, position - about[:, np.newaxis], rotation)["wrench"].copy()


def centroid(
    load: np.ndarray, position: np.ndarray, *, valid: np.ndarray | None = None
) -> np.ndarray:
    """Mean position, weighted by positive normal loads.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, normal; loads that are not positive do not count.
    position : ndarray, shape (3, n)
        Metre.
    valid : ndarray, shape (n,), bool, optional
        Units to take; all if not given.

    Returns
    -------
    ndarray, shape (3,), float64
        Metre; NaN where there is no load.
    """
    used = load > 0.0 if valid is None else valid & (load > 0.0)
    if not used.any():
        return np.full(3, np.nan)
    force = np.zeros((3, load.size))
    force[2] = load
    upright = np.broadcast_to(np.eye(3)[:, :, np.newaxis], (3, 3, load.size))
    return _total(used, force, position, upright)["centroid"].copy()


def _total(
    used: np.ndarray, force: np.ndarray, position: np.ndarray, rotation: np.ndarray
) -> np.ndarray:
    from skin.contact.features import contact_features

    label = np.where(used, 0, -1)
    return contact_features(label, force, 0.0, position, rotation, 1.0)[1]
