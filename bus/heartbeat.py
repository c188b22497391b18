"""Heartbeats: status of every board, once a second, eight bytes.

A board sends one set of data frames. Boards are nodes 1, 2, … of their bus in the order of their
identifiers; the number of heartbeats is limited by their identifiers. Sensors of another kind are
boards without heartbeats.
"""

from __future__ import annotations

import struct

import numpy as np

from topology import Topology

__all__ = ["COMMAND_ID", "FIELDS", "FIRST_ID", "LAST_ID", "LAYOUT", "PERIOD_S", "STATES",
           "heartbeat_nodes", "node_numbers"]  # fmt: skip

FIRST_ID = 0x700
"""The heartbeat of node k has the identifier FIRST_ID + k."""
LAST_ID = 0x7DF
"""The last identifier of a heartbeat."""
COMMAND_ID = 0x7E0
"""Kept free for commands of a host to its boards, which are counted and not read."""

PERIOD_S = 1.0

FIELDS = (
    ("state", 8),
    ("uptime_s", 16),  # saturates
    ("firmware_id", 8),
    ("serial_number", 16),
    ("transmit_errors", 8),  # error counters of the CAN controller
    ("receive_errors", 8),
)
"""Unsigned integers, little endian, in order: name and bits."""
LAYOUT = struct.Struct("<" + "".join({8: "B", 16: "H"}[bits] for _, bits in FIELDS))
STATES = ("starting", "running", "fault")
"""Names of the values of `state`."""


def heartbeat_nodes(topology: Topology, bus: int) -> list[int]:
    """Numbers of the nodes on a bus that send heartbeats.

    Examples
    --------
    >>> from topology import load
    >>> heartbeat_nodes(load("palm"), 0)
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]
    """
    frames = topology.frames
    here = frames.bus == bus
    taken = set(frames.can_id[here].tolist())
    boards = np.flatnonzero(here & (frames.part == 0))[: LAST_ID - FIRST_ID]
    return [
        node
        for node, frame in enumerate(boards, 1)
        if not topology.layouts[frames.layout[frame]].counts_only and FIRST_ID + node not in taken
    ]


def node_numbers(topology: Topology) -> np.ndarray:
    """Number of the board that sends each data frame, counted on its bus.

    Returns
    -------
    ndarray, shape (f,), int
        Order of `Topology.frames`; -1 for a sensor of another kind, which is no such board.
    """
    frames = topology.frames
    nodes = np.empty(len(frames), int)
    for bus in range(len(topology.buses)):
        here = frames.bus == bus
        nodes[here] = np.cumsum(frames.part[here] == 0)
    foreign = np.array([layout.counts_only for layout in topology.layouts], bool)
    nodes[foreign[frames.layout]] = -1
    return nodes
