"""Boards: status of the boards on the buses of a topology, from their heartbeats."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bus.frame import ECHO, FD_FDF
from bus.heartbeat import FIELDS, FIRST_ID, LAST_ID, LAYOUT, STATES
from topology import Topology

__all__ = ["Board", "Boards"]

MOST_SERIALS = 16
_NAMES = tuple(name for name, _ in FIELDS)


@dataclass(slots=True)
class Board:
    """Contents of the heartbeats of one node.

    Attributes
    ----------
    heartbeats : int
        Number of heartbeats.
    last_s : float
        Time of the last one, in seconds of listening.
    state : str
        Its state; a number if it has no name.
    serials : set of int
        Serial numbers; more than one only if two boards have the same node number. At most
        MOST_SERIALS.
    """

    heartbeats: int = 0
    last_s: float = 0.0
    state: str = ""
    serials: set[int] = field(default_factory=set)


class Boards:
    """Boards whose heartbeats were received; their number is bounded by the identifiers.

    Parameters
    ----------
    topology : Topology

    Attributes
    ----------
    heard : dict of (int, int) to Board
        By bus and node.
    """

    def __init__(self, topology: Topology) -> None:
        self.heard: dict[tuple[int, int], Board] = {}
        frames = topology.frames
        self._taken = set(zip(frames.bus.tolist(), frames.can_id.tolist(), strict=True))
        self._taken |= {(b, topology.sync_id) for b in range(len(topology.buses))}
        self._buses = len(topology.buses)

    def hear(self, frames: np.ndarray, listened_s: np.ndarray) -> None:
        """Process the heartbeats among frames; others are ignored.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        listened_s : ndarray, shape (m,)
            Time of each frame, in seconds of listening.
        """
        is_beat = (frames["id"] > FIRST_ID) & (frames["id"] <= LAST_ID)
        is_beat &= (frames["length"] == LAYOUT.size) & (frames["bus"] < self._buses)
        is_beat &= ((frames["flags"] & FD_FDF) == 0) & ((frames["origin"] & ECHO) == 0)
        for i in np.flatnonzero(is_beat):
            bus, can_id = int(frames["bus"][i]), int(frames["id"][i])
            if (bus, can_id) in self._taken:
                continue
            fields = dict(zip(_NAMES, LAYOUT.unpack_from(frames["data"][i].tobytes()), strict=True))
            board = self.heard.setdefault((bus, can_id - FIRST_ID), Board())
            board.heartbeats += 1
            board.last_s = float(listened_s[i])
            state = fields["state"]
            board.state = STATES[state] if state < len(STATES) else str(state)
            if len(board.serials) < MOST_SERIALS:
                board.serials.add(fields["serial_number"])
