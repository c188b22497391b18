"""Errors of the bus.

::

    BusError                 base class
    ├── BusOpenError         a bus of the topology could not be opened
    ├── BusClosedError       the transport was closed, or its interface is gone
    ├── LayoutError          a wire layout that cannot be packed or unpacked
    ├── LogError             a log file is damaged or of another format
    │   └── ChannelError     the channels of a log are not those of the buses
    └── FaultScriptError     a fault script cannot be used
"""

from __future__ import annotations

__all__ = [
    "BusClosedError",
    "BusError",
    "BusOpenError",
    "ChannelError",
    "FaultScriptError",
    "LayoutError",
    "LogError",
]


class BusError(Exception):
    """Base class of errors between wires and counts."""


class BusOpenError(BusError):
    """A bus of the topology could not be opened; the message names bus, interface and remedy."""


class BusClosedError(BusError):
    """The transport was closed, or its interface is permanently gone."""


class LayoutError(BusError):
    """A wire layout that cannot be packed or unpacked; the message names layout and signal."""


class LogError(BusError):
    """A log file is damaged or of another format; the message names file and first invalid
    position."""


class ChannelError(LogError):
    """The channels of a log are not those of the buses: nothing of it can be used."""


class FaultScriptError(BusError):
    """A fault script cannot be used; the message has one problem a line."""
