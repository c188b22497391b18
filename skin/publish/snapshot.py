"""A state as one record of numbers, on its way from the loop to the process that publishes it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skin.messages.record import CONTACTS, record_dtype

if TYPE_CHECKING:
    from skin.state import State
    from topology import Topology

__all__ = ["fill", "snapshot_dtype"]


def snapshot_dtype(topology: Topology) -> np.dtype[Any]:
    """The record of a skin; ``has_moved``: its pose is another one than before."""
    return record_dtype(topology, (("has_moved", "i8", ()),))


def fill(record: np.ndarray, state: State) -> None:
    """Write a state into a record, shape (1,); what was not wanted reads NaN."""
    units = state.units
    record["stamp_ns"], record["cycle"] = state.stamp_ns, state.cycle
    for name in ("force", "force_sigma", "temperature", "test_ratio"):
        values = getattr(units, name)
        record[name] = np.nan if values is None else values
    record["status"] = units.status
    record["contact"] = -1 if state.label is None else state.label
    record["wrench"] = np.nan if state.wrench is None else state.wrench
    record["whole"] = bool(state.whole)
    record["counters"] = list(vars(state.counters).values())
    contacts = (state.contacts or ())[:CONTACTS]
    record["contact_count"] = len(contacts)
    kept = record["contacts"][0]
    for at, contact in enumerate(contacts):  # as bytes: a copy by fields takes far longer
        kept[at] = np.frombuffer(contact.record.tobytes(), np.uint8)
