"""The report at the end of a run, and of its replay."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.cli.options import share_of

if TYPE_CHECKING:
    from skin.state import State
    from topology import Topology

__all__ = ["Tally"]

KEPT = 100_000
"""Cycle times of which percentiles are taken."""


class Tally:
    """Counts cycles, contacts, forces and working time.

    Units that the topology switches off are neither silent nor part of ``valid_share``.
    """

    def __init__(self, topology: Topology) -> None:
        self.topology = topology
        self.cycles = 0
        self.complete = 0
        self.overruns = 0
        self.valid = np.zeros(topology.n, np.int64)
        self.heard = np.zeros(topology.n, bool)
        self.load = 0.0
        self.contacts: set[int] = set()
        self.slipped: set[int] = set()
        self.work_us: deque[float] = deque(maxlen=KEPT)

    def add(self, state: State, work_ns: int) -> None:
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
        enabled = self.topology.enabled
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
            "valid_share": share_of(int(self.valid.sum()), self.cycles, self.topology),
            "peak_force_n": self.load,
            "contacts": len(self.contacts),
            "contacts_slipped": len(self.slipped),
            "cycle_us_p50": float(p50),
            "cycle_us_p99": float(p99),
        }
