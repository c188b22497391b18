"""Plots show what they are given: places, forces, units not to be trusted, bands of one sigma."""

from __future__ import annotations

import numpy as np
import pytest

import topology
from skin.errors import CountsError

pytest.importorskip("matplotlib", reason="matplotlib is not installed: the extra 'plot'")

from skin.view.plots import figure, force_map, plane, torn


@pytest.fixture
def axes():
    with figure((4.0, 3.0)) as made:
        yield made.add_subplot()


@pytest.fixture
def palm():
    return topology.load("palm")


def test_each_unit_lies_in_its_place_and_has_the_colour_of_its_normal_force(axes, palm):
    force = np.zeros((3, palm.n))
    force[2] = np.linspace(0.0, 3.0, palm.n)
    discs = force_map(axes, palm, force)
    flat = plane(palm)
    np.testing.assert_allclose(discs.get_offsets(), palm.position[flat].T * 1e3)
    np.testing.assert_array_equal(discs.get_array(), force[2])
    assert discs.get_clim() == (0.0, 3.0)


def test_arrows_are_tangential_forces_in_the_frame_of_the_skin(axes, palm):
    """Of units that bear a load, the longest as long as 1.4 units."""
    force = np.zeros((3, palm.n))
    force[:, 10] = 0.6, -0.8, 2.0
    force[:, 11] = 0.5, 0.0, 0.0
    force_map(axes, palm, force)
    (arrows,) = (one for one in axes.collections if hasattr(one, "U"))
    turned = palm.rotation[:, :, 10] @ np.array([0.6, -0.8, 0.0])
    expected = turned[plane(palm)] * 1.4 * 2e3 * np.sqrt(palm.area[10] / np.pi)
    np.testing.assert_allclose([arrows.U[0], arrows.V[0]], expected)
    assert arrows.U.size == 1


def test_units_not_to_be_trusted_have_a_cross_and_no_colour(axes, palm):
    force, valid = np.full((3, palm.n), 0.5), np.ones(palm.n, bool)
    valid[5], force[:, 7] = False, np.nan
    discs = force_map(axes, palm, force, valid=valid)
    assert np.flatnonzero(discs.get_array().mask).tolist() == [5, 7]
    (crosses,) = (line for line in axes.lines if line.get_marker() == "x")
    np.testing.assert_allclose(
        np.array(crosses.get_data()).T, palm.position[plane(palm)][:, [5, 7]].T * 1e3
    )


def test_lines_are_torn_where_cycles_were_left_out():
    time_s, values = torn(np.array([0.0, 0.1, 0.3]), 0.1, np.array([[1.0], [2.0], [3.0]]))
    np.testing.assert_array_equal(time_s, [0.0, 0.1, np.nan, 0.3])
    np.testing.assert_array_equal(values, [[1.0], [2.0], [np.nan], [3.0]])


def test_arrays_of_another_shape_are_refused(axes, palm):
    with pytest.raises(CountsError, match=r"force: must be of shape \(3, 64\); got \(64, 3\)"):
        force_map(axes, palm, np.zeros((64, 3)))
