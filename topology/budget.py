"""Exact worst-case length of frames in bits, and the load of a bus.

Bit counts hold for ISO 11898-1:2015 and include stuff bits and the three bits of intermission.
Stuffing is worst when, after the first five bits, every fourth one causes a stuff bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topology.arrays import EXTENDED, Topology
from topology.schema import Bus

__all__ = ["BusLoad", "bus_load", "classic_bits", "fd_bits", "frame_seconds"]

HEARTBEAT_SIZE = 8
"""Bytes of a heartbeat, a classic frame once a second from every sender of data; sensors of another
kind send none."""

SYNC_SIZE = 1


def classic_bits(size: int, extended: bool = False) -> int:
    """Maximum bits of a classic data frame of `size` bytes.

    Start, identifier, control, data and CRC (34 bits and the data; 54 with a 29-bit identifier)
    are stuffed; CRC delimiter, ACK, end of frame and intermission (13 bits) are not.

    Examples
    --------
    >>> classic_bits(8), classic_bits(8, extended=True)
    (135, 160)
    """
    stuffed = (54 if extended else 34) + 8 * size
    return stuffed + (stuffed - 1) // 4 + 13


def fd_bits(size: int, extended: bool = False) -> tuple[int, int]:
    """Maximum bits of a CAN FD data frame of `size` bytes, at either bit rate.

    The nominal rate holds from the start to the bit that switches the rate (17 bits, 36 with a
    29-bit identifier) and from the CRC delimiter on (13 bits); ESI, length, data, stuff count and
    CRC (17 or 21 bits, with fixed stuff bits) have the data rate. Stuff bits on either side of the
    switch are counted at the nominal rate.

    Returns
    -------
    nominal, data : int

    Examples
    --------
    >>> fd_bits(16), fd_bits(64)
    ((34, 193), (34, 678))
    """
    arbitration = 36 if extended else 17
    slow_stuff = (arbitration - 1) // 4
    payload = 5 + 8 * size
    stuff = (arbitration + payload - 1) // 4
    crc = 17 if size <= 16 else 21
    fixed = -(-(4 + crc) // 4)
    return arbitration + slow_stuff + 13, payload + stuff - slow_stuff + 4 + crc + fixed


def frame_seconds(size: int, fd: bool, bus: Bus, extended: bool = False) -> float:
    """Longest time of a data frame of `size` bytes on a bus, s."""
    if not fd:
        return classic_bits(size, extended) / bus.bitrate
    nominal, data = fd_bits(size, extended)
    return nominal / bus.bitrate + data / (bus.data_bitrate or bus.bitrate)


@dataclass(frozen=True)
class BusLoad:
    """Load of one bus by its expected frames.

    Attributes
    ----------
    frames : int
        Data frames per cycle.
    cycle_s : float
        Time on the wire of SYNC and all data frames of a cycle, s.
    load : float
        Fraction of the bus at its cycle rate, heartbeats included.
    highest_rate_hz : float
        Cycle rate at which the load is `max_load`; 0 where heartbeats alone exceed it.
    """

    frames: int
    cycle_s: float
    load: float
    highest_rate_hz: float


def bus_load(topology: Topology, index: int) -> BusLoad:
    """Worst-case load of a bus: SYNC and all data frames every cycle, heartbeats every second.

    Parameters
    ----------
    topology : Topology
    index : int
        Of the bus.
    """
    bus, frames = topology.buses[index], topology.frames
    here = frames.bus == index
    cycle_s = frame_seconds(SYNC_SIZE, False, bus) if topology.sync_id is not None else 0.0
    kinds = np.stack([frames.layout[here], (frames.can_id[here] & EXTENDED) != 0])
    values, number = np.unique(kinds, axis=1, return_counts=True)
    for (layout, extended), count in zip(values.T.tolist(), number.tolist(), strict=True):
        wire = topology.layouts[layout]
        cycle_s += count * frame_seconds(wire.size, wire.fd, bus, bool(extended))
    own = ~np.array([layout.counts_only for layout in topology.layouts], bool)
    senders = int(np.count_nonzero((frames.part[here] == 0) & own[frames.layout[here]]))
    heartbeats = senders * frame_seconds(HEARTBEAT_SIZE, False, bus)
    room = max(bus.max_load - heartbeats, 0.0)
    return BusLoad(
        frames=int(np.count_nonzero(here)),
        cycle_s=cycle_s,
        load=cycle_s * topology.cycle_rate_hz + heartbeats,
        highest_rate_hz=room / cycle_s if cycle_s else float("inf"),
    )
