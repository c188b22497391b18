"""What a decoder refuses, from both sides of each bound; and which units it does not look at."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec import structs

from skin.decode.decoder import Decoder
from skin.decode.model import field_angle_ends
from skin.decode.records import TEMPERATURE
from skin.errors import CalibrationError, OptionError
from tests.fixtures.decode import planned, row_of, with_parameters

LOW, HIGH = 15.0 - 40.0, 95.0 + 40.0
"""Temperatures that a working unit may have, °C."""
OCTAVES = 0.9 * 24.0 * np.log(2.0)
"""Logarithm of M0 in µT, at most."""


def knots(at, value):
    table = np.zeros((16, 2))
    table[at, 1] = value
    return table


def growing(slope, curve=0.0, reference=1.0, size=0.0):
    return {"field_growth_per_mm": slope, "field_growth_per_mm2": curve,
            "field_reference_mm": reference, "field_amplitude_ut": np.exp(size)}  # fmt: skip


BOUNDS = {
    # parameters by how near they are to the bound, 1 being at it; the parameter that is named
    "correction": (lambda x: {"theta_correction_rad": knots(3, x)}, "theta_correction_rad"),
    "correction, other way": (lambda x: {"theta_correction_rad": knots(15, -x)},
                              "theta_correction_rad"),
    "film, hot": (lambda x: {"film_drift_per_k": -0.9 * x / (HIGH - 25.0)}, "film_drift_per_k"),
    "film, cold": (lambda x: {"film_drift_per_k": 0.9 * x / (25.0 - LOW)}, "film_drift_per_k"),
    "film, other reference": (
        lambda x: {"film_drift_per_k": -0.9 * x / (HIGH - 60.0), "film_reference_c": 60.0},
        "film_drift_per_k",
    ),
    "chip, hot": (lambda x: {"hall_gain_per_k": -0.9 * x / (HIGH - 25.0)}, "hall_gain_per_k"),
    "chip, cold": (lambda x: {"hall_gain_per_k": 0.9 * x / (25.0 - LOW)}, "hall_gain_per_k"),
    "strong": (lambda x: growing(0.0, size=x * OCTAVES), "field_growth_per_mm"),
    "weak": (lambda x: growing(0.0, size=-x * OCTAVES), "field_growth_per_mm"),
    "growing, at rest": (lambda x: growing(x * OCTAVES, reference=1.0), "field_growth_per_mm"),
    "growing, 2 mm deep": (lambda x: growing(x * OCTAVES, reference=1.0), "field_growth_per_mm"),
    "curved": (lambda x: growing(0.5, curve=x * (OCTAVES - 0.5), reference=1.0),
               "field_growth_per_mm"),
    "deep beyond the reference": (lambda x: growing(x * OCTAVES / 1.5, reference=0.5),
                                  "field_growth_per_mm"),
    "shallow of the reference": (lambda x: growing(-x * OCTAVES / 1.5, reference=1.5),
                                 "field_growth_per_mm"),
}  # fmt: skip


@pytest.mark.parametrize("bound", BOUNDS)
def test_a_calibration_is_refused_from_its_bound_on(bound):
    given, name = BOUNDS[bound]
    options = {"want": {"force"}, "estimator": "sine", "consistency": False, "sweeps": 0,
               "ambient": False}  # fmt: skip
    Decoder(with_parameters(row_of(2), **given(0.98)), **options)
    with pytest.raises(CalibrationError, match=rf"row/r0c[01]: {name}: must be "):
        Decoder(with_parameters(row_of(2), **given(1.02)), **options)


# -- tables of angles ------------------------------------------------------------------------------


def linear(per_rad, deeper=0.0, bend=0.0):
    """R = per_rad psi + deeper psi H + bend psi³."""
    table = np.zeros((16, 2))
    table[0], table[1], table[4] = per_rad, deeper, bend
    return table


@pytest.mark.parametrize("deeper", [0.0, 0.25, -0.1])
def test_a_table_ends_where_it_has_passed_its_range_by_a_tenth(deeper):
    """At the first of all depths to 2 mm, once all have its range; R that is told there is the
    least of them."""
    skin = with_parameters(row_of(2), field_angle_mm=linear(1.0, deeper), field_angle_max_mm=1.5)
    steepest, flattest = max(1.0, 1.0 + 2.0 * deeper), min(1.0, 1.0 + 2.0 * deeper)
    angle, reach = field_angle_ends(skin)
    np.testing.assert_allclose(angle, max(1.65 / steepest, 1.5 / flattest), atol=np.pi / 360.0)
    np.testing.assert_allclose(reach, angle * flattest)
    assert (reach >= 1.5).all()


def test_a_table_ends_where_it_turns_back_or_at_a_half_turn():
    skin = with_parameters(row_of(2), field_angle_mm=linear(1.0, 0.0, -0.2), field_angle_max_mm=9.0)
    angle, reach = field_angle_ends(skin)  # 1 = 0.6 psi²
    np.testing.assert_allclose(angle, np.sqrt(1.0 / 0.6), atol=np.pi / 360.0)
    np.testing.assert_allclose(reach, angle - 0.2 * angle**3)
    skin = with_parameters(row_of(2), field_angle_mm=linear(0.1), field_angle_max_mm=9.0)
    angle, reach = field_angle_ends(skin)
    np.testing.assert_allclose(angle, np.pi)
    np.testing.assert_allclose(reach, 0.1 * np.pi)
    untold = with_parameters(row_of(2), field_angle_mm=linear(0.0))
    assert field_angle_ends(untold)[1].tolist() == [0.0, 0.0]


# -- units that are not looked at ------------------------------------------------------------------


def odd_one(how, channel):
    """Three units, of which the last one is off or of another kind and lacks a channel."""
    skin = row_of(3)
    wired = skin.wired.copy()
    wired[channel, 2] = False
    skin = dataclasses.replace(skin, wired=wired)
    if how == "off":
        return dataclasses.replace(skin, enabled=np.array([True, True, False]))
    if how == "foreign":
        layouts = (skin.layouts[0], structs.replace(skin.layouts[0], counts_only=True))
        layout = np.array([0, 0, 1], np.int32)
        frames = dataclasses.replace(skin.frames, layout=layout)
        return dataclasses.replace(skin, layouts=layouts, frames=frames)
    return skin


@pytest.mark.parametrize("channel", range(5))
def test_channels_of_units_that_are_off_or_foreign_are_not_needed(channel):
    options = {"want": None, "estimator": "field-angle", "consistency": True, "sweeps": 0,
               "ambient": False}  # fmt: skip
    for how in ("off", "foreign"):
        assert Decoder(odd_one(how, channel), **options).estimator == "field-angle"
        assert Decoder(odd_one(how, channel), sweeps=0, ambient=False).plan.consistency
    with pytest.raises(OptionError, match="row/r0c2: must have "):
        Decoder(odd_one("working", channel), **options)


# -- no more than is wanted ------------------------------------------------------------------------


def wants_of(skin, want, **options):
    options = {"sweeps": 0, "ambient": False} | options
    return planned(skin, want, **options).wants


def test_what_is_not_wanted_is_not_compiled():
    skin = row_of(3)
    warm = wants_of(skin, {"temperature"}, estimator="sine")
    assert warm == wants_of(skin, {"temperature"})
    assert set(warm) == {None}
    assert planned(skin, {"temperature"}, sweeps=0, ambient=False).rows == [TEMPERATURE]
    assert wants_of(skin, {"field"}).angle is None
    for name in ("force", "tangential", "theta", "displacement"):
        assert wants_of(skin, {name}).angle
        assert wants_of(skin, {name}).shear
