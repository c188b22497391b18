"""Surfaces of shapes, against trimesh's meshes of them."""

import numpy as np
import pytest
import trimesh
from hypothesis import example, given
from hypothesis import strategies as st

from skin.robot.surface import from_mesh, primitive

SHAPES = {
    "sphere": (0.03,),
    "capsule": (0.02, 0.03),
    "cylinder": (0.02, 0.03),
    "box": (0.01, 0.02, 0.03),
    "ellipsoid": (0.01, 0.02, 0.03),
}
coordinates = st.floats(-0.06, 0.06)


def inside(kind, size, p):
    """Whether a point is inside, by the definition of the shape."""
    x, y, z = p
    around = np.hypot(x, y)
    if kind == "sphere":
        return np.linalg.norm(p) < size[0]
    if kind == "capsule":
        return np.hypot(around, max(abs(z) - size[1], 0.0)) < size[0]
    if kind == "cylinder":
        return around < size[0] and abs(z) < size[1]
    if kind == "box":
        return bool((np.abs(p) < size).all())
    return np.sum((p / np.array(size)) ** 2) < 1.0


@pytest.mark.parametrize("kind", SHAPES)
@given(x=coordinates, y=coordinates, z=coordinates)
@example(x=0.0, y=0.0, z=4.4e-161)
@example(x=5e-324, y=1e-300, z=0.0)
@example(x=0.02, y=0.03 + 1e-170, z=3e-162)
def test_along_the_normal_the_surface_is_where_the_distance_says(kind, x, y, z):
    look, p = primitive(kind, SHAPES[kind]), np.array([[x], [y], [z]])
    distance, normal = look(p)
    assert np.linalg.norm(normal, axis=0) == pytest.approx([1.0])
    if abs(distance[0]) > 1e-9:
        assert (distance[0] < 0.0) == inside(kind, SHAPES[kind], p[:, 0])
    foot, _ = look(p - distance * normal)
    assert abs(foot[0]) < 1e-9


@pytest.mark.parametrize("kind", ["box", "cylinder", "capsule", "sphere"])
def test_a_mesh_of_a_shape_has_its_distances(kind):
    size = SHAPES[kind]
    mesh = {
        "box": lambda: trimesh.creation.box(2 * np.array(size)),
        "cylinder": lambda: trimesh.creation.cylinder(size[0], 2 * size[-1], sections=256),
        "capsule": lambda: trimesh.creation.capsule(2 * size[-1], size[0], count=[64, 64]),
        "sphere": lambda: trimesh.creation.icosphere(4, size[0]),
    }[kind]()
    if kind == "capsule":
        mesh.apply_translation([0, 0, -mesh.bounds.mean(axis=0)[2]])
    points = np.random.default_rng(2).uniform(-0.06, 0.06, (3, 60))
    of_mesh, _ = from_mesh(np.array(mesh.triangles))(points)
    exact, _ = primitive(kind, size)(points)
    assert np.abs(of_mesh - exact).max() < 1e-4
    assert (of_mesh < 0).any()
