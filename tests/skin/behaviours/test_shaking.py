"""Periodic motion against scipy's fit and the truth; with silent units, bus and a magnet."""

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from skin.behaviours.shaking import Shaking, ShakingSettings
from skin.behaviours.sine_fit import FIT_SIZE, fit_sine
from skin.errors import OptionError


def sine(t, a, b, c, d, hz):
    return a + b * t + c * np.cos(2 * np.pi * hz * t) + d * np.sin(2 * np.pi * hz * t)


def fitted(value, weight, period_s, first=0):
    out = np.zeros(FIT_SIZE)
    scratch = np.zeros((5, 5)), np.zeros(5)
    fit_sine(value, weight, first, period_s, (0.5, 4.0), *scratch, out)
    return out


@pytest.mark.parametrize("seed", range(6))
def test_the_fit_is_that_of_scipy(seed):
    random = np.random.default_rng(seed)
    period_s, count = 0.032, 150
    t = (np.arange(count) - 0.5 * (count - 1)) * period_s
    truth = (2.0, 0.1, *random.uniform(-0.5, 0.5, 2), random.uniform(0.7, 3.0))
    value = sine(t, *truth) + random.normal(0.0, 0.1, count)
    weight = np.ones(count)
    weight[random.permutation(count)[:30]] = 0.0
    heard = weight > 0.0
    best, covariance = curve_fit(sine, t[heard], value[heard], truth)
    ring = 37
    out = fitted(np.roll(value, ring), np.roll(weight, ring), period_s, ring)
    assert out[0] == pytest.approx(best[4], abs=1e-4)
    assert out[1] == pytest.approx(np.sqrt(covariance[4, 4]), rel=0.02)
    assert out[2] == pytest.approx(np.hypot(best[2], best[3]), rel=1e-3)
    assert out[7] == heard.sum()


def test_too_few_samples_tell_nothing():
    weight = np.zeros(100)
    weight[:20] = 1.0
    assert np.isnan(fitted(np.ones(100), weight, 0.03)[:7]).all()


def shaken(held, shaking, seconds, hz, newton=0.15):
    mean = 2.0
    for _ in range(round(seconds / held.period_s)):
        held.weight_n = mean + newton * math.sin(2.0 * math.pi * hz * held.time_s)
        shaking.update(held.step())


def test_1_hz_is_told_to_a_fiftieth(held):
    shaking = Shaking(held.topology)
    shaken(held, shaking, 8.0, 1.0)
    assert shaking.shaken
    assert shaking.frequency_hz == pytest.approx(1.0, abs=0.02)
    assert abs(shaking.frequency_hz - 1.0) < 5.0 * shaking.frequency_sigma_hz
    assert shaking.amplitude_n == pytest.approx(0.15, abs=5.0 * shaking.amplitude_sigma_n)


def test_what_hangs_still_or_grows_is_not_shaken(held):
    shaking = Shaking(held.topology)
    for k in range(5000):
        held.weight_n = 2.0 + 2e-4 * k
        shaking.update(held.step())
        assert not shaking.shaken
    assert math.isnan(shaking.frequency_hz)


def test_it_ends_when_the_shaking_does(held):
    shaking = Shaking(held.topology)
    shaken(held, shaking, 8.0, 1.5)
    shaken(held, shaking, 8.0, 1.5, newton=0.0)
    assert not shaking.shaken
    assert [d.what for d in shaking.decisions] == ["shaken", "not shaken"]


def test_units_that_fall_silent_do_not_change_the_frequency(held):
    shaking = Shaking(held.topology)
    shaken(held, shaking, 6.0, 1.0)
    held.valid[[1, 2, 20]] = False
    shaken(held, shaking, 3.0, 1.0)
    assert shaking.frequency_hz == pytest.approx(1.0, abs=0.02)


def test_a_bus_that_stops_for_200_ms_is_left_out(held):
    shaking = Shaking(held.topology)
    shaken(held, shaking, 6.0, 1.0)
    held.heard = False
    shaken(held, shaking, 0.2, 1.0)
    held.heard = True
    shaken(held, shaking, 2.0, 1.0)
    assert shaking.shaken
    assert shaking.frequency_hz == pytest.approx(1.0, abs=0.02)


def test_a_magnet_near_a_pad_does_not_look_like_shaking(held):
    shaking = Shaking(held.topology)
    shaken(held, shaking, 4.0, 1.0, newton=0.0)
    held.spoilt_n[:2, :6] = 3.0
    held.valid[:6] = False  # MAGNETIC_ANOMALY
    for _ in range(1500):
        shaking.update(held.step())
        assert not shaking.shaken


def test_a_band_below_the_window_is_refused():
    with pytest.raises(OptionError, match=r"band_low: must be a number from 0\.2"):
        ShakingSettings(band_hz=(0.1, 2.0))


@pytest.mark.parametrize(
    ("bad", "message"),
    [({"direction": (0, 0, 0)}, "direction: must be three numbers"),
     ({"direction": (math.nan, 0, 1)}, "direction: must be three numbers"),
     ({"band_hz": 1}, r"band_hz: must be \(low, high\); got 1"),
     ({"band_hz": (4.0, 0.6)}, "band_high: must be a number from 4"),
     ({"sigmas": "8"}, "sigmas: must be a number"), ({"window_s": math.inf}, "window_s: must be")],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(bad, message):
    with pytest.raises(OptionError, match=message):
        ShakingSettings(**bad)


def test_a_band_that_is_too_fast_for_the_skin_is_refused(held):
    with pytest.raises(OptionError, match=r"band_high: must be a number from 0 to 31\.25; got 40"):
        Shaking(held.topology, settings=ShakingSettings(band_hz=(0.6, 40.0)))
    with pytest.raises(OptionError, match="settings: must be a ShakingSettings"):
        Shaking(held.topology, settings={})
