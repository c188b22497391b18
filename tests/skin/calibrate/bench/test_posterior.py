"""What data fix is found, what they do not fix keeps its prior, and outliers move neither."""

import numpy as np
import pytest

from skin.calibrate.bench.posterior import fit_posterior
from skin.errors import ScanError


def line(seed=0, count=400, outliers=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 1.0, count)
    y = 2.0 + 3.0 * x + 0.1 * rng.standard_normal(count)
    y[:outliers] += 50.0
    return x, y


def fitted(x, y, prior):
    return fit_posterior(lambda p: [(y - p["a"] - p["b"] * x) / 0.1], prior)


def test_without_outliers_a_weak_prior_leaves_least_squares():
    x, y = line()
    fit = fitted(x, y, {"a": (0.0, 100.0), "b": (0.0, 100.0)}).fit
    slope, base = np.polyfit(x, y, 1)
    np.testing.assert_allclose(fit.values, [base, slope], atol=0.005)
    exact = np.linalg.inv(np.stack([x**0, x]) @ np.stack([x**0, x]).T) * 0.01
    np.testing.assert_allclose(fit.sigma, np.sqrt(np.diag(exact)), rtol=0.35)


def test_a_tenth_of_outliers_moves_little():
    x, y = line(outliers=40)
    fit = fitted(x, y, {"a": (0.0, 100.0), "b": (0.0, 100.0)}).fit
    np.testing.assert_allclose(fit.values, [2.0, 3.0], atol=0.1)


def test_a_parameter_without_effect_keeps_its_prior():
    x, y = line()
    prior = {"a": (0.0, 10.0), "b": (0.0, 10.0), "c": (7.0, 0.5)}
    found = fitted(x, y, prior)
    assert found.fit["c"] == pytest.approx(7.0)
    assert found.fit.sigma[2] == pytest.approx(0.5, rel=0.01)
    assert found.left[2] == pytest.approx(1.0)
    assert (found.left[:2] < 1e-3).all()


def test_of_two_with_one_effect_the_sum_alone_is_told():
    x, y = line()
    prior = {"a": (0.0, 10.0), "b": (0.0, 10.0), "same": (0.0, 10.0)}
    found = fit_posterior(lambda p: [(y - p["a"] - p["same"] - p["b"] * x) / 0.1], prior)
    assert found.fit["a"] == pytest.approx(1.0, abs=0.05)
    assert found.left[0] == pytest.approx(0.5, abs=0.01)
    both = np.array([1.0, 0.0, 1.0])
    assert both @ found.fit.covariance @ both < 1e-3


def test_intervals_hold_their_share_where_errors_go_on_for_a_while():
    inside = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x = np.linspace(0.0, 8.0, 400) % 1.0
        slow = np.repeat(0.3 * rng.standard_normal(80), 5)
        y = 2.0 + 3.0 * x + slow + 0.1 * rng.standard_normal(400)
        fit = fitted(x, y, {"a": (0.0, 100.0), "b": (0.0, 100.0)}).fit
        inside += list(np.abs(fit.values - [2.0, 3.0]) <= 1.96 * fit.sigma)
    # 40 pieces, of two errors each, make an interval of 95 % hold in 92 % (of 300): in 99 %, 50 of
    # 60 or more; if every sample counted, about half of them would
    assert sum(inside) >= 50


def test_fewer_samples_than_parameters_are_refused():
    with pytest.raises(ScanError, match="samples: must be 2 or more to determine a, b; got 1"):
        fitted(*line(count=1), {"a": (0.0, 1.0), "b": (0.0, 1.0)})


def bent(seed, outliers=0):
    """Samples of a curve, nine of ten at two arguments, to which a line is fitted."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.uniform(0.0, 1.0, 400), np.repeat([0.2, 0.9], 1800)])
    rng.shuffle(x)
    y = x**4 + 0.001 * rng.standard_normal(x.size)
    y[:outliers] += 5.0
    return x, y


@pytest.mark.parametrize("outliers", [0, 100])
def test_a_law_of_another_form_is_off_evenly_over_its_range_however_long_each_part_was(outliers):
    x, y = bent(0, outliers)
    prior = {"a": (0.0, 1.0), "b": (0.0, 1.0)}
    fit = fit_posterior(lambda p: [(y - p["a"] - p["b"] * x) / 0.001], prior, (x,)).fit
    even = np.linspace(0.0, 1.0, 1001)
    error = fit.values[0] + fit.values[1] * even - even**4
    least = np.polyval(np.polyfit(even, even**4, 1), even) - even**4
    assert np.sqrt(np.mean(error**2)) < 1.05 * np.sqrt(np.mean(least**2))


def test_a_law_of_its_own_form_is_found_as_well_with_its_range_as_without():
    ratios = []
    for seed in range(20):
        x, y = line(seed, 4000)
        prior = {"a": (0.0, 100.0), "b": (0.0, 100.0)}
        with_range = fit_posterior(lambda p, x=x, y=y: [(y - p["a"] - p["b"] * x) / 0.1],
                                   prior, (x,))  # fmt: skip
        without = fitted(x, y, prior)
        ratios.append((with_range.fit.values - [2.0, 3.0]) / without.fit.sigma)
    # 40 numbers of unit variance: their mean square is within 1 ± 3 sqrt(2 / 40)
    assert np.mean(np.square(ratios)) < 1.7


def test_parameters_beside_the_fitted_ones_keep_their_prior():
    x, y = line()
    found = fitted(x, y, {"a": (0.0, 100.0), "b": (0.0, 100.0)}).joined({"c": (7.0, 0.5, 0.95)})
    assert found.fit.names == ("a", "b", "c")
    assert found.fit["c"] == 7.0
    assert found.fit.sigma[2] == 0.5
    assert found.left[2] == 0.95
    assert (found.fit.covariance[2, :2] == 0.0).all()
