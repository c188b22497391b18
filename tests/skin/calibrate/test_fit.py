"""The one fit: what data fix is found, what they do not fix keeps its prior, outliers move neither;
and what is left over is a law's own, or noise."""

import numpy as np
import pytest

from skin.calibrate.fit import (
    check_levels,
    check_samples,
    cross_validated,
    even_spread,
    fit_law,
    folds_of,
    law_spread,
)
from skin.errors import ScanError


def line(seed=0, count=400, outliers=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 1.0, count)
    y = 2.0 + 3.0 * x + 0.1 * rng.standard_normal(count)
    y[:outliers] += 50.0
    return x, y


def fitted(x, y, prior, sigma=0.1, over=()):
    return fit_law(lambda p: [(y - p["a"] - p["b"] * x) / sigma], prior, over)


WEAK = {"a": (0.0, 100.0), "b": (0.0, 100.0)}


def test_without_outliers_a_weak_prior_leaves_least_squares():
    x, y = line()
    fit = fitted(x, y, WEAK)
    slope, base = np.polyfit(x, y, 1)
    np.testing.assert_allclose(fit.values, [base, slope], atol=0.005)
    exact = np.linalg.inv(np.stack([x**0, x]) @ np.stack([x**0, x]).T) * 0.01
    np.testing.assert_allclose(fit.sigma, np.sqrt(np.diag(exact)), rtol=0.35)


def test_a_tenth_of_outliers_moves_little():
    np.testing.assert_allclose(fitted(*line(outliers=40), WEAK).values, [2.0, 3.0], atol=0.1)


def test_a_parameter_without_effect_keeps_its_prior():
    fit = fitted(*line(), {"a": (0.0, 10.0), "b": (0.0, 10.0), "c": (7.0, 0.5)})
    assert fit["c"] == pytest.approx(7.0)
    assert fit.sigma[2] == pytest.approx(0.5, rel=0.01)
    assert fit.left[2] == pytest.approx(1.0)
    assert (fit.left[:2] < 1e-3).all()


def test_of_two_with_one_effect_the_sum_alone_is_told():
    x, y = line()
    prior = {name: (0.0, 10.0) for name in ("a", "b", "same")}
    fit = fit_law(lambda p: [(y - p["a"] - p["same"] - p["b"] * x) / 0.1], prior)
    assert fit["a"] == pytest.approx(1.0, abs=0.05)
    assert fit.left[0] == pytest.approx(0.5, abs=0.01)
    both = np.array([1.0, 0.0, 1.0])
    assert both @ fit.covariance @ both < 1e-3


def test_intervals_hold_their_share_where_errors_go_on_for_a_while():
    inside = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x = np.linspace(0.0, 8.0, 400) % 1.0
        slow = np.repeat(0.3 * rng.standard_normal(80), 5)
        y = 2.0 + 3.0 * x + slow + 0.1 * rng.standard_normal(400)
        fit = fitted(x, y, WEAK)
        inside += list(np.abs(fit.values - [2.0, 3.0]) <= 1.96 * fit.sigma)
    # 40 pieces, of two errors each, make an interval of 95 % hold in 92 % (of 300): in 99 %, 50 of
    # 60 or more; if every sample counted, about half of them would
    assert sum(inside) >= 50


@pytest.mark.parametrize("outliers", [0, 100])
def test_a_law_of_another_form_is_off_evenly_over_its_range_however_long_each_part_was(outliers):
    """Nine of ten samples of a curve are at two arguments."""
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0.0, 1.0, 400), np.repeat([0.2, 0.9], 1800)])
    rng.shuffle(x)
    y = x**4 + 0.001 * rng.standard_normal(x.size)
    y[:outliers] += 5.0
    fit = fitted(x, y, {"a": (0.0, 1.0), "b": (0.0, 1.0)}, 0.001, (x,))
    even = np.linspace(0.0, 1.0, 1001)
    error = fit.values[0] + fit.values[1] * even - even**4
    least = np.polyval(np.polyfit(even, even**4, 1), even) - even**4
    assert np.sqrt(np.mean(error**2)) < 1.1 * np.sqrt(np.mean(least**2))


@pytest.mark.parametrize(("bent", "order"), [(0.0, 1), (2.0, 2)])
def test_cross_validation_takes_the_order_that_the_data_have(bent, order):
    x, y = line(seed=5)
    y = y + bent * (x - 0.5) ** 2

    def error(degree, training):
        return (np.polyval(np.polyfit(x[training], y[training], degree), x[~training])
                - y[~training]) ** 2  # fmt: skip

    assert cross_validated((1, 2, 3), folds_of(x.size), error)[0] == order


# -- what a law misses ----------------------------------------------------------------------------

FORCE = np.linspace(0.0, 7.0, 600)


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_makes_no_spread(seed):
    error = 0.02 * np.random.default_rng(seed).standard_normal(FORCE.size)
    found = law_spread(error, FORCE)
    assert np.hypot(found.relative * 7.0, found.absolute) < 0.01
    assert even_spread(error) < 0.006


def test_a_misfit_is_a_share_of_the_force_or_as_large_everywhere():
    share = law_spread(0.04 * FORCE, FORCE)
    assert share.absolute < 0.02
    assert share.relative == pytest.approx(0.04, rel=0.2)
    wave = law_spread(0.1 * np.sin(2.5 * FORCE), FORCE)
    assert wave.relative < 0.01
    assert wave.absolute == pytest.approx(0.1 / np.sqrt(2.0), rel=0.35)
    assert law_spread(np.zeros(50), FORCE[:50]) == pytest.approx((0.0, 0.0), abs=1e-5)


# -- refusals --------------------------------------------------------------------------------------

REFUSED = {
    "fewer than parameters": (lambda: fitted(*line(count=1), WEAK),
                              "samples: must be 2 or more to determine a, b; got 1"),
    "not a number": (lambda: check_samples(2, x=np.array([0.0, np.nan])),
                     "x[1]: must be finite; got nan (and 0 more such samples)"),
    "too few": (lambda: check_samples(3, x=np.zeros(2)), "x: must be 3 samples or more; got 2"),
    "lengths": (lambda: check_samples(2, x=np.zeros(2), y=np.zeros(3)),
                "y: must be 2 samples, as x; got 3"),
    "one level": (lambda: check_levels("depth_mm", np.full(9, 2.0), 2, 0.05),
                  "depth_mm: must have 2 levels or more, 0.05 apart, to show its effect; got 1 "
                  "between 2 and 2"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_scan_that_cannot_tell_is_refused_by_what_it_lacks(case):
    fit, message = REFUSED[case]
    with pytest.raises(ScanError) as caught:
        fit()
    assert str(caught.value).startswith(message)
