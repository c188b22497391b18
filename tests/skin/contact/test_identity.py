"""Identities against slow and obvious ones, and the rules that need a scene of their own."""

import numpy as np
import pytest

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Event, TrackState
from skin.contact.stream import ContactStream
from tests.fixtures.contact_stream import identities, with_gate

PITCH, SIGMA, CYCLE_NS = 0.012, 0.01, 4_000_000


class Units:
    """A few units, loads in sigmas, with a cycle every 4 ms."""

    def __init__(self, rows, columns, capacity=None, **gate):
        position = naive.grid(rows, columns)
        self.graph = neighbour_graph(position, 1.01 * PITCH)
        n = rows * columns
        self.stream = ContactStream(
            position, naive.facing_down(n), 1e-4, *self.graph, want=(),
            capacity=capacity,
        )  # fmt: skip
        with_gate(self.stream, start_sigma=5.0, **gate)
        self.tracker = identities(self.stream)
        self.now = 0

    def see(self, *level, cycles=1):
        """Identities and their units, with which loads; silent units say NaN."""
        level = np.array(level, float)
        for _ in range(cycles):
            self.now += CYCLE_NS
            force = SIGMA * np.array([0.0 * level, 0.0 * level, level])
            self.stream.update(force, SIGMA, stamp_ns=self.now)
        return {c.id: sorted(c.units.tolist()) for c in self.stream.contacts}

    def record(self, identity):
        records = self.tracker.contacts
        known = (records["id"] == identity) & (records["track"] != TrackState.FREE)
        (at,) = np.flatnonzero(known)
        return records[at]


def mirrored(level, flip):
    """Loads of a row of units, from the other end if `flip`."""
    return level[::-1] if flip else level


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(("times", "is_back"), [(3.97, False), (4.03, True)])
def test_an_absorbed_contact_speaks_again_when_it_bears_four_times_the_other(times, is_back, flip):
    units = Units(1, 3)
    light, heavy = (2, 1) if flip else (1, 2)
    assert set(units.see(*mirrored([10, 0, 20], flip), cycles=60)) == {light, heavy}
    assert units.see(*mirrored([10, 4, 20], flip), cycles=5) == {heavy: [0, 1, 2]}
    assert units.record(heavy)["event"] == Event.NONE
    # The unit between them has become that of its heavier neighbour.
    speaker, other = (light, heavy) if is_back else (heavy, light)
    assert units.see(*mirrored([times * 24, 4, 20], flip)) == {speaker: [0, 1, 2]}
    assert bool(units.record(speaker)["event"] & Event.RESUMED) == is_back
    record = units.record(other)
    assert (record["track"], record["seen_ns"]) == (TrackState.ABSORBED, units.now)


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(("heavy", "returns"), [(9900, 1), (10100, 2)])
def test_a_unit_counts_a_thousandth_beside_one_that_a_lost_contact_has_owned(heavy, returns, flip):
    units = Units(1, 6)
    units.see(*mirrored([0, 9, 0, 0, 0, 0], flip))
    units.see(*mirrored([0, 0, 0, 0, 0, 9], flip))
    units.see(*mirrored([0, 0, 0, 0, 0, 0], flip))
    level = mirrored([0, 10, 5, 5, heavy, 0], flip)
    assert list(units.see(*level)) == [returns]
    assert units.record(returns)["event"] == Event.RESUMED


def test_of_two_contacts_that_bear_alike_the_older_one_speaks_for_both():
    units = Units(1, 3)
    assert units.see(10, 0, 10, cycles=60) == {1: [0], 2: [2]}
    assert units.see(10, 4, 10) == {1: [0, 1, 2]}


@pytest.mark.parametrize(("cycles", "settled"), [(10, False), (11, True)])
def test_a_contact_outlives_being_absorbed_once_it_has_settled(cycles, settled):
    units = Units(1, 3, settle_ns=4e7)
    units.see(9, 0, 20, cycles=cycles)
    units.see(9, 5, 20)
    assert units.record(2)["event"] == Event.MERGED
    assert list(units.see(9, 0, 20)) == ([1, 2] if settled else [2, 3])
    assert bool(units.record(2)["event"] & Event.SPLIT) != settled


TILES = 191
"""Of the 256 tiles of four by four units of 64 by 64."""


def tiles(shift, seed=0):
    """Loads in sigmas of three by three units in each tile, that far along the rows."""
    rng, level = np.random.default_rng(seed), np.zeros((64, 64))
    for tile in rng.permutation(256)[:TILES]:
        row, column = 4 * (tile // 16), 4 * (tile % 16) + shift
        level[row : row + 3, column : column + 3] = rng.uniform(10.0, 100.0)
    return level.reshape(-1)


def test_on_4096_units_191_contacts_have_an_identity_and_keep_it_as_they_move():
    units = Units(64, 64)
    assert units.stream.capacity == 256
    first = units.see(*tiles(0))
    assert list(first) == list(range(1, TILES + 1))
    for shift in (1, 2, 1, 0):
        moved = units.see(*tiles(shift))
        assert list(moved) == list(first)
        assert units.tracker.untracked == 0
    assert moved == first
    assert units.see(*np.zeros(4096)) == {}
    assert units.see(*tiles(0)) == first


def test_of_more_contacts_than_the_capacity_the_lightest_is_counted():
    units = Units(64, 64, capacity=TILES - 1)
    found = units.see(*tiles(0), cycles=3)
    assert len(found) == TILES - 1
    assert units.tracker.untracked == 1
    load = tiles(0)
    label = units.tracker.label
    np.testing.assert_array_equal(label < -1, (label < 0) & (load > 0))
    assert load[label < -1].max() <= load[label >= 0].min()
    assert units.tracker.touching_units == np.count_nonzero(load)
