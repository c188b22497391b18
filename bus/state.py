"""BusState: state of a bus, its changes, and decoding of the controller's error frames."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from bus.frame import CAN_ERR

__all__ = ["BusChange", "BusState", "ErrorFrame", "read_error_frame"]


class BusState(StrEnum):
    """State of one bus, as known to this host.

    The first four are the controller's fault confinement (ISO 11898-1); without a controller the
    state stays ACTIVE.
    """

    ACTIVE = "error-active"
    """The bus works."""
    WARNING = "error-warning"
    """96 errors or more on the controller's count: wiring, termination or bit rate."""
    PASSIVE = "error-passive"
    """128 errors or more: the controller may no longer flag errors to others."""
    BUS_OFF = "bus-off"
    """256 transmit errors: the controller has left the bus until it is restarted."""
    DOWN = "down"
    """The interface is switched off."""
    GONE = "gone"
    """The interface is unplugged or deleted."""


@dataclass(frozen=True, slots=True)
class BusChange:
    """One change of a bus's state."""

    stamp_ns: int
    """Time stamp of the error frame, or the host's time where there was none."""
    previous: BusState
    state: BusState
    reason: str
    """Description of the event."""

    def __str__(self) -> str:
        return f"{self.previous} -> {self.state}: {self.reason}"


@dataclass(frozen=True, slots=True)
class ErrorFrame:
    """Contents of an error frame."""

    state: BusState | None
    """The new state of the bus, if the frame contains it."""
    is_overflow: bool
    """The controller's own receive queue was full: a frame is lost."""
    words: str


# linux/can/error.h: classes in the identifier, details in the data.
_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTS = 0x4, 0x40, 0x100, 0x200
_CLASSES = {
    0x1: "transmission timed out",
    0x2: "arbitration lost",
    0x8: "protocol violation",
    0x10: "transceiver fault",
    0x20: "no acknowledgement",
    0x40: "bus-off",
    0x80: "bus error",
    0x100: "controller restarted",
}
_RX_OVERFLOW, _WARNINGS, _PASSIVES, _ACTIVE = 0x1, 0x0C, 0x30, 0x40
_CONTROLLER_WORDS = {
    0x1: "receive queue of the controller full",
    0x2: "transmit queue of the controller full",
    0x4: "receive errors at the warning level",
    0x8: "transmit errors at the warning level",
    0x10: "receiver error-passive",
    0x20: "transmitter error-passive",
    0x40: "back to error-active",
}


def read_error_frame(record: np.void) -> ErrorFrame:
    """Decode an error frame; never raises.

    Parameters
    ----------
    record : FRAME_DTYPE
        A frame with CAN_ERR in its identifier.
    """
    classes = int(record["id"]) & (CAN_ERR - 1)
    data = record["data"][: min(int(record["length"]), 8)].tobytes().ljust(8, b"\0")
    detail = data[1] if classes & _CONTROLLER else 0
    words = [text for bit, text in _CLASSES.items() if classes & bit]
    words += [text for bit, text in _CONTROLLER_WORDS.items() if detail & bit]
    if classes & _COUNTS:
        words.append(f"{data[6]} transmit and {data[7]} receive errors counted")
    state = None
    if classes & _BUS_OFF:
        state = BusState.BUS_OFF
    elif detail & _PASSIVES:
        state = BusState.PASSIVE
    elif detail & _WARNINGS:
        state = BusState.WARNING
    elif classes & _RESTARTED or detail & _ACTIVE:
        state = BusState.ACTIVE
    text = ", ".join(words) or f"error frame of class 0x{classes:X}"
    return ErrorFrame(state, bool(detail & _RX_OVERFLOW), text)
