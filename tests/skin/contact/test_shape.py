"""Axes, extents and normal of what touches: against eigenvectors, and at the bounds."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Flag
from skin.contact.shape import diagonalise
from skin.contact.stream import ContactStream
from tests.fixtures.contact_features import contact_features

AREA = 1e-4
seeds = st.integers(0, 2**32)


def touch(position, load=1.0, rotation=None, depth_mm=None):
    """The one contact of some units; position (3, n)."""
    n = position.shape[1]
    force = np.zeros((3, n))
    force[2] = load
    moved = None if depth_mm is None else np.array([np.zeros(n), np.zeros(n), depth_mm])
    rotation = naive.facing_down(n) if rotation is None else rotation
    (contact,), _ = contact_features(
        np.zeros(n, int), force, 1e-3, position, rotation, AREA, displacement_mm=moved
    )
    return contact


def tilted(n, rng, by=0.3):
    """Rotations (3, 3, n) of units that face +z, more or less."""
    turn = Rotation.from_rotvec(rng.normal(0.0, by, (n, 3))).as_matrix()
    return np.einsum("nij,jkn->ikn", turn, naive.facing_down(n))


@given(
    seeds,
    st.sampled_from([(3.0, 2.0, 1.0), (1.0, 1.0, 0.5), (1.0, 0.2, 0.2), (1.0, 1.0, 1.0),
                     (1.0, 1.0 + 1e-9, 0.0), (1.0, 0.0, 0.0), (1.0, 1e-7, 1e-14),
                     (0.0, 0.0, 0.0)]),
    st.sampled_from([1e-30, 1e-6, 1.0, 1e30]),
    st.sampled_from(["none", "near", "far"]),
)  # fmt: skip
def test_eigenvectors_are_those_of_a_matrix_however_degenerate_tiny_or_huge(seed, square, size, at):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    m = size * (turn.as_matrix() * square) @ turn.as_matrix().T
    near = Rotation.from_rotvec(rng.normal(0.0, 1e-4, 3)) * turn
    v = {"none": np.eye(3), "near": near.as_matrix(),
         "far": Rotation.random(rng=rng).as_matrix()}[at]  # fmt: skip
    diagonal, before = v.T @ m @ v, v.copy()
    diagonalise(v, diagonal)
    values = diagonal.diagonal()
    np.testing.assert_allclose(v.T @ v, np.eye(3), atol=1e-14)
    left = 1e-11 * sum(square)  # beside the diagonal; its square over a gap, in the values
    gap = min((abs(a - b) for a, b in combinations(square, 2) if a != b), default=np.inf)
    rounding = 2e-15 * max(square)
    np.testing.assert_allclose(
        np.sort(values), np.linalg.eigvalsh(m), rtol=0, atol=size * (rounding + left**2 / gap)
    )
    np.testing.assert_allclose(m @ v, v * values, rtol=0, atol=size * (rounding + left))
    if at != "none" and len(set(square)) == 1:  # any axes will do: they stay
        np.testing.assert_array_equal(v, before)


def check_axes(contact, points, load, outward):
    """Hold axes, extents and normal to the covariance of the touched points."""
    covariance = np.cov(points, aweights=np.broadcast_to(load, points.shape[1]), ddof=0)
    square = np.linalg.eigvalsh(covariance)[::-1].clip(0.0)
    near = 1e-9 * square[0]
    assert contact["extent"] ** 2 == pytest.approx(square[:2], rel=1e-8, abs=near)
    assert contact["normal_condition"] ** 2 == pytest.approx(square[1] / square[0], abs=1e-9)
    major, minor, normal = contact["axes"].T
    assert np.cross(normal, major) == pytest.approx(minor, abs=1e-12)
    assert contact["axes"].T @ contact["axes"] == pytest.approx(np.eye(3), abs=1e-12)
    assert normal.tolist() == contact["normal"].tolist()
    assert normal @ outward >= 0.0
    if not contact["flags"] & Flag.NORMAL_ASSUMED:
        assert covariance @ major == pytest.approx(square[0] * major, abs=near)
        assert covariance @ normal == pytest.approx(square[2] * normal, abs=near)


@given(seeds, st.integers(3, 9))
def test_axes_are_those_of_the_covariance_of_the_touched_points(seed, n):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    points = turn @ (rng.normal(size=(3, n)) * [[0.02], [0.01], [0.004 * rng.random()]])
    rotation, load = tilted(n, rng, 0.5), rng.uniform(0.1, 3.0, n)
    depth = rng.uniform(-2.0, 2.0, n)
    contact = touch(points - 1e-3 * depth * rotation[:, 2], load, rotation, depth)
    check_axes(contact, points, load, -rotation[:, 2] @ load)


def test_axes_go_on_from_those_before_as_what_touches_turns_and_tumbles():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(3, 6)) * [[0.02], [0.01], [0.003]]
    graph = neighbour_graph(points, 1.0)
    stream = ContactStream(points, naive.facing_down(6), AREA, *graph)
    load = rng.uniform(1.0, 2.0, 6)
    force = np.array([0.0 * load, 0.0 * load, load])
    before = None
    for number in range(120):
        turn = Rotation.from_rotvec([0.0, 0.3 * np.sin(0.05 * number), 0.12 * number])
        moved = turn.as_matrix() @ points
        stream.move(moved, naive.facing_down(6))
        (contact,) = stream.update(force, 0.01, stamp_ns=number)
        check_axes(contact.record, moved, load, np.array([0.0, 0.0, 1.0]))
        if before is not None:
            assert contact.axes[:, 0] @ before > 0.9, "the major axis keeps its sense"
        before = contact.axes[:, 0].copy()


@pytest.mark.parametrize(("share", "spans"), [(0.049, False), (0.06, True)])
def test_points_span_a_plane_above_a_twentieth_of_their_length(share, spans):
    """Across the units' own normals, which are not those of the plane."""
    turn = Rotation.from_rotvec([0.4, -0.2, 0.1]).as_matrix()
    corners = [[1, 1, -1, -1, 0], [share, -share, share, -share, 0], [0] * 5]
    across = turn @ (0.01 * np.array(corners))
    rotation, load = tilted(5, np.random.default_rng(1)), np.array([1.0, 1.0, 1.0, 1.0, 3.0])
    contact = touch(across, load, rotation)
    assert bool(contact["flags"] & Flag.NORMAL_ASSUMED) != spans
    mean = -rotation[:, 2] @ load
    normal = turn[:, 2] if spans else mean / np.linalg.norm(mean)
    assert contact["normal"] == pytest.approx(normal, abs=1e-9)
    check_axes(contact, across, load, mean)


