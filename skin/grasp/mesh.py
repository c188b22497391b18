"""Exit of a line from a triangle mesh: a compiled search in the engine's own bounding-box tree.

Meshes must be closed, with their faces anticlockwise from outside, as the engine requires.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.jit import jitable

__all__ = ["Meshes", "mesh_crossing"]

DEEPEST_TREE = 256
"""Capacity of the stack of nodes [numeric: twice the depth of a tree of 2^64 faces]."""

ON_EDGE = 1e-9
"""Relative distance outside a face at which a line still meets it: none slips through between two
[numeric]."""


class Meshes(NamedTuple):
    """All meshes of a model, concatenated.

    Attributes
    ----------
    vertex : ndarray, shape (v, 3)
        Metre, frame of the geom.
    face : ndarray, shape (f, 3), int32
        Vertices, counted from the first of their mesh.
    box : ndarray, shape (b, 6)
        Middle and half edges of a node of the trees.
    child : ndarray, shape (b, 2), int32
        Nodes below, counted from the root of their tree; -1 where there is none.
    leaf : ndarray, shape (b,), int32
        Face of a node, counted from the first of its mesh; -1 where it is none.
    start : ndarray, shape (m, 3), int32
        First vertex, first face, root of each mesh.
    stack : ndarray, shape (256,), int32
        Scratch.
    """

    vertex: np.ndarray
    face: np.ndarray
    box: np.ndarray
    child: np.ndarray
    leaf: np.ndarray
    start: np.ndarray
    stack: np.ndarray

    @classmethod
    def of(cls, model: Any) -> Meshes:
        """The meshes of a `mujoco.MjModel`."""
        start = np.stack([model.mesh_vertadr, model.mesh_faceadr, model.mesh_bvhadr], axis=1)
        return cls(
            np.array(model.mesh_vert, float).reshape(-1, 3),
            np.array(model.mesh_face, np.int32).reshape(-1, 3),
            np.array(model.bvh_aabb, float).reshape(-1, 6),
            np.array(model.bvh_child, np.int32).reshape(-1, 2),
            np.array(model.bvh_nodeid, np.int32).ravel(),
            np.array(start, np.int32).reshape(-1, 3),
            np.zeros(DEEPEST_TREE, np.int32),
        )


@jitable
def mesh_crossing(meshes, index, point, direction, deepest):
    """The exit of a line from a mesh, and the outward normal there.

    Of all exits between the point and `deepest`, the last one; a point within the mesh may leave it
    further on.

    Parameters
    ----------
    meshes : Meshes
    index : int
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
    root, stack = meshes.start[index, 2], meshes.stack
    waiting = 1
    stack[0] = 0
    while waiting > 0:
        waiting -= 1
        node = root + stack[waiting]
        if not _meets_box(meshes.box[node], point, direction):
            continue
        if meshes.leaf[node] < 0:
            for side in range(2):
                if meshes.child[node, side] >= 0:
                    stack[waiting] = meshes.child[node, side]
                    waiting += 1
            continue
        at, x, y, z = _face_crossing(meshes, index, meshes.leaf[node], point, direction)
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
def _meets_box(box, point, direction):
    """Whether a ray meets a box."""
    enters, leaves = 0.0, math.inf
    for a in range(3):
        place, half = point[a] - box[a], box[3 + a] * (1.0 + 1e-9) + 1e-12
        if direction[a] == 0.0:
            if abs(place) > half:
                return False
            continue
        one, other = (-half - place) / direction[a], (half - place) / direction[a]
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return enters <= leaves


@jitable
def _face_crossing(meshes, index, face, point, direction):
    """Where a line meets a face, and the face's outward normal; NaN where it passes by [Möller and
    Trumbore, Fast, minimum storage ray-triangle intersection, 1997]."""
    first = meshes.start[index, 0]
    corners = meshes.face[meshes.start[index, 1] + face]
    a, b, c = (meshes.vertex[first + corners[0]], meshes.vertex[first + corners[1]],
               meshes.vertex[first + corners[2]])  # fmt: skip
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
