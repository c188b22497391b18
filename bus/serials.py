"""Which unit is where: serial numbers of files, and those of boards, in their heartbeats."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from bus.boards import Boards
from topology import Topology

__all__ = ["compare_serials", "of_boards"]

NUMBER = re.compile(r"(\d+)(/\d+)?$")
"""At the end of a serial number: that of the board, and which of its units."""


def of_boards(topology: Topology, boards: Boards) -> dict[str, str]:
    """Serial numbers of units by those of their boards: ``1042``; ``1042/2`` of a second unit.

    Boards that were not heard, or that are two with one node number, have none.
    """
    frames, told = topology.frames, {}
    for (bus, node), board in boards.heard.items():
        first = np.flatnonzero((frames.bus == bus) & (frames.part == 0))
        if len(board.serials) != 1 or node > first.size:
            continue
        (serial,) = board.serials
        units = frames.units[first[node - 1]]
        units = units[units >= 0]
        for place, unit in enumerate(units, 1):
            name = topology.unit_names[unit]
            told[name] = str(serial) if units.size == 1 else f"{serial}/{place}"
    return told


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
        own, said = NUMBER.search(serial), heard.get(name)
        if own is None or said is None or ("/" in said and own[2] is None):
            continue
        found[name] = ""
        if own[0].lstrip("0") == said:
            continue
        others = (unit for unit, entry in everywhere.items() if unit != name
                  and (match := NUMBER.search(entry)) and match[0].lstrip("0") == said)  # fmt: skip
        other = next(others, None)
        where = f", which {source} has as {other}" if other else ""
        found[name] = (f"serial number: must be {serial}, as {source} has it; got {said} in "
                       f"heartbeats{where}")  # fmt: skip
    return found
