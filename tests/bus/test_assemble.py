"""Frames → cycles, with SYNC: every unit's numbers are its own, of the right cycle, or flagged."""

from dataclasses import asdict, fields, replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import Assembler, FrameCounters, Status
from bus.assemble.memory import Outcome
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_FDF
from tests.fixtures.bus import (
    PERIOD_NS,
    SYNC_ID,
    TWO_PARTS,
    counts_of,
    data_frames,
    frame,
    join,
    make_topology,
    name_of,
    sync,
    with_data_ids,
)
from topology import CHANNELS, Signal, WireLayout
from topology import LAYOUTS as BUILT_IN

LAYOUTS = ("f3t-classic", "f3t-fd16", "f3t-fd64", TWO_PARTS)


def snapshot(cycle):
    """Copy what a cycle shows, for its arrays do not outlive the next one."""
    return replace(
        cycle,
        **{
            field.name: getattr(cycle, field.name).copy()
            for field in fields(cycle)
            if isinstance(getattr(cycle, field.name), np.ndarray)
        },
    )


def run(assembler, *parts, end=True):
    """Feed records and return copies of all cycles."""
    cycles = [snapshot(cycle) for cycle in assembler.feed(join(*parts))]
    last = assembler.flush() if end else None
    return cycles + ([snapshot(last)] if last else [])


def cycle_frames(small, number, stamp_ns=None):
    """SYNC and all data frames of one cycle."""
    stamp_ns = number * PERIOD_NS if stamp_ns is None else stamp_ns
    syncs = [sync(number, bus=b, stamp_ns=stamp_ns) for b in range(len(small.buses))]
    return join(*syncs, data_frames(small, number, number, stamp_ns=stamp_ns + 1000))


def counting(layout):
    """The same layout with sequence numbers that count the sender's own frames."""
    return msgspec.structs.replace(
        BUILT_IN[layout] if isinstance(layout, str) else layout, sequence="own"
    )


def flags(cycle):
    """Status of every unit, as flags."""
    return [Status(int(word)) for word in cycle.status]


def total(counters):
    """Received frames, by the sum of all kinds."""
    counts = asdict(counters)
    del counts["lost"], counts["controller_overflow"]
    return sum(counts.values())


# -- the undisturbed bus ---------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS, ids=name_of)
@pytest.mark.parametrize("buses", [1, 3])
def test_whole_cycles_are_shown_as_sent(layout, buses):
    small = make_topology(layout, units=12, buses=buses)
    assembler = Assembler(small)
    cycles = run(assembler, *(cycle_frames(small, i) for i in range(250, 262)), end=False)
    assert [cycle.number for cycle in cycles] == list(range(250, 262))
    assert {cycle.closed_by for cycle in cycles} == {"complete"}
    carried = [small.layouts[0].carries(name) for name in CHANNELS]
    for cycle in cycles:
        np.testing.assert_array_equal(
            cycle.counts[carried], counts_of(small, cycle.number)[carried]
        )
        assert (cycle.valid.all(), cycle.status.any(), cycle.age.any()) == (True, False, False)
        bits = small.layouts[0].frame_field("sequence").length
        assert set(cycle.sequence) == {cycle.number % 2**bits}
        assert cycle.stamp_ns == cycle.number * PERIOD_NS
    assert not assembler.pending
    assert assembler.flush() is None
    frames = len(small.frames)
    assert assembler.counters == FrameCounters(data=12 * frames, sync=12 * buses)


@pytest.mark.parametrize("ids", [[0x80000100, 0x100, 0x9FFFFFFF, 0x7FF], [0, 1, 2, 0x9ABCDEF0]])
def test_a_unit_is_known_by_bus_and_whole_identifier(ids):
    small = make_topology("f3t-fd16", units=4)
    # Ordered by (bus, id), as a topology promises.
    small = with_data_ids(small, sorted(ids))
    assembler = Assembler(small)
    (cycle,) = run(assembler, cycle_frames(small, 1), end=False)
    np.testing.assert_array_equal(cycle.counts, counts_of(small, 1))
    for other in ids:
        list(assembler.feed(frame(other ^ CAN_EFF, bytes(16), flags=FD_FDF)))
    foreign = sum((other ^ CAN_EFF) not in ids for other in ids)
    assert assembler.counters.foreign == foreign


