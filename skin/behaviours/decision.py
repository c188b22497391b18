"""Decisions of a behaviour, each with its reason."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["KEPT", "Decision"]

KEPT = 1000
"""Decisions that a behaviour keeps; older ones are dropped [numeric]."""


class Decision(NamedTuple):
    """What was decided, and why, with its numbers.

    Attributes
    ----------
    time_s : float
        Time of the cycle's SYNC since the behaviour's first cycle.
    what, why : str
    """

    time_s: float
    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.time_s:9.3f} s  {self.what}: {self.why}"
