"""Bodies that touch a skin: shapes and poses, how deep they reach, how they carry faces along.

A pose is a transform as in `topology.pose`: (rotation, translation), coordinates of the body to
coordinates of the skin. With a last axis of k it holds one pose for each patch: what the body looks
like from a patch that moves by itself, as the fingers of a gripper do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.errors import OptionError

__all__ = ["FACES", "Body", "Pose", "carried", "moved", "penetration", "turned"]

Pose = tuple[np.ndarray, np.ndarray]
"""Rotation, shape (3, 3) or (3, 3, k), and position in metre, shape (3,) or (3, k)."""

_SIXTH = np.arange(6) * (math.pi / 3.0)
_RING = math.sqrt(2.0 / 3.0)

FACES: dict[str, np.ndarray] = {
    "point": np.array([[0.0], [0.0], [1.0]]),
    "disc": np.array(
        [
            [0.0, *(_RING * np.cos(_SIXTH))],
            [0.0, *(_RING * np.sin(_SIXTH))],
            [0.25, *np.full(6, 0.125)],
        ]
    ),
}
"""Where a face feels: x and y in radii of the unit, and weights. `disc` is the quadrature of the
fifth degree on a disc; it feels an edge that lies beside the middle of a face, `point` does not."""


class Poses(NamedTuple):
    """Rotations, shape (3, 3, k), and positions in metre, shape (3, k)."""

    rotation: np.ndarray
    position: np.ndarray


class _Units(NamedTuple):
    """Faces as of `penetration`: `part` (n,), int32, which pose holds for each; `size` (n,), the
    radius of each face in metre, or how deep the body is in it in millimetre."""

    position: np.ndarray
    rotation: np.ndarray
    part: np.ndarray
    size: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A convex body: the space within a quadric and behind planes, in its own frame.

    Attributes
    ----------
    curvature : ndarray, shape (3,)
        1/m²: points x with ``curvature @ x**2 <= 1``; all 0 where the body has no round part.
    planes : ndarray, shape (4, m)
        Outward unit normals and distances from the origin in metre: ``normal @ x <= distance``.
    compliance_mm_per_n, shear_compliance_mm_per_n : float
        How far the body's surface yields to the force of one unit, normal and tangential; in
        series with the unit's own stiffness. 0: rigid.

    Examples
    --------
    >>> Body.sphere(0.05).curvature
    array([400., 400., 400.])
    """

    curvature: np.ndarray = field(default_factory=lambda: np.zeros(3))
    planes: np.ndarray = field(default_factory=lambda: np.zeros((4, 0)))
    compliance_mm_per_n: float = 0.0
    shear_compliance_mm_per_n: float = 0.0

    @classmethod
    def sphere(cls, radius_m: float, **soft: Any) -> Body:
        """A sphere about the origin; `soft` are the compliances."""
        _positive(radius_m=radius_m)
        return cls(curvature=np.full(3, 1.0 / radius_m**2), **soft)

    @classmethod
    def cylinder(cls, radius_m: float, length_m: float, **soft: Any) -> Body:
        """A cylinder about the origin, its axis along x."""
        _positive(radius_m=radius_m, length_m=length_m)
        round_part = np.array([0.0, 1.0, 1.0]) / radius_m**2
        ends = np.array([[1.0, -1.0], [0.0, 0.0], [0.0, 0.0], [0.5 * length_m] * 2])
        return cls(curvature=round_part, planes=ends, **soft)

    @classmethod
    def block(cls, x_m: float, y_m: float, z_m: float, **soft: Any) -> Body:
        """A block of these edges about the origin."""
        _positive(x_m=x_m, y_m=y_m, z_m=z_m)
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
        _positive(length_m=length_m, angle_rad=angle_rad, height_m=height_m)
        if angle_rad >= math.pi:
            raise OptionError(f"angle_rad: must be less than pi; got {angle_rad:g}")
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


def _positive(**sizes: float) -> None:
    for name, size in sizes.items():
        if not (size > 0.0 and math.isfinite(size)):
            raise OptionError(f"{name}: must be more than 0; got {size:g}")


# -- poses -----------------------------------------------------------------------------------------


