"""Readings of a touched skin: what is learned from, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from bus.status import Status
from skin.calibrate.crosstalk import StrayEstimate, TouchTest
from skin.calibrate.tare import tare
from skin.errors import ScanError
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator
from tests.fixtures.decode import square, with_parameters
from tests.fixtures.finger import press


@pytest.fixture(scope="module")
def skin():
    flat = square(2, 0.012)
    sigma = {"placement_sigma_mm": 0.1, "placement_sigma_rad": 0.01, "field_sigma_ut": 5.0}
    return with_parameters(flat, **sigma)


@pytest.fixture(scope="module")
def units(skin):
    return UnitSimulator(skin, seed=1, field=HalbachField(skin))


def counts(units, displacement, depth):
    values = units.quantities(depth, displacement, np.full(depth.shape, 25.0))
    return units.quantise(units.disturb(values))


@pytest.fixture
def test_of(skin, units):
    still = counts(units, np.zeros((400, 2, skin.n)), np.zeros((400, skin.n)))
    estimate = StrayEstimate(skin)
    found = tare(skin, still)
    tared = estimate.tared(found)
    return TouchTest(found.leaving_out(tared.rest_ut).applied(), estimate, tared, still)


def test_a_press_beside_untouched_units_is_learned_from(test_of, skin, units):
    before = test_of.estimate.sigma_ut()
    assert test_of(counts(units, *press(0, skin.n))) > 100
    assert test_of.pressed[0] > 100
    assert not test_of.pressed[1:].any()
    assert (test_of.estimate.sigma_ut() < before).all()


def test_without_an_untouched_neighbour_nothing_is_learned(test_of, skin, units):
    mean = test_of.estimate.mean.copy()
    displacement, depth = press(0, skin.n)
    depth[:] = depth[:, :1]
    assert test_of(counts(units, displacement, depth)) == 0
    assert test_of(counts(units, 0.0 * displacement, 0.0 * depth)) == 0
    assert np.array_equal(test_of.estimate.mean, mean)


def test_units_that_are_not_valid_tell_nothing(test_of, skin, units):
    recording = counts(units, *press(0, skin.n))
    status = np.zeros((len(recording), skin.n), np.uint16)
    status[:, 0] = int(Status.LATE)
    assert test_of(recording, status) == 0


def test_a_unit_that_is_broken_moves_no_film(test_of, skin, units):
    recording = counts(units, *press(0, skin.n))
    recording[:, :, 3] = 0
    status = np.zeros((len(recording), skin.n), np.uint16)
    status[:, 3] = int(Status.OUT_OF_RANGE)
    mean = test_of.estimate.mean.copy()
    assert test_of(recording, status) == 0
    assert np.array_equal(test_of.estimate.mean, mean)


def test_a_recording_that_is_too_short_is_refused(test_of, skin, units):
    recording = counts(units, *press(0, skin.n))[:39]
    with pytest.raises(ScanError, match="counts: must be 40 cycles or more; got 39"):
        test_of(recording)
