"""Depths against the engine's own rays, shot from the other side."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from skin.sim.mechanics import rays

SIZES = {
    rays.SPHERE: (0.02, 0.0, 0.0),
    rays.CAPSULE: (0.02, 0.03, 0.0),
    rays.ELLIPSOID: (0.02, 0.03, 0.01),
    rays.CYLINDER: (0.02, 0.03, 0.0),
    rays.BOX: (0.02, 0.03, 0.01),
}
KINDS = pytest.mark.parametrize("kind", SIZES)
SEEDS = st.integers(0, 2**32 - 1)
FAR_M = 0.5


def line(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A line through the neighbourhood of the origin."""
    random = np.random.default_rng(seed)
    way = random.normal(size=3)
    return random.uniform(-0.02, 0.02, 3), way / np.linalg.norm(way)


def from_behind(kind: int, size: tuple, point: np.ndarray, way: np.ndarray) -> float:
    """Where the engine sees the line leave, looking back along it from afar; NaN if it passes."""
    seen = mujoco.mju_rayGeom(
        np.zeros(3), np.eye(3).ravel(), np.array(size), point + FAR_M * way, -way, kind, None
    )
    return FAR_M - seen if seen >= 0.0 else np.nan


@KINDS
@settings(max_examples=200, deadline=None)
@given(seed=SEEDS)
def test_a_line_leaves_a_primitive_where_the_engine_sees_it(kind: int, seed: int) -> None:
    point, way = line(seed)
    size = np.array(SIZES[kind])
    enters, out, *_ = rays.crossing(kind, size, tuple(point), tuple(way))
    seen = from_behind(kind, SIZES[kind], point, way)
    if np.isnan(seen):
        assert not enters < out
    else:
        assert out == pytest.approx(seen, abs=1e-12)


@KINDS
@settings(max_examples=100, deadline=None)
@given(seed=SEEDS)
def test_the_normal_is_that_of_the_surface_around_the_exit(kind: int, seed: int) -> None:
    point, way = line(seed)
    size = np.array(SIZES[kind])
    enters, out, *normal = rays.crossing(kind, size, tuple(point), tuple(way))
    if not enters < out or np.dot(normal, way) < 0.1:
        return
    spot, step = point + out * way, 1e-7  # at a grazing ray a longer one feels the curvature
    for axis in np.linalg.svd(way[np.newaxis])[2][1:]:
        _, beside, *other = rays.crossing(kind, size, tuple(point + step * axis), tuple(way))
        if np.dot(normal, other) > 1.0 - 1e-6:  # not across an edge
            along = (point + step * axis + beside * way - spot) / step
            assert np.dot(along, normal) == pytest.approx(0.0, abs=3e-3)


@settings(max_examples=200, deadline=None)
@given(seed=SEEDS)
def test_a_line_leaves_a_hull_where_it_leaves_the_faces_of_the_hull(seed: int) -> None:
    hull = trimesh.creation.torus(0.03, 0.01, major_sections=24, minor_sections=12).convex_hull
    point, way = line(seed)
    planes = ConvexHull(hull.vertices).equations
    faces = np.array([0, len(planes)])
    enters, out, *normal = rays.hull_crossing(planes, faces, tuple(point), tuple(way))
    places, _, _ = hull.ray.intersects_location([point - FAR_M * way], [way], multiple_hits=True)
    if len(places):
        at = (places - point) @ way
        assert (enters, out) == pytest.approx((at.min(), at.max()), abs=1e-9)
        assert np.dot(normal, way) > 0.0
    else:
        assert not enters < out