def moved(pose: Pose, shift_m: np.ndarray) -> Pose:
    """The pose after a translation in metre, skin frame: (3,) for all, or (3, k), one for each."""
    rotation, position = pose
    shift_m = np.asarray(shift_m, float)
    return rotation, position + (shift_m if shift_m.ndim == position.ndim else shift_m[:, None])


def turned(pose: Pose, axis: np.ndarray, angle_rad: float, about: np.ndarray | None = None) -> Pose:
    """The pose after a turn about an axis through a point.

    Parameters
    ----------
    pose : Pose
        A single pose.
    axis : ndarray, shape (3,)
        Skin frame, of any length but 0.
    angle_rad : float
    about : ndarray, shape (3,), optional
        Metre, skin frame; the body's origin if not given.
    """
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross
    rotation, position = pose
    centre = position if about is None else np.asarray(about, float)
    return turn @ rotation, centre + turn @ (position - centre)


def _poses(pose: Pose) -> Poses:
    """The pose as the kernels want it: a last axis of poses, in C order."""
    rotation, position = pose
    if rotation.ndim == 2:
        rotation, position = rotation[:, :, np.newaxis], position[:, np.newaxis]
    return Poses(np.ascontiguousarray(rotation, float), np.ascontiguousarray(position, float))


def _parts(part: np.ndarray | None, pose: Pose, n: int) -> np.ndarray:
    """Which pose holds for each unit; the only one if there is one."""
    return np.zeros(n, np.int32) if pose[1].ndim == 1 or part is None else part


# -- contact of a body and faces -------------------------------------------------------------------


