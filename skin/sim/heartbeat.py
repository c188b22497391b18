"""Heartbeats: what every board says of itself once a second."""

from __future__ import annotations

import struct

import numpy as np

from bus.frame import FrameBatch
from topology import Topology

__all__ = ["FIRST_ID", "LAST_ID", "Heartbeats"]

FIRST_ID = 0x700
"""The heartbeat of node k, counted from 1 on each bus, has the identifier FIRST_ID + k."""
LAST_ID = 0x7DF

STARTING, RUNNING, FAULT = range(3)

LAYOUT = struct.Struct("<BHBHBB")
"""Eight bytes, little endian: state u8 (0 starting, 1 running, 2 fault), uptime u16 in s (stays at
its highest), firmware id u8, serial number u16, transmit and receive error counter of the CAN
controller u8 each."""

FIRMWARE_ID = 1
PERIOD_S = 1.0


class Heartbeats:
    """The heartbeats of simulated boards, spread over the second so that no cycle has them all.

    A board is what sends one set of data frames: `parts` frames of consecutive identifiers. Boards
    are nodes 1, 2, … of their bus in the order of their identifiers; there are as many heartbeats
    as there are identifiers for them.

    Parameters
    ----------
    topology : Topology
    """

    def __init__(self, topology: Topology) -> None:
        self._rate_hz = topology.cycle_rate_hz
        self._period = max(1, round(PERIOD_S * self._rate_hz))
        frames = topology.frames
        boards = [
            int(np.sum((frames.bus == bus) & (frames.part == 0)))
            for bus in range(len(topology.buses))
        ]
        self._nodes = [range(1, min(n, LAST_ID - FIRST_ID) + 1) for n in boards]

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
        """Most heartbeats of one cycle."""
        return -(-len(self._nodes[bus]) // self._period)
