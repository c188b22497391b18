"""How far a field may be from its model until it is an anomaly: each part of the tolerance alone.

A field that is g times that of the model keeps its angle, so that R does, and is off by g - 1.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from bus.status import Status
from skin.decode.decoder import Decoder
from tests.fixtures.decode import amplitude_of, angle_of, row_of, sine, with_parameters
from tests.skin.decode.test_field_angle import counts_at

UNITS = 6
DEPTH, REACH = 1.0, 1.0
EXACT = {"field_noise_ut": 0.0, "frequency_noise_hz": 0.0, "gel_noise_relative": 0.0}


PASSED = norm.isf(0.125 / (UNITS * 1.0 * 86400.0))
"""Sigmas that noise passes once in four days, up or down, of units that answer once a second."""


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


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
@pytest.mark.parametrize("part", PARTS)
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
        skin,
        None,
        estimator,
        dtype="float64",
        consistency=True,
        sweeps=0,
        ambient=False,
    )
    for way in (1.0, -1.0):
        for times, odd in ((0.97, False), (1.03, True)):
            gain = 1.0 + way * times * most
            reading = decoder(counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=gain))
            found = reading.status & Status.MAGNETIC_ANOMALY != 0
            assert (found == odd).all(), (way, times, most)
            assert (reading.valid == (not odd)).all()


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


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
@pytest.mark.parametrize("gain", [1.06, 0.94])
def test_a_small_miss_that_stays_is_an_anomaly_by_its_mean(estimator, gain):
    """6 % of 6.9 mT are less than one reading's noise may be, and more than that of their mean."""
    skin = with_parameters(row_of(UNITS), frequency_noise_hz=0.0, gel_noise_relative=0.0)
    decoder = Decoder(
        skin,
        None,
        estimator,
        dtype="float64",
        consistency=True,
        sweeps=0,
        ambient=False,
    )
    right, wrong = (
        counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=each) for each in (1.0, gain)
    )
    odd = [
        (decoder(raw).status & Status.MAGNETIC_ANOMALY != 0)
        for raw in (*[right] * 20, *[wrong] * 200, *[right] * 200)
    ]
    assert not np.any(odd[:40])
    assert np.all(odd[200:220])
    assert not np.any(odd[-1])
    first = int(np.argmax(np.all(odd, axis=1)))
    assert 25 < first - 20 < 150


def test_units_that_are_left_out_or_decoded_again_do_not_count_for_the_mean():
    skin = with_parameters(row_of(UNITS), frequency_noise_hz=0.0, gel_noise_relative=0.0)
    decoder = Decoder(
        skin,
        None,
        "field-angle",
        dtype="float64",
        sweeps=0,
        ambient=False,
    )
    wrong = counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=1.06)
    late = np.zeros(UNITS, np.uint16)
    late[0] = Status.LATE
    for _ in range(200):
        status = decoder(wrong, late).status
    assert (status & Status.MAGNETIC_ANOMALY != 0).tolist() == [False] + [True] * (UNITS - 1)
    decoder.reset()
    decoder(wrong)
    for _ in range(200):
        status = decoder(wrong, advance=False).status
    assert not (status & Status.MAGNETIC_ANOMALY).any()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_noise_makes_no_more_anomalies_than_it_may(dtype):
    """Of a skin that may have them so often that they can be counted."""
    skin = with_parameters(row_of(400), gel_noise_relative=0.0)
    model = "skin.decode.uncertainty.ANOMALIES_PER_DAY"
    a_day, cycles = 400 * 86400.0, 400
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model, 1e-3 * a_day)
        patch.setattr("skin.decode.uncertainty.ANOMALY_SHARE", 0.0)
        patch.setattr("skin.decode.uncertainty.STRAY_KNOWN_UT", 0.0)
        decoder = Decoder(
            skin,
            None,
            "field-angle",
            dtype=dtype,
            sweeps=0,
            ambient=False,
        )
    rng = np.random.default_rng(4)
    exact = counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, 400)).astype(float)
    found = 0
    for _ in range(cycles):
        raw = exact.copy()
        raw[1] += rng.normal(0.0, 6.0, 400) / skin.scale[1]
        raw[2:5] += rng.normal(0.0, 105.0, (3, 400)) / skin.scale[2:5]
        status = decoder(np.rint(raw).astype(np.int16)).status
        found += int((status & Status.MAGNETIC_ANOMALY != 0).sum())
    # as many by single readings as by their mean; noise of the direction makes some more
    assert 0.3 < found / (2.0 * 1e-3 * 400 * cycles) < 3.0
