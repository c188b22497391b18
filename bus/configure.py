"""Configuration: commands of the host to boards, eight bytes, one identifier on every bus.

Boards are numbered as in their heartbeats (`bus.heartbeat`); sensors of another kind are not such
boards. A board ignores unknown or impossible commands. The frame has no answer: the data show
whether a tare or a rate was accepted.

``tare`` zeroes the frequency and the lateral field of every unit of the board: the board takes the
mean of its last readings as the values at rest, and subtracts the excess from then on. The axial
field is unchanged, since its absolute value gives the displacement. A reading at its rail stays
there.

``rate`` makes the board answer every value-th SYNC only, the same ones for all boards; without SYNC
it divides its rate by the value. 1 is every cycle.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FRAME_DTYPE
from topology import Topology

__all__ = [
    "ALL_NODES",
    "FIELDS",
    "IDENTIFIER",
    "LAYOUT",
    "Command",
    "Configuration",
    "node_numbers",
    "pack",
    "read",
    "understands",
]

IDENTIFIER = 0x7E0

FIELDS = (
    ("command", 8),
    ("node", 8),  # 0: all boards of the bus
    ("value", 16),  # of `rate`: 1 to 65535; of `tare`: 0
    ("reserved", 32),  # 0; other values are of a later protocol, and ignored
)
"""Unsigned integers, little endian, in order: name and bits."""
LAYOUT = struct.Struct("<" + "".join({8: "B", 16: "H", 32: "I"}[bits] for _, bits in FIELDS))
ALL_NODES = 0


class Command(IntEnum):
    """Commands of boards."""

    TARE = 1
    RATE = 2


@dataclass(frozen=True)
class Configuration:
    """One configuration frame.

    Attributes
    ----------
    command : int
        A `Command`, or an unknown number.
    node : int
        Number of the board on its bus; 0 for all.
    value : int
    """

    command: int
    node: int = ALL_NODES
    value: int = 0

    @property
    def valid(self) -> bool:
        """Whether the command is known and its value allowed."""
        if self.command == Command.RATE:
            return self.value >= 1
        return self.command == Command.TARE and self.value == 0


def pack(command: Command, node: int = ALL_NODES, value: int = 0) -> np.ndarray:
    """The frame of a command, to be sent on the bus of the boards.

    Parameters
    ----------
    command : Command
    node : int
        Number of the board on its bus, as in its heartbeats; 0 for all.
    value : int
        Of ``rate``: the decimation.

    Returns
    -------
    ndarray, shape (1,), FRAME_DTYPE

    Raises
    ------
    ValueError
        No board can execute it.

    Examples
    --------
    >>> pack(Command.RATE, node=3, value=2)["data"][0, :8].tolist()
    [2, 3, 2, 0, 0, 0, 0, 0]
    """
    if command not in tuple(Command):
        known = ", ".join(f"{known.value} ({known.name.lower()})" for known in Command)
        raise ValueError(f"command: must be {known}; got {command!r}")
    if not 0 <= node <= 0xFF:
        raise ValueError(f"node: must be 0 (all boards of the bus) to 255; got {node}")
    if not 0 <= value <= 0xFFFF or not Configuration(command, node, value).valid:
        allowed = "1 to 65535" if command == Command.RATE else "0"
        raise ValueError(f"value: must be {allowed} for {command.name.lower()}; got {value}")
    record = np.zeros(1, FRAME_DTYPE)
    record["id"], record["length"] = IDENTIFIER, LAYOUT.size
    record["data"][0, : LAYOUT.size] = np.frombuffer(LAYOUT.pack(command, node, value, 0), np.uint8)
    return record


def read(record: np.void) -> Configuration | None:
    """The command of a frame; None where it is not a configuration frame of this protocol.

    Parameters
    ----------
    record : FRAME_DTYPE
    """
    flagged = int(record["id"]) & (CAN_EFF | CAN_RTR | CAN_ERR)
    if flagged or record["id"] != IDENTIFIER or record["length"] != LAYOUT.size:
        return None
    command, node, value, reserved = LAYOUT.unpack(record["data"][: LAYOUT.size].tobytes())
    return None if reserved else Configuration(command, node, value)


def understands(topology: Topology, bus: int) -> bool:
    """Whether the identifier is free for configuration on a bus, and not one of data.

    Parameters
    ----------
    topology : Topology
    bus : int
    """
    taken = topology.frames.can_id[topology.frames.bus == bus]
    return IDENTIFIER not in taken and topology.sync_id != IDENTIFIER


def node_numbers(topology: Topology) -> np.ndarray:
    """Number of the board that sends each data frame, counted on its bus.

    Returns
    -------
    ndarray, shape (f,), int
        Order of `Topology.frames`; -1 for a sensor of another kind, which takes no configuration.
    """
    frames = topology.frames
    nodes = np.empty(len(frames), int)
    for bus in range(len(topology.buses)):
        here = frames.bus == bus
        nodes[here] = np.cumsum(frames.part[here] == 0)
    foreign = np.array([layout.counts_only for layout in topology.layouts], bool)
    nodes[foreign[frames.layout]] = -1
    return nodes
