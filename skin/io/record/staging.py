"""Kernels of the recorder: they collect frames and states in a slot, and copy its filled part into
the ring.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import from_dtype, types

from bus.compiled.intrinsics import publish
from bus.compiled.jit import compiled, jitable
from bus.frame import FRAME_DTYPE
from skin.io.messages.fill import copy, fill_python

__all__ = [
    "FULL",
    "NO_ROOM",
    "STAGED",
    "Ring",
    "Staged",
    "hand_over",
    "stage",
    "take",
]

FRAME_SIZE = FRAME_DTYPE.itemsize
NO_ROOM, FULL, STAGED = range(3)
"""Results for frames: they do not fit; they fit, and the slot has no room for events; they fit."""


class Staged(NamedTuple):
    """A slot that is being filled, and its fill levels."""

    bytes: np.ndarray
    """The whole slot, shape (size,)."""
    events: np.ndarray
    """Number of events, int64, shape (1,), a field of the slot, as are the next ones."""
    frames: np.ndarray
    has_state: np.ndarray
    """int64, shape (1,)."""
    contacts: np.ndarray
    """Number of contacts, int32, shape (1,)."""
    lost_cycles: np.ndarray
    """Dropped for want of room in the ring, int64, shape (1,)."""
    lost_frames: np.ndarray
    has_moved: np.ndarray
    """Whether there are poses: bool, shape (1,), not a field."""
    places: tuple[int, int, int]
    """Offsets of frames, contacts, and poses, which end the slot."""
    contact_size: int


class Ring(NamedTuple):
    """The writer's view of a `skin.worker.RingBuffer`."""

    slots: np.ndarray
    """Bytes, shape (slots, size)."""
    written: np.ndarray
    """int64, shape (1,), as `read`."""
    read: np.ndarray
    is_open: np.ndarray
    """bool, shape (1,): False for a ring without a reader."""


def stage_python(staged, events, values, event_count, frame_count, event, frames):
    """Add frames and their event to a slot."""
    count, done, new = event_count[0], frame_count[0], frames.size
    if done + new > staged.size:
        return NO_ROOM
    for i in range(new):
        staged[done + i] = frames[i]
    events[count], values[count] = event, new
    event_count[0], frame_count[0] = count + 1, done + new
    return FULL if count + 1 == events.size else STAGED


@jitable
def hand_over_python(staged, ring):
    """Copy the filled part of a slot to the next one of the ring, or count it as lost if the ring
    is full; reset the slot."""
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
    """`skin.io.messages.fill.fill`, then `hand_over`."""
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
hand_over = compiled(hand_over_python, allocates=False)
take = compiled(take_python, allocates=False)
