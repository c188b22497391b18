"""A state as one record of numbers, on its way from the loop to the process that publishes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import FrameCounters
from bus.state import BusState
from skin.contact.record import CONTACT

if TYPE_CHECKING:
    from bus.transport import Transport
    from skin.state import State
    from topology import Topology

__all__ = [
    "BUS_STATES",
    "COUNTERS",
    "MOST_CONTACTS",
    "contacts_of",
    "fill",
    "note",
    "patch_poses",
    "snapshot_dtype",
]

MOST_CONTACTS = 32
"""Contacts of a record [assumed]; more are left out, and counted."""
BUS_STATES = tuple(BusState)
COUNTERS = tuple(vars(FrameCounters()))
"""Names of what `FrameCounters` counts, in the order of a record."""
BUS_COUNTERS = ("queue_drops", "ring_overflows", "controller_overflows")
"""Frames that reached this host and were lost."""


def snapshot_dtype(topology: Topology) -> np.dtype[Any]:
    """The record of a skin of n units, p patches and b buses."""
    n, patches, buses = topology.n, len(topology.patch_names), len(topology.buses)
    return np.dtype(
        [
            ("stamp_ns", np.int64),
            ("cycle", np.int64),
            ("force", np.float32, (3, n)),
            ("force_sigma", np.float32, (3, n)),
            ("temperature", np.float32, (n,)),
            ("test_ratio", np.float32, (n,)),
            ("status", np.uint16, (n,)),
            ("valid", np.bool_, (n,)),
            ("label", np.int32, (n,)),
            ("wrench", np.float64, (6,)),
            ("whole", np.bool_),
            ("count", np.int32),
            ("contacts", f"V{CONTACT.itemsize}", (MOST_CONTACTS,)),
            ("has_pose", np.bool_),
            ("pose", np.float64, (patches, 7)),
            # -- about once a second
            ("is_noted", np.bool_),
            ("counters", np.int64, (len(COUNTERS),)),
            ("overruns", np.int64),
            ("left_out", np.int64),
            ("bus_state", np.uint8, (buses,)),
            ("lost", np.int64, (buses,)),
        ]
    )


def fill(record: np.ndarray, state: State) -> None:
    """Write a state into a record, shape (1,); what was not wanted reads NaN.

    As `State` has it, but for units that are not valid: the process makes NaN of those.
    """
    units = state.units
    record["stamp_ns"], record["cycle"] = state.stamp_ns, state.cycle
    for name in ("force", "force_sigma", "temperature", "test_ratio"):
        values = getattr(units, name)
        record[name] = np.nan if values is None else values
    record["status"], record["valid"] = units.status, units.valid
    record["label"] = -1 if state.label is None else state.label
    record["wrench"] = np.nan if state.wrench is None else state.wrench
    record["whole"] = bool(state.whole)
    record["has_pose"] = record["is_noted"] = False
    contacts = state.contacts or ()
    record["count"] = len(contacts)
    if contacts:
        kept = record["contacts"][0]
        for at, contact in enumerate(contacts[:MOST_CONTACTS]):
            kept[at] = contact.record.tobytes()  # as a whole: a copy by fields takes far longer


def note(record: np.ndarray, state: State, buses: list[Transport], left_out: int) -> None:
    """Write what is diagnosed about once a second into a record that is filled."""
    record["is_noted"] = True
    record["counters"] = list(vars(state.counters).values())
    record["overruns"], record["left_out"] = state.overruns, left_out
    for at, bus in enumerate(buses):
        record["bus_state"][0, at] = BUS_STATES.index(bus.state)
        record["lost"][0, at] = sum(getattr(bus.counters, name) for name in BUS_COUNTERS)


def contacts_of(record: np.void) -> np.ndarray:
    """Contacts of a record, shape (k,), `skin.contact.record.CONTACT`."""
    return record["contacts"].view(CONTACT)[: min(int(record["count"]), MOST_CONTACTS)]


def patch_poses(topology: Topology, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Frames of the patches in that of the skin: each is the frame of its middle unit.

    Parameters
    ----------
    topology : Topology
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)

    Returns
    -------
    ndarray, shape (p, 7)
        x, y, z in metre and a quaternion x, y, z, w.
    """
    from scipy.spatial.transform import Rotation

    found = np.empty((len(topology.patch_names), 7))
    for at in range(len(found)):
        units = np.flatnonzero(topology.patch == at)
        # the file's places choose the unit: it stays the same however patches move
        own = topology.position[:, units]
        away = np.sum((own - own.mean(axis=1, keepdims=True)) ** 2, axis=0)
        middle = units[int(np.argmin(away))]
        found[at, :3] = position[:, middle]
        # a copy: scipy 1.13 takes no array that is read-only
        found[at, 3:] = Rotation.from_matrix(rotation[:, :, middle].copy()).as_quat()
    return found
