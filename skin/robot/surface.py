"""Signed distance of a point to the surface of a shape, and the outward normal.

Primitives exactly, by their own formula; meshes by the nearest triangle. Points have shape (3, n),
metre, in the shape's own frame; a distance is positive outside.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = ["Surface", "from_mesh", "primitive"]

Surface = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From points (3, n) to distances (n,), metre, and outward normals (3, n)."""

AT_ONCE = 4_000_000
"""Pairs of points and triangles processed at once: some 500 MB [numeric]."""
STEPS = 120
"""Bisections for the nearest point of an ellipsoid: to the last digit [numeric]."""


def primitive(kind: str, size: tuple[float, ...]) -> Surface:
    """The surface of a primitive; kinds and sizes as of `topology.robot.model.Geom`."""
    numbers = np.array(size)
    return lambda points: _PRIMITIVES[kind](numbers, np.asarray(points, float))


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and directions; +x where there is no length."""
    largest = np.max(np.abs(vectors), axis=0)
    some = largest > 0.0
    along_x = np.zeros(vectors.shape)
    along_x[0] = 1.0
    # Over the largest component first: squares of a tiny vector are lost or round.
    scaled = np.where(some, vectors / np.where(some, largest, 1.0), along_x)
    length = np.linalg.norm(scaled, axis=0)
    return largest * length, scaled / length


def _sphere(size: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    length, normal = _unit(p)
    return length - size[0], normal


def _capsule(size: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    away = p.copy()
    away[2] -= np.clip(p[2], -size[1], size[1])
    return _sphere(size, away)


def _plane(_: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normal = np.zeros(p.shape)
    normal[2] = 1.0
    return p[2].copy(), normal


def _rounded(over: np.ndarray, outward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance and normal for a convex polyhedron: distances beyond each face (m, n), and normals
    (m, 3, n). Outside, perpendicular faces combine; inside the nearest counts."""
    beyond = np.maximum(over, 0.0)
    outside, _ = _unit(beyond)
    nearest = np.argmax(over, axis=0)
    every = np.arange(over.shape[1])
    inner = outward[nearest, :, every].T
    _, outer = _unit(np.sum(beyond[:, np.newaxis] * outward, axis=0))
    is_out = outside > 0.0
    return np.where(is_out, outside, over[nearest, every]), np.where(is_out, outer, inner)


def _box(size: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    side = np.where(p < 0.0, -1.0, 1.0)
    return _rounded(np.abs(p) - size[:, np.newaxis], np.eye(3)[:, :, np.newaxis] * side)


def _cylinder(size: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    flat = p.copy()
    flat[2] = 0.0
    around, radial = _unit(flat)
    cap = np.zeros(p.shape)
    cap[2] = np.where(p[2] < 0.0, -1.0, 1.0)
    over = np.stack([around - size[0], np.abs(p[2]) - size[1]])
    return _rounded(over, np.stack([radial, cap]))


def _ellipsoid(size: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest point is at ``a² p / (t + a²)``, with t the root on the surface; it is found as
    its difference to minus the least of a²."""
    square = size[:, np.newaxis] ** 2
    least = size.min()
    beyond = square - least**2
    sign, p = np.where(p < 0.0, -1.0, 1.0), np.maximum(np.abs(p), 1e-12 * least)
    low = np.zeros(p.shape[1])
    high = np.linalg.norm(p, axis=0) * size.max() + least**2
    for _ in range(STEPS):
        middle = (low + high) / 2.0
        with np.errstate(divide="ignore"):
            outside = np.sum((size[:, np.newaxis] * p / (middle + beyond)) ** 2, axis=0) > 1.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    nearest = square * p / (high + beyond)
    inside = np.sum(p**2 / square, axis=0) < 1.0
    distance = np.linalg.norm(p - nearest, axis=0)
    _, normal = _unit(nearest / square)
    return np.where(inside, -distance, distance), sign * normal


_PRIMITIVES: dict[str, Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "sphere": _sphere,
    "capsule": _capsule,
    "plane": _plane,
    "box": _box,
    "cylinder": _cylinder,
    "ellipsoid": _ellipsoid,
}


def from_mesh(triangles: np.ndarray) -> Surface:
    """The surface of triangles, shape (f, 3, 3): vertices of each, metre, anticlockwise from
    outside. Of several triangles at the same distance, the one that faces the point counts."""
    a, b, c = np.moveaxis(np.asarray(triangles, float), 1, 0)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    keep = area > 0.0
    a, b, c, normal = a[keep], b[keep], c[keep], normal[keep] / area[keep, np.newaxis]

    def look(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        distance, found = np.empty(points.shape[1]), np.empty(points.shape)
        step = max(1, AT_ONCE // max(len(a), 1))
        for start in range(0, points.shape[1], step):
            some = slice(start, start + step)
            p = points[:, some].T[:, np.newaxis]
            away = p - _closest(p, a, b, c)
            far = np.linalg.norm(away, axis=-1)
            facing = np.sum(away * normal, axis=-1)
            alike = far <= far.min(axis=1, keepdims=True) + 1e-9
            best = np.argmax(np.where(alike, np.abs(facing), -1.0), axis=1)
            row = np.arange(len(best))
            distance[some] = np.where(facing[row, best] < 0.0, -1.0, 1.0) * far[row, best]
            found[:, some] = normal[best].T
        return distance, found

    return look


def _closest(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Nearest points of triangles (f, 3) to points (n, 1, 3), shape (n, f, 3): in the face where
    the foot lies in it, else on the nearest of the three edges."""
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    square = np.sum(normal * normal, axis=-1)
    ap = p - a
    v = np.sum(np.cross(ap, ac) * normal, axis=-1) / square
    w = np.sum(np.cross(ab, ap) * normal, axis=-1) / square
    within = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    best = a + v[..., np.newaxis] * ab + w[..., np.newaxis] * ac
    least = np.where(within, 0.0, np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        share = np.sum((p - start) * edge, axis=-1) / np.sum(edge * edge, axis=-1)
        foot = start + np.clip(share, 0.0, 1.0)[..., np.newaxis] * edge
        far = np.sum((p - foot) ** 2, axis=-1)
        nearer = ~within & (far < least)
        best = np.where(nearer[..., np.newaxis], foot, best)
        least = np.where(nearer, far, least)
    return best
