"""Stray fields that a tare and touch show: the truth is a sum of dipoles, or magnet theory.
And which readings are learned from."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bus.status import Status
from skin.calibrate.crosstalk import MOST_UNITS, StrayEstimate, TouchTest
from skin.calibrate.tare import tare
from skin.errors import ScanError, SkinError
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator
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


def touched(skin, field, estimate, rng, noise_ut=10.0):
    n = skin.n
    for unit in (0, 4, 8):
        displacement, depth = (values[::15] for values in press(unit, n))
        change = field(displacement, depth) - field(*at_rest(n))
        change += noise_ut * rng.standard_normal(change.shape)
        change[:, :, unit] = np.nan  # its own film moves
        moved = np.concatenate([displacement, depth[:, np.newaxis]], axis=1)
        estimate.learn(change, noise_ut, moved)


@pytest.mark.long
def test_readings_at_rest_and_in_touch_each_bring_the_stencil_nearer_to_the_truth(skin, field):
    estimate, n = StrayEstimate(skin), skin.n
    drawn, prior = missed_ut(estimate.theory, field, n), estimate.sigma_ut().mean()
    noise = 10.0 * np.random.default_rng(4).standard_normal((3, n))
    estimate.learn(field(*at_rest(n)) + noise, 10.0)
    tared, rest = missed_ut(estimate.stencil(), field, n), estimate.sigma_ut().mean()
    touched(skin, field, estimate, np.random.default_rng(2))
    learned, last = missed_ut(estimate.stencil(), field, n), estimate.sigma_ut().mean()
    assert learned < tared < drawn
    assert last < rest < prior
    assert learned < 2.0 * last + estimate.theory.left_out_rms_ut.mean()


def test_the_rest_that_is_learned_lies_within_its_sigma(skin, field):
    estimate, n = StrayEstimate(skin), skin.n
    true = field(*at_rest(n))[0]
    estimate.learn(true[np.newaxis], 10.0)
    off = (estimate.stencil().rest_ut - true) / estimate.rest_sigma_ut()
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_a_skin_of_too_many_units_is_refused():
    with pytest.raises(SkinError, match=f"must have {MOST_UNITS} units or fewer"):
        StrayEstimate(square(17, 0.012))


# -- which readings are learned from ---------------------------------------------------------------


@pytest.fixture(scope="module")
def four():
    sigma = {"placement_sigma_mm": 0.1, "placement_sigma_rad": 0.01, "field_sigma_ut": 5.0}
    return with_parameters(square(2, 0.012), **sigma)


@pytest.fixture(scope="module")
def units(four):
    return UnitSimulator(four, seed=1, field=HalbachField(four))


def counts(units, displacement, depth):
    values = units.quantities(depth, displacement, np.full(depth.shape, 25.0))
    return units.quantise(units.disturb(values))


@pytest.fixture
def test_of(four, units):
    still = counts(units, np.zeros((400, 2, four.n)), np.zeros((400, four.n)))
    estimate = StrayEstimate(four)
    found = tare(four, still)
    tared = estimate.tared(found)
    return TouchTest(found.leaving_out(tared.rest_ut).applied(), estimate, tared, still)


def test_a_press_beside_untouched_units_is_learned_from(test_of, four, units):
    before = test_of.estimate.sigma_ut()
    assert test_of(counts(units, *press(0, four.n))) > 100
    assert test_of.pressed[0] > 100
    assert not test_of.pressed[1:].any()
    assert (test_of.estimate.sigma_ut() < before).all()


def test_without_an_untouched_neighbour_nothing_is_learned(test_of, four, units):
    mean = test_of.estimate.mean.copy()
    displacement, depth = press(0, four.n)
    depth[:] = depth[:, :1]
    assert test_of(counts(units, displacement, depth)) == 0
    assert test_of(counts(units, 0.0 * displacement, 0.0 * depth)) == 0
    assert np.array_equal(test_of.estimate.mean, mean)


def test_units_that_are_not_valid_tell_nothing(test_of, four, units):
    recording = counts(units, *press(0, four.n))
    status = np.zeros((len(recording), four.n), np.uint16)
    status[:, 0] = int(Status.LATE)
    assert test_of(recording, status) == 0


def test_a_unit_that_is_broken_moves_no_film(test_of, four, units):
    recording = counts(units, *press(0, four.n))
    recording[:, :, 3] = 0
    status = np.zeros((len(recording), four.n), np.uint16)
    status[:, 3] = int(Status.OUT_OF_RANGE)
    mean = test_of.estimate.mean.copy()
    assert test_of(recording, status) == 0
    assert np.array_equal(test_of.estimate.mean, mean)


def test_a_recording_that_is_too_short_is_refused(test_of, four, units):
    recording = counts(units, *press(0, four.n))[:39]
    with pytest.raises(ScanError, match="counts: must be 40 cycles or more; got 39"):
        test_of(recording)
