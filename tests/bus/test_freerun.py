"""Frames → cycles, without SYNC: one cycle a period, each unit's newest value, never an old one."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import Assembler, Status
from tests.bus.test_assemble import flags, run
from tests.fixtures.bus import (
    PERIOD_NS,
    TWO_PARTS,
    counts_of,
    data_frames,
    frame,
    join,
    make_topology,
)

START = 1_700_000_000_000_000_000


def stream(small, cycles, lags):
    """Frames of unit u's cycle i at START + i periods + lags(u, i), by their stamps."""
    frames = []
    for i in range(cycles):
        for u, record in enumerate(data_frames(small, i, i)):
            record["stamp_ns"] = START + i * PERIOD_NS + lags(u, i)
            frames.append(record.reshape(1))
    return join(*sorted(frames, key=lambda record: int(record["stamp_ns"][0])))


@given(
    st.lists(st.integers(0, PERIOD_NS - 1), min_size=3, max_size=3),
    st.randoms(use_true_random=False),
)
def test_each_period_is_one_cycle_with_values_of_this_or_the_one_before(phases, random):
    small = make_topology("f3t-fd16", units=3, sync_id=None)
    jitter = PERIOD_NS // 4
    records = stream(
        small, 30, lambda u, i: phases[u] + random.randint(-jitter, jitter) + jitter
    )  # fmt: skip
    assembler = Assembler(small)
    cycles = run(assembler, records, end=False)
    assert [cycle.number for cycle in cycles] == list(range(len(cycles)))
    spanned = int(records["stamp_ns"][-1] - records["stamp_ns"][0])
    assert abs(len(cycles) - spanned / PERIOD_NS) <= 1.5
    assert {cycle.closed_by for cycle in cycles} == {"deadline"}
    for before, cycle in pairwise(cycles[1:]):
        assert cycle.valid.all()
        assert (cycle.age <= 1).all()
        # Neither a step back (an unsigned difference would be large) nor one over a frame.
        assert (cycle.sequence - before.sequence <= 2).all()
        for u in range(3):
            np.testing.assert_array_equal(
                cycle.counts[:, u], counts_of(small, int(cycle.sequence[u]))[:, u]
            )
    counters = assembler.counters
    assert (counters.data, counters.lost, counters.late) == (90, 0, 0)


