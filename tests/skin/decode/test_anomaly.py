"""How far a field may be from its model until it is an anomaly: each part of the tolerance alone.

A field that is g times that of the model keeps its angle, so that R does, and is off by g - 1.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
from scipy.stats import norm

from bus.status import Status
from skin.decode.decoder import Decoder
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import amplitude_of, angle_of, row_of, sine, with_parameters
from tests.skin.decode.test_field_angle import counts_at

UNITS = 6
DEPTH, REACH = 1.0, 1.0
EXACT = {"field_noise_ut": 0.0, "frequency_noise_hz": 0.0, "gel_noise_relative": 0.0}


PASSED = norm.isf(0.5 * np.sqrt(0.25 / (UNITS * 1.0 * 86400.0)))
"""Sigmas that noise passes twice in a row once in four days, of units that answer once a second."""


def whole_ut(skin):
    """Size of the model's field at the pose."""
    reach, depth = np.full(UNITS, REACH), np.full(UNITS, DEPTH)
    lateral = amplitude_of(skin, depth) * np.sin(skin.parameters["field_wavenumber_rad_per_mm"])
    return lateral / np.sin(angle_of(skin, reach, depth))


PARTS = {
    # parameters; what they add to the square of 2 %, µT² or as a share, to the 0.3 mT of neighbours
    "share": ({}, 0.0, 0.0),
    "field": ({"field_sigma_ut": 400.0}, 25.0 * 400.0**2, 0.0),
    "noise": ({"field_noise_ut": 400.0}, PASSED**2 * 400.0**2, 0.0),
    "amplitude": ({"field_amplitude_sigma_relative": 0.05}, 0.0, 25.0 * 0.05**2),
    "rest": ({"frequency_sigma_hz": 90.0}, 0.0, 25.0 * (0.72 * 0.1) ** 2),
    "depth": ({"frequency_noise_hz": 90.0}, 0.0, PASSED**2 * (0.72 * 0.1) ** 2),
}


@long_after_first("estimator", ["sine", "field-angle"])
@long_after_first("part", PARTS)
def test_a_field_is_an_anomaly_beyond_its_tolerance(part, estimator):
    """2 %, sigmas, and 0.3 mT of neighbours whose rest is known.

    Five sigmas of what is constant, of noise those that it passes every fourth day.
    """
    parameters, field_ut2, share = PARTS[part]
    skin = with_parameters(row_of(UNITS), **(EXACT | parameters))
    growth = skin.parameters["field_growth_per_mm"]
    assert growth == pytest.approx(0.72 * np.ones(UNITS))
    stray_ut = 300.0
    most = np.sqrt(0.02**2 + share + (stray_ut**2 + field_ut2) / whole_ut(skin) ** 2)
    decoder = Decoder(
        skin, None, estimator, dtype="float64", consistency=True, sweeps=0, ambient=False
    )
    for way in (1.0, -1.0):
        for times, odd in ((0.97, False), (1.03, True)):
            gain = 1.0 + way * times * most
            raw = counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=gain)
            assert decoder(raw).valid.all()  # one reading alone says nothing
            reading = decoder(raw)
            found = reading.status & Status.MAGNETIC_ANOMALY != 0
            assert reading.test_ratio == pytest.approx(np.full(UNITS, times), abs=0.01)
            assert (found == odd).all(), (way, times, most)
            assert (reading.valid == (not odd)).all()


