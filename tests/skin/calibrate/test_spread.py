"""One sigma of a law that misses: none for noise alone, and true whatever the misfit's form."""

import numpy as np
import pytest

from skin.calibrate.spread import Spread, even_spread, law_spread

FORCE = np.linspace(0.0, 7.0, 600)
MISFITS = {
    "a wave": 0.1 * np.sin(2.5 * FORCE),
    "a bow": 0.12 * (FORCE / 3.5 - 1.0) ** 2 - 0.04,
    "a share that changes": 0.05 * FORCE * np.sin(4.0 * FORCE),
}


def sigma(spread):
    return np.hypot(spread.relative * FORCE, np.minimum(spread.absolute, FORCE))


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_makes_no_spread(seed):
    error = 0.02 * np.random.default_rng(seed).standard_normal(FORCE.size)
    told = law_spread(error, FORCE, 0.02)
    assert np.hypot(told.relative * 7.0, told.absolute) < 0.006
    assert even_spread(error, 0.02) < 0.006


@pytest.mark.parametrize("name", MISFITS)
@pytest.mark.parametrize("noise", [0.001, 0.02])
def test_two_of_three_readings_lie_within_one_sigma(name, noise):
    rng, misfit = np.random.default_rng(1), MISFITS[name]
    told = law_spread(misfit + 0.005 * rng.standard_normal(FORCE.size), FORCE, noise)
    readings = misfit + noise * rng.standard_normal((200, FORCE.size))
    within = np.abs(readings) <= np.hypot(sigma(told), noise)
    assert 0.63 < within.mean() < 0.74
    # at small loads and at large ones as well
    halves = within[:, 1:300].mean(), within[:, 300:].mean()
    assert min(halves) > 0.5


def test_an_error_that_is_a_share_of_the_force_has_no_absolute_part():
    told = law_spread(0.04 * FORCE, FORCE, 0.001)
    assert told.absolute < 0.02
    assert told.relative == pytest.approx(0.04, rel=0.2)


def test_an_error_that_is_as_large_everywhere_has_no_share():
    told = law_spread(MISFITS["a wave"], FORCE, 0.001)
    assert told.relative < 0.01
    assert told.absolute == pytest.approx(0.1 / np.sqrt(2.0), rel=0.35)


def test_a_law_without_errors_has_none():
    assert law_spread(np.zeros(50), FORCE[:50], 0.01) == pytest.approx(Spread(0.0, 0.0), abs=1e-5)
    assert even_spread(np.zeros(50), 0.01) == 0.0
