"""Differences between the topology of a recording and another one, as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from topology import Topology
from topology.packed import PARAMETER, TEXTS, to_arrays

__all__ = ["differences"]


def differences(recorded: Topology, given: Topology) -> list[str]:
    """Differences between two topologies, as text; empty if they decode the same."""
    found = []
    for name in ("name", "unit_names", "patch_names"):
        one, other = getattr(recorded, name), getattr(given, name)
        if one != other:
            found.append(f"{name.replace('_', ' ')}: {_shown(one, other)}")
    if found and recorded.n != given.n:
        return found
    buses = [bus.name for bus in recorded.buses], [bus.name for bus in given.buses]
    if buses[0] != buses[1]:
        found.append(f"buses: {_shown(*map(tuple, buses))}")
    if recorded.layouts != given.layouts:
        found.append("layouts of the frames")
    one, other = to_arrays(recorded), to_arrays(given)
    for name, values in one.items():
        theirs = other.get(name)
        if name == TEXTS or theirs is None:
            continue
        if values.shape != theirs.shape:
            found.append(f"{name.removeprefix(PARAMETER)}: {values.shape} and {theirs.shape}")
        elif not np.array_equal(values, theirs):
            found.append(name.removeprefix(PARAMETER) + _units(values, theirs, given))
    return found


def _units(values: np.ndarray, theirs: np.ndarray, topology: Topology) -> str:
    """The units whose values differ, as text, for arrays along the units."""
    if values.shape[-1:] != (topology.n,):
        return ""
    units = np.flatnonzero((values != theirs).reshape(-1, topology.n).any(axis=0))
    more = f" and {units.size - 1} more" if units.size > 1 else ""
    return f" of {topology.unit_names[units[0]]}{more}"


def _shown(one: Any, other: Any) -> str:
    """Two values; of two lists, the first names that only one of them has."""
    if isinstance(one, str):
        return f"{one!r} and {other!r}"
    only, others = ([name for name in a if name not in b] for a, b in ((one, other), (other, one)))
    found = [
        f"{len(names)} only in {place} ({names[0]!r}{', …' if len(names) > 1 else ''})"
        for names, place in ((only, "the recording"), (others, "the topology given"))
        if names
    ]
    return ", ".join(found) or "another order"
