"""The fits tell what was put in, know how well they know it, and refuse scans that cannot tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skin.calibrate.amplitude import fit_amplitude
from skin.calibrate.film import fit_film
from skin.errors import ScanError
from skin.physics.least_squares import least_squares
from tests.fixtures.decode import posed, row_of, strokes
from topology import CHANNELS

SEEDS, BX = range(12), CHANNELS.index("bx")
DEPTHS, REACHES = np.linspace(0.0, 2.0, 6), np.linspace(0.0, 2.5, 14)
PRESS, SLIDE, _ = strokes(DEPTHS, REACHES)
AMPLITUDE = {"field_wavenumber_rad_per_mm": 0.63, "field_amplitude_ut": 10900.0,
             "field_growth_per_mm": 0.73, "field_growth_per_mm2": 0.02}  # fmt: skip


def lateral(rng, noise=105.0):
    k, amplitude, growth, quadratic = AMPLITUDE.values()
    above = PRESS - 2.0
    field = amplitude * np.exp(growth * above + quadratic * above**2) * np.sin(k * SLIDE)
    return field + noise * rng.standard_normal(field.shape)


def scan_amplitude(rng):
    return fit_amplitude(lateral(rng), PRESS, SLIDE, degree=2)


def test_parameters_lie_within_three_sigma_of_the_truth_as_often_as_the_covariance_says():
    true = np.array(list(AMPLITUDE.values()))
    squares, off = [], []
    for seed in SEEDS:
        fit = scan_amplitude(np.random.default_rng(seed))
        assert fit.names == tuple(AMPLITUDE)
        squares.append((fit.values - true) @ np.linalg.solve(fit.covariance, fit.values - true))
        off.append((fit.values - true) / fit.sigma)
        assert 0.6 < fit.chi2 < 1.5
    off = np.abs(off)
    assert np.mean(off < 3.0) > 0.97
    assert 0.5 < np.mean(off < 1.0) < 0.9
    # the whole covariance, not its diagonal alone: chi square of p degrees, mean of 12
    assert 0.4 < np.mean(squares) / true.size < 1.8


def test_the_sine_law_fits_the_film_of_magnet_theory():
    field = posed(row_of(1), PRESS, SLIDE, 0.0, noise=False)[0][:, BX, 0]
    linear = fit_amplitude(field, PRESS, SLIDE, sigma_ut=1.0)
    quadratic = fit_amplitude(field, PRESS, SLIDE, sigma_ut=1.0, degree=2)
    assert linear.residual_rms < 0.002 * linear["field_amplitude_ut"]
    assert quadratic.residual_rms < linear.residual_rms
    assert 0.61 < linear["field_wavenumber_rad_per_mm"] < 0.64
    # where the law does not hold to the stated noise, the covariance owns up to it
    surer = fit_amplitude(field, PRESS, SLIDE, sigma_ut=0.01)
    np.testing.assert_allclose(surer.sigma, linear.sigma, rtol=1e-3)


@settings(max_examples=10)
@given(st.permutations(range(PRESS.size)))
def test_the_order_of_the_samples_does_not_matter(order):
    field = lateral(np.random.default_rng(3))
    one = fit_amplitude(field, PRESS, SLIDE)
    other = fit_amplitude(field[order], PRESS[order], SLIDE[order])
    np.testing.assert_allclose(other.values, one.values, rtol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_least_squares_is_numpys(seed, scale):
    rng = np.random.default_rng(seed)
    matrix, values = rng.standard_normal((30, 4)), rng.standard_normal(30)
    sigma = scale * rng.uniform(0.5, 2.0, 30)
    fit = least_squares(matrix * [1.0, 1e6, 1e-6, 1.0], values, sigma, "abcd")
    naive = np.linalg.lstsq(matrix / sigma[:, None], values / sigma, rcond=None)[0]
    np.testing.assert_allclose(fit.values * [1.0, 1e6, 1e-6, 1.0], naive, rtol=1e-8, atol=1e-10)


# -- refusals ------------------------------------------------------------------------------------

FIELD = lateral(np.random.default_rng(0))
SPOILT = np.where(np.arange(PRESS.size) == 7, np.nan, FIELD)
REFUSED = {
    "one depth": (
        lambda: fit_amplitude(FIELD, np.full(PRESS.size, 2.0), SLIDE),
        "depth_mm: must have 2 levels or more, 0.05 apart, to show its effect; got 1 between 2 "
        "and 2",
    ),
    "not a number": (
        lambda: fit_amplitude(SPOILT, PRESS, SLIDE),
        "lateral_ut[7]: must be finite; got nan (and 0 more such samples)",
    ),
    "too few": (
        lambda: fit_amplitude(FIELD[:2], PRESS[:2], SLIDE[:2]),
        "lateral_ut: must be 3 samples or more; got 2",
    ),
    "lengths": (
        lambda: fit_amplitude(FIELD, PRESS[:-1], SLIDE),
        "depth_mm: must be 84 samples, as lateral_ut; got 83",
    ),
    "no shear": (
        lambda: fit_amplitude(0.0 * FIELD, PRESS, SLIDE),
        "lateral_ut: must rise above 5 sigma, 525 µT; got 0 at most",
    ),
    "two names for one effect": (
        lambda: least_squares(np.ones((5, 2)), np.ones(5), 1.0, ("left", "right")),
        "scan: must determine left, right apart; got samples in which they have one and the same "
        "effect",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_scan_that_cannot_tell_is_refused_by_what_it_lacks(case):
    fit, message = REFUSED[case]
    with pytest.raises(ScanError) as caught:
        fit()
    assert str(caught.value).startswith(message)


def test_strokes_along_one_line_do_not_tell_a_direction():
    values, _ = posed(row_of(1), PRESS, SLIDE, 0.0)
    with pytest.raises(ScanError, match="direction_rad: must have 4 levels"):
        fit_film(values[:, BX : BX + 3, 0], PRESS, SLIDE, np.zeros(PRESS.size))
