"""Heartbeats of simulated boards."""

from __future__ import annotations

from bus.frame import FrameBatch
from bus.heartbeat import FIRST_ID, LAYOUT, PERIOD_S, STATES, heartbeat_nodes
from topology import Topology

__all__ = ["Heartbeats"]

FIRMWARE_ID = 1
RUNNING = STATES.index("running")


class Heartbeats:
    """The heartbeats of simulated boards, spread evenly over each second.

    Parameters
    ----------
    topology : Topology
    """

    def __init__(self, topology: Topology) -> None:
        self._rate_hz = topology.cycle_rate_hz
        self._period = max(1, round(PERIOD_S * self._rate_hz))
        self._nodes = [heartbeat_nodes(topology, bus) for bus in range(len(topology.buses))]

    def append(self, cycle: int, batch: FrameBatch, *, bus: int, stamp_ns: int = 0) -> int:
        """Append the heartbeats that are due in a cycle; return how many."""
        first = cycle % self._period
        due = self._nodes[bus][first :: self._period]
        uptime_s = min(int(cycle / self._rate_hz), 0xFFFF)
        for node in due:
            serial = ((bus & 0xFF) << 8) | node
            data = LAYOUT.pack(RUNNING, uptime_s, FIRMWARE_ID, serial, 0, 0)
            batch.append(FIRST_ID + node, data, stamp_ns=stamp_ns, bus=bus)
        return len(due)

    def most(self, bus: int) -> int:
        """Largest number of heartbeats of one cycle."""
        return -(-len(self._nodes[bus]) // self._period)
