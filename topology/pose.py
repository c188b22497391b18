"""Rigid transforms as plain arrays: rotations of shape (3, 3, ...), translations of shape (3, ...).

`T_a_b` takes coordinates in b to coordinates in a. A transform is a pair (rotation, translation);
further axes are units, last as everywhere.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

__all__ = [
    "IDENTITY",
    "apply",
    "compose",
    "from_axes",
    "from_quaternion",
    "from_rpy",
    "rotate",
]

Transform = tuple[np.ndarray, np.ndarray]

IDENTITY: Transform = (np.eye(3), np.zeros(3))
"""The transform of a frame onto itself."""


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
    turns = [_about(2, yaw), _about(1, pitch), _about(0, roll)]
    return reduce(np.matmul, turns)


def _about(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[j, i] = np.sin(angle)
    rotation[i, j] = -rotation[j, i]
    return rotation


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
    w, x, y, z = np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z])
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_axes(normal: np.ndarray, x_axis: np.ndarray) -> np.ndarray:
    """Unit frames from outward normals: z is -normal, x is `x_axis` made square to it.

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
