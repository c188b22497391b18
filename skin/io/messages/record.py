"""The record of a cycle, from which another process makes its messages.

Recorder, publisher and view have the same fields, and each has further ones of its own. The loop
writes them into the memory of a ring buffer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import FrameCounters
from bus.state import BusState
from bus.transport import Transport
from skin.contact.record import CONTACT
from skin.state import State, if_wanted
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
Fields = Sequence[tuple[str, str, tuple[int, ...]]]


def record_dtype(topology: Topology, contacts: int, others: Fields = ()) -> np.dtype[Any]:
    """The record of a skin.

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
    found: list[Any] = [
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
        ("contacts", "i8", (contacts, CONTACT.itemsize // 8)),  # CONTACT records
        ("moved", "i8", ()),  # counts changes of the poses; pose and q hold where it has changed
        ("pose", "f8", (12, n)),  # position, rotation
        ("q", "f8", (joints,)),  # joints that the poses are of, NaN where these are not known
        *others,
    ]
    found.sort(key=lambda field: -np.dtype(field[1]).itemsize)  # aligned, without gaps
    return np.dtype([*found, ("padding", "u1", (-np.dtype(found).itemsize % 8,))])


class RecordWriter:
    """Writes the cycles of a pipeline into records.

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
    of : dict of str to ndarray
        Each field of all records.
    """

    def __init__(
        self,
        records: np.ndarray,
        pipeline: Pipeline,
        transports: Sequence[Transport] = (),
        *,
        knows_poses: bool = True,
    ) -> None:
        self.of: dict[str, np.ndarray] = {name: records[name] for name in records.dtype.names or ()}
        self._pipeline, self._transports = pipeline, transports
        own = knows_poses and pipeline.poses[0] is pipeline.topology.position
        self._poses = pipeline.poses if own else None
        self._moved = 0
        self._lost, self._states = np.zeros(1, np.int64), np.full(1, -1)

    def look(self) -> None:
        """Look at the states of the buses, which later records have."""
        if self._transports:
            self._lost = np.array([sum(getattr(bus.counters, name) for name in BUS_COUNTERS)
                                   for bus in self._transports])  # fmt: skip
            self._states = np.array([BUS_STATES.index(bus.state) for bus in self._transports])

    def state(self, at: int, state: State, lost_cycles: int = 0, lost_frames: int = 0) -> None:
        """Write a state into record `at`; quantities that are not wanted are NaN, or -1."""
        of, units, contacts = self.of, state.units, if_wanted(state, "contacts") or ()
        of["stamp_ns"][at], of["cycle"][at] = state.stamp_ns, state.cycle
        of["whole"][at] = if_wanted(state, "whole") is True
        of["untracked"][at] = if_wanted(state, "untracked") or 0
        of["overruns"][at] = state.overruns
        of["lost_cycles"][at], of["lost_frames"][at] = lost_cycles, lost_frames
        of["bus_lost"][at], of["bus_states"][at] = self._lost, self._states
        of["counters"][at] = self._pipeline.assembler.totals
        for name in OF_UNITS:
            _set(of[name], at, if_wanted(units, name), np.nan)
        _set(of["wrench"], at, if_wanted(state, "wrench"), np.nan)
        _set(of["contact"], at, if_wanted(state, "label"), -1)
        of["status"][at] = units.status
        of["contact_count"][at] = len(contacts)
        for k, contact in enumerate(contacts):
            of["contacts"][at, k] = np.frombuffer(contact.record, np.int64)  # whole, not by field

    def poses(self, at: int) -> None:
        """Write the poses of the units into record `at`, and the joints that they are of, where
        they have changed since the last call."""
        of, pipeline = self.of, self._pipeline
        if pipeline.poses is not self._poses:
            self._poses = position, rotation = pipeline.poses
            self._moved += 1
            of["pose"][at, :3], of["pose"][at, 3:] = position, rotation.reshape(9, -1)
            of["q"][at] = np.nan if pipeline.q is None else pipeline.q
        of["moved"][at] = self._moved


def _set(field: np.ndarray, at: int, value: np.ndarray | None, none: float) -> None:
    field[at] = none if value is None else value


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
