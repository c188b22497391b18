"""Travel: distance of an object that is observed repeatedly."""

from __future__ import annotations

import math

__all__ = ["Travel"]


class Travel:
    """Distance by a weighted straight line through observed positions."""

    def __init__(self) -> None:
        self._weight = self._t = self._tt = 0.0
        self._x, self._tx = [0.0] * 3, [0.0] * 3

    def add(self, weight: float, time_s: float, place: list[float]) -> None:
        """Add an observation."""
        self._weight += weight
        self._t += weight * time_s
        self._tt += weight * time_s * time_s
        for i in range(3):
            self._x[i] += weight * place[i]
            self._tx[i] += weight * time_s * place[i]

    @property
    def length_m(self) -> float:
        """Speed times the duration of a uniform motion with the same spread in time."""
        mean = self._t / self._weight
        spread = self._tt / self._weight - mean * mean
        if not spread > 0.0:
            return 0.0
        slope = [(b - mean * a) / self._weight for a, b in zip(self._x, self._tx, strict=True)]
        return math.hypot(*slope) * math.sqrt(12.0 / spread)
