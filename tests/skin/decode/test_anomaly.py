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

pytestmark = pytest.mark.usefixtures("few_variants")

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
            raw = counts_at(skin, DEPTH, REACH, np.linspace(-3, 3, UNITS), gain=gain)
            assert decoder(raw).valid.all()  # one reading alone says nothing
            reading = decoder(raw)
            found = reading.status & Status.MAGNETIC_ANOMALY != 0
            assert reading.test_ratio == pytest.approx(np.full(UNITS, times), abs=0.01)
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
@pytest.mark.parametrize("gain", [1.05, 0.95])
def test_a_small_miss_that_stays_is_an_anomaly_by_its_mean(estimator, gain):
    """5 % of the field are less than what one reading may miss, and more than what many may."""
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


STRAY_UT = 250.0
"""What neighbours may add, whose fields at rest are taken off: 0.3 mT."""


def pressed(skin, depth_mm, cycles, seed):
    """Counts of cycles at rest and of a press, shape (t, c, n): upright films, whose vertical field
    is `STRAY_UT` more or less than theirs, with noise; from the laws alone."""
    press = np.clip(np.arange(1, 100) / cycles, 0.0, 1.0)
    depth = depth_mm * np.concatenate([np.zeros(200), press])
    rng = np.random.default_rng(seed)
    h = np.repeat(depth[:, np.newaxis], skin.n, axis=1)
    value = np.zeros((len(h), 6, skin.n))
    value[:, 0] = 100.0 * 12.0 ** (5.0 / 60.0)  # 25 °C
    value[:, 1] = 4500.0 - 900.0 * h
    # psi / (k R) -> slope of the table of angles at R = 0
    slope = sum(skin.parameters["field_angle_mm"][i] * h**i for i in range(4))
    value[:, 4] = 11073.0 * np.exp(0.72 * (h - 2.0)) * (np.pi / 5.0) * slope
    value[:, 4] += STRAY_UT * np.where(np.arange(skin.n) % 2, 1.0, -1.0)
    value[:, 5] = 25.0
    value[:, 1] += rng.normal(0.0, 6.0, h.shape)
    value[:, 2:5] += rng.normal(0.0, 105.0, (len(h), 3, skin.n))
    value[:, 0] *= skin.parameters["gel_current_20c_ua"] / 100.0
    return np.rint((value - skin.offset) / skin.scale).astype(np.int16)


@pytest.mark.parametrize("cycles", [1, 5, 25])
@pytest.mark.parametrize("depth_mm", [1.0, 1.5, 2.0])
def test_a_press_is_not_judged_by_a_share_that_was_learnt_at_rest(depth_mm, cycles):
    """What is 6 % of the field at rest, and allowed, is 2 % of it when pressed, and allowed."""
    skin = row_of(64)
    decoder = Decoder(skin, None, "field-angle", sweeps=0, ambient=False)
    for raw in pressed(skin, depth_mm, cycles, 5):
        reading = decoder(raw)
        assert reading.valid.all()
    assert np.allclose(reading.displacement_mm[2], depth_mm, atol=0.05)


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


@long_after_first("dtype", ["float32", "float64"])
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
