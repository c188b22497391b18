"""Bodies in contact with a skin: shapes, poses, penetration, and displacement of faces.

A pose is a transform as in `topology.pose`: (rotation, translation), coordinates of the body to
coordinates of the skin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bus.compiled.jit import compiled

__all__ = ["DISC", "POINT", "Body", "Pose", "carried", "moved", "penetration"]

Pose = tuple[np.ndarray, np.ndarray]
"""Rotation, shape (3, 3), and position in metre, shape (3,)."""

_SIXTH = np.arange(6) * (math.pi / 3.0)
_RING = math.sqrt(2.0 / 3.0)

POINT = np.array([[0.0], [0.0], [1.0]])
DISC = np.array(
    [
        [0.0, *(_RING * np.cos(_SIXTH))],
        [0.0, *(_RING * np.sin(_SIXTH))],
        [0.25, *np.full(6, 0.125)],
    ]
)
"""Sensitive points of a face: x and y in radii of the unit, and weights. `DISC` is the quadrature
of the fifth degree on a disc, which detects an edge off the middle of a face; `POINT` does not."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A convex body: the intersection of a quadric and half-spaces, in its own frame.

    Attributes
    ----------
    curvature : ndarray, shape (3,)
        1/m²: points x with ``curvature @ x**2 <= 1``; all 0 where the body has no round part.
    planes : ndarray, shape (4, m)
        Outward unit normals and distances from the origin in metre: ``normal @ x <= distance``.
    compliance_mm_per_n : float
        Yield of the body's surface under the force of one unit, normal or tangential; in series
        with the unit's own stiffness. 0: rigid.

    Examples
    --------
    >>> Body.sphere(0.05).curvature
    array([400., 400., 400.])
    """

    curvature: np.ndarray = field(default_factory=lambda: np.zeros(3))
    planes: np.ndarray = field(default_factory=lambda: np.zeros((4, 0)))
    compliance_mm_per_n: float = 0.0

    @classmethod
    def sphere(cls, radius_m: float, **soft: Any) -> Body:
        """A sphere about the origin; `soft` is its compliance."""
        return cls(curvature=np.full(3, 1.0 / radius_m**2), **soft)

    @classmethod
    def cylinder(cls, radius_m: float, length_m: float, **soft: Any) -> Body:
        """A cylinder about the origin, its axis along x."""
        round_part = np.array([0.0, 1.0, 1.0]) / radius_m**2
        ends = np.array([[1.0, -1.0], [0.0, 0.0], [0.0, 0.0], [0.5 * length_m] * 2])
        return cls(curvature=round_part, planes=ends, **soft)

    @classmethod
    def block(cls, x_m: float, y_m: float, z_m: float, **soft: Any) -> Body:
        """A block of these edges about the origin."""
        normals = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
        return cls(planes=np.vstack([normals, 0.5 * np.array([x_m, y_m, z_m] * 2)]), **soft)

    @classmethod
    def plate(cls, x_m: float, y_m: float, thickness_m: float = 0.1, **soft: Any) -> Body:
        """A flat plate: the middle of its lower face in the origin, the rest along +z."""
        block = cls.block(x_m, y_m, thickness_m, **soft)
        planes = block.planes.copy()
        planes[3, [2, 5]] = thickness_m, 0.0
        return cls(planes=planes, **soft)

    @classmethod
    def edge(
        cls, length_m: float, angle_rad: float = 0.5 * math.pi, height_m: float = 0.1, **soft: Any
    ) -> Body:
        """A wedge that opens along +z: its ridge along x, the middle of the ridge in the origin."""
        c, s = math.cos(0.5 * angle_rad), math.sin(0.5 * angle_rad)
        planes = np.array(
            [
                [1.0, -1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, c, -c, 0.0],
                [0.0, 0.0, -s, -s, 1.0],
                [0.5 * length_m, 0.5 * length_m, 0.0, 0.0, height_m],
            ]
        )
        return cls(planes=planes, **soft)


# -- poses -----------------------------------------------------------------------------------------


def moved(pose: Pose, shift_m: np.ndarray) -> Pose:
    """The pose after a translation in metre, shape (3,), skin frame."""
    return pose[0], pose[1] + shift_m


# -- contact of a body and faces -------------------------------------------------------------------


def penetration(
    body: Body,
    pose: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    radius_m: np.ndarray | None = None,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """Penetration of a body at each unit, along the unit's own z axis.

    Parameters
    ----------
    body : Body
    pose : Pose
    position : ndarray, shape (3, n)
        Middle of each face, metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes, z into the skin.
    radius_m : ndarray, shape (n,), optional
        Radius of each face, for the weighted mean over it (`DISC`), without negative parts.
        Otherwise only its middle counts.
    out : ndarray, shape (n,), optional
        Output array.

    Returns
    -------
    ndarray, shape (n,)
        Millimetre, from the face to where the axis leaves the body. Negative: distance of the body
        along the axis; -inf where the axis misses the body or the body lies behind the face.

    Examples
    --------
    >>> pose = np.eye(3), np.array([0.0, 0.0, -0.004])
    >>> penetration(Body.sphere(0.005), pose, np.zeros((3, 1)), np.eye(3)[..., None])
    array([1.])
    """
    n = position.shape[1]
    depth_mm = np.empty(n) if out is None else out
    face, radius = (POINT, np.zeros(n)) if radius_m is None else (DISC, radius_m)
    felt = position, rotation, face, radius
    _penetration(body.curvature, body.planes, _contiguous(pose), felt, depth_mm)
    return depth_mm


def carried(
    before: Pose,
    after: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    depth_mm: np.ndarray,
    *,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """Displacement of the body's surface along each face between two poses.

    Sliding, turning on the spot (torsion) and rolling are all in the two poses: a unit sees the
    motion of the point of the body that ends up in contact with the face.

    Parameters
    ----------
    before, after : Pose
    position, rotation, out
        As for `penetration`.
    depth_mm : ndarray, shape (n,)
        Depth at which the body meets the face after the motion.

    Returns
    -------
    ndarray, shape (2, n)
        Millimetre, along x and y of the unit; 0 where `depth_mm` is not above 0.
    """
    shift_mm = np.empty((2, position.shape[1])) if out is None else out
    poses = _contiguous(before), _contiguous(after)
    _carry(*poses, position, rotation, depth_mm, shift_mm)
    return shift_mm


def _contiguous(pose: Pose) -> Pose:
    """The pose as contiguous arrays, for kernels."""
    return np.ascontiguousarray(pose[0], float), np.ascontiguousarray(pose[1], float)


def _penetration_python(curvature, planes, pose, felt, depth_mm):
    """`penetration`, in place; see there."""
    body_rotation, body_position = pose
    position, rotation, face, radius = felt
    g0, g1, g2 = curvature[0], curvature[1], curvature[2]
    round_part = g0 + g1 + g2 > 0.0
    for i in range(position.shape[1]):
        d0 = d1 = d2 = 0.0
        for r in range(3):
            z = rotation[r, 2, i]
            d0 += body_rotation[r, 0] * z
            d1 += body_rotation[r, 1] * z
            d2 += body_rotation[r, 2] * z
        mean, deepest = 0.0, -np.inf
        for s in range(face.shape[1]):
            a, b = face[0, s] * radius[i], face[1, s] * radius[i]
            x0 = x1 = x2 = 0.0
            for r in range(3):
                x = position[r, i] + a * rotation[r, 0, i] + b * rotation[r, 1, i]
                x -= body_position[r]
                x0 += body_rotation[r, 0] * x
                x1 += body_rotation[r, 1] * x
                x2 += body_rotation[r, 2] * x
            # the interval of the axis within the body, as distances from the face
            first, last = -np.inf, np.inf
            if round_part:
                square = g0 * d0 * d0 + g1 * d1 * d1 + g2 * d2 * d2
                half = g0 * x0 * d0 + g1 * x1 * d1 + g2 * x2 * d2
                rest = g0 * x0 * x0 + g1 * x1 * x1 + g2 * x2 * x2 - 1.0
                under = half * half - square * rest
                if square > 0.0 and under >= 0.0:
                    root = np.sqrt(under)
                    first, last = (-half - root) / square, (-half + root) / square
                elif rest >= 0.0:
                    first, last = np.inf, -np.inf
            for m in range(planes.shape[1]):
                towards = planes[0, m] * d0 + planes[1, m] * d1 + planes[2, m] * d2
                distance = planes[3, m] - planes[0, m] * x0 - planes[1, m] * x1 - planes[2, m] * x2
                if towards > 0.0:
                    last = min(last, distance / towards)
                elif towards < 0.0:
                    first = max(first, distance / towards)
                elif distance < 0.0:
                    last = -np.inf
            if first >= min(last, 0.0):
                continue
            mean += face[2, s] * max(last, 0.0)
            deepest = max(deepest, last)
        depth_mm[i] = 1e3 * (mean if deepest > 0.0 else deepest)


def _carry_python(pose_before, pose_after, position, rotation, depth_mm, shift_mm):
    """`carried`, in place: displacement of each point of the body."""
    turn_0, before = pose_before
    turn_1, after = pose_after
    back = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for m in range(3):
                back[i, j] += turn_0[i, m] * turn_1[j, m]
    for i in range(position.shape[1]):
        along_x = along_y = 0.0
        if depth_mm[i] > 0.0:
            depth = 1e-3 * depth_mm[i]
            r0 = position[0, i] + depth * rotation[0, 2, i] - after[0]
            r1 = position[1, i] + depth * rotation[1, 2, i] - after[1]
            r2 = position[2, i] + depth * rotation[2, 2, i] - after[2]
            for j, r in enumerate((r0, r1, r2)):
                was = back[j, 0] * r0 + back[j, 1] * r1 + back[j, 2] * r2
                travel = after[j] - before[j] + (r - was)
                along_x += rotation[j, 0, i] * travel
                along_y += rotation[j, 1, i] * travel
        shift_mm[0, i] = 1e3 * along_x
        shift_mm[1, i] = 1e3 * along_y


_penetration = compiled(_penetration_python, fastmath=("contract",))
_carry = compiled(_carry_python, fastmath=("contract",))
