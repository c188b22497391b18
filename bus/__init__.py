"""Counts from CAN buses: frames in batches, transports, and the assembly of frames into cycles."""

from bus.assemble import Assembler
from bus.codec import Packer, crc16
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from bus.errors import BusClosedError, BusError, BusOpenError, LayoutError, LogError
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.memory import MemoryTransport
from bus.open import open_transport
from bus.state import BusChange, BusState
from bus.status import INVALID, Status
from bus.transport import Transport, TransportCounters
from bus.wait import Waiter

__all__ = [
    "FRAME_DTYPE",
    "INVALID",
    "Assembler",
    "BusChange",
    "BusClosedError",
    "BusError",
    "BusOpenError",
    "BusState",
    "ClosedBy",
    "FrameBatch",
    "FrameCounters",
    "LayoutError",
    "LogError",
    "MemoryTransport",
    "Packer",
    "RawCycle",
    "Status",
    "Transport",
    "TransportCounters",
    "Waiter",
    "crc16",
    "open_transport",
]
