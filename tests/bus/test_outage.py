"""A link that keeps frames while it is down, and delivers them at once: late, never as new."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import Assembler
from tests.bus.test_assemble import counting, run
from tests.bus.test_freerun import START
from tests.fixtures.bus import (
    PERIOD_NS,
    TWO_PARTS,
    counts_of,
    data_frames,
    join,
    make_topology,
    sync,
)
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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("outage", [5, 15, 16, 17, 40, 300])
@pytest.mark.parametrize("over", [1, 2, 3])
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
    # nothing is doubted for longer than a cycle after the last kept frame
    back = BEFORE + outage + over + 1
    assert all(shown[i].valid.all() for i in range(back, back + AFTER - over - 2))
    assert assembler.counters.late >= outage - over


def _carried(small):
    """Which channels the layout has, shape (c, 1)."""
    from topology import CHANNELS

    return np.array([small.layouts[0].carries(name) for name in CHANNELS])[:, np.newaxis]


@given(st.data())
@settings(max_examples=60)
def test_own_counts_tell_old_frames_from_new_ones_after_any_outage(data):
    bits = data.draw(st.sampled_from(["f3t-classic", "f3t-fd16"]))
    small = make_topology(counting(bits), units=2)
    outage = data.draw(st.integers(2, 40))
    over, order = data.draw(st.integers(1, 4)), data.draw(st.booleans())
    cycles = run(Assembler(small), *delivered(small, BEFORE, BEFORE + outage, over, order))
    for cycle in cycles:
        right = (cycle.counts == counts_of(small, cycle.number)) | ~_carried(small)
        assert right.all(axis=0)[cycle.valid].all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_that_returns_is_shown_again_after_a_cycle(kind):
    """Off for a while, with nothing kept: one cycle is waited for, and no more."""
    small, gone = make_topology(KINDS[kind], units=4), 40
    each = delivered(small, BEFORE, BEFORE + gone, 1)
    each[BEFORE + gone] = join(
        sync(BEFORE + gone, stamp_ns=(BEFORE + gone) * PERIOD_NS),
        data_frames(small, BEFORE + gone, BEFORE + gone),
    )
    shown = {cycle.number: cycle for cycle in run(Assembler(small), *each)}
    later = range(BEFORE + gone + 1, BEFORE + gone + AFTER)
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
    assert all(valid.all() for valid, _, _ in shown[back + 2 :])
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
