"""Logarithms of densities against scipy."""

import math

import pytest
from scipy import stats

from skin.behaviours.densities import beta_log, log_normal_log, log_normal_longer_log, normal_log


@pytest.mark.parametrize("value", [0.02, 0.3, 1.0, 4.0])
def test_densities_are_those_of_scipy(value):
    own = stats.lognorm(s=0.6, scale=0.4)
    assert normal_log(value, 0.5, 0.2) == pytest.approx(stats.norm(0.5, 0.2).logpdf(value))
    assert log_normal_longer_log(value, 0.4, 0.6) == pytest.approx(own.logsf(value), rel=1e-6)
    per_log = own.pdf(value) * value  # over the logarithm of the value
    assert log_normal_log(value, 0.4, 0.6) == pytest.approx(math.log(per_log))


@pytest.mark.parametrize(("a", "b"), [(1.0, 12.0), (0.3, 0.3), (8.0, 1.3)])
def test_shares_are_beta_distributed_and_their_ends_are_finite(a, b):
    assert beta_log(0.4, a, b) == pytest.approx(stats.beta(a, b).logpdf(0.4))
    assert beta_log(0.0, a, b) == pytest.approx(stats.beta(a, b).logpdf(0.005))
    assert beta_log(1.0, a, b) == pytest.approx(stats.beta(a, b).logpdf(0.995))
