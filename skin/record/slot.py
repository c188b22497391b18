"""A slot of the ring buffer: what a cycle was given, and what came of it."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.frame import FRAME_DTYPE
from skin.contact.record import CONTACT
from skin.messages.record import CONTACTS, record_dtype
from skin.state import State
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.stream import ContactStream
    from skin.record.staging import Ring, Staged

__all__ = ["EVENTS", "Event", "SlotWriter", "slot_dtype"]

EVENTS = 24
"""Events that a slot has room for; more go on in the next one."""
SPARE_FRAMES = 8


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
    expected = len(topology.frames) + len(topology.buses)
    frames = expected + expected // 2 + SPARE_FRAMES
    return record_dtype(
        topology,
        (
            ("event_values", "i8", (EVENTS,)),
            ("event_count", "i8", ()),
            ("frame_count", "i8", ()),
            ("events", "u1", (EVENTS,)),  # Event
            ("has_state", "i8", ()),
        ),
        (("frames", "i8", (frames, FRAME_DTYPE.itemsize // 8)),),
    )


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
        from skin.record.staging import Contacts, Numbers  # bring the compiler along

        self.fields = fields = {name: slot[name] for name in slot.dtype.names or ()}
        for name in ("force", "force_sigma", "temperature", "test_ratio", "wrench"):
            fields[name][...] = np.nan  # of what is not wanted
        fields["contact"][...] = -1
        present, records = np.zeros(0, np.int64), np.zeros((0, CONTACT.itemsize), np.uint8)
        if contacts is not None:
            present, every = contacts.data.slots.present, contacts.records
            records = every.view(np.uint8).reshape(every.size, CONTACT.itemsize)
        self._totals = totals
        self._contacts = Contacts(present, records, fields["contact_count"], fields["contacts"][0])
        told = np.zeros(4, np.int64)
        self._numbers = Numbers(told, (fields["stamp_ns"], fields["cycle"], fields["whole"]))
        self._told = told.data  # takes a number in half the time of the array
        self._rest: tuple[Any, ...] = ()
        self._units = self._wrench = self._label = None
        self._fill: Callable[[], object] | None = None
        self._cast: list[tuple[np.ndarray, np.ndarray]] = []

    def hand_over(self, staged: Staged, ring: Ring) -> None:
        """Let what is written go into a ring at once, from now on."""
        self._rest, self._fill = (staged, ring), None

    def write(self, state: State) -> None:
        """Write a state; what is not wanted stays NaN, or -1. Of contacts, as many as there is room
        for."""
        told, contacts = self._told, state.contacts
        told[0], told[1], told[2] = state.stamp_ns, state.cycle, bool(state.whole)
        told[3] = min(len(contacts), CONTACTS) if contacts else 0
        fill = self._fill
        if (
            fill is None
            or state.units is not self._units
            or state.wrench is not self._wrench
            or state.label is not self._label
        ):
            fill = self._fill = self._bound(state)
        if self._cast:
            for into, given in self._cast:
                into[:] = given
        fill()

    def _bound(self, state: State) -> Callable[[], object]:
        """What copies from the arrays of a state, which those of one pipeline share."""
        from bus.compiled.bound import Bound
        from skin.record.staging import fill, take

        self._units, self._wrench, self._label = units, *_ = state.units, state.wrench, state.label
        self._cast = []
        pairs = [
            self._bytes(given, name)
            for name, given in (
                ("counters", self._totals), ("status", units.status), ("force", units.force),
                ("force_sigma", units.force_sigma), ("temperature", units.temperature),
                ("test_ratio", units.test_ratio), ("wrench", state.wrench),
                ("contact", state.label),
            )
        ]  # fmt: skip
        given, fields = zip(*pairs, strict=True)
        kernel = take if self._rest else fill
        return Bound(kernel, self._numbers, given, fields, self._contacts, *self._rest)

    def _bytes(self, given: np.ndarray | None, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Bytes of an array, and those of its field; none where it is not wanted, or is copied in
        other ways."""
        into = self.fields[name][0]
        if given is not None and given.dtype == into.dtype and given.flags.c_contiguous:
            return given.reshape(-1).view(np.uint8), into.reshape(-1).view(np.uint8)
        if given is not None:
            self._cast.append((into, given))
        return np.zeros(0, np.uint8), np.zeros(0, np.uint8)