def test_disabled_units_are_flagged_and_not_waited_for():
    small = make_topology(units=3, enabled=[True, False, True])
    frames = cycle_frames(small, 7)
    with_all, without = Assembler(small), Assembler(small)
    (cycle,) = run(with_all, frames, end=False)
    assert flags(cycle) == [Status.OK, Status.DISABLED, Status.OK]
    assert cycle.valid.tolist() == [True, False, True]
    (cycle,) = run(without, frames[[0, 1, 3]], end=False)
    assert cycle.closed_by == "complete"
    assert flags(cycle)[1] == Status.DISABLED | Status.NEVER


@pytest.mark.parametrize("layout", ["f3t-fd16", "f3t-classic"])
def test_a_self_reported_fault_makes_its_unit_invalid(layout):
    small = make_topology(layout, units=3)
    codes = np.array([0, 1, 0], np.uint8)
    frames = join(sync(0), data_frames(small, 0, 0, fault_code=codes))
    assembler = Assembler(small)
    (cycle,) = run(assembler, frames, end=False)
    assert flags(cycle) == [Status.OK, Status.FAULT, Status.OK]
    assert cycle.fault_code.tolist() == [0, 1, 0]
    (cycle,) = run(assembler, cycle_frames(small, 1), end=False)
    assert cycle.valid.all()


def test_a_fault_of_the_board_is_one_of_each_of_its_units():
    layout = WireLayout(
        name="board", size=4, units=2,
        signals=(
            Signal(name="status", start=0, length=8),
            *(Signal(name="gel", start=8 + 8 * i, length=6, slot=i) for i in range(2)),
            Signal(name="unit_status", start=24, length=8, slot=1),
        ),
    )  # fmt: skip
    small = make_topology(layout, units=4)
    frames = join(
        sync(0), frame(0x100, [9, 1, 2, 5]), frame(0x101, [0, 3, 4, 0]),
        sync(1), frame(0x100, [0, 1, 2, 0]), frame(0x101, [7, 3, 4, 0]),
    )  # fmt: skip
    first, second = run(Assembler(small), frames)
    assert first.fault_code.tolist() == [9, 5, 0, 0]
    assert second.fault_code.tolist() == [0, 0, 7, 7]
    assert first.counts[0].tolist() == [1, 2, 3, 4]


# -- silence ---------------------------------------------------------------------------------------


def test_a_silent_unit_ages_keeps_its_value_and_turns_stale():
    small = make_topology(units=3)
    heard = [True, True, True, False, False, False, False, False, False, True, True]
    parts = [cycle_frames(small, i)[[0, 1, 3] if not h else [0, 1, 2, 3]]
             for i, h in enumerate(heard)]  # fmt: skip
    cycles = run(Assembler(small, stale_cycles=4), *parts)
    late, stale = Status.LATE, Status.LATE | Status.STALE
    assert [flags(c)[1] for c in cycles] == [0, 0, 0, late, late, late, stale, stale, stale, 0, 0]
    assert [int(c.age[1]) for c in cycles] == [0, 0, 0, 1, 2, 3, 4, 5, 6, 0, 0]
    for cycle in cycles:
        shown = cycle.number if heard[cycle.number] else 2
        np.testing.assert_array_equal(cycle.counts[:5, 1], counts_of(small, shown)[:5, 1])
        np.testing.assert_array_equal(cycle.valid, [True, heard[cycle.number], True])