def test_a_steady_miss_is_an_anomaly_beyond_what_noise_leaves_in_the_mean():
    """A low-pass over 50 readings, of whose noise step / (2 - step) of the variance is left."""
    noise_ut, step = 400.0, -np.expm1(-1.0 / 50.0)
    skin = with_parameters(row_of(UNITS), **EXACT | {"field_noise_ut": noise_ut})
    sigmas = norm.isf(0.5 * 0.25 / (UNITS * 86400.0))
    left_ut2 = sigmas**2 * step / (2.0 - step) * noise_ut**2
    most = np.sqrt(0.02**2 + (300.0**2 + left_ut2) / whole_ut(skin) ** 2)
    for times, odd in ((0.97, False), (1.03, True)):
        raw = counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=1.0 + times * most)
        decoder = Decoder(skin, None, dtype="float64", sweeps=0, ambient=False)
        reading = decoder(np.repeat(raw[np.newaxis], 250, axis=0))
        assert not (reading.status[:2] & Status.MAGNETIC_ANOMALY).any()
        assert ((reading.status[-1] & Status.MAGNETIC_ANOMALY != 0) == odd).all()


CRESTS = {
    # parameters; share of the crest, at which the field and its sigma reach it
    "noise": ({"field_noise_ut": 400.0}, lambda m0: 1.0 - 400.0 / m0),
    "amplitude": ({"field_amplitude_sigma_relative": 0.3}, lambda m0: 1.0 / 1.3),
    "depth": ({"frequency_sigma_hz": 180.0}, lambda m0: 1.0 / (1.0 + 0.72 * 0.2)),
}


@pytest.mark.parametrize("part", CRESTS)
def test_a_field_that_may_have_reached_the_crest_is_saturated(part):
    """Where one sigma of it, of M0 or of the depth is enough to."""
    parameters, share_of = CRESTS[part]
    skin = with_parameters(row_of(UNITS), **(EXACT | parameters))
    m0 = amplitude_of(skin, np.full(UNITS, DEPTH))[0]
    for times, saturated in ((0.99, False), (1.01, True)):
        ratio = times * share_of(m0)
        reach = np.arcsin(ratio) / skin.parameters["field_wavenumber_rad_per_mm"]
        reading = sine(skin, dtype="float64")(counts_at(skin, DEPTH, reach, 0.0))
        assert ((reading.status & Status.SATURATED != 0) == saturated).all()


@pytest.mark.parametrize("gain", [1.3, 0.7])
def test_a_reading_beyond_is_shown_and_doubted_and_the_second_in_a_row_is_flagged(gain):
    """Depth or field is wrong: sigma holds what either makes of it."""
    skin = with_parameters(row_of(UNITS), **EXACT)
    decoder = Decoder(skin, None, "field-angle", "float64", sweeps=0, ambient=False)
    way = np.linspace(-3, 3, UNITS)
    right, odd = (counts_at(skin, DEPTH, REACH, way, gain=each) for each in (1.0, gain))
    for _ in range(10):
        sound = copy.deepcopy(decoder(right))
    doubted = copy.deepcopy(decoder(odd))
    assert sound.valid.all()
    assert doubted.valid.all()
    assert (doubted.test_ratio > 1.0).all()
    assert (sound.test_ratio < 0.2).all()
    # the depth at which the film has this field: M0 grows by 0.72 / mm
    error_mm = np.log(gain) / 0.72
    assert (doubted.displacement_sigma_mm[2] > 0.7 * abs(error_mm)).all()
    stiffness = 4.5  # N/mm beyond 0.6 mm
    expected = 0.7 * stiffness * abs(error_mm)
    if gain > 1.0:
        assert (doubted.force_sigma[2] > expected).all()
    # a field that is off by as much across turns R / S of it
    across = (gain - 1.0) * whole_ut(skin) / gain
    assert (doubted.force_sigma[:2].max(axis=0) > 0.25 * abs(across) * 0.5 / whole_ut(skin)).all()
    assert (doubted.force_sigma > sound.force_sigma).all()
    # forgotten by the next one that is right
    again = decoder(right)
    assert again.valid.all()
    np.testing.assert_allclose(again.force_sigma, sound.force_sigma)
    decoder(odd)
    assert (decoder(odd).status & Status.MAGNETIC_ANOMALY != 0).all()
    assert not (decoder(right).status & Status.MAGNETIC_ANOMALY).any()
