"""A rigid sphere against the faces of units."""

from __future__ import annotations

import numpy as np

__all__ = ["reach"]


def reach(
    centre: np.ndarray, radius: float, position: np.ndarray, axis: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How deep a sphere reaches into each unit, along the unit's own z axis.

    Parameters
    ----------
    centre : ndarray, shape (3,)
    radius : float
    position : ndarray, shape (3, n)
        Middle of each face.
    axis : ndarray, shape (3, n)
        Unit vectors into the skin.

    Returns
    -------
    touched : ndarray, shape (n,), bool
        Whether the middle of the face lies inside the sphere.
    depth : ndarray, shape (n,)
        From the face to where the axis leaves the sphere, in the unit of the arguments; 0 where
        nothing touches.

    Examples
    --------
    >>> touched, depth = reach(np.array([0.0, 0.0, -4.0]), 5.0, np.zeros((3, 1)), np.eye(3)[:, 2:])
    >>> depth
    array([1.])
    """
    away = centre[:, np.newaxis] - position
    along = np.einsum("in,in->n", away, axis)
    inside = radius * radius - np.einsum("in,in->n", away, away)
    touched = inside > 0.0
    depth = along + np.sqrt(np.maximum(inside + along * along, 0.0))
    return touched, np.where(touched, depth, 0.0)
