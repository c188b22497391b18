"""Bodies in contact with a skin: shapes, poses, penetration, and displacement of faces.

A pose is a transform as in `topology.pose`: (rotation, translation), coordinates of the body to
coordinates of the skin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from msgspec.structs import asdict

from bus.compiled.jit import compiled
from skin.sim.mechanics.rays import BOX, CYLINDER, SPHERE, crossing
from skin.sim.mechanics.vectors import turned_back

__all__ = ["Body", "Pose", "carried", "penetration"]

Pose = tuple[np.ndarray, np.ndarray]
"""Rotation, shape (3, 3), and position in metre, shape (3,)."""

ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns the axis of a cylinder from z to x."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A convex body: a primitive of `skin.sim.mechanics.rays`, in its own frame.

    Attributes
    ----------
    kind : int
    size : ndarray, shape (3,)
        Metre, as `crossing` has them.
    axes, middle : ndarray, shape (3, 3) and (3,)
        Pose of the primitive in the frame of the body.
    compliance_mm_per_n : float
        Yield of the body's surface under the force of one unit, normal or tangential; in series
        with the unit's own stiffness. 0: rigid.

    Examples
    --------
    >>> Body.sphere(0.05).size
    array([0.05, 0.  , 0.  ])
    """

    kind: int
    size: np.ndarray
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    middle: np.ndarray = field(default_factory=lambda: np.zeros(3))
    compliance_mm_per_n: float = 0.0

    @classmethod
    def sphere(cls, radius_m: float, **soft: Any) -> Body:
        """A sphere about the origin; `soft` is its compliance."""
        return cls(kind=SPHERE, size=np.array([radius_m, 0.0, 0.0]), **soft)

    @classmethod
    def cylinder(cls, radius_m: float, length_m: float, **soft: Any) -> Body:
        """A cylinder about the origin, its axis along x."""
        size = np.array([radius_m, 0.5 * length_m, 0.0])
        return cls(kind=CYLINDER, size=size, axes=ALONG_X, **soft)

    @classmethod
    def block(cls, x_m: float, y_m: float, z_m: float, **soft: Any) -> Body:
        """A block of these edges about the origin."""
        return cls(kind=BOX, size=0.5 * np.array([x_m, y_m, z_m]), **soft)

    @classmethod
    def plate(cls, x_m: float, y_m: float, thickness_m: float = 0.1, **soft: Any) -> Body:
        """A flat plate: the middle of its lower face in the origin, the rest along +z."""
        middle = np.array([0.0, 0.0, 0.5 * thickness_m])
        return cls(kind=BOX, size=0.5 * np.array([x_m, y_m, thickness_m]), middle=middle, **soft)

    @classmethod
    def of(cls, shape: Any, compliance_mm_per_n: float = 0.0) -> Body:
        """The body of a shape in a scene file (`skin.sim.scenes.script.Shape`)."""
        make = getattr(cls, shape.__struct_config__.tag)
        body: Body = make(**asdict(shape), compliance_mm_per_n=compliance_mm_per_n)
        return body

    @property
    def lowest_m(self) -> float:
        """Depth of the lowest point of the body below its origin."""
        return float(self.size[2 if self.kind == BOX else 0] - self.middle[2])


def penetration(
    body: Body,
    pose: Pose,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
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
    depth_mm = np.empty(position.shape[1]) if out is None else out
    axes = (pose[0] @ body.axes).reshape(1, 9)
    middle = pose[0] @ body.middle + pose[1]
    _penetration(body.kind, body.size, axes, middle, position, rotation, depth_mm)
    return depth_mm


def carried(
    before: Pose, after: Pose, position: np.ndarray, rotation: np.ndarray, depth_mm: np.ndarray
) -> np.ndarray:
    """Displacement of the body's surface along each face between two poses.

    Sliding, turning on the spot (torsion) and rolling are all in the two poses: a unit sees the
    motion of the point of the body that ends up in contact with the face.

    Parameters
    ----------
    before, after : Pose
    position, rotation
        As for `penetration`.
    depth_mm : ndarray, shape (n,)
        Depth at which the body meets the face after the motion.

    Returns
    -------
    ndarray, shape (2, n)
        Millimetre, along x and y of the unit; 0 where `depth_mm` is not above 0.
    """
    touched = depth_mm > 0.0
    depth_m = 1e-3 * np.where(touched, depth_mm, 0.0)
    arm = position + depth_m * rotation[:, 2] - after[1][:, np.newaxis]
    travel = (after[1] - before[1])[:, np.newaxis] + arm - before[0] @ after[0].T @ arm
    return 1e3 * touched * np.einsum("ijn,in->jn", rotation[:, :2], travel)


def _penetration_python(kind, size, axes, middle, position, rotation, depth_mm):
    """`penetration`, in place; see there."""
    for i in range(position.shape[1]):
        away = (position[0, i] - middle[0], position[1, i] - middle[1], position[2, i] - middle[2])
        into = (rotation[0, 2, i], rotation[1, 2, i], rotation[2, 2, i])
        point, direction = turned_back(axes, 0, away), turned_back(axes, 0, into)
        enters, out, _, _, _ = crossing(kind, size, point, direction)
        depth_mm[i] = 1e3 * out if enters < min(out, 0.0) else -np.inf


_penetration = compiled(_penetration_python, fastmath=("contract",))
