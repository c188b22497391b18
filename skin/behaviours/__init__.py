"""Behaviours: actions of a robot based on its skin.

Streaming components over `State`: each takes every cycle, answers at once, keeps a log of its
decisions with their reasons, and neither sleeps nor starts a thread. No lower layer imports them.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["KEPT", "Decision"]

KEPT = 1000
"""Decisions that a behaviour keeps; older ones are dropped [numeric]."""


class Decision(NamedTuple):
    """What was decided `time_s` after the behaviour's first cycle, and why, with its numbers."""

    time_s: float
    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.time_s:9.3f} s  {self.what}: {self.why}"
