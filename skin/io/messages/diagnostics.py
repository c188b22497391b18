"""Diagnostics: flagged units, lost frames, states of buses, and dropped records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bus.cycle import WRONG_FRAMES
from bus.state import BusState
from bus.status import INVALID, Status
from skin.io.messages.definitions import DIAGNOSTICS, encode, header, make
from skin.io.messages.record import BUS_STATES, COUNTERS

__all__ = ["Diagnostics"]

OK, WARN, ERROR, STALE = range(4)
"""Levels of diagnostic_msgs/DiagnosticStatus."""
WRONG = (*WRONG_FRAMES, "overruns")
"""Counters of faults: frames, and missed cycles."""
LEVELS = {BusState.ACTIVE: OK, BusState.WARNING: WARN, BusState.PASSIVE: WARN}
Entry = tuple[int, str, str, dict[str, str]]


class Diagnostics:
    """Records to ``diagnostic_msgs/msg/DiagnosticArray``.

    Parameters
    ----------
    skin : mapping
        As of `skin.io.messages.record.described`.
    into : str
        Name of the output that drops cycles.
    name : str
        Of the skin.
    """

    def __init__(self, skin: Mapping[str, Any], into: str, name: str = "skin") -> None:
        self._skin, self._into, self._name = skin, into, name
        self._enabled = np.array(skin["enabled"], bool)
        self._before = dict.fromkeys(COUNTERS, 0)
        self._bus_lost = [0] * len(skin["buses"])

    def message(self, record: np.ndarray) -> bytes:
        """Diagnostics at the record of a cycle."""
        found = []
        for level, name, text, values in (
            self._units(record["status"]), self._frames(record), *self._buses(record),
            _contacts(record), self._left_out(record),
        ):  # fmt: skip
            pairs = [make("diagnostic_msgs/msg/KeyValue", *pair) for pair in values.items()]
            found.append(make(
                "diagnostic_msgs/msg/DiagnosticStatus", level, f"{self._name}: {name}", text,
                self._skin["topology"], pairs,
            ))  # fmt: skip
        head = header(int(record["stamp_ns"]), "")
        return encode(DIAGNOSTICS, make("diagnostic_msgs/msg/DiagnosticArray", head, found))

    def _units(self, status: np.ndarray) -> Entry:
        flagged = np.flatnonzero((status & int(INVALID) != 0) & self._enabled)
        values = {
            self._skin["names"][i]: ", ".join(
                str(flag.name).lower() for flag in Status(int(status[i])) & INVALID
            )
            for i in flagged.tolist()
        }
        count = int(self._enabled.sum())
        level = OK if not values else ERROR if len(values) == count else WARN
        return level, "units", f"{len(values)} of {count} units not valid", values

    def _frames(self, record: np.ndarray) -> Entry:
        counts = dict(zip(COUNTERS, record["counters"].tolist(), strict=True))
        counts["overruns"] = int(record["overruns"])
        before, self._before = self._before, counts
        new = {kind: counts[kind] - before.get(kind, 0) for kind in WRONG}
        text = ", ".join(f"{count} {kind}" for kind, count in new.items() if count > 0)
        values = {kind: str(count) for kind, count in counts.items()}
        if text:
            return WARN, "frames", f"{text} since the last message", values
        return OK, "frames", "all frames taken", values

    def _buses(self, record: np.ndarray) -> list[Entry]:
        """State of each bus, and frames that this host has lost on it since the last message."""
        entries: list[Entry] = []
        states, lost = record["bus_states"].tolist(), record["bus_lost"].tolist()
        before, self._bus_lost = self._bus_lost, lost
        for bus, number, count, old in zip(self._skin["buses"], states, lost, before, strict=True):
            if number < 0:
                entries.append((STALE, f"bus {bus}", "state not known", {}))
                continue
            state, new = BUS_STATES[number], count - old
            level = max(LEVELS.get(state, ERROR), WARN if new > 0 else OK)
            text = f"{state}, {new} frames lost on this host" if new > 0 else str(state)
            values = {"state": str(state), "lost on this host": str(count)}
            entries.append((level, f"bus {bus}", text, values))
        return entries

    def _left_out(self, record: np.ndarray) -> Entry:
        cycles, frames = int(record["lost_cycles"]), int(record["lost_frames"])
        values = {"lost_cycles": str(cycles), "lost_frames": str(frames)}
        if not cycles + frames:
            return OK, self._into, "nothing left out", values
        return WARN, self._into, f"{cycles} cycles and {frames} frames left out", values


def _contacts(record: np.ndarray) -> Entry:
    """Contacts of the record's cycle, and those beyond the capacity."""
    beyond, values = int(record["untracked"]), {"contacts": str(int(record["contact_count"]))}
    if not beyond:
        return OK, "contacts", "all have an identity", values
    return WARN, "contacts", f"{beyond} beyond the capacity have no identity", values
