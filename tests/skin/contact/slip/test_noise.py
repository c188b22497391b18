"""Noise: what units vary by is learned while they hold, and sigma is its lower bound."""

import numpy as np
import pytest
from scipy.signal import lfilter

from skin.contact.record import Flag, SlipState
from skin.contact.slip import PARAMETERS
from tests.fixtures.cases import long_after_first
from tests.skin.contact.slip.hold import Hold

RATE_HZ = 250.0
SECONDS = 12.0


def by_unit(contact):
    """Noise ratios in the order of the array."""
    return contact.noise_ratio[np.argsort(contact.units)]


def contact_held(noise, sigma_mm=0.03):
    """A contact whose units are dragged a little and held, under noise (t, 2, n) mm."""
    hold = Hold(4, 5, sigma_mm=sigma_mm)
    for t, now in enumerate(noise):
        hold.step(hold.dome(), (0.3 * min(1.0, t / 100.0), 0.0), noise=now)
    return hold.contact


def held(noise, sigma_mm=0.03):
    """Noise ratios of these units."""
    return by_unit(contact_held(noise, sigma_mm))


def white(seed, sigma_mm):
    rng = np.random.default_rng(seed)
    return sigma_mm * rng.standard_normal((int(SECONDS * RATE_HZ), 2, 20))


def test_noise_that_is_twice_as_large_as_told_is_seen_as_twice_as_large():
    ratio = held(white(1, 0.06))
    # a low-pass has a reading anew in twice its time constant; two axes a unit
    readings = 2.0 * PARAMETERS.memory_s / (2.0 * PARAMETERS.slow_s)
    error = 2.0 * np.sqrt(0.5 / readings)
    assert ratio.std() < error
    # of twenty units together, and as much for what a fit and an anchor take
    assert ratio.mean() == pytest.approx(2.0, abs=4.0 * error / np.sqrt(20.0))


def test_a_unit_that_is_noisier_than_its_sigma_says_is_named():
    noise = white(7, 0.03)
    noise[:, :, 7] *= 1.5
    contact = contact_held(noise)
    assert contact.noisy_units.tolist() == [7]
    assert contact.flags & Flag.NOISY
    assert "noise beyond sigma at 7" in repr(contact)


@long_after_first("seed", range(8, 12))
def test_no_unit_is_called_noisy_whose_sigma_is_right(seed):
    contact = contact_held(white(seed, 0.03))
    assert not contact.noisy_units.size
    assert not contact.flags & Flag.NOISY


@pytest.mark.parametrize("told", [0.03, 0.06])
def test_noise_that_is_as_told_or_smaller_is_believed(told):
    ratio = held(white(5, 0.03), told)
    assert ratio.min() >= 1.0
    assert ratio.mean() < 1.02


def wandering(seed, sigma_mm, share, tau_s=2.0):
    """White noise and a slow one that is bounded, so many times as large."""
    keeps = np.exp(-1.0 / RATE_HZ / tau_s)
    slow = lfilter([np.sqrt(1.0 - keeps**2)], [1.0, -keeps], white(seed, sigma_mm), axis=0)
    return white(seed + 50, sigma_mm) + share * slow


def alarms_held(noise):
    """Whether a contact whose units are dragged a little and held has an alarm."""
    hold, alarm = Hold(4, 5), False
    for t, now in enumerate(noise):
        hold.step(hold.dome(), (0.3 * min(1.0, t / 100.0), 0.0), noise=now)
        alarm |= hold.contact.slip >= SlipState.INCIPIENT
    return alarm


@long_after_first("seed", range(20, 24))
def test_slow_noise_that_is_bounded_is_no_slip(seed):
    assert not alarms_held(wandering(seed, 0.03, 1.0))


@long_after_first("seed", range(24, 28))
def test_units_that_drift_are_no_slip(seed):
    speed = 0.02 * np.random.default_rng(seed).standard_normal((2, 20))
    t = np.arange(int(SECONDS * RATE_HZ))[:, np.newaxis, np.newaxis] / RATE_HZ
    assert not alarms_held(white(seed, 0.03) + speed * t)


@long_after_first("seed", range(28, 32))
def test_noise_that_doubles_while_a_contact_lasts_is_no_slip(seed):
    noise = white(seed, 0.03)
    noise[500:] *= 2.0
    assert not alarms_held(noise)
