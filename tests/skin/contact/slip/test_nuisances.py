"""What may look like slip is taken out of the lags, as a projection by singular values does it."""

import numpy as np
import pytest

from skin.contact.slip import SlipSettings
from skin.contact.slip.data import SlipData, slip_arrays
from skin.contact.slip.pattern_test import alarm_odds, project_nuisances

MODEL = SlipSettings(gain_error=0.02).model()
OUT_OF_PLANE = 0.3


def rows_of(n, motions, rng):
    """Random units, as many as a row is long."""
    scratch = slip_arrays(SlipData.zeros(n)).scratch
    unit, row = scratch.unit, scratch.row
    length = row.load.size
    row.design[0][:motions] = rng.standard_normal((motions, length))
    row.design[1][:motions] = rng.standard_normal((motions, length))
    way = rng.standard_normal((2, length))
    row.imposed[:] = np.hypot(*way)
    row.direction[:] = way / row.imposed
    row.root_weight[:n] = rng.uniform(5.0, 30.0, n)
    row.square_distance[:] = rng.uniform(0.2, 2.0, length)
    unit.lag[:] = 0.1 * rng.standard_normal((2, length))
    unit.moved[:], unit.followed[:] = rng.standard_normal((2, 2, length))
    unit.gain_information[:] = rng.uniform(1.0, 3.0, length) / MODEL.gain_error**2
    return scratch, length


def project(scratch, length, motions, stuck):
    """Residual and redundancy by the projection on all that columns and priors leave."""
    unit, row, root = scratch.unit, scratch.row, scratch.row.root_weight
    columns = [np.concatenate([row.design[c][a] for c in (0, 1)]) for a in range(motions)]
    columns.append((row.imposed * row.direction).ravel())
    priors = [0.0] * min(motions, 3) + [1.0 / OUT_OF_PLANE] * (motions - 3)
    priors.append(1.0 / MODEL.gain_error)
    if stuck >= 20:
        way = ((unit.moved - unit.followed) * row.direction).sum(axis=0)
        way *= row.square_distance / (MODEL.gain_error**2 * unit.gain_information)
        columns.append((way * row.direction).ravel())
        priors.append(1.0 / 0.05)
    seen = np.array(columns).T * np.tile(root, 2)[:, np.newaxis]
    all_rows = np.vstack([seen, np.diag(priors)])
    scale = np.linalg.norm(all_rows, axis=0)
    u, s, _ = np.linalg.svd(all_rows / np.where(scale > 0.0, scale, 1.0), full_matrices=False)
    u = u[: 2 * length, s > 1e-6]
    left = np.eye(2 * length) - u @ u.T
    along = np.vstack([np.diag(row.direction[0]), np.diag(row.direction[1])])
    residual = -along.T @ left @ (root * unit.lag).ravel()
    return residual, np.einsum("ij,ik,kj->j", along, left, along)


def hold(scratch, length, motions, stuck):
    """Hold the kernel against that projection."""
    residual, redundancy = project(scratch, length, motions, stuck)
    nuisances = project_nuisances(
        length, motions, stuck, OUT_OF_PLANE, MODEL, scratch.unit, scratch.row,
        scratch.pattern.prior,
    )  # fmt: skip
    assert nuisances == motions + 1 + (stuck >= 20)
    row = scratch.row
    size = max(np.abs(row.root_weight * scratch.unit.lag).max(), 1e-300)
    np.testing.assert_allclose(row.residual, residual, 1e-7, 1e-7 * size)
    np.testing.assert_allclose(row.redundancy, redundancy, 1e-7, 1e-9)
    judged = redundancy > 0.01
    expected = np.where(judged, residual / np.sqrt(np.where(judged, redundancy, 1.0)), 0.0)
    np.testing.assert_allclose(row.slip_score, expected, 1e-6, 1e-7 * size)
    return judged


@pytest.mark.parametrize("stuck", [19, 20])
@pytest.mark.parametrize("motions", [3, 6])
def test_nuisances_are_taken_out_with_their_priors(motions, stuck):
    scratch, length = rows_of(12, motions, np.random.default_rng(motions))
    scratch.pattern.prior[:] = 7.0  # what the last contact has left
    assert hold(scratch, length, motions, stuck).all()


@pytest.mark.parametrize("motions", [3, 6])
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_motions_are_taken_out_however_much_or_little_is_known_of_units(scale, motions):
    scratch, length = rows_of(12, motions, np.random.default_rng(5))
    scratch.row.root_weight[:] *= scale
    hold(scratch, length, motions, 12)


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_that_is_others_together_is_taken_out_once(seed):
    rng = np.random.default_rng(seed)
    scratch, length = rows_of(9, 3, rng)
    design = scratch.row.design
    for c in range(2):
        design[c][2] = 0.7 * design[c][0] - 1.3 * design[c][1]
    hold(scratch, length, 3, 9)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_a_motion_along_one_axis_alone_is_taken_out_once(seed, axis):
    rng = np.random.default_rng(seed)
    scratch, length = rows_of(9, 3, rng)
    design = scratch.row.design
    design[axis][:2] = 0.0
    design[axis][2] = 0.0
    design[1 - axis][2] = 0.7 * design[1 - axis][0] - 1.3 * design[1 - axis][1]
    hold(scratch, length, 3, 9)


def test_a_unit_of_which_a_hundredth_is_left_is_not_judged_alone():
    rng = np.random.default_rng(9)
    judged = []
    for lever in (1.0, 5.0, 8.0, 12.0, 40.0):
        scratch, length = rows_of(8, 3, rng)
        scratch.row.direction[:] = [[1.0], [0.0]]
        for c in range(2):
            scratch.row.design[c][0, 0] = lever * (1 - c) * 8.0
        judged.append(bool(hold(scratch, length, 3, 8)[0]))
    assert judged[0]
    assert not judged[-1]


def test_the_odds_that_alarm_are_the_looks_of_an_hour_over_the_alarms_of_one():
    model = SlipSettings(false_alarms_per_hour=5.0).model()
    assert alarm_odds(0.2, 0.004, model) == pytest.approx(np.log(3600.0 * 50.0 / 5.0))
    assert alarm_odds(1.0, 720.0, model) == 0.0
    assert alarm_odds(1.0, 719.0, model) > 0.0
    assert alarm_odds(1.0, 7200.0, model) == 0.0
