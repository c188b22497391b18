"""Laws of poses, patch shapes and the neighbour graph."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.topology as naive
from topology import pose
from topology.layout import count, place
from topology.neighbours import compressed_rows, neighbour_pairs
from topology.schema import Cylinder, Dome, Grid, Hex, List, ListUnit

COMMON = {"name": "patch", "bus": "main", "layout": "f3t-fd64", "first_id": 0x100}

angles = st.floats(-10, 10)
lengths = st.floats(0.001, 1.0)
numbers = st.integers(1, 7)
vectors = st.tuples(*[st.floats(-1, 1)] * 3)
rotations = st.builds(pose.from_rpy, angles, angles, angles)
transforms = st.tuples(rotations, vectors.map(np.array))

grids = st.builds(
    lambda r, c, p, q: Grid(**COMMON, rows=r, columns=c, pitch_m=p, row_pitch_m=q),
    numbers, numbers, lengths, st.none() | lengths,
)  # fmt: skip
hexes = st.builds(
    lambda r, c, p: Hex(**COMMON, rows=r, columns=c, pitch_m=p), numbers, numbers, lengths
)
cylinders = st.builds(
    lambda r, c, p, k, s: Cylinder(
        **COMMON, rows=r, columns=c, pitch_m=p, radius_m=k * c * p, stagger=s
    ),
    numbers, numbers, lengths, st.floats(0.17, 10), st.booleans(),
)  # fmt: skip
domes = st.builds(
    lambda n, p, k: Dome(**COMMON, rings=n, pitch_m=p, radius_m=k * (n + 1) * p),
    st.integers(0, 6), lengths, st.floats(0.4, 10),
)  # fmt: skip
shapes = grids | hexes | cylinders | domes
clouds = st.lists(vectors, max_size=30, unique=True).map(lambda v: np.array(v).reshape(-1, 3).T)


def is_rotation(matrix):
    identity = np.einsum("ij...,ik...->jk...", matrix, matrix)
    wanted = np.eye(3).reshape(3, 3, *[1] * (matrix.ndim - 2))
    determinant = np.linalg.det(np.moveaxis(matrix, (0, 1), (-2, -1)))
    return np.allclose(identity, wanted) and np.allclose(determinant, 1)


@given(angles, angles, angles)
def test_roll_pitch_yaw_is_a_rotation_and_turns_about_fixed_axes_in_turn(roll, pitch, yaw):
    about_x, about_y = pose.from_rpy(roll, 0, 0), pose.from_rpy(0, pitch, 0)
    about_z = pose.from_rpy(0, 0, yaw)
    rotation = pose.from_rpy(roll, pitch, yaw)
    assert is_rotation(rotation)
    np.testing.assert_allclose(rotation, about_z @ about_y @ about_x, atol=1e-12)


@pytest.mark.parametrize(
    ("rpy", "start", "end"),
    [((1, 0, 0), 1, 2), ((0, 1, 0), 2, 0), ((0, 0, 1), 0, 1)],
    ids=["roll: y to z", "pitch: z to x", "yaw: x to y"],
)
def test_a_quarter_turn_takes_one_axis_to_the_next(rpy, start, end):
    rotation = pose.from_rpy(*np.array(rpy) * np.pi / 2)
    np.testing.assert_allclose(rotation[:, start], np.eye(3)[end], atol=1e-12)


@given(vectors.filter(lambda v: np.linalg.norm(v) > 0.01), angles, st.floats(0.1, 10))
def test_a_quaternion_turns_by_its_angle_about_its_axis(axis, angle, length):
    axis = np.array(axis) / np.linalg.norm(axis)
    rotation = pose.from_quaternion(
        *length * np.array([np.cos(angle / 2), *np.sin(angle / 2) * axis])
    )
    assert is_rotation(rotation)
    np.testing.assert_allclose(rotation @ axis, axis, atol=1e-9)
    np.testing.assert_allclose(np.trace(rotation), 1 + 2 * np.cos(angle), atol=1e-9)
    skew = rotation - rotation.T
    turned = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) / 2
    np.testing.assert_allclose(turned, np.sin(angle) * axis, atol=1e-9)


@given(transforms, transforms, transforms, vectors)
def test_transforms_compose_associatively_about_the_identity(a, b, c, point):
    point = np.array(point)
    left = pose.compose(pose.compose(a, b), c)
    right = pose.compose(a, pose.compose(b, c))
    np.testing.assert_allclose(pose.apply(left, point), pose.apply(right, point), atol=1e-9)
    there = pose.apply(a, pose.apply(b, point))
    np.testing.assert_allclose(pose.apply(pose.compose(a, b), point), there, atol=1e-9)
    same = pose.compose(pose.IDENTITY, pose.compose(a, pose.IDENTITY))
    np.testing.assert_allclose(pose.apply(same, point), pose.apply(a, point), atol=1e-12)


@given(shapes)
def test_unit_frames_are_right_handed_with_z_into_the_skin(patch):
    units = place(patch)
    assert units.position.shape == (3, count(patch)) == (3, len(units.names))
    assert len(set(units.names)) == count(patch)
    assert is_rotation(units.rotation)
    apex = np.argmin(np.linalg.norm(units.position, axis=0))
    assert units.rotation[2, 2, apex] < 0


@given(grids | hexes | cylinders)
def test_patches_of_rows_are_centred_below_their_apex(patch):
    position = place(patch).position
    centre = (position.max(axis=1) + position.min(axis=1)) / 2
    np.testing.assert_allclose(centre[:2], 0, atol=1e-9)
    assert position[2].max() <= 1e-12


@given(domes)
def test_domes_have_their_apex_in_the_origin_and_everything_else_below(patch):
    position = place(patch).position
    np.testing.assert_allclose(position[:, 0], 0, atol=1e-12)
    assert (position[2, 1:] < 0).all()


@given(domes.filter(lambda patch: patch.rings))
def test_odd_rings_of_a_dome_start_half_a_step_on(patch):
    units = place(patch)
    ring = np.rint(
        np.arccos(np.clip(-units.rotation[2, 2], -1, 1)) * patch.radius_m / patch.pitch_m
    )
    for k in range(1, patch.rings + 1):
        members = np.flatnonzero(ring == k)
        x, y, _ = units.position[:, members[0]]
        np.testing.assert_allclose(np.arctan2(y, x), (k % 2) * np.pi / members.size, atol=1e-6)


@given(grids)
def test_a_grid_steps_by_its_pitch(patch):
    x, y, z = place(patch).position.reshape(3, patch.rows, patch.columns)
    np.testing.assert_allclose(np.diff(x, axis=1), patch.pitch_m)
    np.testing.assert_allclose(np.diff(y, axis=0), patch.row_pitch_m or patch.pitch_m)
    np.testing.assert_allclose(np.diff(x, axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(np.diff(y, axis=1), 0, atol=1e-12)
    assert not z.any()


def test_grid_units_have_x_along_columns_and_y_against_rows():
    units = place(Grid(**COMMON, rows=2, columns=3, pitch_m=0.01))
    assert units.names == ("r0c0", "r0c1", "r0c2", "r1c0", "r1c1", "r1c2")
    np.testing.assert_array_equal(units.rotation[:, :, 4], np.diag([1.0, -1.0, -1.0]))
    np.testing.assert_allclose(units.position[:, 5], [0.01, 0.005, 0.0], atol=1e-15)


@given(st.integers(3, 9), st.integers(3, 9), lengths)
def test_inside_a_hexagonal_patch_every_unit_has_six_neighbours_at_one_distance(r, c, pitch):
    patch = Hex(**COMMON, rows=r, columns=c, pitch_m=pitch)
    position = place(patch).position
    distance = np.linalg.norm(position[:, :, None] - position[:, None, :], axis=0)
    near = np.isclose(distance, pitch)
    inner = [i * c + j for i in range(1, r - 1) for j in range(1, c - 1)]
    assert (near[inner].sum(axis=1) == 6).all()
    assert (near.sum(axis=1) <= 6).all()


@given(cylinders)
def test_cylinder_units_lie_on_the_cylinder_and_look_away_from_its_axis(patch):
    units = place(patch)
    from_axis = units.position + np.array([0, 0, patch.radius_m])[:, None]
    from_axis[1] = 0
    np.testing.assert_allclose(np.linalg.norm(from_axis, axis=0), patch.radius_m)
    outward = -units.rotation[:, 2]
    np.testing.assert_allclose(outward[1], 0, atol=1e-12)
    np.testing.assert_allclose(outward * patch.radius_m, from_axis, atol=1e-9)
    np.testing.assert_allclose(units.rotation[1, 0], 0, atol=1e-12)  # x goes around the axis
    np.testing.assert_allclose(units.rotation[1, 1], -1)  # y goes against it


@given(domes)
def test_dome_units_lie_on_the_sphere_and_look_away_from_its_middle(patch):
    units = place(patch)
    from_middle = units.position + np.array([0, 0, patch.radius_m])[:, None]
    np.testing.assert_allclose(np.linalg.norm(from_middle, axis=0), patch.radius_m)
    np.testing.assert_allclose(-units.rotation[:, 2] * patch.radius_m, from_middle, atol=1e-9)
    # x goes along the meridian, away from the apex: down, and never around.
    assert (units.rotation[2, 0, 1:] <= 1e-12).all() or patch.pitch_m * patch.rings > (
        np.pi / 2 * patch.radius_m
    )


@given(st.integers(1, 6), st.integers(1, 6), st.booleans())
def test_a_cylinder_turns_into_the_flat_patch_as_its_radius_grows(rows, columns, stagger):
    flat = (Hex if stagger else Grid)(**COMMON, rows=rows, columns=columns, pitch_m=0.01)
    bent = Cylinder(
        **COMMON, rows=rows, columns=columns, pitch_m=0.01, radius_m=100.0, stagger=stagger
    )
    np.testing.assert_allclose(place(bent).position, place(flat).position, atol=1e-4)
    np.testing.assert_allclose(place(bent).rotation, place(flat).rotation, atol=1e-2)


@given(
    vectors.filter(lambda v: np.linalg.norm(v) > 0.1),
    st.none() | vectors.filter(lambda v: np.linalg.norm(v) > 0.1),
)
def test_a_listed_unit_looks_along_its_normal_with_x_near_its_x_axis(normal, x_axis):
    if x_axis is not None and np.linalg.norm(np.cross(normal, x_axis)) < 0.01:
        x_axis = None
    unit = ListUnit(xyz_m=(0.1, 0.2, 0.3), normal=normal, x_axis=x_axis)
    placed = place(List(**COMMON, units=(unit,)))
    x, y, z = placed.rotation[:, :, 0].T
    assert is_rotation(placed.rotation)
    np.testing.assert_allclose(-z, np.array(normal) / np.linalg.norm(normal))
    if x_axis is not None:
        assert x @ np.array(x_axis) > 0
        np.testing.assert_allclose(y @ np.array(x_axis), 0, atol=1e-9)


def test_a_single_point_of_a_wide_reach_makes_no_pairs_of_the_others():
    position = np.zeros((3, 4000))
    position[0] = np.arange(4000) * 1e-3
    reach = np.where(np.arange(4000) == 7, 10.0, 1.5e-3)
    i, j = neighbour_pairs(position, reach, np.zeros(4000))
    assert i.size == 2 * 3999 - 2
    assert {*i.tolist(), *j.tolist()} == {*range(4000)}


@given(clouds, st.data())
def test_neighbours_share_a_body_and_the_larger_reach(position, data):
    n = position.shape[1]

    def one_each(values):
        return np.array(data.draw(st.lists(values, min_size=n, max_size=n)))

    body, reaches = one_each(st.integers(0, 1)), one_each(st.sampled_from([0.3, 1.0, 2.0]))
    i, j = neighbour_pairs(position, reaches, body)
    found = set(zip(i.tolist(), j.tolist(), strict=True))
    wanted = {
        (a, b)
        for a, b in naive.pairs_within(position, 3.5)
        if body[a] == body[b]
        and np.linalg.norm(position[:, a] - position[:, b]) <= max(reaches[a], reaches[b]) + 1e-12
    }
    assert found <= wanted
    assert all(
        np.linalg.norm(position[:, a] - position[:, b]) > max(reaches[a], reaches[b]) - 1e-12
        for a, b in wanted - found
    )
    start, index = compressed_rows(n, i, j)
    rows = [index[start[k] : start[k + 1]].tolist() for k in range(n)]
    assert all(row == sorted(row) for row in rows)
    assert {(a, b) for a, row in enumerate(rows) for b in row} == found | {(b, a) for a, b in found}
