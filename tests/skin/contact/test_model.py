"""Geometry of units, and neighbour graphs against all distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.contact as naive
from skin.contact.model import check_poses, checked_graph, contact_model, neighbour_graph
from skin.errors import SkinError


@pytest.mark.parametrize("area", [0.0, -1.0, np.nan, [1.0, 1.0, 0.0], np.ones(2), np.ones((3, 1))])
def test_an_area_that_is_none_is_refused(area):
    with pytest.raises(SkinError, match="area: must be positive, one or 3 of them; got"):
        contact_model(np.zeros((3, 3)), naive.facing_down(3), area, [0, 0, 0, 0], [])


def test_poses_of_another_number_of_units_are_refused():
    right = np.zeros((3, 3)), naive.facing_down(3)
    wrong = np.zeros((3, 4)), naive.facing_down(4)
    for position, rotation in ((right[0], wrong[1]), (wrong[0], right[1]), wrong):
        with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
            check_poses(3, position, rotation)
    check_poses(3, *right)
    with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
        contact_model(right[0], wrong[1], 1.0, [0, 0, 0, 0], [])


@given(st.integers(0, 2**32), st.integers(1, 12))
def test_neighbours_are_who_lies_within_reach(seed, n):
    rng = np.random.default_rng(seed)
    position = rng.random((3, n))
    reach = rng.uniform(0.05, 1.0)
    distance = np.linalg.norm(position[:, :, None] - position[:, None, :], axis=0)
    beside = (distance <= reach) & ~np.eye(n, dtype=bool)
    start, index = neighbour_graph(position, reach)
    assert (start.dtype, index.dtype) == (np.int32, np.int32)
    told = [index[start[i] : start[i + 1]].tolist() for i in range(n)]
    assert told == [np.flatnonzero(row).tolist() for row in beside]
    checked = checked_graph(n, start, index)
    assert [one.tolist() for one in checked] == [start.tolist(), index.tolist()]


def test_reach_is_up_to_rounding_and_no_further():
    start, index = neighbour_graph(naive.grid(1, 3, 0.1), 0.1)
    assert (start.tolist(), index.tolist()) == ([0, 1, 3, 4], [1, 0, 2, 1])
    assert neighbour_graph(naive.grid(1, 3, 0.1), 0.1 * (1 - 1e-6))[1].size == 0
    for reach in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(SkinError, match="reach_m: must be a positive number of metres"):
            neighbour_graph(np.zeros((3, 2)), reach)
    for position in (np.zeros((2, 3)), np.zeros((3, 0)), np.full((3, 2), np.nan)):
        with pytest.raises(SkinError, match="position: must "):
            neighbour_graph(position, 0.1)


@pytest.mark.parametrize(
    ("start", "index", "words"),
    [
        ([0, 1, 2], [0], "neighbour_index: must be 2 numbers"),
        ([0, 1, 2, 2], [1, 0], "neighbour_start: must be 3 numbers"),
        ([1, 1, 2], [1, 0], "neighbour_start: .* that begin with 0 and do not fall"),
        ([0, 2, 1], [1], "neighbour_start: .* that begin with 0 and do not fall"),
        ([0, 1, 2], [1, -1], "neighbour_index: must be units 0 to 1; got -1 to 1"),
        ([0, 1, 2], [2, 0], "neighbour_index: must be units 0 to 1; got 0 to 2"),
        ([0, 1, 2], [1.5, 0.0], "neighbour_index: must be whole numbers; got others"),
        ([0, 1, 1], [1], "neighbour_index: must have each pair .* both ways.*; got 1 for unit 0"),
        ([0, 1, 2], [0, 1], "neighbour_index: .* none with itself; got 0 for unit 0"),
    ],
)
def test_what_is_no_graph_is_refused(start, index, words):
    assert checked_graph(2, [0, 1, 2], [1, 0])[1].tolist() == [1, 0]
    assert checked_graph(2, [0, 0, 0], [])[1].size == 0
    with pytest.raises(SkinError, match=words):
        checked_graph(2, start, index)
