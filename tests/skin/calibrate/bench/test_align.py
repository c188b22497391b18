"""Two clocks of the same motion are brought together, and how well is said."""

import numpy as np
import pytest

from skin.calibrate.bench.series import align
from skin.errors import ScanError


def motion(t):
    """Presses of different lengths."""
    return np.clip(np.sin(t / 2.0) + 0.5 * np.sin(t / 3.1), 0.0, None)


def recorded(lag_s, drift_ppm, seed, seconds=120.0):
    """Counts at 50 Hz that stiffen with depth, and a depth at 83 Hz on another clock."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.02)
    counts = 4500.0 - 900.0 * motion(time) - 40.0 * motion(time) ** 2
    counts += 6.0 * rng.standard_normal(time.size)
    other = np.arange(0.0, seconds, 1.0 / 83.0)
    depth = motion(other) + 0.002 * rng.standard_normal(other.size)
    clock = other + lag_s + 1e-6 * drift_ppm * (other - 0.5 * time[-1])
    return time, counts, clock, depth


@pytest.mark.parametrize(("lag_s", "drift_ppm"), [(0.0, 0.0), (1.2345, 80.0), (-2.5, -200.0)])
def test_lag_and_drift_are_found_within_their_sigma(lag_s, drift_ppm):
    found = align(*recorded(lag_s, drift_ppm, seed=1))
    assert abs(found.lag_s - lag_s) < 4.0 * found.lag_sigma_s < 0.004
    assert abs(found.drift_ppm - drift_ppm) < 4.0 * found.drift_sigma_ppm < 200.0
    at = np.array([10.0, 100.0])
    np.testing.assert_allclose(
        found.reference_time(at), at + lag_s + 1e-6 * drift_ppm * (at - 59.99), atol=2e-3
    )


def test_the_sigma_of_the_lag_is_that_of_many_recordings():
    found = [align(*recorded(0.5, 20.0, seed)) for seed in range(16)]
    errors = np.array([(f.lag_s - 0.5) / f.lag_sigma_s for f in found])
    # chi-squared of 16 normal errors: a root mean square of 0.57 to 1.46 in 99 %
    assert 0.57 < np.sqrt(np.mean(errors**2)) < 1.46


def test_clocks_of_other_epochs_are_brought_together():
    time, counts, clock, depth = recorded(0.25, 0.0, seed=2)
    found = align(time, counts, clock + 1e5, depth)
    assert found.lag_s == pytest.approx(1e5 + 0.25, abs=2e-3)


def test_a_reference_of_something_else_is_refused():
    time, counts, clock, _ = recorded(0.0, 0.0, seed=3)
    noise = np.random.default_rng(4).standard_normal(clock.size)
    with pytest.raises(ScanError, match="reference: must go with the counts"):
        align(time, counts, clock, noise)
