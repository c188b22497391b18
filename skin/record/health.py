"""Diagnostics: units that are flagged, frames that are lost, buses, and the recording itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from bus.cycle import FrameCounters
from bus.state import BusState
from bus.status import INVALID, Status
from skin.record.cdr import Cdr

__all__ = ["Health"]

OK, WARN, ERROR, STALE = b"\0", b"\1", b"\2", b"\3"
"""Levels of diagnostic_msgs/DiagnosticStatus."""
KINDS = tuple(field.name for field in fields(FrameCounters))
WRONG = ("late", "repeated", "torn", "short", "foreign", "error", "crc", "lost")
"""Kinds of frames that tell of something wrong."""
STATES = tuple(BusState)
LEVELS = {BusState.ACTIVE: OK, BusState.WARNING: WARN, BusState.PASSIVE: WARN}
Entry = tuple[bytes, str, str, dict[str, str]]


class Health:
    """Slots to ``diagnostic_msgs/msg/DiagnosticArray``.

    Parameters
    ----------
    topology : str
    names : sequence of str
        Of the units.
    enabled : ndarray, shape (n,), bool
    buses : sequence of str
    """

    def __init__(
        self, topology: str, names: Sequence[str], enabled: np.ndarray, buses: Sequence[str]
    ) -> None:
        self._topology, self._names, self._enabled = topology, names, enabled
        self._buses, self._states = buses, [-1] * len(buses)
        self._before = np.zeros(len(KINDS), np.int64)

    def begin(self, counters: np.ndarray) -> None:
        """Tell, at first, of frames after these, shape (15,)."""
        self._before = counters.copy()

    def hear(self, slot: np.ndarray) -> None:
        """Take the states of the buses, where a slot has them."""
        states = slot["bus_states"].tolist()
        if min(states, default=-1) >= 0:
            self._states = states

    def message(self, slot: np.ndarray) -> bytes:
        """Diagnostics at a slot that has a state."""
        entries = [
            self._units(slot["status"]), self._frames(slot["counters"]), *self._of_buses(),
            self._recording(int(slot["lost_cycles"]), int(slot["lost_frames"])),
        ]  # fmt: skip
        message = Cdr()
        message.header(int(slot["stamp_ns"]), "")
        message.number("I", len(entries))
        for level, name, text, values in entries:
            message.raw += level
            message.text(name).text(text).text(self._topology)
            message.number("I", len(values))
            for key, value in values.items():
                message.text(key).text(value)
        return bytes(message.raw)

    def _units(self, status: np.ndarray) -> Entry:
        flagged = np.flatnonzero((status & int(INVALID) != 0) & self._enabled)
        values = {
            self._names[i]: ", ".join(
                str(flag.name).lower() for flag in Status(int(status[i])) & INVALID
            )
            for i in flagged.tolist()
        }
        count = int(self._enabled.sum())
        level = OK if not values else ERROR if len(values) == count else WARN
        return level, "skin: units", f"{len(values)} of {count} units not valid", values

    def _frames(self, counters: np.ndarray) -> Entry:
        new = dict(zip(KINDS, (counters - self._before).tolist(), strict=True))
        self._before = counters.copy()
        wrong = {kind: new[kind] for kind in WRONG if new[kind] > 0}
        text = ", ".join(f"{count} {kind}" for kind, count in wrong.items())
        values = {kind: str(int(total)) for kind, total in zip(KINDS, counters, strict=True)}
        told = f"{text} since the last message" if text else "all frames taken"
        return WARN if wrong else OK, "skin: frames", told, values

    def _of_buses(self) -> list[Entry]:
        entries: list[Entry] = []
        for name, number in zip(self._buses, self._states, strict=True):
            if number < 0:
                entries.append((STALE, f"skin: bus {name}", "state not known", {}))
                continue
            state = STATES[number]
            entries.append((LEVELS.get(state, ERROR), f"skin: bus {name}", str(state), {}))
        return entries

    def _recording(self, cycles: int, frames: int) -> Entry:
        values = {"lost_cycles": str(cycles), "lost_frames": str(frames)}
        if not cycles + frames:
            return OK, "skin: recording", "nothing left out", values
        return WARN, "skin: recording", f"{cycles} cycles and {frames} frames left out", values
