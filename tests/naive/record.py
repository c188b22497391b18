"""The record of a cycle, field by field from its state."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from skin.state import if_wanted
from skin.view.snapshot import snapshot_dtype


def fill(record, state):
    """Write any state into a record, shape (1,); what was not wanted reads NaN, or -1."""
    units = state.units
    record["stamp_ns"], record["cycle"] = state.stamp_ns, state.cycle
    for name in ("force", "force_sigma", "temperature", "test_ratio"):
        values = if_wanted(units, name)
        record[name] = np.nan if values is None else values
    record["status"] = units.status
    record["contact"] = -1 if if_wanted(state, "label") is None else state.label
    record["wrench"] = np.nan if if_wanted(state, "wrench") is None else state.wrench
    record["whole"] = bool(if_wanted(state, "whole"))
    record["counters"] = list(vars(state.counters).values())
    record["untracked"] = if_wanted(state, "untracked") or 0
    contacts = if_wanted(state, "contacts") or ()
    record["contact_count"] = len(contacts)
    kept = record["contacts"][0]
    for at, contact in enumerate(contacts):
        kept[at] = np.frombuffer(contact.record.tobytes(), np.int64)


def snapshots(count, n):
    """Empty snapshots of a view of n units on no bus."""
    return np.zeros(count, snapshot_dtype(SimpleNamespace(n=n, buses=(), robot=None), 16))