def test_cycles_wait_for_units_that_may_come_and_not_for_the_dead():
    small = make_topology(units=3)
    dead = run(Assembler(small), *(cycle_frames(small, i)[[0, 1, 2]] for i in range(8)))
    assert [c.closed_by for c in dead] == ["sync"] * 5 + ["complete"] * 3


def test_a_unit_that_comes_back_behind_all_others_is_waited_for_again():
    small = make_topology(units=3)
    assembler = Assembler(small)
    run(assembler, *(cycle_frames(small, i)[:3] for i in range(8)), end=False)
    cycles = run(assembler, *(cycle_frames(small, i) for i in range(8, 11)), end=False)
    assert [c.closed_by for c in cycles] == ["complete"] * 3
    assert [bool(c.valid[2]) for c in cycles] == [False, True, True]
    assert assembler.counters.late == 1


def test_the_deadline_counts_from_the_opening_of_the_cycle():
    small = make_topology(units=2)
    now = [1_000_000]
    assembler = Assembler(small, clock=lambda: now[0])
    assert assembler.deadline_ns == round(0.9 * PERIOD_NS)
    assert assembler.expire(10**12) is None
    run(assembler, cycle_frames(small, 3)[:2], end=False)
    assert (assembler.pending, assembler.waiting) == (True, 1)
    assert assembler.expire(now[0] + assembler.deadline_ns - 1) is None
    cycle = assembler.expire(now[0] + assembler.deadline_ns)
    assert (cycle.number, cycle.closed_by) == (3, "deadline")
    assert flags(cycle) == [Status.OK, Status.NEVER]
    assert assembler.expire(10**12) is None
    run(assembler, cycle_frames(small, 3)[2:], end=False)
    assert assembler.counters.late == 1


def test_a_silent_host_is_no_reason_to_show_old_numbers():
    small = make_topology(units=2)
    now = [0]
    assembler = Assembler(small, stale_cycles=3, clock=lambda: now[0])
    run(assembler, cycle_frames(small, 9), end=False)
    assert assembler.silence(4 * PERIOD_NS - 1) is None
    cycle = assembler.silence(4 * PERIOD_NS)
    assert (cycle.number, cycle.closed_by, cycle.valid.any()) == (10, "deadline", False)
    assert cycle.stamp_ns == 10 * PERIOD_NS
    assert assembler.silence(4 * PERIOD_NS) is None
    cycle = assembler.silence(7 * PERIOD_NS)
    assert (cycle.number, cycle.age.tolist()) == (13, [4, 4])
    assert flags(cycle) == [Status.LATE | Status.STALE] * 2
    # The host comes back: numbers go up, and agree with its counter.
    (cycle,) = run(assembler, cycle_frames(small, 12), end=False)
    assert (cycle.number, cycle.valid.all()) == (256 + 12, True)


# -- SYNC ------------------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 255), min_size=1, max_size=40), st.integers(0, 255))
def test_numbers_agree_with_the_counter_and_never_step_back(steps, first):
    small = make_topology(units=1)
    counters = np.cumsum([first, *steps])
    cycles = run(Assembler(small), *(sync(int(c)) for c in counters))
    assert [cycle.number for cycle in cycles] == counters.tolist()


@given(st.lists(st.tuples(st.integers(0, 1), st.booleans()), max_size=60))
def test_a_sync_on_several_buses_is_one_cycle(order):
    small = make_topology(units=2, buses=2)
    sent, parts = [0, 0], []
    for b, is_lost in order:
        if sent[b] - sent[1 - b] < 100:  # buses drift apart, but not by half a turn
            if not is_lost or sent[b] == 0:
                parts.append(sync(sent[b], bus=b))
            sent[b] += 1
    numbers = [cycle.number for cycle in run(Assembler(small), *parts)]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == 0 or numbers[-1] < max(sent)


