"""What neighbours add, by sums of dipoles, where sweeps take it off and where they do not."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np
import pytest

import topology
from bus.status import Status
from skin.decode import records
from skin.decode.decoder import Decoder
from skin.decode.uncertainty import neighbours_of
from skin.options import Options
from skin.physics.stencil import neighbours_at_rest, rest_sigma_ut
from skin.physics.stray import field_at_rest
from skin.sim.unit import UnitSimulator
from tests.fixtures.decode import square
from tests.fixtures.plant import Plant, Touch, Units

WANT = {"force", "displacement", "sigma"}
SIDE, SCENES = 5, 40


def counts_of(skin, displacement, depth, noise=True):
    """Of films as drawn, each a grid of dipoles, felt by all chips."""
    plant = Plant(skin, Units({}, np.ones(skin.n), np.zeros((3, skin.n))))

    def field(moved, pressed, _warm):
        return plant.film_field(Touch(pressed, moved))

    units = UnitSimulator(skin, seed=3, noise=noise, field=field)
    values = units.quantities(depth, displacement, np.full(depth.shape, 25.0))
    return units.quantise(units.disturb(values))


def scenes(seed):
    """Six tenths of the units pressed and sheared, each for itself, through the whole range."""
    rng, n = np.random.default_rng(seed), SIDE**2
    pressed = rng.random((SCENES, n)) < 0.6
    depth = 2.0 * rng.random((SCENES, n)) * pressed
    reach = 2.5 * np.sqrt(rng.random((SCENES, n))) * pressed
    around = rng.uniform(-np.pi, np.pi, (SCENES, n))
    return reach[:, np.newaxis] * np.stack([np.cos(around), np.sin(around)], axis=1), depth


def test_both_doors_have_the_same_defaults():
    """So that a batch and a live skin show the same numbers."""
    ours, theirs = inspect.signature(Decoder).parameters, Options()
    shared = ours.keys() & {field.name for field in dataclasses.fields(Options)} - {"want"}
    assert shared >= {"sweeps", "ambient", "dtype", "estimator", "creep", "skip", "stencil"}
    for name in shared:
        assert ours[name].default == getattr(theirs, name), name


@pytest.mark.long
def test_what_sweeps_do_not_take_off_is_in_sigma():
    """And no pressed unit is an anomaly, nor invalid."""
    skin = square(SIDE)
    moved, depth = scenes(31)
    decoder = Decoder(skin, WANT, sweeps=0, ambient=False)
    reading = decoder(counts_of(skin, moved, depth))
    off = np.abs(reading.displacement_mm[:, :2] - moved)
    sigma = reading.displacement_sigma_mm[:, :2]
    pressed = np.repeat(depth[:, np.newaxis] > 0.0, 2, axis=1)
    assert 0.66 < np.mean(off <= sigma) < 0.80
    assert 0.66 < np.mean((off <= sigma)[pressed]) < 0.80
    assert np.mean(off > 3.0 * sigma) < 0.02
    assert not (reading.status & Status.MAGNETIC_ANOMALY).any()
    assert reading.valid.all()


def test_a_unit_that_was_not_tared_does_not_know_the_field_of_its_resting_neighbours():
    skin = topology.load("palm")
    units = UnitSimulator(skin, noise=False)
    one, both = np.ones((1, skin.n)), np.ones((1, 2, skin.n))
    raw = units.quantise(units.disturb(units.quantities(one, 0.6 * both, 25.0 * one)))

    def decoded(is_tared, offset_ut=0.0):
        offset = skin.offset.copy()
        offset[records.BX] += offset_ut
        moved = dataclasses.replace(skin, tared=np.full(skin.n, is_tared), offset=offset)
        decoder = Decoder(moved, WANT, dtype="float64", sweeps=0, ambient=False)
        return decoder(raw[0]), decoder.rest_ut

    (with_tare, _), (without, rest_ut) = decoded(True), decoded(False)
    ways = (decoded(True, 1.0)[0].displacement_mm - decoded(True, -1.0)[0].displacement_mm) / 2.0
    off = rest_sigma_ut(skin) ** 2
    known_ut2 = 0.5 * (off[0] + off[1])
    known_ut2 += (skin.parameters["placement_sigma_rad"] * rest_ut[2]) ** 2
    more = without.displacement_sigma_mm[:2] ** 2 - with_tare.displacement_sigma_mm[:2] ** 2
    ratio = more / (known_ut2 * np.sum(ways[:2] ** 2, axis=0))
    assert ((ratio > 0.9) & (ratio < 1.25)).all()  # slopes along both axes count as one


def test_what_rests_beyond_the_horizon_adds_up_to_twice_what_its_outer_half_does():
    """Of 0.1 m; beside 0.3 mT of films that are made otherwise."""
    hand = topology.load("hand")
    rest_ut = neighbours_at_rest(hand)
    outer_ut = np.abs(rest_ut - field_at_rest(hand, 0.05)).max(axis=0)
    found = neighbours_of(hand, rest_ut, None).still_ut
    np.testing.assert_allclose(found, np.hypot(300.0, 2.0 * outer_ut))
