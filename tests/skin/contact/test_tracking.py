"""Identities of contacts through motion, merging, splitting, loss and silence."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Event, TrackState
from skin.contact.stream import ContactStream
from skin.errors import SkinError
from tests.fixtures.contact_stream import identities, with_gate
from tests.fixtures.kernels import interpret_contacts

ROWS, COLUMNS, PITCH = 8, 24, 0.012
POSITION = naive.grid(ROWS, COLUMNS)
GRAPH = neighbour_graph(POSITION, 1.5 * PITCH)
CYCLE_NS = 4_000_000
SIGMA = 0.01


def bump(x, y, load=3.0, radius=2.0):
    """Load of a round contact; x, y and radius in pitches."""
    square = ((POSITION[0] / PITCH - x) ** 2 + (POSITION[1] / PITCH - y) ** 2) / radius**2
    return load * np.maximum(1.0 - square, 0.0)


def tracking(**options):
    """A stream that finds identities and nothing else."""
    return ContactStream(
        POSITION, naive.facing_down(ROWS * COLUMNS), 1e-4, *GRAPH, want=(), dtype="float64",
        **options,
    )  # fmt: skip


class Watch:
    """A stream that is shown one load pattern after another."""

    def __init__(self, capacity=None, **gate):
        self.stream = with_gate(tracking(capacity=capacity), **gate)
        self.tracker = identities(self.stream)
        self.now = 0
        self.valid = np.ones(ROWS * COLUMNS, bool)

    def see(self, *bumps, cycles=1):
        """Ids of the contacts now, keyed by the bump they belong to."""
        load = np.sum([np.zeros(ROWS * COLUMNS), *bumps], axis=0)
        for _ in range(cycles):
            self.now += CYCLE_NS
            force = np.array([np.zeros(load.size), np.zeros(load.size), load])
            self.stream.update(force, SIGMA, valid=self.valid, stamp_ns=self.now)
        ids = self.tracker.contacts["id"][self.tracker.present]
        peaks = [self.tracker.label[np.argmax(np.where(self.valid, one, -1))] for one in bumps]
        return [int(ids[k]) if k >= 0 else None for k in peaks]

    def record(self, identity):
        (at,) = np.flatnonzero(
            (self.tracker.contacts["id"] == identity)
            & (self.tracker.contacts["track"] != TrackState.FREE)
        )
        return self.tracker.contacts[at]


@pytest.fixture
def watch():
    return Watch()


def test_a_contact_keeps_its_identity_wherever_it_goes(watch):
    for x in np.linspace(2.0, 21.0, 200):
        assert watch.see(bump(x, 3.5)) == [1]
    record = watch.record(1)
    assert record["cycles"] == 200
    assert record["seen_ns"] - record["born_ns"] == 199 * CYCLE_NS


def test_a_contact_that_jumps_to_the_next_unit_is_the_same(watch):
    for x in range(2, 20):
        assert watch.see(bump(x, 4.0, radius=0.8)) == [1]


def test_two_contacts_that_pass_each_other_apart_keep_their_identities(watch):
    for step in np.linspace(0.0, 19.0, 150):
        assert watch.see(bump(2 + step, 1.0, radius=1.5), bump(21 - step, 6.0, radius=1.5)) == [
            1,
            2,
        ]


def test_parted_again_both_are_themselves(watch):
    assert watch.see(bump(5, 4, 2.0), bump(15, 4, 4.0), cycles=100) == [1, 2]
    for x in np.linspace(5.0, 11.5, 60):
        together = watch.see(bump(x, 4, 2.0), bump(15, 4, 4.0))
    assert together == [2, 2], "the heavier speaks for both"
    assert watch.record(1)["track"] == TrackState.ABSORBED
    for x in np.linspace(11.5, 5.0, 60):
        parted = watch.see(bump(x, 4, 2.0), bump(15, 4, 4.0))
    assert parted == [1, 2]


def test_of_two_that_merged_the_one_that_stays_is_itself(watch):
    watch.see(bump(9, 4, 4.0), bump(14, 4, 2.0), cycles=100)
    events = 0
    for x in np.linspace(14.0, 12.5, 20):
        watch.see(bump(9, 4, 4.0), bump(x, 4, 2.0))
        events += bool(watch.record(1)["event"] & Event.MERGED)
    assert watch.see(bump(9, 4, 4.0), bump(12.5, 4, 2.0)) == [1, 1]
    assert events == 1
    assert watch.see(bump(12.5, 4, 2.0)) == [2]
    assert watch.record(2)["event"] & Event.RESUMED
    assert watch.tracker.contacts["id"][watch.tracker.present].tolist() == [2]


def test_of_one_that_splits_the_heavier_part_stays_itself(watch):
    assert watch.see(bump(9, 4, 4.0), bump(12, 4, 2.0), cycles=100) == [1, 1]
    assert watch.see(bump(8, 4, 4.0, 1.5), bump(13, 4, 2.0, 1.5)) == [1, 2]
    assert watch.record(1)["event"] & Event.SPLIT
    assert watch.record(2)["parent"] == 1
    assert watch.record(2)["event"] == Event.BORN


def test_a_fleeting_part_leaves_no_identity_behind(watch):
    watch.see(bump(8, 4, 4.0, 1.5), bump(13, 4, 2.0, 1.5), cycles=3)
    assert watch.see(bump(9, 4, 4.0), bump(12, 4, 2.0), cycles=3) == [1, 1]
    assert watch.see(bump(8, 4, 4.0, 1.5), bump(13, 4, 2.0, 1.5)) == [1, 3]


def test_lost_for_a_moment_a_contact_comes_back_as_itself(watch):
    assert watch.see(bump(5, 4), cycles=10) == [1]
    watch.see(cycles=10)
    assert watch.tracker.present.size == 0
    assert watch.see(bump(5.5, 4)) == [1]
    assert watch.record(1)["event"] & Event.RESUMED
    watch.see(cycles=30)
    assert watch.see(bump(5.5, 4)) == [2], "after its memory it is another one"


def test_ended_contacts_are_named_once(watch):
    watch.see(bump(5, 4), bump(15, 4), cycles=5)
    watch.see(bump(5, 4))
    assert watch.tracker.ended.tolist() == [2]
    watch.see(bump(5, 4))
    assert watch.tracker.ended.tolist() == []


def test_a_row_of_units_that_falls_silent_splits_no_contact(watch):
    watch.see(bump(10, 4, radius=3.0), cycles=50)
    watch.valid = POSITION[0] != 10 * PITCH
    assert watch.see(bump(8, 4, radius=1.5) + bump(12, 4, radius=1.5), cycles=20) == [1]
    assert watch.tracker.present.size == 1
    assert not (watch.tracker.label >= 0)[~watch.valid].any()
    watch.see(cycles=1)
    assert watch.see(bump(8, 4, radius=1.5), bump(12, 4, radius=1.5))[0] == 1
    assert watch.tracker.present.size == 2, "without load there is nothing left to bridge"


def test_beyond_the_capacity_the_lightest_are_counted_and_lose_nothing(watch):
    watch = Watch(capacity=2)
    ids = watch.see(bump(3, 3, 3.0, 1.5), bump(10, 3, 1.0, 1.5), bump(18, 3, 2.0, 1.5), cycles=5)
    assert ids == [1, None, 2]
    assert watch.tracker.untracked == 1
    touching = watch.tracker.touching_units
    assert touching == np.count_nonzero(
        (bump(3, 3, 3.0, 1.5) + bump(10, 3, 1.0, 1.5) + bump(18, 3, 2.0, 1.5)) > 3 * SIGMA
    )


@given(st.integers(0, 2**32))
def test_identities_are_unique_and_own_connected_units(seed):
    """Random pressing, silence and a full table: what must hold in every cycle."""
    rng = np.random.default_rng(seed)
    watch = Watch(capacity=3, memory_ns=2e7, settle_ns=1e7)
    tracker = watch.tracker
    for _ in range(30):
        bumps = [
            bump(rng.uniform(0, COLUMNS), rng.uniform(0, ROWS), radius=rng.uniform(0.8, 3.0))
            for _ in range(rng.integers(0, 6))
        ]
        watch.valid = rng.random(ROWS * COLUMNS) > 0.1
        watch.see(*bumps, cycles=rng.integers(1, 4))
        present = tracker.present
        ids = tracker.contacts["id"][present]
        assert (np.diff(ids) > 0).all()
        assert (tracker.contacts["track"][present] == TrackState.PRESENT).all()
        for k, record in enumerate(present):
            units = tracker.units_of(record)
            assert sorted(units) == np.flatnonzero(tracker.label == k).tolist()
            assert units.size
            assert watch.valid[units].all()
        named = tracker.contacts["id"][tracker.contacts["track"] != TrackState.FREE]
        assert np.unique(named).size == named.size


def test_machine_code_and_python_find_alike(monkeypatch):
    rng = np.random.default_rng(5)
    compiled = Watch(capacity=3, memory_ns=2e7, settle_ns=1e7)
    python = Watch(capacity=3, memory_ns=2e7, settle_ns=1e7)
    for _ in range(40):
        bumps = [
            bump(rng.uniform(0, COLUMNS), rng.uniform(0, ROWS), radius=rng.uniform(0.8, 3.0))
            for _ in range(rng.integers(0, 6))
        ]
        compiled.valid = python.valid = rng.random(ROWS * COLUMNS) > 0.1
        compiled.see(*bumps)
        with monkeypatch.context() as patch:
            interpret_contacts(patch)
            python.see(*bumps)
        assert compiled.tracker.contacts.tobytes() == python.tracker.contacts.tobytes()
        np.testing.assert_array_equal(compiled.tracker.label, python.tracker.label)


def test_options_that_make_no_sense_are_refused():
    with pytest.raises(SkinError, match="false_contacts_per_day: must leave a start of contact at"):
        tracking(false_contacts_per_day=1e9)
    with pytest.raises(SkinError, match="capacity: must be an integer from 1 to 4096; got 0"):
        tracking(capacity=0)