def test_a_bus_that_was_silent_for_long_falls_in_again():
    small = make_topology(units=2, buses=2)
    assembler = Assembler(small)
    run(assembler, cycle_frames(small, 0), end=False)
    alone = [join(sync(i), data_frames(small, i, i, bus=0)) for i in range(1, 1000)]
    run(assembler, *alone, end=False)
    cycles = run(assembler, *(cycle_frames(small, i) for i in range(1000, 1005)), end=False)
    assert [cycle.number for cycle in cycles] == [1000, 1001, 1002, 1003, 1004]
    assert cycles[-2].valid.all()
    assert cycles[-1].valid.all()
    # It is in step again: it leads as well as the other one.
    alone = [join(sync(i, bus=1), data_frames(small, i, i, bus=1)) for i in range(1005, 1008)]
    cycles = run(assembler, *alone)
    assert [cycle.number for cycle in cycles] == [1005, 1006, 1007]


def test_a_sync_without_a_counter_counts_on():
    small = make_topology(counting("f3t-classic"), units=1)
    assembler = Assembler(small)
    parts = [join(frame(SYNC_ID), data_frames(small, i, 5 + i)) for i in range(3)]
    cycles = run(assembler, *parts)
    assert [cycle.number for cycle in cycles] == [0, 1, 2]
    assert cycles[-1].valid.all()


def test_the_hosts_own_sync_opens_a_cycle_in_its_log_and_none_twice_on_its_bus():
    small = make_topology(units=2)
    frames = [cycle_frames(small, i) for i in range(3)]
    for records in frames:
        records["origin"][0] = ECHO
    assembler = Assembler(small)
    cycles = run(assembler, *(join(r[:1], r) for r in frames), end=False)
    assert [cycle.number for cycle in cycles] == [0, 1, 2]
    assert all(cycle.valid.all() for cycle in cycles)
    assert assembler.counters == FrameCounters(data=6, sync=6)


def test_a_sync_of_another_size_is_none():
    small = make_topology(units=1)
    assembler = Assembler(small)
    odd = [frame(SYNC_ID, bytes(n)) for n in range(2, 65)] + [frame(SYNC_ID, b"\0", flags=FD_FDF)]
    assert run(assembler, *odd) == []
    assert assembler.counters == FrameCounters(short=64)


def test_a_repeated_sync_is_none_and_a_stuck_counter_still_makes_cycles():
    small = make_topology(units=1)
    quick = run(Assembler(small), *(sync(7, stamp_ns=i) for i in range(5)))
    assert [cycle.number for cycle in quick] == [7]
    slow = [join(sync(7, stamp_ns=i * PERIOD_NS), data_frames(small, i, 7)) for i in range(4)]
    cycles = run(Assembler(small), *slow, end=False)
    assert [cycle.number for cycle in cycles] == [7, 7 + 256, 7 + 512, 7 + 768]
    assert all(cycle.valid.all() for cycle in cycles)


def test_a_restart_of_the_host_is_not_counted_as_loss():
    small = make_topology("f3t-fd16", units=2)
    assembler = Assembler(small)
    numbers = [*range(190, 201), *range(5)]
    cycles = run(assembler, *(cycle_frames(small, i) for i in numbers), end=False)
    assert [cycle.number % 256 for cycle in cycles] == numbers
    assert all(cycle.valid.all() for cycle in cycles)
    assert assembler.counters.lost == 0


# -- sequence numbers ------------------------------------------------------------------------------


def test_a_frame_that_came_and_could_not_be_used_is_not_lost_as_well():
    small = make_topology("f3t-fd16", units=1)
    parts = [cycle_frames(small, i) for i in range(6)]
    parts[2]["data"][1, 9] ^= 1
    parts[4]["length"][1] = 8
    assembler = Assembler(small)
    run(assembler, *parts)
    counters = assembler.counters
    assert (counters.crc, counters.short, counters.lost, counters.data) == (1, 1, 0, 4)


