"""Rigid transforms as plain arrays: rotations of shape (3, 3, ...), translations of shape (3, ...).

`T_a_b` takes coordinates in b to coordinates in a. A transform is a pair (rotation, translation);
further axes are units, last as everywhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = [
    "IDENTITY",
    "apply",
    "compose",
    "from_axes",
    "from_quaternion",
    "from_rpy",
    "pose_fault",
    "rotate",
]

Transform = tuple[np.ndarray, np.ndarray]

IDENTITY: Transform = (np.eye(3), np.zeros(3))
"""The identity."""

ROTATION_TOLERANCE = 1e-6
"""Tolerance of the scalar products of a rotation's columns [assumed: above the rounding of float32,
far below the accuracy of measured angles]."""

FARTHEST_M = 1000.0
"""Largest distance of a unit from its frame [assumed]."""


def from_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation Rz(yaw) Ry(pitch) Rx(roll), the convention of URDF.

    Parameters
    ----------
    roll, pitch, yaw : float
        Radian, about the parent's fixed x, y and z axes.

    Returns
    -------
    ndarray, shape (3, 3), float64

    Examples
    --------
    >>> from_rpy(0.0, 0.0, np.pi / 2).round(12) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    return _scipy_rotation().from_euler("xyz", [roll, pitch, yaw]).as_matrix()


def _scipy_rotation() -> Any:
    from scipy.spatial.transform import Rotation  # heavy: not before it is needed

    return Rotation


def from_quaternion(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Rotation of a quaternion of any length but 0.

    Returns
    -------
    ndarray, shape (3, 3), float64

    Examples
    --------
    >>> from_quaternion(2.0, 0.0, 0.0, 0.0)
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    return _scipy_rotation().from_quat([x, y, z, w]).as_matrix()


def from_axes(normal: np.ndarray, x_axis: np.ndarray) -> np.ndarray:
    """Unit frames from outward normals: z is -normal, x is `x_axis` orthogonalised to it.

    Parameters
    ----------
    normal, x_axis : ndarray, shape (3, n), float64
        Of any length but 0, and not parallel.

    Returns
    -------
    ndarray, shape (3, 3, n), float64
        Columns are the unit's axes.
    """
    z = -normal / np.linalg.norm(normal, axis=0)
    x = x_axis - z * np.sum(x_axis * z, axis=0)
    x = x / np.linalg.norm(x, axis=0)
    return np.stack([x, np.cross(z, x, axis=0), z], axis=1)


def compose(outer: Transform, inner: Transform) -> Transform:
    """T_a_c from T_a_b, one transform, and T_b_c, one or many."""
    return (np.tensordot(outer[0], inner[0], axes=1), apply(outer, inner[1]))


def apply(transform: Transform, points: np.ndarray) -> np.ndarray:
    """Points of shape (3, ...) in a from points in b by one T_a_b."""
    rotation, translation = transform
    return rotate(rotation, points) + translation.reshape(3, *([1] * (points.ndim - 1)))


def rotate(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors of shape (3, ...) turned by one rotation."""
    return np.tensordot(rotation, vectors, axes=1)


def pose_fault(
    position: np.ndarray, rotation: np.ndarray, name: str = "position"
) -> tuple[int, str] | None:
    """The first of m poses that is none, and what is wrong with it; None if all are fine.

    Parameters
    ----------
    position : ndarray, shape (3, m)
        Metre.
    rotation : ndarray, shape (3, 3, m)
    name : str
        Name of the position in messages.

    Examples
    --------
    >>> pose_fault(np.zeros((3, 1)), 2.0 * np.eye(3)[:, :, np.newaxis])
    (0, 'rotation: must be orthonormal within 1e-06; got columns that are off by 3')
    """
    far = np.abs(position).max(axis=0)
    turns = np.moveaxis(np.asarray(rotation, float), 2, 0)
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(np.matmul(turns.transpose(0, 2, 1), turns) - np.eye(3)).max(axis=(1, 2))
        mirrored = np.linalg.det(turns) < 0.0
    # NaN is not within bounds
    near, orthonormal = far <= FARTHEST_M, off <= ROTATION_TOLERANCE
    for i in np.flatnonzero(~(near & orthonormal) | mirrored)[:1]:
        if not near[i]:
            return int(i), f"{name}: must be within {FARTHEST_M:g} m; got {far[i]:g}"
        if not orthonormal[i]:
            fault = f"must be orthonormal within {ROTATION_TOLERANCE:g}; got columns that are off"
            return int(i), f"rotation: {fault} by {off[i]:g}"
        return int(i), "rotation: must be right-handed; got a mirror"
    return None