def test_a_burst_that_comes_each_period_is_never_cut():
    small = make_topology("f3t-fd16", units=3, sync_id=None)
    records = stream(small, 10, lambda u, i: (u + i % 3) * PERIOD_NS // 10)
    cycles = run(Assembler(small), records)
    assert [set(cycle.sequence) for cycle in cycles] == [{1}, *({i} for i in range(2, 10))]
    assert not any(cycle.age.any() for cycle in cycles)
    assert [cycle.closed_by for cycle in cycles] == ["deadline"] * 8 + ["end"]


def test_a_unit_is_late_after_two_cycles_and_stale_in_the_end():
    small = make_topology(units=2, sync_id=None)
    records = stream(small, 10, lambda u, i: u)
    silent = (records["id"] == 0x101) & (records["stamp_ns"] > START + 3 * PERIOD_NS)
    cycles = run(Assembler(small, stale_cycles=4), records[~silent])
    late, stale = Status.LATE, Status.LATE | Status.STALE
    assert [flags(cycle)[1] for cycle in cycles] == [
        0,
        0,
        0,
        late,
        late,
        stale,
        stale,
        stale,
        stale,
    ]
    assert [int(cycle.age[1]) for cycle in cycles] == [0, 0, 1, 2, 3, 4, 5, 6, 7]
    assert all(flags(cycle)[0] == Status.OK for cycle in cycles)


def test_a_long_silence_makes_units_stale_and_is_then_passed_over():
    small = make_topology(units=2, sync_id=None)
    records = stream(small, 1000, lambda u, i: u)
    heard = (records["stamp_ns"] < START + 5 * PERIOD_NS) | (
        records["stamp_ns"] >= START + 900 * PERIOD_NS
    )
    cycles = run(Assembler(small, stale_cycles=3), records[heard])
    numbers = [cycle.number for cycle in cycles]
    assert numbers == [*range(8), *range(899, 999)]
    assert flags(cycles[7]) == [Status.LATE | Status.STALE] * 2
    # they may be old ones, which a link had kept
    assert not any(cycle.valid.any() for cycle in cycles[8:10])
    assert all(cycle.valid.all() for cycle in cycles[10:])


def test_a_frame_that_is_sent_on_and_on_is_no_sign_of_life():
    small = make_topology("f3t-fd16", units=1, sync_id=None)
    parts = [data_frames(small, 1, 7, stamp_ns=START + i * PERIOD_NS) for i in range(30)]
    assembler = Assembler(small)
    cycles = run(assembler, *parts)
    assert flags(cycles[-1]) == [Status.LATE | Status.STALE]
    counters = assembler.counters
    assert (counters.data, counters.repeated + counters.late) == (1, 29)


@pytest.mark.parametrize("step", [-3600 * 10**9, -3 * PERIOD_NS, 3600 * 10**9])
def test_a_clock_that_steps_stops_nothing(step):
    small = make_topology("f3t-fd16", units=2, sync_id=None)
    records = stream(small, 40, lambda u, i: u)
    records["stamp_ns"][40:] += step
    assembler = Assembler(small)
    cycles = run(assembler, records)
    fresh = [cycle for cycle in cycles if cycle.valid.all()]
    assert abs(len(fresh) - 39) <= 2
    assert [c.number for c in cycles] == sorted({c.number for c in cycles})
    counters = assembler.counters
    assert (counters.data + counters.late, counters.lost) == (80, 0)


# -- live: the caller's clock ----------------------------------------------------------------------


@given(st.lists(st.integers(-(2**40), 2**40), min_size=40, max_size=40))
def test_with_the_callers_clock_stamps_are_only_data(noise):
    small = make_topology("f3t-fd16", units=2, sync_id=None)
    assembler = Assembler(small)
    assert assembler.expire(0) is None
    numbers = []
    for i in range(40):
        frames = data_frames(small, i, i, stamp_ns=START + noise[i])
        assert list(assembler.feed(frames)) == []
        assert assembler.pending
        assert assembler.expire((i + 1) * PERIOD_NS - 1) is None
        cycle = assembler.expire((i + 1) * PERIOD_NS)
        numbers.append(cycle.number)
        assert cycle.valid.all()
        np.testing.assert_array_equal(cycle.counts, counts_of(small, i))
    assert numbers == list(range(40))


def test_a_caller_that_was_away_gets_one_cycle_and_the_true_number():
    small = make_topology("f3t-fd16", units=1, sync_id=None)
    assembler = Assembler(small)
    assembler.expire(0)
    run(assembler, data_frames(small, 0, 0), end=False)
    assert assembler.expire(PERIOD_NS).number == 0
    run(assembler, *(data_frames(small, i, i) for i in range(1, 8)), end=False)
    cycle = assembler.expire(8 * PERIOD_NS + 5)
    assert (cycle.number, cycle.sequence.tolist(), cycle.valid.all()) == (1, [7], True)
    assert assembler.expire(9 * PERIOD_NS - 1) is None
    cycle = assembler.expire(9 * PERIOD_NS)
    assert (cycle.number, cycle.age.tolist()) == (8, [7])


def test_a_bus_where_nobody_speaks_still_has_its_cycles():
    small = make_topology(units=2, sync_id=None)
    assembler = Assembler(small)
    assembler.expire(0)
    cycles = [assembler.expire(i * PERIOD_NS) for i in range(1, 4)]
    assert [cycle.number for cycle in cycles] == [0, 1, 2]
    assert all(flags(cycle) == [Status.NEVER] * 2 for cycle in cycles)


# -- several frames a unit, foreign buses ----------------------------------------------------------


def test_the_parts_of_a_set_may_lie_on_both_sides_of_a_tick():
    small = make_topology(TWO_PARTS, units=2, sync_id=None)
    parts = [frame(0x701, stamp_ns=START)]  # ticks lie half a period off the first frame
    for i in range(8):
        frames = data_frames(small, i, i, stamp_ns=START + i * PERIOD_NS + PERIOD_NS // 2)
        frames["stamp_ns"] += np.array([-1000, 1000])
        parts.append(frames)
    assembler = Assembler(small)
    cycles = run(assembler, *parts)
    assert [cycle.sequence.tolist() for cycle in cycles[1:]] == [[i, i] for i in range(1, 8)]
    assert all((cycle.age == 0).all() for cycle in cycles[1:])
    assert assembler.counters.torn == 0


def test_parts_of_different_sequence_are_torn():
    small = make_topology(TWO_PARTS, units=2, sync_id=None)
    first, second, third = (
        data_frames(small, i, i, stamp_ns=START + i * PERIOD_NS) for i in range(3)
    )
    second["stamp_ns"] = first["stamp_ns"]  # within the time that parts may be apart
    assembler = Assembler(small)
    (cycle, last) = run(assembler, first[:1], second[1:], third)
    assert flags(cycle) == [Status.NEVER | Status.TORN] * 2
    assert flags(last) == [Status.OK] * 2
    assert (assembler.counters.torn, assembler.counters.data) == (2, 2)


def test_parts_more_than_half_a_period_apart_are_torn():
    layout = type(TWO_PARTS)(
        name="bare", size=6, units=2, parts=2,
        signals=tuple(s for s in TWO_PARTS.signals if s.name != "sequence"),
    )  # fmt: skip
    small = make_topology(layout, units=2, sync_id=None)
    frames = [data_frames(small, i, 0, stamp_ns=START + i * PERIOD_NS) for i in range(3)]
    assembler = Assembler(small)
    cycles = run(assembler, frames[0][:1], frames[1][1:], frames[2])
    # The second part of cycle 1 waits for a first one that never comes.
    assert assembler.counters.torn == 2
    np.testing.assert_array_equal(cycles[-1].counts[:2], counts_of(small, 2)[:2])


def test_error_and_foreign_bus_frames_move_no_clock():
    small = make_topology(units=1, sync_id=None)
    assembler = Assembler(small)
    far = START + 100 * PERIOD_NS
    cycles = run(
        assembler,
        data_frames(small, 0, 0, stamp_ns=START),
        frame(0x2000_0004, bytes(8), stamp_ns=far),
        frame(0x100, bytes(8), stamp_ns=far, bus=9),
        data_frames(small, 1, 1, stamp_ns=START + PERIOD_NS),
        end=False,
    )
    assert cycles == []
