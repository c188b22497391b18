"""Decisions of a behaviour, each with its reason."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["Decision", "Decisions"]

KEPT = 1000
"""Decisions kept in a log; older ones are dropped [numeric]."""


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


class Decisions:
    """A log of decisions; iterate over it, oldest first."""

    def __init__(self) -> None:
        self._kept: deque[Decision] = deque(maxlen=KEPT)

    def add(self, time_s: float, what: str, why: str) -> None:
        """Append a decision."""
        self._kept.append(Decision(time_s, what, why))

    @property
    def last(self) -> Decision | None:
        """The newest, or None."""
        return self._kept[-1] if self._kept else None

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Decision]:
        return iter(tuple(self._kept))
