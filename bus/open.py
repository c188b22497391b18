"""Opens the transport of a bus by its `interface`."""

from __future__ import annotations

from bus.linux import has_batches
from bus.transport import Transport
from topology import Bus

__all__ = ["open_transport"]


def open_transport(bus: Bus, index: int = 0) -> Transport:
    """Open one bus of a topology by its `interface`.

    `memory` is in-process, `socketcan` the batch reader of Linux; others, and `socketcan` without
    the batch reader, use python-can.

    Parameters
    ----------
    bus : Bus
    index : int
        Written to `bus` of every received frame.

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

        return SocketCanTransport(bus, index)
    from bus.pythoncan import PythonCanTransport

    return PythonCanTransport(bus, index=index)
