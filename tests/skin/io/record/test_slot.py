"""What is copied into a slot and handed over, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

import skin
from bus.frame import FRAME_DTYPE
from skin.contact.record import CONTACT
from skin.io.messages.writer import RecordWriter
from skin.io.record.slot import EVENTS, Event, slot_dtype
from skin.io.record.staging import FULL, NO_ROOM, STAGED, Ring, Staged, hand_over, stage
from skin.state import if_wanted
from skin.worker import RingBuffer
from topology import load

pytest.importorskip("mcap", reason="mcap is not installed")


def pressed(**options):
    """A skin, and its state in the middle of a press."""
    live = skin.open("strip", simulate="press", pace=False, **options)
    return live, next(state for state in live if np.nanmax(state.units.force[2]) > 1.0)


@pytest.mark.parametrize(
    "options", [{}, {"dtype": "float64"}, {"want": {"force"}}, {"want": {"force", "sigma"}}]
)
def test_a_state_stands_in_its_slot_as_numpy_would_copy_it(options):
    live, state = pressed(**options)
    with live:
        pipeline = live.pipeline
        slot = np.zeros(1, slot_dtype(live.topology, 16))
        RecordWriter(slot, pipeline.contacts, pipeline.assembler.totals).write(state)
        units = state.units
        assert (slot["stamp_ns"][0], slot["cycle"][0]) == (state.stamp_ns, state.cycle)
        assert slot["counters"][0].tolist() == pipeline.assembler.totals.tolist()
        for name, source, missing in (
            ("status", units, None), ("force", units, np.nan), ("force_sigma", units, np.nan),
            ("wrench", state, np.nan), ("temperature", units, np.nan), ("contact", state, -1),
            ("test_ratio", units, np.nan),
        ):  # fmt: skip
            given = if_wanted(source, {"contact": "label"}.get(name, name))
            expected = np.full_like(slot[name][0], missing if given is None else 0)
            if given is not None:
                expected[:] = given
            np.testing.assert_array_equal(slot[name][0], expected, name)
        assert slot["whole"][0] == (if_wanted(state, "whole") is True)
        contacts = if_wanted(state, "contacts") or ()
        assert slot["contact_count"][0] == len(contacts)
        records = slot["contacts"][0].view(CONTACT)[:, 0]
        assert records["id"][: len(contacts)].tolist() == [contact.id for contact in contacts]
        for record, contact in zip(records, contacts, strict=False):
            assert record.tobytes() == contact.record.tobytes()


def test_states_of_other_arrays_are_written_as_well():
    live, state = pressed()
    with live:
        pipeline = live.pipeline
        slot = np.zeros(1, slot_dtype(live.topology, 16))
        writer = RecordWriter(slot, pipeline.contacts, pipeline.assembler.totals)
        writer.write(state)
        kept = state.copy()
        kept.units.force[:] = 7.0
        kept.wrench[:] = 3.0
        kept.units.test_ratio[:] = 2.5
        assert (slot["whole"] == 1).all()
        kept.whole = False
        writer.write(kept)
        assert (slot["force"] == 7.0).all()
        assert (slot["wrench"] == 3.0).all()
        assert (slot["test_ratio"] == 2.5).all()
        assert (slot["whole"] == 0).all()


@pytest.fixture
def slot():
    """A slot of a strip, and what stages frames in it."""
    made = np.zeros(1, slot_dtype(load("strip"), 16))
    frames = made["frames"][0].view(FRAME_DTYPE).reshape(-1)
    into = (
        frames, made["events"][0], made["event_values"][0], made["event_count"],
        made["frame_count"],
    )  # fmt: skip
    return made, frames, lambda given, event=0: stage(*into, event, given)


def some_frames(count):
    """Frames of random bytes."""
    return np.random.default_rng(count).integers(0, 256, 80 * count, np.uint8).view(FRAME_DTYPE)


def test_frames_that_lie_scattered_are_gathered(slot):
    made, frames, put = slot
    given = some_frames(9)
    assert put(given[:1]) == STAGED
    assert put(given[1::2], int(Event.FED_PART)) == STAGED
    expected = np.concatenate([given[:1], given[1::2]])
    assert frames[:5].tobytes() == expected.tobytes()
    assert made["event_values"][0, :2].tolist() == [1, 4]
    assert made["events"][0, :2].tolist() == [Event.FED, Event.FED_PART]


def test_frames_beyond_the_room_of_a_slot_are_left_as_they_are(slot):
    made, frames, put = slot
    assert put(some_frames(frames.size + 1)) == NO_ROOM
    assert (made["event_count"][0], made["frame_count"][0]) == (0, 0)
    assert put(some_frames(frames.size)) == STAGED


def test_the_last_event_that_fits_is_told(slot):
    _, _, put = slot
    told = [put(some_frames(0)) for _ in range(EVENTS)]
    assert told == [STAGED] * (EVENTS - 1) + [FULL]


def test_a_slot_goes_into_the_ring_as_far_as_it_is_filled(slot):
    made, _, put = slot
    dtype = made.dtype
    ring = RingBuffer(dtype, 2)
    has_moved, is_open = np.zeros(1, bool), np.ones(1, bool)
    places = {name: dtype.fields[name][1] for name in dtype.names}
    ends = (
        Staged(
            made.view(np.uint8), made["event_count"], made["frame_count"], made["has_state"],
            made["contact_count"], made["lost_cycles"], made["lost_frames"], has_moved,
            (places["frames"], places["contacts"], places["pose"]), CONTACT.itemsize,
        ),
        Ring(
            ring.records.view(np.uint8).reshape(2, -1), *ring.counters, is_open,
        ),
    )  # fmt: skip

    def give(count, **fields):
        for name, value in fields.items():
            made[name] = value
        put(some_frames(count))
        hand_over(*ends)

    give(3, has_state=1, contact_count=2, contacts=5, pose=1.0)
    (first,) = ring.unread()
    assert first["frames"][:3].tobytes() == some_frames(3).tobytes()
    assert not first["frames"][3:].any()
    assert (first["contacts"][:2] == 5).all()
    assert not first["contacts"][2:].any()
    assert not first["pose"].any()
    has_moved[0] = True
    give(1, has_state=0)
    second = ring.unread()[1]
    assert (second["pose"] == 1.0).all()
    assert not second["contacts"].any()
    assert (second["frame_count"], second["event_count"]) == (1, 1)
    assert not has_moved[0]
    for count, lost in ((4, 4), (5, 9)):  # the ring is full
        give(count, has_state=1)
        assert (made["lost_frames"][0], ring.waiting) == (lost, 2)
    assert made["lost_cycles"][0] == 2
    ring.release(1)
    give(2, has_state=1)
    assert ring.records[0]["lost_frames"] == 9
    is_open[0] = False
    ring.release(2)
    give(2, has_state=1)
    assert (ring.waiting, made["lost_cycles"][0]) == (0, 3)
