"""Exit of a line from a triangle mesh.

Meshes must be closed, with their faces anticlockwise from outside, as the engine requires. Every
face is tried, so that the time of a search is that of their number.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bus.compiled.jit import jitable

__all__ = ["mesh_crossing", "triangles"]

ON_EDGE = 1e-9
"""Relative distance outside a face at which a line still meets it: none slips through between two
[numeric]."""


def triangles(model: Any) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the faces of all meshes of a `mujoco.MjModel`, shape (f, 3, 3), metre, frame of
    the geom, and the first face of each geom and the first behind it, shape (g, 2)."""
    first_vertex = np.repeat(model.mesh_vertadr, model.mesh_facenum)
    faces = np.reshape(model.mesh_face, (-1, 3)) + first_vertex[:, np.newaxis]
    corners = np.array(model.mesh_vert, float).reshape(-1, 3)[faces]
    of_geom = np.zeros((model.ngeom, 2), np.int64)
    for g in np.flatnonzero(model.geom_dataid >= 0):
        mesh = model.geom_dataid[g]
        if mesh < model.nmesh:
            of_geom[g] = model.mesh_faceadr[mesh] + np.array([0, model.mesh_facenum[mesh]])
    return corners.reshape(-1, 3, 3), of_geom


@jitable
def mesh_crossing(corners, faces, point, direction, deepest):
    """The exit of a line from a mesh, and the outward normal there.

    Of all exits between the point and `deepest`, the last one; a point within the mesh may leave it
    further on.

    Parameters
    ----------
    corners : ndarray, shape (f, 3, 3)
    faces : ndarray, shape (2,)
        First face of the mesh, and the first behind it.
    point, direction : tuple of 3 float
        Metre, and a direction of length 1; frame of the geom.
    deepest : float
        Metre.

    Returns
    -------
    tuple of 4 float
        Metre along the line, -inf where it leaves nothing, and a normal.
    """
    last, next_at, next_is_exit = -math.inf, math.inf, False
    normal = next_normal = (0.0, 0.0, 0.0)
    for f in range(faces[0], faces[1]):
        at, x, y, z = _face_crossing(corners[f], point, direction)
        if not at > 0.0:
            continue
        is_exit = x * direction[0] + y * direction[1] + z * direction[2] > 0.0
        if is_exit and last < at <= deepest:
            last, normal = at, (x, y, z)
        if at < next_at:
            next_at, next_is_exit, next_normal = at, is_exit, (x, y, z)
    if last > 0.0:
        return last, normal[0], normal[1], normal[2]
    if next_is_exit:
        return next_at, next_normal[0], next_normal[1], next_normal[2]
    return -math.inf, 0.0, 0.0, 0.0


@jitable
def _face_crossing(corners, point, direction):
    """Where a line meets a face, and the face's outward normal; NaN where it passes by [Möller and
    Trumbore, Fast, minimum storage ray-triangle intersection, 1997]."""
    a, b, c = corners[0], corners[1], corners[2]
    e1 = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    e2 = (c[0] - a[0], c[1] - a[1], c[2] - a[2])
    x, y, z = _cross(e1, e2)
    length = math.sqrt(x * x + y * y + z * z)
    against = x * direction[0] + y * direction[1] + z * direction[2]
    if length == 0.0 or against == 0.0:
        return math.nan, 0.0, 0.0, 0.0
    off = (a[0] - point[0], a[1] - point[1], a[2] - point[2])
    turn = _cross(direction, off)
    u = -(turn[0] * e2[0] + turn[1] * e2[1] + turn[2] * e2[2]) / against
    v = (turn[0] * e1[0] + turn[1] * e1[1] + turn[2] * e1[2]) / against
    if u < -ON_EDGE or v < -ON_EDGE or u + v > 1.0 + ON_EDGE:
        return math.nan, 0.0, 0.0, 0.0
    at = (off[0] * x + off[1] * y + off[2] * z) / against
    return at, x / length, y / length, z / length


@jitable
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
