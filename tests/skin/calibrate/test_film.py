"""The film of a unit: R from the angle of the field, and the sine law, of magnet theory."""

from __future__ import annotations

import numpy as np
import pytest

from skin.calibrate.film import angle_powers, fit_crest, fit_film
from skin.errors import ScanError
from tests.fixtures.decode import posed, row_of, strokes
from topology import CHANNELS, UnitModel

BX = CHANNELS.index("bx")
PRESS, SLIDE, _ = strokes(np.linspace(0.0, 2.0, 6), np.linspace(0.0, 2.5, 14))
AMPLITUDE = {"field_wavenumber_rad_per_mm": 0.63, "field_growth_per_mm": 0.73,
             "field_growth_per_mm2": 0.02, "field_amplitude_ut": 10900.0}  # fmt: skip


def lateral(rng, noise=105.0):
    k, growth, quadratic, amplitude = AMPLITUDE.values()
    above = PRESS - 2.0
    field = amplitude * np.exp(growth * above + quadratic * above**2) * np.sin(k * SLIDE)
    return field + noise * rng.standard_normal(field.shape)


def test_the_sine_law_is_found_within_its_sigma():
    off = []
    for seed in range(6):
        fit = fit_crest(lateral(np.random.default_rng(seed)), PRESS, SLIDE, 2.0, 105.0)
        assert fit.names == tuple(AMPLITUDE)
        off.append((fit.values - list(AMPLITUDE.values())) / fit.sigma)
    off = np.abs(off)
    assert np.mean(off < 3.0) > 0.95
    assert 0.5 < np.mean(off < 1.0) < 0.9


def test_the_preset_of_the_unit_model_is_what_magnet_theory_gives():
    table = np.array(UnitModel().field_angle_mm)
    depth, displacement, direction = strokes(np.linspace(0.0, 2.5, 26), np.linspace(0.0, 3.0, 31))
    field = posed(row_of(1), depth, displacement, direction, noise=False)[0][:, 2:5, 0]
    angle = np.arctan2(np.hypot(field[:, 0], field[:, 1]), field[:, 2])
    found = angle_powers(angle, depth) @ table
    assert np.abs(found - displacement).max() < 0.8e-3


def test_errors_that_grow_to_the_end_of_the_range_are_in_the_variance_there():
    """Of a film whose field waves three times around it."""
    depth, reach, around = strokes(
        np.linspace(0.0, 2.0, 7), np.linspace(0.2, 2.8, 9), np.linspace(-np.pi, np.pi, 16, False)
    )
    field = posed(row_of(1), depth, reach, around, noise=False)[0][:, 2:5, 0]
    off = 0.04 * (reach / 2.8) ** 3 * np.cos(3.0 * around)
    film = fit_film(field, depth, reach + off, around, sigma_ut=20.0)
    terms = np.stack([reach ** (3 * i) * depth ** (2 * j) for i in range(3) for j in range(2)])
    variance = film.sigma_mm**2 * ((film.shape + np.eye(6)[0]) @ terms)
    assert (variance > -1e-9).all()
    assert np.sqrt(variance[reach > 2.7].mean()) > 3.0 * np.sqrt(variance[reach < 1.5].mean())


def test_strokes_along_one_line_do_not_tell_a_direction():
    values, _ = posed(row_of(1), PRESS, SLIDE, 0.0)
    with pytest.raises(ScanError, match="direction_rad: must have 4 levels"):
        fit_film(values[:, BX : BX + 3, 0], PRESS, SLIDE, np.zeros(PRESS.size))
