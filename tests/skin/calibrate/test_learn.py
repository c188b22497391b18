"""Stray fields learned from a tare and from touch; the truth is a sum of dipoles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.calibrate.crosstalk import MOST_UNITS, StrayEstimate
from skin.errors import SkinError
from tests.fixtures.decode import square, with_parameters
from tests.fixtures.film import WEAK
from tests.fixtures.finger import press
from tests.fixtures.plant import Plant, Touch, Units

SIDE = 3


@pytest.fixture(scope="module")
def skin():
    flat = square(SIDE, 0.012)
    sigma = {"placement_sigma_mm": 0.2, "placement_sigma_rad": 0.03}
    return with_parameters(flat, **sigma)


@pytest.fixture(scope="module")
def field(skin):
    """What films of another shape, off their places, add at the chips."""
    place = 2e-4 * np.random.default_rng(0).standard_normal((3, skin.n))
    real = dataclasses.replace(skin, position=skin.position + place)

    units = Units({}, np.ones(skin.n), np.zeros((3, skin.n)))
    both, own = (Plant(real, units, WEAK, alone=alone) for alone in (False, True))

    def stray(displacement, depth):
        touch = Touch(depth, displacement)
        return both.film_field(touch) - own.film_field(touch)

    return stray


def at_rest(n, count=1):
    return np.zeros((count, 2, n)), np.zeros((count, n))


def scenes(n, count=10):
    rng = np.random.default_rng(1)
    return rng.uniform(-1.5, 1.5, (count, 2, n)), rng.uniform(0.0, 2.0, (count, n))


def missed_ut(stencil, field, n):
    displacement, depth = scenes(n)
    true = field(displacement, depth) - field(*at_rest(n))
    moved = np.concatenate([displacement, depth[:, np.newaxis]], axis=1)
    return np.sqrt(np.mean((stencil(moved) - true)[:, :2] ** 2))


def touched(skin, field, estimate, rng, noise_ut=10.0, spoilt=()):
    n = skin.n
    for unit in (0, 4, 8):
        displacement, depth = (values[::15] for values in press(unit, n))
        change = field(displacement, depth) - field(*at_rest(n))
        change += noise_ut * rng.standard_normal(change.shape)
        change[:, :, list(spoilt)] += 2000.0
        moved = np.concatenate([displacement, depth[:, np.newaxis]], axis=1)
        estimate.touch(moved, change, np.arange(n) != unit, noise_ut)


@pytest.mark.long
def test_readings_at_rest_and_in_touch_each_bring_the_stencil_nearer_to_the_truth(skin, field):
    estimate, n = StrayEstimate(skin), skin.n
    drawn, prior = missed_ut(estimate.theory, field, n), estimate.sigma_ut().mean()
    noise = 10.0 * np.random.default_rng(4).standard_normal((3, n))
    estimate.rest(field(*at_rest(n))[0] + noise, np.full((3, n), 10.0))
    tared, rest = missed_ut(estimate.stencil(), field, n), estimate.sigma_ut().mean()
    touched(skin, field, estimate, np.random.default_rng(2))
    learned, last = missed_ut(estimate.stencil(), field, n), estimate.sigma_ut().mean()
    assert learned < tared < drawn
    assert last < rest < prior
    assert learned < 2.0 * last + estimate.theory.left_out_rms_ut.mean()


def test_the_rest_that_is_learned_lies_within_its_sigma(skin, field):
    estimate, n = StrayEstimate(skin), skin.n
    true = field(*at_rest(n))[0]
    estimate.rest(true, np.full((3, n), 10.0))
    off = (estimate.stencil().rest_ut - true) / estimate.rest_sigma_ut()
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_a_skin_of_too_many_units_is_refused():
    with pytest.raises(SkinError, match=f"must have {MOST_UNITS} units or fewer"):
        StrayEstimate(square(17, 0.012), object())