def test_own_counts_count_gaps_repeats_and_restarts():
    small = make_topology(counting("f3t-fd16"), units=1)
    assembler = Assembler(small)
    counts = [250, 251, 254, 255, 0, 0, 3, 0, 1, 2]
    parts = [join(sync(i), data_frames(small, i, c)) for i, c in enumerate(counts)]
    cycles = run(assembler, *parts)
    #              250   251   254   255   0     0      3     0      1     2
    assert [bool(c.valid[0]) for c in cycles] == [
        True, True, True, True, True, False, True, False, True, True,
    ]  # fmt: skip
    counters = assembler.counters
    assert (counters.lost, counters.repeated, counters.late) == (4, 1, 1)


def test_units_that_count_for_themselves_belong_to_the_cycle_they_arrive_in():
    small = make_topology(counting("f3t-classic"), units=2)
    assembler = Assembler(small)
    frames = [data_frames(small, i, 11 + i) for i in range(3)]
    early = run(assembler, frames[0], sync(0), frames[1], frames[2], end=False)
    assert [c.number for c in early] == [0]
    np.testing.assert_array_equal(early[0].counts[:5], counts_of(small, 1)[:5])
    assert assembler.counters.late == 4


def test_frames_without_sequence_numbers_belong_to_the_cycle_they_arrive_in():
    layout = WireLayout(name="bare", size=2, signals=(Signal(name="gel", start=0, length=12),))
    small = make_topology(layout, units=2)
    assembler = Assembler(small)
    cycles = run(
        assembler, frame(0x100, b"\x01\0"), sync(0), frame(0x100, b"\x02\0"),
        frame(0x100, b"\x03\0"), frame(0x101, b"\x04\0"), frame(0x100, b"\x05\0"), end=False,
    )  # fmt: skip
    assert cycles[0].counts[0].tolist() == [2, 4]
    counters = assembler.counters
    assert (counters.data, counters.late, counters.repeated) == (2, 2, 1)


# -- two senders -----------------------------------------------------------------------------------


def test_two_senders_with_one_identifier_are_found_and_forgiven():
    small = make_topology("f3t-fd16", units=2)
    assembler = Assembler(small)

    def with_twin(i):
        return join(cycle_frames(small, i)[:2], data_frames(small, i + 50, i)[:1],
                    cycle_frames(small, i)[2:])  # fmt: skip

    cycles = run(assembler, *(cycle_frames(small, i) for i in range(3)), end=False)
    cycles += run(assembler, *(with_twin(i) for i in range(3, 13)), end=False)
    seen = [bool(flags(c)[0] & Status.DUPLICATE) for c in cycles]
    assert not any(seen[:4])
    assert all(seen[7:])
    assert not any(c.valid[0] for c in cycles[7:])
    assert all(c.valid[1] for c in cycles)
    for cycle in cycles:  # the first one holds
        np.testing.assert_array_equal(cycle.counts[:, 0], counts_of(small, cycle.number)[:, 0])
    after = run(assembler, *(cycle_frames(small, i) for i in range(13, 113)), end=False)
    assert after[10].status[0] == Status.DUPLICATE
    assert after[-1].valid.all()
    assert assembler.counters.repeated == 10


def test_the_same_frame_twice_is_no_second_sender():
    small = make_topology("f3t-fd16", units=2)
    parts = [join(c := cycle_frames(small, i), c[1:], c[2:]) for i in range(30)]
    assembler = Assembler(small)
    cycles = run(assembler, *parts)
    assert all(cycle.valid.all() for cycle in cycles)
    assert assembler.counters.repeated == 30 * 3


