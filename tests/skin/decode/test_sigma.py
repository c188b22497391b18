"""One sigma of every output: coverage, what it is made of, and that it is honest where laws end."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.decoder import Decoder
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import row_of, with_parameters
from tests.skin.decode.test_field_angle import counts_at

NAMES = ("temperature", "fx", "fy", "fz", "x", "y", "h", "tangential", "theta")
UNITS, CYCLES = 500, 16


def rows_of(reading, sigma=False):
    """Quantities or their sigmas by the names above, shape (t, n)."""
    end = "_sigma" if sigma else ""
    force = getattr(reading, f"force{end}")
    place = reading.displacement_sigma_mm if sigma else reading.displacement_mm
    whole = (getattr(reading, f"{name}{end}") for name in ("temperature", "tangential", "theta"))
    temperature, tangential, theta = whole
    rows = (temperature, *force.swapaxes(0, 1), *place.swapaxes(0, 1), tangential, theta)
    return dict(zip(NAMES, rows, strict=True))


def coverage(estimator, depth, reach):
    """Share of truths within one sigma, of noisy readings of nominal units in all directions."""
    skin = row_of(UNITS)
    rng = np.random.default_rng(5)
    direction = rng.uniform(-np.pi, np.pi, (CYCLES, UNITS))
    temperature = 25.0
    raw = counts_at(skin, np.full(direction.shape, depth), reach, direction, temperature, noise=rng)
    got = Decoder(skin, None, estimator, dtype="float64", sweeps=0, ambient=False)(raw)
    shear = 0.5 * reach + 2.375 * max(reach - 2.0, 0.0)
    normal = 1.5 * depth + 3.0 * max(depth - 0.6, 0.0)
    truth = (
        temperature, shear * np.cos(direction), shear * np.sin(direction), normal,
        reach * np.cos(direction), reach * np.sin(direction), depth, shear, direction,
    )  # fmt: skip
    value, sigma = rows_of(got), rows_of(got, sigma=True)
    found = {}
    for name, exact in zip(NAMES, truth, strict=True):
        off = value[name] - exact
        off = (off + np.pi) % (2.0 * np.pi) - np.pi if name == "theta" else off
        found[name] = np.mean(np.abs(off) <= sigma[name])
    return found


@long_after_first(
    ("depth", "reach"),
    [(0.2, 0.0), (0.2, 0.5), (0.2, 1.5), (0.2, 2.5), (1.0, 0.1), (1.0, 1.2), (1.0, 2.3),
     (1.9, 0.3), (1.9, 1.8), (1.9, 2.2), (1.9, 2.8)],
)  # fmt: skip
def test_two_of_three_truths_lie_within_one_sigma(depth, reach):
    """8000 readings: 1.5 % is three sigma of the share itself."""
    found = coverage("field-angle", depth, reach)
    if reach < 0.2:  # no direction yet, and a length that cannot be negative: documented
        del found["theta"], found["tangential"]
    for name, share in found.items():
        assert 0.66 <= share <= 0.705, (name, share)


@pytest.mark.parametrize(("depth", "reach"), [(0.2, 0.0), (0.2, 1.2), (1.0, 0.5), (1.9, 1.5)])
def test_the_arcsine_is_as_honest_below_its_crest(depth, reach):
    found = coverage("sine", depth, reach)
    if reach < 0.2:
        del found["theta"], found["tangential"]
    for name, share in found.items():
        assert 0.655 <= share <= 0.705, (name, share)


def naive_rows(told):
    force, place = told["force"], told["displacement_mm"]
    rows = (told["temperature"], *force.swapaxes(0, 1), *place.swapaxes(0, 1),
            told["tangential"], told["theta"])  # fmt: skip
    return dict(zip(NAMES, rows, strict=True))


def test_field_sigma_widens_the_field_and_the_residue_of_a_background_does_the_same():
    skin = row_of(30)
    raw = counts_at(skin, 1.0, np.linspace(0.0, 2.2, 30), 0.7)
    wider = Decoder(
        with_parameters(skin, field_sigma_ut=200.0), None, "field-angle", sweeps=0, ambient=False
    )(raw)
    background = np.zeros((5, 30), np.float32)
    background[4] = 200.0**2
    told = Decoder(skin, None, "field-angle", sweeps=0, ambient=False)(raw, None, background)
    for name in ("displacement_sigma_mm", "force_sigma", "theta_sigma", "tangential_sigma"):
        np.testing.assert_allclose(getattr(told, name), getattr(wider, name), rtol=1e-4)
    plain = Decoder(skin, None, "field-angle", sweeps=0, ambient=False)(raw)
    assert np.all(told.displacement_sigma_mm[:2] > 1.5 * plain.displacement_sigma_mm[:2])


def test_a_direction_of_which_nothing_is_known_is_uniform():
    raw = counts_at(row_of(2), 0.2, np.zeros(2), 0.0)
    raw[2:4] = 0
    got = Decoder(row_of(2), None, "field-angle", sweeps=0, ambient=False)(raw)
    np.testing.assert_allclose(got.theta_sigma, np.pi / np.sqrt(3.0), rtol=1e-6)
