"""The record of a cycle, from which another process makes its messages.

Recorder and publisher have the same fields, and each has further ones in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from bus.cycle import FrameCounters
from bus.state import BusState
from bus.transport import Transport
from skin.contact.record import CONTACT
from skin.state import State
from topology import Topology

__all__ = [
    "BUS_STATES",
    "COUNTERS",
    "contacts_of",
    "described",
    "note",
    "record_dtype",
]

COUNTERS = tuple(field.name for field in fields(FrameCounters))
"""Order of the counters of frames."""
BUS_STATES = tuple(BusState)
BUS_COUNTERS = ("queue_drops", "ring_overflows", "controller_overflows")
"""Counters of frames that reached this host and were lost."""
Fields = Sequence[tuple[str, str, tuple[int, ...]]]


def record_dtype(
    topology: Topology, contacts: int, first: Fields = (), variable: Fields = ()
) -> np.dtype[Any]:
    """The record of a skin, with further fields.

    Parameters
    ----------
    topology : Topology
    contacts : int
        Contacts that it can hold; see `skin.pipeline.Pipeline.contact_capacity`.
    first : sequence of tuple
        Name, kind and shape of the first fields.
    variable : sequence of tuple
        Fields that may be partly filled, as the contacts and the pose that follow them.
    """
    n, buses = topology.n, len(topology.buses)
    dtype = np.dtype(
        [
            *first,
            ("lost_cycles", "i8"),  # dropped so far
            ("lost_frames", "i8"),
            ("stamp_ns", "i8"),
            ("cycle", "i8"),
            ("whole", "i8"),  # 1 as of `State.whole`, else 0
            ("untracked", "i8"),  # contacts beyond the capacity
            ("counters", "i8", (len(COUNTERS),)),
            ("wrench", "f8", (6,)),
            ("overruns", "i8"),  # this and the next two: about once a second
            ("bus_lost", "i8", (buses,)),  # frames lost on this host
            ("bus_states", "i4", (buses,)),  # index of BUS_STATES, -1: not known
            ("force", "f4", (3, n)),
            ("force_sigma", "f4", (3, n)),
            ("temperature", "f4", (n,)),
            ("test_ratio", "f4", (n,)),
            ("contact", "i4", (n,)),
            ("contact_count", "i4"),
            ("status", "u2", (n,)),
            *variable,
            ("contacts", "u1", (contacts, CONTACT.itemsize)),  # CONTACT records
            ("pose", "f8", (12, n)),  # position, rotation
        ]
    )
    return np.dtype([*_fields(dtype), ("padding", "u1", (-dtype.itemsize % 8,))])


def _fields(dtype: np.dtype[Any]) -> list[tuple[str, Any, tuple[int, ...]]]:
    return [(name, dtype[name].base, dtype[name].shape) for name in dtype.names or ()]


def note(record: np.ndarray, state: State, buses: Sequence[Transport]) -> None:
    """Write the fields that only diagnostics use into a record, shape (1,)."""
    record["overruns"] = state.overruns
    for at, bus in enumerate(buses):
        record["bus_states"][0, at] = BUS_STATES.index(bus.state)
        record["bus_lost"][0, at] = sum(getattr(bus.counters, name) for name in BUS_COUNTERS)


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
