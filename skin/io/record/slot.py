"""A slot of the ring buffer: the inputs of a cycle, and its state."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from bus.frame import FRAME_DTYPE
from skin.io.messages.record import record_dtype
from skin.sinks import Ending
from topology import Topology

__all__ = ["EVENTS", "Event", "slot_dtype"]

EVENTS = 24
"""Events per slot; further ones go into the next slot."""
SPARE_FRAMES = 8


class Event(IntEnum):
    """Calls of a pipeline. The first four are those of ``f3t_msgs/msg/CanFrames``."""

    FED = 0
    """Frames; the value is their number."""
    EXPIRED = int(Ending.EXPIRED)
    """The value is the age of the cycle in ns, also of the next two."""
    SILENT = int(Ending.SILENT)
    FLUSHED = int(Ending.FLUSHED)
    MOVED = 4
    """The poses in the slot hold from the next cycle on."""
    FED_PART = 5
    """As FED, and the batch continues with the next event."""


def slot_dtype(topology: Topology, contacts: int) -> np.dtype[Any]:
    """The dtype of a slot, for a skin with so many contacts at most.

    Events are in order, their frames one after the other. Fields that may be partly filled, or
    empty, are last: frames, contacts, poses.
    """
    expected = len(topology.frames) + len(topology.buses)
    frames = expected + expected // 2 + SPARE_FRAMES
    return record_dtype(
        topology,
        contacts,
        (
            ("event_values", "i8", (EVENTS,)),
            ("event_count", "i8", ()),
            ("frame_count", "i8", ()),
            ("events", "u1", (EVENTS,)),  # Event
            ("has_state", "i8", ()),
        ),
        (("frames", "i8", (frames, FRAME_DTYPE.itemsize // 8)),),
    )
