"""Laws of the assembler, over any frames."""

from dataclasses import asdict, fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import INVALID, Assembler, Status
from bus.assemble import cycles, feed
from tests.bus.test_assemble import counting, cycle_frames, run, total
from tests.fixtures.bus import PERIOD_NS, SYNC_ID, TWO_PARTS, frame, join, make_topology, name_of

RECORDS = st.tuples(
    st.sampled_from([0x100, 0x101, 0x102, 0x103, SYNC_ID, 0x701, 0x80000100, None]),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 6, 8, 16, 64, None]),
    st.integers(0, 255),
    st.sampled_from([0, 0, 0, 4, 5, 255]),
    st.sampled_from([0, 0, 0, 1, 128]),
    st.sampled_from([0, 0, 0, 1, 255]),
    st.one_of(st.integers(0, 50 * PERIOD_NS), st.integers(-(2**63), 2**63 - 1)),
    st.binary(min_size=3, max_size=3),
)


def records_of(drawn):
    """Make records, however absurd."""
    made = join(*(frame(0) for _ in drawn))
    for record, (can_id, any_id, length, any_length, flag, origin, bus, stamp, data) in zip(
        made, drawn, strict=True
    ):
        record["id"] = any_id if can_id is None else can_id
        record["length"] = any_length if length is None else length
        record["flags"], record["origin"], record["bus"] = flag, origin, bus
        record["stamp_ns"] = stamp
        record["data"] = np.resize(np.frombuffer(data, np.uint8), 64)
    return made


@pytest.mark.parametrize("layout", ["f3t-classic", "f3t-fd16", TWO_PARTS], ids=name_of)
@pytest.mark.parametrize("sync_id", [SYNC_ID, None])
@pytest.mark.parametrize("sequence", ["sync", "own"])
@given(drawn=st.lists(RECORDS, max_size=60))
def test_every_frame_is_counted_exactly_once(layout, sync_id, sequence, drawn):
    layout = layout if sequence == "sync" else counting(layout)
    small = make_topology(layout, units=4, sync_id=sync_id)
    assembler = Assembler(small)
    records = records_of(drawn)
    ages = np.full(4, -1)
    for cycle in run(assembler, records):
        assert total(cycle.counters) <= records.size
        np.testing.assert_array_equal(cycle.valid, (cycle.status & int(INVALID)) == 0)
        np.testing.assert_array_equal(cycle.age < 0, cycle.status & int(Status.NEVER) != 0)
        assert not cycle.counts[:, cycle.age < 0].any()
        assert (ages[cycle.age < 0] < 0).all()
        ages = cycle.age
    assert total(assembler.counters) == records.size
    assert min(asdict(assembler.counters).values()) >= 0
    by_source = sum(assembler.by_frame(kind) for kind in ("data", "late", "repeated", "torn",
                                                          "short", "crc"))  # fmt: skip
    assert (by_source >= 0).all()
    assert by_source.sum() <= records.size


@pytest.mark.parametrize("sync_id", [SYNC_ID, None])
@given(drawn=st.lists(RECORDS, max_size=40), cut=st.integers(0, 40))
def test_where_a_batch_is_cut_changes_nothing(sync_id, drawn, cut):
    small = make_topology(TWO_PARTS, units=4, sync_id=sync_id)
    records = records_of(drawn)
    whole, halves = Assembler(small), Assembler(small)
    expected = run(whole, records)
    got = run(halves, records[:cut], end=False) + run(halves, records[cut:])
    for one, other in zip(got, expected, strict=True):
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


@pytest.mark.parametrize("layout", ["f3t-classic", "f3t-fd16", TWO_PARTS], ids=name_of)
@pytest.mark.parametrize("sync_id", [SYNC_ID, None])
@given(drawn=st.lists(RECORDS, max_size=40))
def test_the_kernel_and_its_python_agree(layout, sync_id, drawn):
    small = make_topology(layout, units=4, sync_id=sync_id)
    records = join(cycle_frames(small, 0), records_of(drawn), cycle_frames(small, 1))
    compiled = Assembler(small)
    run(compiled, records)
    interpreted = Assembler(small)
    interpreted._kernels = feed.feed_python, cycles.close_cycle_python
    run(interpreted, records)
    for one, other in zip(
        (*compiled._memory, *compiled._shown), (*interpreted._memory, *interpreted._shown),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_array_equal(one, other)
