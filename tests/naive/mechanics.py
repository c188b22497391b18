"""Contact mechanics the slow and obvious way, and plain skins to try it on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import nnls
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


def sphere_reach(
    centre: np.ndarray, radius: float, position: np.ndarray, axis: np.ndarray
) -> np.ndarray:
    """How deep a sphere reaches into faces, metre, shape (n,); 0 where it holds no middle."""
    away = centre[:, np.newaxis] - position
    along = np.einsum("in,in->n", away, axis)
    inside = radius * radius - np.einsum("in,in->n", away, away)
    depth = along + np.sqrt(np.maximum(inside + along * along, 0.0))
    return np.where(inside > 0.0, depth, 0.0)


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


def linear_contact(influence: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Loads f >= 0 with influence @ f >= depth, and no load where there is a gap.

    That is the least elastic energy, and with the matrix's Cholesky factor a least-squares problem
    of numbers that may not be negative.
    """
    factor = np.linalg.cholesky(influence)
    return nnls(factor.T, np.linalg.solve(factor, depth), maxiter=50 * depth.size)[0]


def held_tractions(
    influence: np.ndarray, want: np.ndarray, limit: np.ndarray, rounds: int = 20000
) -> np.ndarray:
    """Tractions of least energy within circles of radius `limit`: projected gradients.

    `influence` has shape (2 n, 2 n), `want` (2, n).
    """
    force = np.zeros_like(want)
    rate = 1.0 / np.linalg.eigvalsh(influence)[-1]
    for _ in range(rounds):
        force = force + rate * (want - (influence @ force.ravel()).reshape(want.shape))
        size = np.hypot(*force)
        force *= np.minimum(1.0, limit / np.where(size > 0.0, size, 1.0))
    return force


def moved(pose: Pose, shift_m: np.ndarray) -> Pose:
    """The pose after a translation in metre."""
    return pose[0], pose[1] + shift_m


def turned(pose: Pose, axis: np.ndarray, angle_rad: float) -> Pose:
    """The pose after a turn of the body about an axis through its origin, of any length but 0."""
    turn = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis)).as_matrix()
    return turn @ pose[0], pose[1]


def rolled(pose: Pose, shift_m: np.ndarray, radius_m: float, outward: np.ndarray) -> Pose:
    """The pose after rolling without sliding by `shift_m` over a plane of normal `outward`."""
    way = float(np.linalg.norm(shift_m))
    if way == 0.0:
        return pose
    return moved(turned(pose, np.cross(outward, shift_m), way / radius_m), shift_m)
