"""How far a field may be from its model until it is an anomaly: each part of the tolerance alone.

A field that is g times that of the model keeps its angle, so that R does, and is off by g - 1.
"""

from __future__ import annotations

import numpy as np
import pytest

from bus.status import Status
from skin.decode.decoder import Decoder
from tests.fixtures.decode import amplitude_of, angle_of, row_of, sine, with_parameters
from tests.skin.decode.test_field_angle import counts_at

UNITS = 6
DEPTH, REACH = 1.0, 1.0
EXACT = {"field_noise_ut": 0.0, "frequency_noise_hz": 0.0, "gel_noise_relative": 0.0}


def whole_ut(skin):
    """Size of the model's field at the pose."""
    reach, depth = np.full(UNITS, REACH), np.full(UNITS, DEPTH)
    lateral = amplitude_of(skin, depth) * np.sin(skin.parameters["field_wavenumber_rad_per_mm"])
    return lateral / np.sin(angle_of(skin, reach, depth))


PARTS = {
    # parameters; what they add to the square of 15 %, µT² or as a share, to the 1 mT of neighbours
    "share": ({}, 0.0, 0.0),
    "field": ({"field_sigma_ut": 400.0}, 25.0 * 400.0**2, 0.0),
    "noise": ({"field_noise_ut": 400.0}, 25.0 * 400.0**2, 0.0),
    "amplitude": ({"field_amplitude_sigma_relative": 0.05}, 0.0, 25.0 * 0.05**2),
    "depth": ({"frequency_sigma_hz": 90.0}, 0.0, 25.0 * (0.72 * 0.1) ** 2),
}


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("part", PARTS)
def test_a_field_is_an_anomaly_beyond_its_tolerance(part, known, estimator):
    """15 %, five sigma, and 1 mT of neighbours; 0.3 mT of them where their rest is known."""
    parameters, field_ut2, share = PARTS[part]
    skin = with_parameters(row_of(UNITS), **(EXACT | parameters))
    growth = skin.parameters["field_growth_per_mm"]
    assert growth == pytest.approx(0.72 * np.ones(UNITS))
    stray_ut = 300.0 if known else 1000.0
    most = np.sqrt(0.15**2 + share + (stray_ut**2 + field_ut2) / whole_ut(skin) ** 2)
    rest = np.zeros((3, UNITS)) if known else None
    decoder = Decoder(skin, None, estimator, dtype="float64", rest_ut=rest, consistency=True)
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
