"""The states of a run, or of its replay, counted to their end."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from skin.state import State
    from topology import Topology

__all__ = ["Tally"]

KEPT = 100_000
"""Cycle times of which percentiles are taken."""
LOOK = 64
"""Cycles from one question whether to go on to the next: it may need a system call."""


class Tally:
    """Counts cycles, contacts, forces and working time.

    Units that the topology switches off are neither silent nor part of ``valid_share``.
    """

    def __init__(self, topology: Topology) -> None:
        self.topology = topology
        self.cycles = self.complete = self.overruns = 0
        self.valid = np.zeros(topology.n, np.int64)
        self.heard = np.zeros(topology.n, bool)
        self.load = 0.0
        self.contacts: set[int] = set()
        self.slipped: set[int] = set()
        self.work_us: deque[float] = deque(maxlen=KEPT)
        self._end_s: float | None = None

    def follow(
        self,
        source: Any,
        seconds: float | None = None,
        *,
        show: Callable[[State, int], object] = lambda state, work_ns: None,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> None:
        """Count the states of an open skin, or of a replay, until there are no more, for a time
        from the first one on, or as long as something goes on."""
        timing = getattr(source, "timing", source)
        for state in source:
            self.add(state, timing.work_ns)
            show(state, timing.work_ns)
            if self.is_over(seconds) or (self.cycles % LOOK == 1 and not goes_on()):
                break

    def is_over(self, seconds: float | None) -> bool:
        """Whether so long has passed since this was first asked."""
        if self._end_s is None and seconds is not None:
            self._end_s = time.monotonic() + seconds
        return self._end_s is not None and time.monotonic() >= self._end_s

    def add(self, state: State, work_ns: int) -> None:
        """Count a state."""
        from skin.contact.record import SlipState
        from skin.state import Status, if_wanted

        self.cycles += 1
        self.complete += state.closed_by == "complete"
        self.overruns = state.overruns
        self.valid += state.units.valid
        self.heard |= (state.units.status & int(Status.NEVER | Status.DISABLED)) == 0
        if (wrench := if_wanted(state, "wrench")) is not None:
            self.load = max(self.load, float(np.linalg.norm(wrench[:3])))
        for contact in if_wanted(state, "contacts") or ():
            self.contacts.add(contact.id)
            if contact.slip >= SlipState.INCIPIENT:
                self.slipped.add(contact.id)
        self.work_us.append(work_ns * 1e-3)

    def report(self) -> dict[str, Any]:
        """What was counted; ``valid_share`` is None where the layout has counts only."""
        enabled, feels = self.topology.enabled, self.topology.feels
        readings = max(1, self.cycles * int(feels.sum()))
        silent = np.flatnonzero(~self.heard & enabled)
        p50, p99 = np.percentile(self.work_us, [50, 99]) if self.work_us else (0.0, 0.0)
        return {
            "topology": self.topology.name,
            "units": self.topology.n,
            "units_enabled": int(enabled.sum()),
            "units_heard": int(self.heard.sum()),
            "silent_units": [self.topology.unit_names[i] for i in silent],
            "cycles": self.cycles,
            "complete_cycles": int(self.complete),
            "overruns": self.overruns,
            "valid_share": int(self.valid.sum()) / readings if feels.any() else None,
            "peak_force_n": self.load,
            "contacts": len(self.contacts),
            "contacts_slipped": len(self.slipped),
            "cycle_us_p50": float(p50),
            "cycle_us_p99": float(p99),
        }
