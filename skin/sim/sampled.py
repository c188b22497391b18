"""A scene, sampled cycle by cycle: the counts of units, and the truth."""

from __future__ import annotations

from collections import deque

import numpy as np

from skin.errors import SkinError
from skin.sim.truth import Scene, Truth
from skin.sim.unit import UnitSimulator
from topology import CHANNELS

__all__ = ["RECENT", "SampledScene"]

RECENT = 16
"""Cycles whose counts are stored for buses that lag."""


class SampledScene:
    """Counts of the last cycles of a scene. Cycle c is the instant (c - first) / cycle rate.

    Parameters
    ----------
    scene : Scene
    units : UnitSimulator
    history : int or None
        Number of stored truths; None for all, 0 for none.

    Attributes
    ----------
    cycle, first : int
        The last and the first cycle; -1 before it.
    cycles : int
        Number of sampled cycles.
    history : deque of (int, Truth)
        Stored cycles and their truths, oldest first.
    """

    def __init__(self, scene: Scene, units: UnitSimulator, history: int | None) -> None:
        n = units.topology.n
        self.scene, self.units = scene, units
        self.cycle = self.first = -1
        self.cycles = 0
        self.history: deque[tuple[int, Truth]] = deque(maxlen=history)
        self._rate_hz = units.topology.cycle_rate_hz
        self._counts = np.zeros((RECENT, len(CHANNELS), n), np.int16)
        self._cycles: list[int | None] = [None] * RECENT
        self._start = self._begun()

    def _begun(self) -> Truth:
        """Sample the first instant, whichever cycle it is, without noise: compiles the kernels of
        scene and units before the first cycle."""
        truth = self.scene.at(0.0)
        self.units.quantities(
            truth.depth_mm, truth.displacement_mm, truth.temperature, truth.film_temperature,
            truth.hall_temperature,
        )  # fmt: skip
        return truth

    def counts(self, cycle: int) -> np.ndarray:
        """Counts of a cycle, shape (c, n), int16; those of the last one if it is not stored."""
        if cycle > self.cycle:
            self._counts[cycle % RECENT] = self.units.counts(self._go_on(cycle))
        slot = cycle % RECENT
        if self._cycles[slot] != cycle:  # it was skipped by all buses; the scene is past it
            slot = self.cycle % RECENT
        return self._counts[slot]

    def recent(self, last: int) -> np.ndarray:
        """Stored counts of the cycles that end with `last`, shape (m, c, n)."""
        slots = [
            slot
            for slot, cycle in enumerate(self._cycles)
            if cycle is not None and last - RECENT < cycle <= last
        ]
        return self._counts[slots]

    def truth_at(self, cycle: int) -> Truth:
        """Truth of a stored cycle; SkinError for others."""
        for number, truth in reversed(self.history):
            if number == cycle:
                return truth
        known = f"{self.history[0][0]} to {self.history[-1][0]}" if self.history else "none"
        raise SkinError(f"cycle: must be a stored one ({known}); got {cycle}")

    def _go_on(self, cycle: int) -> Truth:
        """Advance to a cycle without taking its counts."""
        if self.first < 0:
            self.first, truth = cycle, self._start
        else:
            truth = self.scene.at((cycle - self.first) / self._rate_hz)
        self._cycles[cycle % RECENT] = cycle
        if self.history.maxlen != 0:
            self.history.append((cycle, truth.copy()))
        self.cycle = cycle
        self.cycles += 1
        return truth