def penetration(
    body: Body,
    pose: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    radius_m: np.ndarray | None = None,
    part: np.ndarray | None = None,
    face: str = "point",
    out: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """How deep a body reaches into each unit, along the unit's own z axis.

    Parameters
    ----------
    body : Body
    pose : Pose
    position : ndarray, shape (3, n)
        Middle of each face, metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes, z into the skin.
    radius_m : ndarray, shape (n,), optional
        Radius of each face; needed where it feels at more than its middle.
    part : ndarray, shape (n,), int32, optional
        Which of several poses holds for each unit.
    face : str
        Key of `FACES`, or an OptionError is raised. Where a face feels at several points the depth
        is their weighted mean, each not less than 0.
    out : tuple of ndarray, optional
        Where to write what is returned.

    Returns
    -------
    depth_mm : ndarray, shape (n,)
        From the face to where the axis leaves the body. Negative: how far the body is away along
        the axis; -inf where it would pass beside the face or lies behind it.
    normal : ndarray, shape (3, n)
        Outward normal of the body where it reaches deepest, skin frame; NaN where nothing meets.

    Examples
    --------
    >>> pose = np.eye(3), np.array([0.0, 0.0, -0.004])
    >>> unit = np.zeros((3, 1)), np.eye(3)[..., None]
    >>> depth_mm, normal = penetration(Body.sphere(0.005), pose, *unit)
    >>> depth_mm
    array([1.])
    """
    if face not in FACES:
        raise OptionError.unknown("face", face, FACES)
    n = position.shape[1]
    depth_mm, normal = out or (np.empty(n), np.empty((3, n)))
    radius = np.zeros(n) if radius_m is None else radius_m
    units = _Units(position, rotation, _parts(part, pose, n), radius)
    _penetration(body.curvature, body.planes, _poses(pose), units, FACES[face], depth_mm, normal)
    return depth_mm, normal


def carried(
    before: Pose,
    after: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    depth_mm: np.ndarray,
    *,
    part: np.ndarray | None = None,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """How far the body's surface moved along each face between two poses.

    What the body does as a whole, sliding, turning on the spot (torsion) or rolling, is in the two
    poses: a unit sees the way of that point of the body which ends up where it meets the face.

    Parameters
    ----------
    before, after : Pose
        As many of the one as of the other, or an OptionError is raised.
    position, rotation, part, out
        As for `penetration`.
    depth_mm : ndarray, shape (n,)
        Depth at which the body meets the face after the motion.

    Returns
    -------
    ndarray, shape (2, n)
        Millimetre, along x and y of the unit; 0 where `depth_mm` is not above 0.
    """
    n = position.shape[1]
    shift_mm = np.empty((2, n)) if out is None else out
    if before[1].shape != after[1].shape:
        raise OptionError(
            f"after: must be as many poses as before, {before[1].shape}; got {after[1].shape}"
        )
    units = _Units(position, rotation, _parts(part, after, n), depth_mm)
    _carry(_poses(before), _poses(after), units, shift_mm)
    return shift_mm


def _penetration_python(curvature, planes, poses, units, face, depth_mm, normal):
    """`penetration`, in place; see there."""
    body_rotation, body_position = poses
    position, rotation, part, radius = units
    g0, g1, g2 = curvature[0], curvature[1], curvature[2]
    round_part = g0 + g1 + g2 > 0.0
    for i in range(position.shape[1]):
        k = part[i]
        d0 = d1 = d2 = 0.0
        for r in range(3):
            z = rotation[r, 2, i]
            d0 += body_rotation[r, 0, k] * z
            d1 += body_rotation[r, 1, k] * z
            d2 += body_rotation[r, 2, k] * z
        mean, deepest = 0.0, -np.inf
        n0 = n1 = n2 = np.nan
        for s in range(face.shape[1]):
            a, b = face[0, s] * radius[i], face[1, s] * radius[i]
            x0 = x1 = x2 = 0.0
            for r in range(3):
                x = position[r, i] + a * rotation[r, 0, i] + b * rotation[r, 1, i]
                x -= body_position[r, k]
                x0 += body_rotation[r, 0, k] * x
                x1 += body_rotation[r, 1, k] * x
                x2 += body_rotation[r, 2, k] * x
            # the part of the axis within the body, as distances from the face
            first, last = -np.inf, np.inf
            leaves = -1
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
                    if distance / towards < last:
                        last = distance / towards
                        leaves = m
                elif towards < 0.0:
                    first = max(first, distance / towards)
                elif distance < 0.0:
                    last = -np.inf
            if first >= min(last, 0.0):
                continue
            mean += face[2, s] * max(last, 0.0)
            if last > deepest:
                deepest = last
                if leaves >= 0:
                    v0, v1, v2 = planes[0, leaves], planes[1, leaves], planes[2, leaves]
                else:
                    v0, v1, v2 = g0 * (x0 + last * d0), g1 * (x1 + last * d1), g2 * (x2 + last * d2)
                    length = np.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
                    v0, v1, v2 = v0 / length, v1 / length, v2 / length
                n0 = body_rotation[0, 0, k] * v0
                n0 += body_rotation[0, 1, k] * v1 + body_rotation[0, 2, k] * v2
                n1 = body_rotation[1, 0, k] * v0
                n1 += body_rotation[1, 1, k] * v1 + body_rotation[1, 2, k] * v2
                n2 = body_rotation[2, 0, k] * v0
                n2 += body_rotation[2, 1, k] * v1 + body_rotation[2, 2, k] * v2
        depth_mm[i] = 1e3 * (mean if deepest > 0.0 else deepest)
        normal[0, i], normal[1, i], normal[2, i] = n0, n1, n2


def _carry_python(poses_before, poses_after, units, shift_mm):
    """`carried`, in place: how far each point of the body is from where it was."""
    turn_0, before = poses_before
    turn_1, after = poses_after
    position, rotation, part, depth_mm = units
    poses = after.shape[1]
    back = np.zeros((3, 3, poses))
    for i in range(3):
        for j in range(3):
            for k in range(poses):
                for m in range(3):
                    back[i, j, k] += turn_0[i, m, k] * turn_1[j, m, k]
    for i in range(position.shape[1]):
        k = part[i]
        along_x = along_y = 0.0
        if depth_mm[i] > 0.0:
            depth = 1e-3 * depth_mm[i]
            r0 = position[0, i] + depth * rotation[0, 2, i] - after[0, k]
            r1 = position[1, i] + depth * rotation[1, 2, i] - after[1, k]
            r2 = position[2, i] + depth * rotation[2, 2, i] - after[2, k]
            for j, r in enumerate((r0, r1, r2)):
                was = back[j, 0, k] * r0 + back[j, 1, k] * r1 + back[j, 2, k] * r2
                way = after[j, k] - before[j, k] + (r - was)
                along_x += rotation[j, 0, i] * way
                along_y += rotation[j, 1, i] * way
        shift_mm[0, i] = 1e3 * along_x
        shift_mm[1, i] = 1e3 * along_y


_penetration = compiled(_penetration_python, fastmath=("contract",))
_carry = compiled(_carry_python, fastmath=("contract",))
