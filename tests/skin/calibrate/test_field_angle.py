"""R from the angle of the field: to the micrometre without noise, as well as it says with noise."""

from __future__ import annotations

import numpy as np
import pytest

from skin.calibrate.field_angle import field_angle, fit_field_angle
from skin.errors import ScanError
from skin.physics.scan import strokes
from skin.sim.bench import Bench
from tests.fixtures.decode import row_of
from topology import UnitModel

POSES = strokes(np.linspace(0.0, 2.0, 9), np.linspace(0.0, 3.0, 25), 0.3)
CHECK = strokes(np.linspace(0.0, 2.0, 31), np.linspace(0.0, 3.0, 47), 1.1)


def scanned(poses, **how):
    readings = how.pop("readings", 1)
    return Bench(row_of(1), **how).scan(*poses, readings=readings).field_ut[..., 0]


EXACT = scanned(CHECK, noise=False)


def errors_um(found):
    """Error at poses that were not in the scan, µm."""
    return 1e3 * (found(field_angle(EXACT), CHECK[0]) - CHECK[1])


def test_without_noise_the_polynomial_is_within_a_micrometre_of_magnet_theory():
    found = fit_field_angle(scanned(POSES, noise=False), *POSES)
    assert np.abs(errors_um(found)).max() < 1.0
    assert found.fit.residual_max < 1e-3
    assert found.least_slope > 1.0


def test_the_preset_of_the_unit_model_is_what_magnet_theory_gives():
    table = np.reshape(UnitModel().field_angle_mm, (4, 4))
    depth, displacement, direction = strokes(np.linspace(0.0, 2.5, 26), np.linspace(0.0, 3.0, 31))
    angle = field_angle(scanned((depth, displacement, direction), noise=False))
    powers = angle[:, None] ** np.arange(1, 8, 2)
    found = np.einsum("ti,ij,tj->t", powers, table, np.vander(depth, 4, increasing=True))
    assert np.abs(found - displacement).max() < 0.8e-3


def test_displacement_grows_with_the_angle_all_over_the_scan():
    found = fit_field_angle(scanned(POSES, noise=False), *POSES)
    for depth in np.linspace(0.0, 2.0, 21):
        reach = np.linspace(0.0, 3.0, 301)
        angle = field_angle(scanned((np.full(301, depth), reach, 0.0), noise=False))
        assert (np.diff(found(angle, depth)) > 0.0).all()


@pytest.mark.parametrize("readings", [4, 64])
def test_the_error_of_a_noisy_scan_is_what_its_covariance_says(readings):
    off = []
    for seed in range(6):
        field = scanned(POSES, seed=seed, readings=readings)
        found = fit_field_angle(field, *POSES, sigma_ut=105.0 / np.sqrt(readings))
        assert 0.7 < found.fit.chi2 < 1.4
        moved = CHECK[1] > 0.05
        sigma = 1e3 * found.sigma_mm(field_angle(EXACT), CHECK[0])
        off.append((errors_um(found) / np.where(moved, sigma, np.inf))[moved])
    assert 0.5 < np.mean(np.square(off)) < 1.7
    assert np.mean(np.abs(off) < 3.0) > 0.97


def test_the_error_falls_with_the_root_of_the_samples():
    rms = []
    for readings in (1, 16):
        of_seeds = [
            errors_um(
                fit_field_angle(
                    scanned(POSES, seed=seed, readings=readings), *POSES,
                    sigma_ut=105.0 / np.sqrt(readings),
                )
            )
            for seed in range(4)
        ]  # fmt: skip
        rms.append(np.sqrt(np.mean(np.square(of_seeds))))
    assert rms[0] < 12.0
    assert 2.5 < rms[0] / rms[1] < 6.0


def test_the_polynomial_is_odd_in_the_angle():
    found = fit_field_angle(scanned(POSES, noise=False), *POSES)
    angle = np.linspace(0.0, 1.4, 50)
    assert (found(-angle, 1.0) == -found(angle, 1.0)).all()
    assert found(0.0, 1.0) == 0.0


def test_the_coefficients_are_those_of_plain_powers():
    found = fit_field_angle(scanned(POSES, noise=False), *POSES)
    angle, depth = 1.1, 0.7
    total = sum(
        found.coefficients[i, j] * angle ** (2 * i + 1) * depth**j
        for i in range(4)
        for j in range(4)
    )
    assert found(angle, depth) == pytest.approx(total, rel=1e-12)


def test_the_direction_of_the_scan_does_not_matter():
    turned = (POSES[0], POSES[1], POSES[2] + 2.0)
    one = fit_field_angle(scanned(POSES, noise=False), *POSES)
    other = fit_field_angle(scanned(turned, noise=False), *turned)
    np.testing.assert_allclose(errors_um(one), errors_um(other), atol=0.1)


def test_the_strength_of_the_film_does_not_matter():
    field = scanned(POSES, noise=False)
    one = fit_field_angle(field, *POSES)
    other = fit_field_angle(0.9 * field, *POSES)
    np.testing.assert_allclose(other.coefficients, one.coefficients, rtol=0.0, atol=1e-9)


DEPTH, REACH, DIRECTION = POSES
FIELD = scanned(POSES, noise=False)
REFUSED = {
    "one depth": (
        (FIELD, np.full_like(DEPTH, 2.0), REACH),
        "depth_mm: must have 4 levels or more, 0.05 apart, to tell its effect; got 1 between 2 "
        "and 2",
    ),
    "no shear": (
        (FIELD, DEPTH, np.zeros_like(REACH)),
        "displacement_mm: must have 4 levels or more, 0.05 apart, to tell its effect; got 1 "
        "between 0 and 0",
    ),
    "too few": (
        (FIELD[:10], DEPTH[:10], REACH[:10]),
        "field_ut: must be 16 samples or more; got 10",
    ),
    "not a number": (
        (np.where(np.arange(len(FIELD))[:, None] == 3, np.nan, FIELD), DEPTH, REACH),
        "field_ut[3]: must be finite; got [nan nan nan] (and 0 more such samples)",
    ),
    "backwards": (
        (FIELD, DEPTH, 3.0 - REACH),
        "field_ut: must have an angle that grows with displacement over the scan",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_scan_that_cannot_tell_is_refused_by_what_it_lacks(case):
    given, message = REFUSED[case]
    with pytest.raises(ScanError) as caught:
        fit_field_angle(*given)
    assert str(caught.value).startswith(message)
