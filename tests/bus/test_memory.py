"""What the in-process transport does beyond the contract."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import BusClosedError, FrameBatch, MemoryTransport
from tests.bus.transport_contract import numbered, numbers, receive
from tests.fixtures.bus import frame, join


def test_every_end_of_a_channel_hears_all_others_in_one_order():
    with (
        MemoryTransport("tree", 0) as a,
        MemoryTransport("tree", 1) as b,
        MemoryTransport("tree", 2) as c,
        MemoryTransport("elsewhere") as d,
    ):
        a.send(numbered(2))
        b.send(numbered(2, 10))
        assert numbers(receive(c, 4)) == [0, 1, 10, 11]
        assert numbers(receive(a, 2)) == [10, 11]
        assert numbers(receive(b, 2)) == [0, 1]
        assert d.receive(FrameBatch(1)) == 0


def test_a_pair_is_reached_by_no_name():
    near, far = MemoryTransport.pair()
    with near, far, MemoryTransport("") as other:
        near.send(numbered(1))
        assert other.receive(FrameBatch(1)) == 0
        assert far.receive(FrameBatch(1)) == 1


@given(st.integers(1, 7), st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=20))
def test_what_is_sent_is_received_or_counted_as_overflow(capacity, steps):
    near, far = MemoryTransport.pair(capacity=capacity)
    with near, far:
        queue, sent, overflows = [], 0, 0
        for sending, taking in steps:
            near.send(numbered(sending, sent))
            arrived = list(range(sent, sent + sending))
            sent += sending
            kept = arrived[: capacity - len(queue)]
            overflows += sending - len(kept)
            queue += kept
            batch = FrameBatch(taking)
            assert far.receive(batch) == min(taking, len(queue))
            assert numbers(batch.frames) == queue[:taking]
            del queue[:taking]
        assert far.counters.ring_overflows == overflows
        assert far.counters.received + len(queue) + overflows == near.counters.sent == sent


def test_a_stamp_is_kept_and_its_absence_is_filled():
    near, far = MemoryTransport.pair()
    with near, far:
        near.send(join(frame(1, stamp_ns=42), frame(2), frame(3, stamp_ns=-5)))
        stamps = receive(far, 3)["stamp_ns"]
        assert (stamps[0], stamps[2]) == (42, -5)
        assert stamps[1] > 1_600_000_000_000_000_000


def test_what_the_sender_does_later_changes_nothing():
    near, far = MemoryTransport.pair(index=5)
    with near, far:
        heard = []
        records = numbered(2)
        near.send(records)
        records["id"] = 0
        assert set(receive(far, 2)["id"]) == {0x123}
        far.listener = heard.append
        records = numbered(2)
        near.send(records)
        records["id"] = 0
        assert set(heard[0]["id"]) == {0x123}
        assert set(heard[0]["bus"]) == {5}


def test_a_listener_answers_before_send_returns():
    near, far = MemoryTransport.pair()
    with near, far:
        threads = []

        def answer(records):
            threads.append(threading.current_thread())
            far.send(numbered(records.size, 100))

        far.listener = answer
        near.send(numbered(3))
        batch = FrameBatch(8)
        assert near.receive(batch) == 3
        assert numbers(batch.frames) == [100, 101, 102]
        assert threads == [threading.current_thread()]
        assert far.receive(FrameBatch(1)) == 0


def test_a_closed_end_says_which():
    with MemoryTransport("palm") as named:
        pass
    near, far = MemoryTransport.pair()
    near.close()
    far.close()
    for end, words in ((named, "memory bus 'palm': closed at this end"),
                       (near, "memory bus: closed at this end")):  # fmt: skip
        with pytest.raises(BusClosedError, match=words):
            end.receive(FrameBatch(1))


def test_bytes_past_the_length_are_not_needed():
    near, far = MemoryTransport.pair()
    with near, far:
        dirty = frame(0x10, b"ab")
        dirty["data"][0, 2:] = 0xAA
        near.send(dirty)
        got = receive(far, 1)[0]
        assert got["data"][:2].tobytes() == b"ab"
        assert got["length"] == 2