@given(seeds, st.integers(1, 3))
def test_one_point_has_no_extent_and_the_axes_of_its_units(seed, n):
    """Even far from the middle of the array, where a spread is a difference of large numbers."""
    rng = np.random.default_rng(seed)
    place = np.hstack([np.repeat(rng.normal(size=(3, 1)), n, axis=1), rng.normal(size=(3, 4))])
    rotation, load = tilted(n + 4, rng), rng.uniform(0.1, 2.0, n + 4)
    force = np.array([0.0 * load, 0.0 * load, load])
    label = np.where(np.arange(n + 4) < n, 0, -1)
    (contact,), _ = contact_features(label, force, 1e-3, place, rotation, AREA)
    assert contact["extent"].tolist() == [0.0, 0.0]
    assert contact["normal_condition"] == 0.0
    assert contact["flags"] & Flag.NORMAL_ASSUMED
    normal = -rotation[:, 2, :n] @ load[:n]
    normal /= np.linalg.norm(normal)
    along = rotation[:, 0, :n] @ load[:n]
    along -= normal * (normal @ along)
    assert contact["normal"] == pytest.approx(normal)
    assert contact["axes"][:, 0] == pytest.approx(along / np.linalg.norm(along))


@given(seeds, st.integers(2, 8))
def test_arm_is_the_mean_distance_from_the_line_through_the_centre(seed, n):
    rng = np.random.default_rng(seed)
    position, load = rng.normal(0.0, 0.02, (3, n)) + 0.3, rng.uniform(0.5, 3.0, n)
    rotation = tilted(n, rng)
    contact = touch(position, load, rotation)
    arm = naive.torsion_arm(load, position, contact["normal"])
    assert contact["arm"] == pytest.approx(arm, rel=1e-9)
    alone = touch(position[:, :1], 1.0, rotation[:, :, :1])
    assert alone["arm"] == 0.0
