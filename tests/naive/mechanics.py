"""Contact mechanics the slow and obvious way, and plain skins to try it on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from skin.sim.mechanics.body import Body, Pose
from skin.sim.mechanics.rays import CYLINDER, SPHERE
from topology import Topology, load


@cache
def square(side: int, pitch_m: float = 0.012) -> Topology:
    """A flat square of units in the plane z = 0, outward normal +z; units as those of the palm."""
    palm, n = load("palm"), side * side
    line = (np.arange(side) - 0.5 * (side - 1)) * pitch_m
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    return replace(
        palm,
        unit_names=tuple(f"u{i}" for i in range(n)),
        patch=np.zeros(n, np.int32),
        position=np.stack([x, y, np.zeros(n)]),
        rotation=np.repeat(palm.rotation[..., :1], n, axis=-1),
        area=np.full(n, min(pitch_m**2, palm.area[0])),
        parameters={k: np.repeat(v[..., :1], n, axis=-1) for k, v in palm.parameters.items()},
    )


def inside(body: Body, points: np.ndarray, slack: float = 1e-12) -> np.ndarray:
    """Which points, shape (3, m), lie in a body, all in the body's frame."""
    x, y, z = body.axes.T @ (points - body.middle[:, np.newaxis])
    if body.kind == SPHERE:
        return np.sqrt(x * x + y * y + z * z) <= body.size[0] + slack
    if body.kind == CYLINDER:
        return (np.hypot(x, y) <= body.size[0] + slack) & (np.abs(z) <= body.size[1] + slack)
    return np.all(np.abs([x, y, z]) <= body.size[:, np.newaxis] + slack, axis=0)


def line_integral_rectangle(x: float, y: float, half: float, fineness: int = 400) -> np.ndarray:
    """Integrals of 1/r, x²/r³, y²/r³ and xy/r³ over a square seen from (x, y), by midpoints."""
    line = (np.arange(fineness) + 0.5) / fineness * 2.0 * half - half
    a, b = np.meshgrid(x - line, y - line)
    r = np.hypot(a, b)
    cell = (2.0 * half / fineness) ** 2
    return cell * np.array([np.sum(f) for f in (1 / r, a * a / r**3, b * b / r**3, a * b / r**3)])


def moved(pose: Pose, shift_m: np.ndarray) -> Pose:
    """The pose after a translation in metre."""
    return pose[0], pose[1] + shift_m


def turned(pose: Pose, axis: np.ndarray, angle_rad: float) -> Pose:
    """The pose after a turn of the body about an axis through its origin, of any length but 0."""
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis)).as_matrix()
    return turn @ pose[0], pose[1]
