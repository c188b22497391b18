"""Channels: the bus of each frame of a log. docs/guides/bulk.md has the rule as a table."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from bus.errors import ChannelError, LogError
from topology import Topology
from topology.errors import nearest
from topology.files import check_path

__all__ = ["LEFT_OUT", "ONLY", "Channels", "buses_of", "first_of", "names_of", "numbers_of"]

LEFT_OUT = -1
"""Index of unwanted channels."""
ONLY = "*"
"""Stands for the only channel of a log, where the topology names none that a log could have."""
MOST_BUSES = 256
"""`bus` of a frame is one byte."""
MOST_CHANNELS = 1024
NAME = re.compile(r"[!-~]{1,63}")
"""Name of the channels of every log."""
NUMBERED = re.compile(r"(?:can|vcan|slcan)?(\d{1,2})")
FIRST = {".asc": 1, ".blf": 1, ".trc": 1}
"""Number of can0 in the formats that number their channels and have no names."""
HOW = "--map FILE_CHANNEL=BUS, in Python channels={...}, names the bus of a channel"


def names_of(topology: Topology) -> list[str]:
    """Names of the buses in a log: their channels, or their own names where channels are not
    unique."""
    channels = [bus.channel for bus in topology.buses]
    are_unique = len(set(channels)) == len(channels) and all(map(NAME.fullmatch, channels))
    return channels if are_unique else [bus.name for bus in topology.buses]


def numbers_of(topology: Topology) -> list[int]:
    """Numbers of the buses, from 0, in a log without names: n of "cann"; none if one has no
    number, or two have the same."""
    found = [int(one[1]) for one in map(NUMBERED.fullmatch, names_of(topology)) if one]
    return found if len(set(found)) == len(topology.buses) else []


def first_of(path: str | os.PathLike[str]) -> int | None:
    """Number of can0 in a log, by its suffix; None where the channels have names."""
    check_path("log", path, LogError)
    return FIRST.get(Path(Path(path).name.lower().removesuffix(".gz")).suffix)


def buses_of(
    topology: Topology,
    path: str | os.PathLike[str] | None = None,
    channels: Mapping[str, str] | None = None,
) -> dict[str, int]:
    """Bus indices of a topology by channel, as `read` takes them for `buses`.

    Parameters
    ----------
    topology : Topology
    path : path, optional
        The log, whose suffix decides whether its channels have names.
    channels : mapping of str to str, optional
        Name of the bus of a channel, by the name or number that the log has for it. The other buses
        have the channels of the topology.

    Raises
    ------
    ChannelError
        `channels` names a bus that is not there, or one twice.

    Examples
    --------
    >>> import topology
    >>> buses_of(topology.load("hand"))
    {'hand-palm': 0, 'hand-fingers': 1}
    >>> buses_of(topology.load("hand"), "run.blf", {"7": "palm"})
    {'can1': 1, '7': 0}
    """
    free, known = {bus.name: i for i, bus in enumerate(topology.buses)}, {}
    for channel, name in (channels or {}).items():
        if name not in free:
            raise ChannelError(f"channels: {channel}: must be a bus of {topology.name!r}, each "
                               f"once; got {name!r}{nearest(name, free)}")  # fmt: skip
        known[str(channel)] = free.pop(name)
    names, numbers = names_of(topology), numbers_of(topology)
    is_numbered = path is not None and first_of(path) is not None
    # buses within a process have no channel in the field: logs of several are our own
    in_process = all(bus.interface == "memory" for bus in topology.buses)
    if is_numbered and (numbers or (in_process and len(names) > 1)):
        names = [f"can{number}" for number in numbers or range(len(names))]
    buses = {name: i for i, name in enumerate(names) if i not in known.values()} | known
    if len(names) == 1 and not known and (in_process or (is_numbered and not numbers)):
        buses[ONLY] = 0
    return buses


class Channels:
    """Bus indices for the channels of a log.

    Parameters
    ----------
    buses : mapping of str to int, optional
        Bus index of each wanted channel; frames of others are left out. Without it the first
        channel that appears is bus 0, the next one bus 1, and so on. A channel without a name is
        that of the only bus.
    first : int, optional
        Number of can0, in a log that numbers its channels: `buses` may have numbers, too.

    Attributes
    ----------
    seen : dict of str to int
        Bus index (`LEFT_OUT` for others) of every channel, in order of first appearance.
    """

    def __init__(self, buses: Mapping[str, int] | None = None, first: int | None = None) -> None:
        self.buses, self.first = buses, first
        self.seen: dict[str, int] = {}

    def index(self, name: str) -> int:
        """Bus index of a channel, which is "" where the log names none.

        Raises
        ------
        ValueError
            More channels than a frame can index.
        ChannelError
            Nothing says which bus it is.
        """
        found = self.seen.get(name)
        if found is None:
            most = MOST_BUSES if self.buses is None else MOST_CHANNELS
            if len(self.seen) == most:
                raise ValueError(f"must be one of at most {most} channels")
            found = len(self.seen) if self.buses is None else self._wanted(name, self.buses)
            self.seen[name] = found
        return found

    def _wanted(self, name: str, buses: Mapping[str, int]) -> int:
        """Bus index of a channel that appears for the first time."""
        if not name:
            if len(indices := set(buses.values())) > 1:
                raise ChannelError("must name the channel of each frame, for a skin of "
                                   f"{len(indices)} buses; got a log without channels")  # fmt: skip
            return indices.pop()
        if ONLY in buses and next(iter(self.seen), name) not in buses:
            return LEFT_OUT if self.seen else buses[ONLY]
        number = name if self.first is None else self._number(name)
        found = buses.get(number, buses.get(name, LEFT_OUT))
        if (self.first, number, found) == (1, "0", LEFT_OUT) and not all(map(str.isdigit, buses)):
            raise ChannelError(f"must count its channels from 1; got channel 0: {HOW}")
        return found

    def lacking(self, is_left_out: bool) -> str:
        """The fault of a log without frames of a wanted channel, or of several where the only one
        is wanted; or nothing. `is_left_out`: whether frames of other channels were."""
        buses, got = self.buses or {}, ", ".join(map(self._shown, self.seen))
        if ONLY in buses and is_left_out and next(iter(self.seen)) not in buses:
            return f"must have one channel, or {next(iter(buses))!r}; got {got}: {HOW}"
        asked = [name for name, bus in buses.items() if bus not in self.seen.values()]
        fault = f"must hold frames of {', '.join(map(repr, asked))}; got {got} alone"
        fault += f": {HOW}" if is_left_out else ""
        return fault if self.seen and asked else ""

    def _number(self, name: str) -> str:
        """Number in the log of a channel, such as can0."""
        return str(int(name.removeprefix("can")) + (self.first or 0))

    def _shown(self, name: str) -> str:
        numbered = self.first is not None and name
        return f"channel {self._number(name)} ({name})" if numbered else repr(name)
