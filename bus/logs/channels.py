"""Channels: which bus a frame of a log belongs to."""

from __future__ import annotations

from collections.abc import Mapping

from topology import Topology

__all__ = ["LEFT_OUT", "Channels", "buses_of"]

LEFT_OUT = -1
"""Index for the frames of a channel that nobody asked for."""
MOST_BUSES = 256
"""`bus` of a frame is one byte."""
MOST_CHANNELS = 1024


def buses_of(topology: Topology) -> dict[str, int]:
    """Bus indices of a topology by channel, as `read` takes them for `buses`.

    Examples
    --------
    >>> import topology
    >>> buses_of(topology.load("palm"))
    {'palm': 0}
    """
    return {bus.channel: index for index, bus in enumerate(topology.buses)}


class Channels:
    """Bus indices for the channels of a log.

    Parameters
    ----------
    buses : mapping of str to int, optional
        Bus index of each channel that counts; frames of others are left out. Without it the first
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
            More channels than a frame can tell apart.
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
        """What is wrong where a log has frames, but none of the channels asked for; or nothing."""
        if self.buses is None or not self.seen or any(i != LEFT_OUT for i in self.seen.values()):
            return ""
        asked, got = (", ".join(map(repr, names)) for names in (self.buses, self.seen))
        return f"must hold frames of {asked}; got {got} alone"
