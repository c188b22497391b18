"""The contract of a transport, and the way from a topology's bus to one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from bus.frame import FrameBatch
from topology import Bus

__all__ = ["Transport", "TransportCounters", "open_transport"]


@dataclass
class TransportCounters:
    """What a transport has counted since it was opened."""

    received: int = 0
    """Frames handed to the caller."""
    sent: int = 0
    """Frames given to the interface."""
    send_failures: int = 0
    """Frames that the interface would not take."""
    queue_drops: int = 0
    """Frames lost in the interface's or the socket's receive queue."""
    ring_overflows: int = 0
    """Frames lost in a ring of our own, because the caller did not read in time."""


class Transport(ABC):
    """One end of a CAN bus.

    Every transport keeps this contract, and one set of tests holds all of them to it:

    - frames arrive in the order of the bus, none twice, and a lost one is counted;
    - frames that this end sent itself do not come back;
    - error and remote frames come through with their bits set in `id`;
    - `receive` and `send` may be called from different threads, each from one.
    """

    def __init__(self, index: int = 0) -> None:
        self.index = index
        """Written to `bus` of every received frame."""
        self.counters = TransportCounters()

    @abstractmethod
    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`, at most as many as fit.

        Waits up to `timeout_s` seconds for the first one; what has arrived by then is taken
        without waiting for more.

        Returns
        -------
        int
            Number of frames appended; 0 after the time-out.

        Raises
        ------
        BusClosedError
            The transport was closed, or its interface is gone.
        """

    @abstractmethod
    def send(self, records: np.ndarray) -> int:
        """Send frames, in order.

        Parameters
        ----------
        records : ndarray, shape (m,), FRAME_DTYPE

        Returns
        -------
        int
            Number of frames taken by the interface; the others are counted in `send_failures`.

        Raises
        ------
        BusClosedError
            The transport was closed, or its interface is gone.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the interface; closing twice is fine."""

    def __enter__(self) -> Transport:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def open_transport(bus: Bus, index: int = 0) -> Transport:
    """Open one bus of a topology by its `interface`.

    `memory` is in-process; any other name goes to python-can.

    Raises
    ------
    BusOpenError
        The interface is unknown or cannot be opened.
    """
    if bus.interface == "memory":
        from bus.memory import MemoryTransport

        return MemoryTransport(bus.channel or bus.name, index=index)
    from bus.pythoncan import PythonCanTransport

    return PythonCanTransport(bus, index=index)
