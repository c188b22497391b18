"""Kernels of the recorder: they gather frames and states in a slot, and copy it into the ring.

A cycle's share of recording is a few thousand bytes, and no arithmetic. Array by array the
interpreter needs longer for each than for the bytes; here all of them are one call, whose arrays
are plain bytes, so that one compiled function serves any skin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import from_dtype, types

from bus.compiled.intrinsics import publish
from bus.compiled.jit import compiled, jitable
from bus.frame import FRAME_DTYPE

__all__ = [
    "FULL",
    "NO_ROOM",
    "STAGED",
    "Contacts",
    "Numbers",
    "Ring",
    "Staged",
    "fill",
    "hand_over",
    "stage",
    "take",
]

FRAME_SIZE = FRAME_DTYPE.itemsize
NO_ROOM, FULL, STAGED = range(3)
"""What becomes of frames: they do not fit; they do, and no event more; they do."""


class Numbers(NamedTuple):
    """What a state is told by."""

    given: np.ndarray
    """Time stamp, number of the cycle, whether it is whole, contacts, int64, shape (4,)."""
    fields: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Of the slot: where the first three go, int64, shape (1,)."""


class Contacts(NamedTuple):
    """Where records of contacts are, and where they go."""

    present: np.ndarray
    """Which records, oldest first, int64, shape (s // 2,)."""
    records: np.ndarray
    """Bytes, shape (s, size)."""
    count: np.ndarray
    """Of the slot: how many to copy, int32, shape (1,)."""
    copies: np.ndarray
    """Of the slot, bytes, shape (k, size)."""


class Staged(NamedTuple):
    """A slot that is being filled, and what of it is."""

    bytes: np.ndarray
    """All of it, shape (size,)."""
    events: np.ndarray
    """How many, int64, shape (1,), a field of it, as are the next ones."""
    frames: np.ndarray
    has_state: np.ndarray
    """int64, shape (1,)."""
    contacts: np.ndarray
    """How many, int32, shape (1,)."""
    lost_cycles: np.ndarray
    """What the ring had no room for, int64, shape (1,)."""
    lost_frames: np.ndarray
    has_moved: np.ndarray
    """Whether there are poses: bool, shape (1,), no field."""
    places: tuple[int, int, int]
    """Where frames begin, contacts, and poses, which go on to the end."""
    contact_size: int


class Ring(NamedTuple):
    """`skin.worker.RingBuffer`, as its writer sees it."""

    slots: np.ndarray
    """Bytes, shape (slots, size)."""
    written: np.ndarray
    """int64, shape (1,), as `read`."""
    read: np.ndarray
    is_open: np.ndarray
    """bool, shape (1,): False for a ring that nobody reads."""


@jitable
def copy(given, into, first, last):
    """Copy bytes `first` to `last`, to the same places."""
    for i in range(first, last):
        into[i] = given[i]


def stage_python(staged, events, values, event_count, frame_count, event, frames):
    """Add frames, and the event that brought them, to a slot."""
    count, done, new = event_count[0], frame_count[0], frames.size
    if done + new > staged.size:
        return NO_ROOM
    for i in range(new):
        staged[done + i] = frames[i]
    events[count], values[count] = event, new
    event_count[0], frame_count[0] = count + 1, done + new
    return FULL if count + 1 == events.size else STAGED


@jitable
def fill_python(numbers, given, fields, contacts):
    """Copy numbers and arrays of a state into their fields, and the contacts that are there."""
    for k in range(len(numbers.fields)):
        numbers.fields[k][0] = numbers.given[k]
    contacts.count[0] = numbers.given[len(numbers.fields)]
    for k in range(len(given)):
        copy(given[k], fields[k], 0, given[k].size)
    for k in range(contacts.count[0]):
        copy(contacts.records[contacts.present[k]], contacts.copies[k], 0, contacts.copies.shape[1])


@jitable
def hand_over_python(staged, ring):
    """Copy a slot, as far as it is filled, to the next one of the ring, or count it as lost where
    there is none; begin anew."""
    at = ring.written[0]
    if ring.is_open[0] and at - ring.read[0] < ring.slots.shape[0]:
        slot = ring.slots[at % ring.slots.shape[0]]
        frames, contacts, poses = staged.places
        copy(staged.bytes, slot, 0, frames + FRAME_SIZE * staged.frames[0])
        if staged.has_state[0]:
            end = contacts + staged.contact_size * staged.contacts[0]
            copy(staged.bytes, slot, contacts, end)
        if staged.has_moved[0]:
            copy(staged.bytes, slot, poses, staged.bytes.size)
        publish(ring.written, at + 1)
    else:
        staged.lost_cycles[0] += staged.has_state[0]
        staged.lost_frames[0] += staged.frames[0]
    staged.events[0] = staged.frames[0] = 0
    staged.has_state[0] = 0
    staged.has_moved[0] = False


def take_python(numbers, given, fields, contacts, staged, ring):
    """Both: `fill`, and `hand_over`."""
    fill_python(numbers, given, fields, contacts)
    staged.has_state[0] = 1
    hand_over_python(staged, ring)


_frames_in = types.Array(from_dtype(FRAME_DTYPE), 1, "A", readonly=True)
_frames = types.Array(from_dtype(FRAME_DTYPE), 1, "C")
_bytes, _counts = types.uint8[::1], types.int64[::1]

stage = compiled(
    stage_python,
    [types.int64(_frames, _bytes, _counts, _counts, _counts, types.int64, _frames_in)],
    allocates=False,
)
fill = compiled(fill_python, allocates=False)
hand_over = compiled(hand_over_python, allocates=False)
take = compiled(take_python, allocates=False)
