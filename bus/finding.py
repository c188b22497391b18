"""Finding: one fault or deviation, and common texts of findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bus.frame import CAN_EFF
from topology import Bus

__all__ = ["Finding", "frame_kind", "hex_id", "rates", "some"]


@dataclass(frozen=True)
class Finding:
    """One fault or deviation.

    Attributes
    ----------
    code : str
        Kind of finding: "missing-unit", "silent-branch", …
    severity : "error" or "warning"
        An error costs readings now; a warning may.
    subject : str
        Bus, unit, identifier or host.
    count : int
        Occurrences: frames, units or cycles, as stated in the text.
    text : str
        Observation and expectation.
    likely_cause : str
        What to check first.
    """

    code: str
    severity: Literal["error", "warning"]
    subject: str
    count: int
    text: str
    likely_cause: str

    def __str__(self) -> str:
        return f"{self.subject}: {self.text}. Likely cause: {self.likely_cause}"


def hex_id(can_id: int) -> str:
    return f"0x{can_id & ~CAN_EFF:08X}" if can_id & CAN_EFF else f"0x{can_id:03X}"


def some(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def frame_kind(is_fd: bool) -> str:
    return "CAN FD" if is_fd else "classic"


def rates(bus: Bus) -> str:
    data = "" if bus.data_bitrate is None else f" and {bus.data_bitrate / 1e6:g} Mbit/s for data"
    return f"{bus.bitrate / 1e6:g} Mbit/s{data}"
