"""FrameBatch: a buffer of frames that neither grows nor forgets."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import FRAME_DTYPE, FrameBatch
from tests.fixtures.bus import frame


def test_a_record_holds_the_kernels_canfd_frame():
    offsets = {name: FRAME_DTYPE.fields[name][1] for name in FRAME_DTYPE.names}
    base = offsets.pop("id")
    assert offsets.pop("stamp_ns") == 0
    # linux/can.h: can_id u32, len u8, flags u8, res0 u8, res1 u8, data 64.
    assert {name: place - base for name, place in offsets.items()} == {
        "length": 4, "flags": 5, "origin": 6, "bus": 7, "data": 8,
    }  # fmt: skip
    assert FRAME_DTYPE.itemsize - base == 72


def test_what_is_appended_is_there():
    batch = FrameBatch(2)
    batch.append(0x123, b"abc", stamp_ns=-7, flags=5, origin=1, bus=3)
    record = batch.frames[0]
    assert [record[name] for name in FRAME_DTYPE.names[:-1]] == [-7, 0x123, 3, 5, 1, 3]
    assert record["data"][:3].tobytes() == b"abc"
    assert (len(batch), batch.room, batch.capacity) == (1, 1, 2)
    batch.clear()
    assert (batch.count, batch.frames.size) == (0, 0)


def test_a_full_batch_and_too_many_bytes_are_refused():
    batch = FrameBatch(1)
    with pytest.raises(ValueError, match="data: must be at most 64 bytes; got 65"):
        batch.append(1, bytes(65))
    batch.append(1, bytes(64))
    with pytest.raises(IndexError, match=r"batch is full \(1 frames\)"):
        batch.append(2, b"")
    assert batch.frames["id"].tolist() == [1]


@given(st.integers(0, 5), st.lists(st.integers(0, 5), max_size=5))
def test_extend_takes_what_fits(capacity, sizes):
    batch, sent = FrameBatch(capacity), 0
    for size in sizes:
        room = batch.room
        assert batch.extend(np.repeat(frame(sent), size)) == min(room, size)
        sent += 1
    assert batch.count == min(capacity, sum(sizes))


@given(st.lists(st.lists(st.integers(-100, 100), max_size=8), max_size=4), st.booleans())
def test_merging_keeps_the_order_of_each_bus_and_orders_the_buses_by_time(stamps, are_sorted):
    batch = FrameBatch(64)
    for bus, mine in enumerate(stamps):
        for i, stamp in enumerate(sorted(mine) if are_sorted else mine):
            batch.append(i, b"", stamp_ns=stamp, bus=bus)
    before = batch.frames.copy()
    batch.merge()
    for bus in range(len(stamps)):
        np.testing.assert_array_equal(
            batch.frames[batch.frames["bus"] == bus], before[before["bus"] == bus]
        )
    if are_sorted:
        assert (np.diff(batch.frames["stamp_ns"]) >= 0).all()
