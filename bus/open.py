"""Opens the transport of a bus by its `interface`."""

from __future__ import annotations

import numpy as np

from bus.linux import has_batches
from bus.transport import Transport
from topology import Bus

__all__ = ["open_transport"]


def open_transport(bus: Bus, index: int = 0, *, filters: np.ndarray | None = None) -> Transport:
    """Open one bus of a topology by its `interface`.

    `memory` is in-process, `socketcan` the batch reader of Linux; others, and `socketcan` without
    the batch reader, use python-can.

    Parameters
    ----------
    bus : Bus
    index : int
        Written to `bus` of every received frame.
    filters : ndarray, shape (k, 2), uint32, optional
        Identifiers and masks that the kernel lets through, from `bus.socketcan.filters`; other
        transports receive all frames.

    Raises
    ------
    BusOpenError
        The interface is unknown or cannot be opened.
    """
    if bus.interface == "memory":
        from bus.memory import MemoryTransport

        return MemoryTransport(bus.channel or bus.name, index=index)
    if bus.interface == "socketcan" and has_batches():
        from bus.socketcan import SocketCanTransport

        return SocketCanTransport(bus, index, filters=filters)
    from bus.pythoncan import PythonCanTransport

    return PythonCanTransport(bus, index=index)
