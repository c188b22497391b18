"""Boards: status of the boards on the buses of a topology, from their heartbeats; and which unit is
where, by serial numbers of files and of boards."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bus.frame import ECHO, FD_FDF
from bus.heartbeat import FIELDS, FIRST_ID, LAST_ID, LAYOUT, STATES
from topology import Topology

__all__ = ["Board", "Boards", "compare_serials", "of_boards"]

MOST_SERIALS = 16
_NAMES = tuple(name for name, _ in FIELDS)
_NUMBER = re.compile(r"(\d+)(/\d+)?$")
"""At the end of a serial number: that of the board, and which of its units."""


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


def of_boards(topology: Topology, boards: Boards) -> dict[str, str]:
    """Serial numbers of units by those of their boards: ``1042``; ``1042/2`` of a second unit.

    Boards that were not heard, or that are two with one node number, have none.
    """
    frames, found = topology.frames, {}
    for (bus, node), board in boards.heard.items():
        first = np.flatnonzero((frames.bus == bus) & (frames.part == 0))
        if len(board.serials) != 1 or node > first.size:
            continue
        (serial,) = board.serials
        units = frames.units[first[node - 1]]
        units = units[units >= 0]
        for place, unit in enumerate(units, 1):
            name = topology.unit_names[unit]
            found[name] = str(serial) if units.size == 1 else f"{serial}/{place}"
    return found


def compare_serials(
    given: Mapping[str, str], heard: Mapping[str, str], everywhere: Mapping[str, str], source: str
) -> dict[str, str]:
    """Units whose serial number is known on both sides, and what is wrong with it, if anything.

    What stands before the number, as in ``F3T-1042``, is the maker's. Of boards with several units
    a number alone may be the unit's own, and decides nothing.

    Parameters
    ----------
    given : mapping of str to str
        Unit to its serial number by a file.
    heard : mapping of str to str
        As of `of_boards`.
    everywhere : mapping of str to str
        Serial numbers of all units that the file knows.
    source : str
        The file, in words.
    """
    found = {}
    for name, serial in given.items():
        own, said = _NUMBER.search(serial), heard.get(name)
        if own is None or said is None or ("/" in said and own[2] is None):
            continue
        found[name] = ""
        if own[0].lstrip("0") == said:
            continue
        numbers = ((unit, _NUMBER.search(entry)) for unit, entry in everywhere.items())
        other = next((unit for unit, match in numbers if unit != name and match
                      and match[0].lstrip("0") == said), None)  # fmt: skip
        where = f", which {source} has as {other}" if other else ""
        found[name] = (f"serial number: must be {serial}, as {source} has it; got {said} in "
                       f"heartbeats{where}")  # fmt: skip
    return found
