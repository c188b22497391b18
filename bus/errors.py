"""Errors of the bus.

::

    BusError                 everything below
    ├── BusOpenError         a bus of the topology could not be opened
    ├── BusClosedError       the transport was closed, or its interface is gone
    ├── LayoutError          a wire layout that cannot be packed or unpacked
    ├── LogError             a log file is not what it says it is
    └── FaultScriptError     a script of faults to order cannot be used
"""

from __future__ import annotations

__all__ = [
    "BusClosedError",
    "BusError",
    "BusOpenError",
    "FaultScriptError",
    "LayoutError",
    "LogError",
]


class BusError(Exception):
    """Anything that goes wrong between wires and counts."""


class BusOpenError(BusError):
    """A bus of the topology could not be opened; the message names bus, interface and remedy."""


class BusClosedError(BusError):
    """The transport was closed, or its interface is gone for good."""


class LayoutError(BusError):
    """A wire layout that cannot be packed or unpacked; the message names layout and signal."""


class LogError(BusError):
    """A log file is not what it says it is; the message names file and first offending position."""


class FaultScriptError(BusError):
    """A script of faults to order cannot be used; the message has one problem a line."""
