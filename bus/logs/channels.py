"""Channels: the bus of each frame of a log."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from bus.errors import LogError
from topology import Topology
from topology.files import check_path

__all__ = ["LEFT_OUT", "Channels", "buses_of", "is_numbered", "names_of", "numbers_of"]

LEFT_OUT = -1
"""Index of unwanted channels."""
MOST_BUSES = 256
"""`bus` of a frame is one byte."""
MOST_CHANNELS = 1024
NAME = re.compile(r"[!-~]{1,63}")
"""Name of the channels of every log."""
NUMBERED = re.compile(r"can(\d{1,2})")


def names_of(topology: Topology) -> list[str]:
    """Names of the buses in a log: their channels, or their own names where channels are not
    unique."""
    channels = [bus.channel for bus in topology.buses]
    are_unique = len(set(channels)) == len(channels) and all(map(NAME.fullmatch, channels))
    return channels if are_unique else [bus.name for bus in topology.buses]


def numbers_of(topology: Topology) -> list[int]:
    """Numbers of the buses, from 0, in a log without names: n of "cann", else their order."""
    found = [NUMBERED.fullmatch(name) for name in names_of(topology)]
    return [int(one[1]) if all(found) and one else i for i, one in enumerate(found)]


def is_numbered(path: str | os.PathLike[str]) -> bool:
    """Whether a log, by its suffix, numbers its channels and has no names."""
    check_path("log", path, LogError)
    return Path(path).name.lower().removesuffix(".gz").endswith(".blf")


def buses_of(topology: Topology, path: str | os.PathLike[str] | None = None) -> dict[str, int]:
    """Bus indices of a topology by channel, as `read` takes them for `buses`.

    Parameters
    ----------
    topology : Topology
    path : path, optional
        The log, whose suffix decides whether its channels have names.

    Examples
    --------
    >>> import topology
    >>> buses_of(topology.load("palm"))
    {'palm': 0}
    >>> buses_of(topology.load("palm"), "run.blf")
    {'can0': 0}
    """
    if path is not None and is_numbered(path):
        return {f"can{number}": index for index, number in enumerate(numbers_of(topology))}
    return {name: index for index, name in enumerate(names_of(topology))}


class Channels:
    """Bus indices for the channels of a log.

    Parameters
    ----------
    buses : mapping of str to int, optional
        Bus index of each wanted channel; frames of others are left out. Without it the first
        channel that appears is bus 0, the next one bus 1, and so on.

    Attributes
    ----------
    seen : dict of str to int
        Bus index (`LEFT_OUT` for others) of every channel, in order of first appearance.
    """

    def __init__(self, buses: Mapping[str, int] | None = None) -> None:
        self.buses = buses
        self.seen: dict[str, int] = {}

    def index(self, name: str) -> int:
        """Bus index of a channel.

        Raises
        ------
        ValueError
            More channels than a frame can index.
        """
        found = self.seen.get(name)
        if found is None:
            most = MOST_BUSES if self.buses is None else MOST_CHANNELS
            if len(self.seen) == most:
                raise ValueError(f"must be one of at most {most} channels")
            found = len(self.seen) if self.buses is None else self.buses.get(name, LEFT_OUT)
            self.seen[name] = found
        return found

    def missing(self) -> str:
        """The fault of a log with frames, but none of the wanted channels; or nothing."""
        if self.buses is None or not self.seen or any(i != LEFT_OUT for i in self.seen.values()):
            return ""
        asked, got = (", ".join(map(repr, names)) for names in (self.buses, self.seen))
        return f"must hold frames of {asked}; got {got} alone"