@pytest.mark.parametrize("offset", [1, 7, 60, 128, 200])
def test_two_interleaved_counts_are_two_senders(offset):
    small = make_topology("f3t-fd16", units=1, sync_id=None)
    parts = []
    for i in range(80):
        step, twin = divmod(i, 2)
        parts.append(
            data_frames(small, step + 30 * twin, step + offset * twin, stamp_ns=i * PERIOD_NS // 2)
        )
    assembler = Assembler(small)
    cycles = run(assembler, *parts)
    assert flags(cycles[-1])[0] & Status.DUPLICATE
    # Once they are found, the gaps between their counts are no loss.
    assert assembler.counters.lost < 10 * offset


# -- frozen ----------------------------------------------------------------------------------------


def test_counts_that_stay_bit_identical_are_frozen_until_they_move():
    small = make_topology(units=2, frozen_cycles=4)
    moving = [data_frames(small, i, i)[:1] for i in range(12)]
    steady = [data_frames(small, max(i, 8), i)[1:] for i in range(12)]
    cycles = run(Assembler(small), *(join(sync(i), moving[i], steady[i]) for i in range(12)))
    frozen = [bool(flags(c)[1] & Status.FROZEN) for c in cycles]
    assert frozen == [False] * 3 + [True] * 6 + [False] * 3
    assert all(c.valid[0] for c in cycles)


# -- frames that must not become numbers -----------------------------------------------------------


def broken(record, **changes):
    """Return a record with other fields."""
    changed = record.copy()
    for name, value in changes.items():
        changed[name] = value
    return changed


def corrupted(record, bit):
    """Return a record with one bit of its payload turned over."""
    changed = record.copy()
    changed["data"][0, bit // 8] ^= 1 << bit % 8
    return changed


HOSTILE = {
    "error": lambda d, x: broken(d, id=CAN_ERR | int(d["id"][0])),
    "remote": lambda d, x: broken(d, id=CAN_RTR | int(d["id"][0])),
    "echo": lambda d, x: broken(d, origin=ECHO),
    "short": lambda d, x: broken(d, length=x % 16),
    "foreign": lambda d, x: broken(d, id=0x600 + x % 64),
    "crc": lambda d, x: corrupted(d, x % 128),
    "heartbeat": lambda d, x: broken(d, id=0x700 + x % 224),
    "configuration": lambda d, x: broken(d, id=0x7E0),
}


@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(HOSTILE)), st.integers(0, 999), st.integers(0, 30)),
        max_size=30,
    )
)
def test_hostile_frames_change_no_number_and_are_counted_by_kind(hostile):
    small = make_topology("f3t-fd16", units=4)
    clean = join(*(cycle_frames(small, i) for i in range(6)))
    expected = run(Assembler(small), clean)
    other = data_frames(small, 77, 3)
    parts = [clean[i : i + 1] for i in range(clean.size)]
    for kind, x, place in hostile:
        parts[place % len(parts)] = join(
            HOSTILE[kind](other[[x % 4]], x), parts[place % len(parts)]
        )
    assembler = Assembler(small)
    cycles = run(assembler, *parts)
    for got, want in zip(cycles, expected, strict=True):
        for field in ("number", "stamp_ns", "closed_by"):
            assert getattr(got, field) == getattr(want, field)
        for field in ("counts", "valid", "status", "age", "sequence"):
            np.testing.assert_array_equal(getattr(got, field), getattr(want, field))
    kinds = [kind for kind, _, _ in hostile]
    for kind in HOSTILE:
        assert getattr(assembler.counters, kind) == kinds.count(kind)
    assert assembler.counters.lost == 0


@pytest.mark.parametrize(
    ("layout", "changes"),
    [
        ("f3t-classic", {"flags": FD_FDF}),
        ("f3t-fd16", {"flags": 0}),
        ("f3t-classic", {"length": 7}),
        ("f3t-fd64", {"length": 48}),
        ("f3t-fd64", {"length": 255}),
    ],
)
def test_a_frame_of_another_kind_or_length_is_short(layout, changes):
    small = make_topology(layout, units=5)
    assembler = Assembler(small)
    run(assembler, sync(0), broken(data_frames(small, 0, 0), **changes))
    assert assembler.counters.short == len(small.frames)
    assert assembler.counters.data == 0


