"""A link that keeps frames while it is down, and delivers them at once: late, never as new; and
SYNCs that others sent, or that were left out."""

import msgspec
import numpy as np
import pytest

from bus import Assembler, FrameCounters
from tests.bus.test_assemble import counting, cycle_frames, run
from tests.bus.test_freerun import START
from tests.fixtures.bus import (
    PERIOD_NS,
    SYNC_ID,
    TWO_PARTS,
    counts_of,
    data_frames,
    frame,
    join,
    make_topology,
    sync,
)
from tests.fixtures.cases import long_after_first
from topology import LAYOUTS

BARE = msgspec.structs.replace(
    LAYOUTS["f3t-classic"],
    name="bare",
    signals=tuple(s for s in LAYOUTS["f3t-classic"].signals if s.name != "sequence"),
)
KINDS = {
    "its SYNC's counter, 4 bits": "f3t-classic",
    "its SYNC's counter, 8 bits": "f3t-fd16",
    "its SYNC's counter, a board": "f3t-fd64",
    "its SYNC's counter, two parts": TWO_PARTS,
    "its own count, 4 bits": counting("f3t-classic"),
    "its own count, 8 bits": counting("f3t-fd16"),
    "no number": BARE,
}
BEFORE, AFTER = 12, 12


def delivered(small, first, last, over, others_first=False):
    """Streams of cycles, one a list item: the first frames of cycles `first` to `last` - 1 come in
    `over` cycles from `last` on, before their own, and before or behind those of the others."""
    kept, each = [], []
    for i in range(last + AFTER):
        stamp_ns = i * PERIOD_NS
        frames = data_frames(small, i, i, stamp_ns=stamp_ns + 1000)
        mine, others, burst = frames[:1], frames[1:], []
        if first <= i < last:
            kept.append(mine)
            mine = mine[:0]
        elif kept:
            now = -(-len(kept) // max(over - (i - last), 1))
            burst, kept = [part.copy() for part in kept[:now]], kept[now:]
            for part in burst:
                part["stamp_ns"] = stamp_ns + 500
        parts = (others, *burst, mine) if others_first else (*burst, mine, others)
        each.append(join(sync(i, stamp_ns=stamp_ns), *parts))
    return each


@long_after_first("kind", KINDS)
@long_after_first("outage", [5, 15, 16, 17, 40, 300])
@long_after_first("over", [1, 2, 3])
def test_what_a_link_has_kept_is_late_and_never_new(kind, outage, over):
    small = make_topology(KINDS[kind], units=4)
    assembler = Assembler(small)
    each = delivered(small, BEFORE, BEFORE + outage, over)
    cycles = run(assembler, *each)
    shown = {cycle.number: cycle for cycle in cycles}
    hit = small.frames.units[0][small.frames.units[0] >= 0]
    for number, cycle in shown.items():
        right = (cycle.counts == counts_of(small, number)) | ~_carried(small)
        assert right.all(axis=0)[cycle.valid].all(), (number, cycle.counts)
        assert (cycle.sampled_ns[cycle.valid] == number * PERIOD_NS).all()
    assert not any(shown[i].valid[hit].any() for i in range(BEFORE, BEFORE + outage))
    # nothing is doubted for longer than two cycles after the last kept frame
    back = BEFORE + outage + over + 2
    assert all(shown[i].valid.all() for i in range(back, BEFORE + outage + AFTER))
    assert assembler.counters.late >= outage - over


def _carried(small):
    """Which channels the layout has, shape (c, 1)."""
    from topology import CHANNELS

    return np.array([small.layouts[0].carries(name) for name in CHANNELS])[:, np.newaxis]


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_that_returns_is_shown_again_after_two_cycles(kind):
    """Off for a while, with nothing kept: two cycles are waited for, and no more."""
    small, gone = make_topology(KINDS[kind], units=4), 40
    each = delivered(small, BEFORE, BEFORE + gone, 1)
    each[BEFORE + gone] = join(
        sync(BEFORE + gone, stamp_ns=(BEFORE + gone) * PERIOD_NS),
        data_frames(small, BEFORE + gone, BEFORE + gone),
    )
    shown = {cycle.number: cycle for cycle in run(Assembler(small), *each)}
    later = range(BEFORE + gone + 2, BEFORE + gone + AFTER)
    assert all(shown[i].valid.all() and shown[i].closed_by == "complete" for i in later)


def test_a_sender_that_leaves_out_a_count_is_shown_again_after_a_cycle():
    """Its SYNC was lost on the way: its own count is behind the cycles from then on."""
    small = make_topology(counting("f3t-fd16"), units=1)
    counts = [0, 1, 2, None, 3, 4, 5, 6]
    parts = [
        join(sync(i), *([] if c is None else [data_frames(small, i, c)]))
        for i, c in enumerate(counts)
    ]
    valid = [bool(cycle.valid[0]) for cycle in run(Assembler(small), *parts)]
    assert valid == [True, True, True, False, False, True, True, True]


@pytest.mark.parametrize("outage", [6, 20, 200])
def test_without_sync_a_burst_after_an_outage_is_late(outage):
    """By the caller's clock, as in a live run."""
    now = [START]
    small = make_topology("f3t-fd16", units=3, sync_id=None)
    assembler = Assembler(small, clock=lambda: now[0])
    shown, kept = [], []
    assembler.expire(now[0])
    for i in range(BEFORE + outage + AFTER):
        frames = data_frames(small, i, i, stamp_ns=now[0])
        if BEFORE <= i < BEFORE + outage:
            kept.append(frames[:1])
            frames = frames[1:]
        elif kept:
            frames, kept = join(*kept, frames), []
        assert not list(assembler.feed(frames))
        now[0] += PERIOD_NS
        cycle = assembler.expire(now[0])
        assert cycle is not None
        shown.append((cycle.valid.copy(), cycle.sequence.copy(), cycle.sampled_ns.copy()))
    back = BEFORE + outage
    # a unit keeps its value one cycle long, since units and ticks are not in step
    assert not any(valid[0] for valid, _, _ in shown[BEFORE + 1 : back + 1])
    assert all(valid.all() for valid, _, _ in shown[back + 3 :])
    for i, (valid, sequence, sampled_ns) in enumerate(shown):
        assert (((i - sequence[valid]) & 0xFF) <= 1).all()
        assert (abs(sampled_ns[valid] - START - i * PERIOD_NS) <= PERIOD_NS).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_tells_when_it_sampled_what_it_shows(kind):
    """A unit that is missing shows its last value, of then."""
    small = make_topology(KINDS[kind], units=4)
    cycles = run(Assembler(small), *delivered(small, BEFORE, BEFORE + 4, 1))
    hit = small.frames.units[0][small.frames.units[0] >= 0]
    for cycle in cycles[BEFORE : BEFORE + 4]:
        assert (cycle.sampled_ns[hit] == (BEFORE - 1) * PERIOD_NS).all()
    assert (Assembler(small).flush() or cycles[0]).sampled_ns.dtype == np.int64


def test_units_of_each_bus_sample_at_its_own_sync():
    small = make_topology("f3t-fd16", units=4, buses=2)
    frames = data_frames(small, 0, 0, stamp_ns=9_000)
    (cycle,) = run(Assembler(small), sync(0, bus=0, stamp_ns=100), sync(0, bus=1, stamp_ns=350),
                   frames, end=False)  # fmt: skip
    assert cycle.sampled_ns.tolist() == [100, 100, 350, 350]
    never = Assembler(make_topology("f3t-fd16", units=2))
    (cycle,) = run(never, sync(0, stamp_ns=5), end=True)
    assert cycle.sampled_ns.tolist() == [-1, -1]


def validity(small, times, *, others_first=False, cycles=80):
    """Of the units of the first frame, by cycle: `times` tells how often it comes in cycle i, and
    counts go on by one a frame where they are the sender's own."""
    assembler, count, parts = Assembler(small), 0, []
    echoes = small.layouts[0].sequence == "sync"
    for i in range(cycles):
        stamp_ns = i * PERIOD_NS
        others = data_frames(small, i, i, stamp_ns=stamp_ns + 1000)[1:]
        mine = []
        for _ in range(times(i)):
            mine.append(data_frames(small, i, i if echoes else count, stamp_ns=stamp_ns + 500)[:1])
            count += 1
        parts.append(
            join(
                sync(i, stamp_ns=stamp_ns), *((others, *mine) if others_first else (*mine, others))
            )
        )
    hit = small.frames.units[0][small.frames.units[0] >= 0]
    return [bool(cycle.valid[hit].all()) for cycle in run(assembler, *parts)], assembler


ALONE = [kind for kind in KINDS if kind != "its SYNC's counter, two parts"]


ANSWERS, KNOWN = 9, 4
"""Answers of a slow board, and those of them after which its rate is known."""


def slow_board(kind, every, place_of):
    """Answers of a board that are shown whole, from 0, of one that answers each `every`-th SYNC:
    `place_of(answer, part)` is where a frame of it comes, 0 before those of the other boards, 1
    behind them, 2 behind the next SYNC."""
    small, cycles = make_topology(KINDS[kind], units=12), ANSWERS * every
    parts, echoes = small.layouts[0].parts, small.layouts[0].sequence == "sync"
    shown, held = [], []
    for i in range(cycles):
        number = i if echoes else i // every
        frames = data_frames(small, i, i, stamp_ns=i * PERIOD_NS + 1000)
        mine = data_frames(small, i, number, stamp_ns=i * PERIOD_NS + 1000)[:parts]
        places = ([], [], [])
        for part in range(parts if i % every == 0 else 0):
            places[place_of(i // every, part)].append(mine[part : part + 1])
        shown += [sync(i, stamp_ns=i * PERIOD_NS), *held, *places[0], frames[parts:], *places[1]]
        held = places[2]
    hit = small.frames.units[0][small.frames.units[0] >= 0]
    closed = run(Assembler(small), *shown)
    assert [cycle.number for cycle in closed] == list(range(cycles))
    for cycle in closed:
        right = (cycle.counts == counts_of(small, cycle.number)) | ~_carried(small)
        assert right[:, hit].all() or not cycle.valid[hit].any()
    valid = [cycle.number for cycle in closed if cycle.valid[hit].all()]
    assert all(i % every == 0 for i in valid)
    return [i // every for i in valid]


@long_after_first("kind", KINDS)
@long_after_first("every", [2, 5, 6, 10])
@long_after_first("order", ["first", "last", "one part last", "now first, now last"])
def test_a_board_that_answers_every_kth_cycle_is_waited_for_in_that_cycle(kind, every, order):
    """Its frames are those that end the cycle: closed without waiting for them, they are late."""
    place_of = {
        "first": lambda answer, part: 0,
        "last": lambda answer, part: 1,
        "one part last": lambda answer, part: part,
        "now first, now last": lambda answer, part: answer % 3 % 2,
    }[order]
    shown = slow_board(kind, every, place_of)
    assert [answer for answer in shown if answer >= KNOWN] == list(range(KNOWN, ANSWERS))


@long_after_first("kind", ["its own count, 4 bits", "its own count, 8 bits", "no number"])
@long_after_first("others_first", [True, False])
def test_a_unit_that_sends_twice_a_cycle_returns_after_an_outage(kind, others_first):
    valid, _ = validity(
        make_topology(KINDS[kind], units=12), lambda i: 0 if 20 <= i < 40 else 2,
        others_first=others_first,
    )  # fmt: skip
    assert all(valid[1:20])
    assert not any(valid[20:40])
    # a count of four bits that is late by half of its range is one that steps back
    assert all(valid[48:] if others_first else valid[43:])


@pytest.mark.parametrize("kind", ALONE)
@long_after_first("first", [1, 2])
def test_a_burst_that_a_sync_cuts_is_late_as_a_whole(kind, first):
    """The first of the kept frames come in a cycle of their own."""
    small, outage = make_topology(KINDS[kind], units=12), 41
    each = delivered(small, BEFORE, BEFORE + outage, 1)
    burst = each[BEFORE + outage]
    before = each[BEFORE + outage - 1]
    each[BEFORE + outage - 1] = join(before[:1], burst[1 : 1 + first], before[1:])
    each[BEFORE + outage] = join(burst[:1], burst[1 + first :])
    for cycle in run(Assembler(small), *each):
        right = (cycle.counts == counts_of(small, cycle.number)) | ~_carried(small)
        assert right.all(axis=0)[cycle.valid].all(), cycle.number


# -- SYNCs of others, and SYNCs that were left out -------------------------------------------------


@pytest.mark.parametrize("layout", ["f3t-classic", counting("f3t-classic")], ids=["sync", "own"])
@pytest.mark.parametrize("before", [0, 1, 300])
@pytest.mark.parametrize("buses", [1, 2])
def test_a_sync_without_a_counter_is_foreign_once_ours_have_one(layout, before, buses):
    """A CANopen master, which may have begun before this host, and sends more often."""
    small = make_topology(layout, units=4, buses=buses)
    assembler = Assembler(small)
    empty = frame(SYNC_ID, b"")
    run(assembler, *before * [empty], end=False)
    parts = []
    for i in range(57, 157):
        ours = cycle_frames(small, i)
        parts += [ours[: buses + 1], empty, ours[buses + 1 :], empty]
    cycles = run(assembler, *parts, end=False)[min(before, 1) :]
    first = before or 57
    assert [cycle.number for cycle in cycles] == list(range(first, first + 100))
    assert all(cycle.valid.all() for cycle in cycles)
    kinds = assembler.counters
    assert (kinds.foreign, kinds.sync) == (200, 100 * buses + before)
    assert (kinds.lost, kinds.late, kinds.repeated) == (0, 0, 0)


@pytest.mark.parametrize("layout", ["f3t-classic", counting("f3t-classic")], ids=["sync", "own"])
def test_what_no_sync_asked_for_is_neither_lost_nor_old(layout):
    """A host that is late leaves SYNCs out; a number that is the board's own counts answers."""
    small, number, rng = make_topology(layout, units=4), 0, np.random.default_rng(5)
    assembler, parts = Assembler(small), []
    for answer in range(300):
        number += 1 + int(rng.choice([0, 4, 5, 12, 600], p=[0.3, 0.3, 0.2, 0.15, 0.05]))
        sequence = answer if small.layouts[0].sequence == "own" else number
        parts += [sync(number), data_frames(small, answer, sequence)]
    cycles = run(assembler, *parts, end=False)
    assert all(cycle.valid.all() for cycle in cycles)
    assert assembler.counters == FrameCounters(data=4 * 300, sync=300)
