"""The record of a cycle, from which another process makes its messages.

Recorder, publisher and view have the same fields, and each has further ones of its own. The loop
writes them into the memory of a ring buffer.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import FrameCounters
from bus.state import BusState
from bus.transport import Transport
from skin.contact.record import CONTACT
from skin.state import Reading, State, if_wanted
from topology import Topology

if TYPE_CHECKING:
    from skin.pipeline import Pipeline

__all__ = ["BUS_STATES", "COUNTERS", "RecordWriter", "contacts_of", "described", "record_dtype"]

COUNTERS = tuple(field.name for field in fields(FrameCounters))
"""Order of the counters of frames."""
BUS_STATES = tuple(BusState)
BUS_COUNTERS = ("queue_drops", "ring_overflows", "controller_overflows")
"""Counters of frames that reached this host and were lost."""
OF_UNITS = ("force", "force_sigma", "temperature", "test_ratio")
NOT_WANTED = {"contact": -1, **dict.fromkeys(("wrench", *OF_UNITS), np.nan)}
NUMBER = struct.Struct("<q")
Fields = Sequence[tuple[str, str, tuple[int, ...]]]


def record_dtype(topology: Topology, contacts: int, others: Fields = ()) -> np.dtype[Any]:
    """The record of a skin, with further fields, which are last.

    Parameters
    ----------
    topology : Topology
    contacts : int
        Contacts that it can hold; see `skin.pipeline.Pipeline.contact_capacity`.
    others : sequence of tuple
        Name, kind and shape of further fields.
    """
    n, buses = topology.n, len(topology.buses)
    joints = 0 if topology.robot is None else len(topology.robot.joint_names)
    state: list[Any] = [
        ("stamp_ns", "i8", ()),
        ("cycle", "i8", ()),
        ("whole", "i8", ()),  # 1 as of `State.whole`, else 0
        ("untracked", "i8", ()),  # contacts beyond the capacity
        ("overruns", "i8", ()),
        ("lost_cycles", "i8", ()),  # dropped so far
        ("lost_frames", "i8", ()),
        ("contact_count", "i8", ()),
        ("bus_lost", "i8", (buses,)),  # frames lost on this host
        ("bus_states", "i8", (buses,)),  # index of BUS_STATES, -1: not known
        ("counters", "i8", (len(COUNTERS),)),
        ("wrench", "f8", (6,)),
        ("force", "f4", (3, n)),
        ("force_sigma", "f4", (3, n)),
        ("temperature", "f4", (n,)),
        ("test_ratio", "f4", (n,)),
        ("contact", "i4", (n,)),
        ("status", "u2", (n,)),
    ]
    state += [("padding", "u1", (-np.dtype(state).itemsize % 8,))]
    rest: list[Any] = [
        ("contacts", "i8", (contacts, CONTACT.itemsize // 8)),  # CONTACT records
        ("moved", "i8", ()),  # counts changes of the poses; pose and q hold where it has changed
        ("pose", "f8", (12, n)),  # position, rotation
        ("q", "f8", (joints,)),  # joints that the poses are of, NaN where these are not known
        *others,
    ]
    rest.sort(key=lambda field: -np.dtype(field[1]).itemsize)  # aligned, without gaps
    rest += [("padding_at_end", "u1", (-np.dtype(rest).itemsize % 8,))]
    return np.dtype(state + rest)


class RecordWriter:
    """Writes the cycles of a pipeline into records.

    States are written as bytes, from views of the pipeline's own arrays: field by field, numpy
    takes several times as long.

    Parameters
    ----------
    records : ndarray, shape (m,)
        Of `record_dtype`.
    pipeline : Pipeline
    transports : sequence of Transport
        Buses whose states are written; unknown without any.
    knows_poses : bool
        Whether the reader has the poses of the topology.

    Attributes
    ----------
    bytes : memoryview
        Of all records.
    size : int
        Bytes of a record.
    """

    def __init__(
        self,
        records: np.ndarray,
        pipeline: Pipeline,
        transports: Sequence[Transport] = (),
        *,
        knows_poses: bool = True,
    ) -> None:
        self.bytes = records.view(np.uint8).data
        self.size, self._records = records.dtype.itemsize, records
        self._pipeline, self._transports = pipeline, transports
        own = knows_poses and pipeline.poses[0] is pipeline.topology.position
        self._poses = pipeline.poses if own else None
        self._moved = 0
        buses = len(pipeline.topology.buses)
        self._health = (0,) * buses + (-1,) * buses
        self._head = struct.Struct(f"<{8 + 2 * buses}q").pack
        places: Any = records.dtype.fields
        self._until = places["padding"][1] + records.dtype["padding"].itemsize
        self._contacts_at, self._moved_at = places["contacts"][1], places["moved"][1]
        self._units: Any = None
        self._wrench = self._label = self._units
        self._parts: list[Any] = [b""]
        self._cast: list[tuple[np.ndarray, np.ndarray]] = []

    def look(self) -> None:
        """Look at the states of the buses, which later records have."""
        if self._transports:
            lost = [sum(getattr(bus.counters, name) for name in BUS_COUNTERS)
                    for bus in self._transports]  # fmt: skip
            self._health = (*lost, *(BUS_STATES.index(bus.state) for bus in self._transports))

    def state(self, at: int, state: State, lost_cycles: int = 0, lost_frames: int = 0) -> None:
        """Write a state into record `at`; quantities that are not wanted are NaN, or -1."""
        contacts = getattr(state, "contacts", None)
        units, wrench = state.units, getattr(state, "wrench", None)
        label = getattr(state, "label", None)
        if units is not self._units or wrench is not self._wrench or label is not self._label:
            self._units, self._wrench, self._label = units, wrench, label
            self._parts = self._views(units, wrench, label)
        parts, first = self._parts, self.size * at
        parts[0] = self._head(
            state.stamp_ns, state.cycle, getattr(state, "whole", None) is True,
            getattr(state, "untracked", None) or 0, state.overruns, lost_cycles, lost_frames,
            len(contacts) if contacts else 0, *self._health,
        )  # fmt: skip
        for own, given in self._cast:
            own[...] = given
        self.bytes[first : first + self._until] = b"".join(parts)
        if contacts:
            data = b"".join([contact.record.tobytes() for contact in contacts])
            first += self._contacts_at
            self.bytes[first : first + len(data)] = data

    def _views(self, units: Reading, wrench: Any, label: Any) -> list[Any]:
        """Room for the head, then the memory of the arrays of a state, in their order."""
        self._cast = []
        found: list[Any] = [b""]
        dtype = self._records.dtype
        for name, given in (
            ("counters", self._pipeline.assembler.totals), ("wrench", wrench),
            *((name, if_wanted(units, name)) for name in OF_UNITS), ("contact", label),
            ("status", units.status), ("padding", None),
        ):  # fmt: skip
            own, kind = given, dtype[name].base
            if own is None or own.dtype != kind or not own.flags.c_contiguous:
                own = np.full(dtype[name].shape, NOT_WANTED.get(name, 0), kind)
                if given is not None:
                    self._cast.append((own, given))
            found.append(own.reshape(-1).view(np.uint8).data)
        return found

    def poses(self, at: int) -> None:
        """Write the poses of the units into record `at`, and the joints that they are of, where
        they have changed since the last call."""
        pipeline = self._pipeline
        if pipeline.poses is not self._poses:
            self._poses = position, rotation = pipeline.poses
            self._moved += 1
            record = self._records[at : at + 1]
            record["pose"][0, :3], record["pose"][0, 3:] = position, rotation.reshape(9, -1)
            record["q"] = np.nan if pipeline.q is None else pipeline.q
        NUMBER.pack_into(self.bytes, self.size * at + self._moved_at, self._moved)


def contacts_of(record: np.ndarray | np.void) -> np.ndarray:
    """The CONTACT records of a record, shape (k,)."""
    return record["contacts"][: int(record["contact_count"])].view(CONTACT)[:, 0]


def described(topology: Topology) -> dict[str, Any]:
    """Constant metadata of a skin for messages, as JSON."""
    rows = {
        "position": topology.position, "rotation": topology.rotation.reshape(9, -1),
        "patch": topology.patch, "enabled": topology.enabled,
    }  # fmt: skip
    return {
        "topology": topology.name,
        "names": topology.unit_names,
        "patches": topology.patch_names,
        "buses": [bus.name for bus in topology.buses],
        **{name: values.tolist() for name, values in rows.items()},
    }
