"""Pictures: places, forces, units not to be trusted; lines end where cycles were left out."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import topology
from skin.errors import CountsError
from skin.view.picture import Run, figure, force_map, plane, save_run

PALM = topology.load("palm")


def test_a_run_is_drawn_with_its_truth_and_its_errors(tmp_path, monkeypatch):
    drawn, save = [], Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, *given, **how: (drawn.append(figure),
                                                         save(figure, *given, **how))
    )  # fmt: skip
    time_s = np.arange(400) / PALM.cycle_rate_hz
    like = time_s[:, np.newaxis] + 1.0
    force = np.repeat(like[:, :, np.newaxis], 3, axis=1) * np.ones(PALM.n)
    wrench, centroid = like * np.ones(6), like * np.ones(3)
    run = Run(time_s, force, force, 1.5 * wrench, wrench, centroid, centroid)
    save_run(tmp_path / "run.png", PALM, run)
    upper, _, lower, _ = drawn[0].subfigs[1].axes
    found = [line.get_ydata() for line in upper.lines if line.get_label().startswith("F")]
    errors = [line.get_ydata() for line in lower.lines if len(line.get_ydata()) == time_s.size]
    np.testing.assert_allclose(np.transpose(found), 1.5 * wrench[:, :3])
    np.testing.assert_allclose(np.transpose(errors), 0.5 * wrench[:, :3])
    assert (tmp_path / "run.png").stat().st_size > 10_000


@pytest.fixture
def axes():
    with figure((4.0, 3.0)) as made:
        yield made.add_subplot()


def test_each_unit_lies_in_its_place_and_has_the_colour_of_its_normal_force(axes):
    force = np.zeros((3, PALM.n))
    force[2] = np.linspace(0.0, 3.0, PALM.n)
    discs = force_map(axes, PALM, force)
    flat = plane(PALM)
    np.testing.assert_allclose(discs.get_offsets(), PALM.position[flat].T * 1e3)
    np.testing.assert_array_equal(discs.get_array(), force[2])
    assert discs.get_clim() == (0.0, 3.0)


def test_arrows_are_tangential_forces_in_the_frame_of_the_skin(axes):
    """Of units that bear a load, the longest as long as 1.4 units."""
    force = np.zeros((3, PALM.n))
    force[:, 10] = 0.6, -0.8, 2.0
    force[:, 11] = 0.5, 0.0, 0.0
    force_map(axes, PALM, force)
    (arrows,) = (one for one in axes.collections if hasattr(one, "U"))
    turned = PALM.rotation[:, :, 10] @ np.array([0.6, -0.8, 0.0])
    expected = turned[plane(PALM)] * 1.4 * 2e3 * np.sqrt(PALM.area[10] / np.pi)
    np.testing.assert_allclose([arrows.U[0], arrows.V[0]], expected)
    assert arrows.U.size == 1


def test_units_not_to_be_trusted_have_a_cross_and_no_colour(axes):
    force, valid = np.full((3, PALM.n), 0.5), np.ones(PALM.n, bool)
    valid[5], force[:, 7] = False, np.nan
    discs = force_map(axes, PALM, force, valid=valid)
    assert np.flatnonzero(discs.get_array().mask).tolist() == [5, 7]
    (crosses,) = (line for line in axes.lines if line.get_marker() == "x")
    np.testing.assert_allclose(
        np.array(crosses.get_data()).T, PALM.position[plane(PALM)][:, [5, 7]].T * 1e3
    )


def test_arrays_of_another_shape_are_refused(axes):
    with pytest.raises(CountsError, match=r"force: must be of shape \(3, 64\); got \(64, 3\)"):
        force_map(axes, PALM, np.zeros((64, 3)))