def test_a_full_controller_is_counted_apart():
    small = make_topology(units=1)
    assembler = Assembler(small)
    run(
        assembler,
        frame(CAN_ERR | 0x004, [0, 0x01, 0, 0, 0, 0, 0, 0]),
        frame(CAN_ERR | 0x204, [0, 0x05, 0, 0, 0, 0, 100, 0]),
        frame(CAN_ERR | 0x004, [0, 0x04, 0, 0, 0, 0, 0, 0]),
        frame(CAN_ERR | 0x004, [0]),
        frame(CAN_ERR | 0x040, [0, 0x01, 0, 0, 0, 0, 0, 0]),
    )
    assert assembler.counters == FrameCounters(error=5, controller_overflow=2)


def test_bytes_past_the_length_are_not_read():
    small = make_topology("f3t-fd16", units=2)
    assembler, parts = Assembler(small), []
    for i in range(20):
        frames = cycle_frames(small, i)
        stale = frames.copy()
        stale["data"][:, 16:] = 0xA5
        parts.append(join(frames[:2], stale[1:], stale[1:]))
    for cycle in run(assembler, *parts):
        np.testing.assert_array_equal(cycle.counts, counts_of(small, cycle.number))
        assert cycle.valid.all()  # and no twin is suspected behind the repeats
    assert assembler.counters.repeated == 20 * 3


# -- layouts of several frames ---------------------------------------------------------------------


def test_a_set_with_a_missing_part_is_torn_and_keeps_its_last_whole_value():
    small = make_topology(TWO_PARTS, units=4)
    assembler = Assembler(small)
    torn = cycle_frames(small, 1)[[0, 2, 3, 4]]
    cycles = run(assembler, cycle_frames(small, 0), torn, cycle_frames(small, 2))
    assert flags(cycles[1]) == [Status.TORN | Status.LATE] * 2 + [Status.OK] * 2
    np.testing.assert_array_equal(cycles[1].counts[:2, :2], counts_of(small, 0)[:2, :2])
    assert flags(cycles[2]) == [Status.OK] * 4
    counters = assembler.counters
    assert (counters.torn, counters.data, counters.lost) == (1, 10, 1)
    assert assembler.by_frame("torn").tolist() == [0, 1, 0, 0]


@given(st.lists(st.integers(0, 15), max_size=40), st.booleans())
def test_no_unit_ever_shows_parts_of_different_cycles(losses, has_sync):
    small = make_topology(TWO_PARTS, units=4, sync_id=SYNC_ID if has_sync else None)
    parts = []
    for i, lost in enumerate(losses):
        frames = data_frames(small, i, i, stamp_ns=(i + 1) * PERIOD_NS)
        keep = [k for k in range(4) if not lost >> k & 1]
        parts += [sync(i, stamp_ns=(i + 1) * PERIOD_NS)] * has_sync + [frames[keep]]
    whole = {tuple(counts_of(small, i)[:2, u]) for i in range(len(losses)) for u in range(4)}
    for cycle in run(Assembler(small), *parts):
        for u in range(4):
            assert cycle.age[u] < 0 or tuple(cycle.counts[:2, u]) in whole


# -- wrong use -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stale_cycles": 0}, "stale_cycles: must be at least 1; got 0"),
        ({"deadline_s": 0.0}, "deadline_s: must be above 0 s and finite; got 0.0"),
        ({"deadline_s": float("nan")}, "deadline_s: must be above 0 s and finite; got nan"),
    ],
)
def test_options_that_cannot_be_are_refused(options, message):
    with pytest.raises(ValueError, match=message.replace(".", r"\.")):
        Assembler(make_topology(units=1), **options)


def test_anything_but_frames_is_refused():
    with pytest.raises(ValueError, match=r"frames: must be FRAME_DTYPE of shape \(m,\); got int64"):
        list(Assembler(make_topology(units=1)).feed(np.zeros(3, int)))


def test_the_counters_of_kernels_and_cycles_are_in_one_order():
    names = [field.name for field in fields(FrameCounters)]
    assert [outcome.name.lower() for outcome in Outcome] == names
    assert list(Outcome) == list(range(15))
