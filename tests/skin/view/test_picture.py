"""Pictures: places, forces, units not to be trusted; lines end where cycles were left out."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import topology
from skin.errors import CountsError
from skin.view.picture import Run, figure, force_map, plane, save_run

PALM = topology.load("palm")
PERIOD_S = 1.0 / PALM.cycle_rate_hz
WAYS = {
    "none left out": np.arange(400),
    "a second": np.r_[0, 250:649],
    "one": np.r_[:100, 101:400],
    "every other one": np.arange(0, 800, 2),
}


def run_of(cycles):
    """A run in which all values are the time since its start."""
    time_s = cycles * PERIOD_S
    like = time_s[:, np.newaxis] + 1.0
    force = np.repeat(like[:, :, np.newaxis], 3, axis=1) * np.ones(PALM.n)
    wrench, centroid = like * np.ones(6), like * np.ones(3)
    return Run(time_s, force, force, wrench, wrench, centroid, centroid)


@pytest.mark.long_but_first
@pytest.mark.parametrize("cycles", WAYS.values(), ids=WAYS)
def test_no_line_crosses_cycles_that_were_left_out_and_each_cycle_is_seen(
    cycles, tmp_path, monkeypatch
):
    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, *given, **how: (drawn.append(figure),
                                                         save(figure, *given, **how))
    )  # fmt: skip
    save_run(tmp_path / "run.png", PALM, run_of(cycles))
    lines = [
        line
        for axes in drawn[0].subfigs[1].axes
        for line in axes.lines
        if line.get_marker() == "."  # a cycle between two gaps is seen
    ]
    assert len(lines) == 2 * 2 * 3
    for line in lines:
        time_s, values = np.asarray(line.get_data())
        joined = np.isfinite(values[1:]) & np.isfinite(values[:-1])
        assert np.diff(time_s)[joined] == pytest.approx(PERIOD_S)
        assert np.isfinite(values).sum() == cycles.size


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
