"""A slot of the ring buffer: what a cycle was given, and what came of it."""

from __future__ import annotations

from dataclasses import fields
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import FrameCounters
from bus.frame import FRAME_DTYPE
from skin.contact.record import CONTACT
from skin.state import State
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.stream import ContactStream

__all__ = ["EVENTS", "Event", "SlotWriter", "slot_dtype"]

EVENTS = 24
"""Events that a slot has room for; more go on in the next one."""
CONTACTS = 16
"""Contacts that a slot has room for: as many as a skin tells apart."""
SPARE_FRAMES = 8
COUNTERS = len(fields(FrameCounters))


class Event(IntEnum):
    """What was done with a pipeline. The first four are those of ``f3t_msgs/msg/CanFrames``."""

    FED = 0
    """Frames; the value says how many."""
    EXPIRED = 1
    """`Pipeline.expire`; the value is the age of the cycle in ns, as of the next two."""
    SILENT = 2
    FLUSHED = 3
    MOVED = 4
    """The poses in the slot are those of the next cycle."""
    FED_PART = 5
    """As FED, and the batch goes on with the next event."""


def slot_dtype(topology: Topology) -> np.dtype[Any]:
    """The type of a slot, for a skin.

    Events stand in their order, their frames one after the other. What may be filled in part, or
    not at all, stands last: frames, contacts, poses.
    """
    n = topology.n
    expected = len(topology.frames) + len(topology.buses)
    dtype = np.dtype(
        [
            ("event_values", "i8", (EVENTS,)),
            ("event_count", "i8"),
            ("frame_count", "i8"),
            ("lost_cycles", "i8"),  # left out of the recording until now
            ("lost_frames", "i8"),
            ("stamp_ns", "i8"),
            ("cycle", "i8"),
            ("counters", "i8", (COUNTERS,)),  # FrameCounters
            ("wrench", "f8", (6,)),
            ("force", "f4", (3, n)),
            ("force_sigma", "f4", (3, n)),
            ("temperature", "f4", (n,)),
            ("contact", "i4", (n,)),
            ("contact_slots", "i4", (CONTACTS,)),
            ("contact_count", "i4"),
            ("bus_states", "i4", (len(topology.buses),)),  # index of BusState, -1: not known
            ("status", "u2", (n,)),
            ("events", "u1", (EVENTS,)),  # Event
            ("has_state", "u1"),
            ("frames", "i8", (expected + expected // 2 + SPARE_FRAMES, FRAME_DTYPE.itemsize // 8)),
            ("contacts", "u1", (CONTACTS, CONTACT.itemsize)),  # CONTACT records
            ("pose", "f8", (12, n)),  # position, rotation
        ]
    )
    return np.dtype([*_fields(dtype), ("padding", "u1", (-dtype.itemsize % 8,))])


def _fields(dtype: np.dtype[Any]) -> list[tuple[str, Any, tuple[int, ...]]]:
    return [(name, dtype[name].base, dtype[name].shape) for name in dtype.names or ()]


class SlotWriter:
    """Writes states into a slot.

    Parameters
    ----------
    slot : ndarray, shape (1,)
        Of `slot_dtype`.
    contacts : ContactStream or None
        Of the pipeline.
    totals : ndarray, int64
        `bus.assemble.Assembler.totals`

    Attributes
    ----------
    fields : dict of str to ndarray
        Each field of the slot.
    """

    def __init__(
        self, slot: np.ndarray, contacts: ContactStream | None, totals: np.ndarray
    ) -> None:
        self.fields = fields = {name: slot[name] for name in slot.dtype.names or ()}
        self._totals = totals
        if contacts is not None:
            records = contacts.records
            self._bytes = records.view(np.uint8).reshape(records.size, CONTACT.itemsize)
            self._present = contacts.data.slots.present
        for name in ("force", "force_sigma", "temperature", "wrench"):
            fields[name][...] = np.nan  # of what is not wanted
        fields["contact"][...] = -1
        self._numbers = fields["stamp_ns"], fields["cycle"]
        inner = {name: array[0] for name, array in fields.items() if array.ndim > 1}
        self._always = inner["counters"], inner["status"]
        self._units = inner["force"], inner["force_sigma"], inner["temperature"]
        self._array = inner["wrench"], inner["contact"]
        self._listed = fields["contact_count"], inner["contact_slots"], inner["contacts"]
        self._has_state = fields["has_state"]

    def write(self, state: State) -> int:
        """Write a state; what is not wanted stays NaN, or -1. How many contacts it has room for."""
        units = state.units
        stamp, cycle = self._numbers
        stamp[0], cycle[0] = state.stamp_ns, state.cycle
        counters, status = self._always
        counters[:], status[:] = self._totals, units.status
        force, sigma, temperature = self._units
        if units.force is not None:
            force[:] = units.force
        if units.force_sigma is not None:
            sigma[:] = units.force_sigma
        if units.temperature is not None:
            temperature[:] = units.temperature
        wrench, label = self._array
        if state.wrench is not None:
            wrench[:] = state.wrench
        if state.label is not None:
            label[:] = state.label
        counts, places, records = self._listed
        count = 0
        if state.contacts:
            count = min(len(state.contacts), CONTACTS)
            present = self._present[:count]
            places[:count] = present
            records[:count] = self._bytes[present]
        counts[0], self._has_state[0] = count, 1
        return count
