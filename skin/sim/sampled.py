"""A scene, sampled cycle by cycle: the counts of units, and the truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.sim.truth import Scene, Truth
from skin.sim.unit import UnitSimulator

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
    truths : dict of int to Truth
        Of the stored cycles, oldest first.
    """

    def __init__(self, scene: Scene, units: UnitSimulator, history: int | None) -> None:
        self.scene, self.units = scene, units
        self.cycle = self.first = -1
        self.cycles = 0
        self.truths: dict[int, Truth] = {}
        self._history = history
        self._counts: dict[int, np.ndarray] = {}
        self._rate_hz = units.topology.cycle_rate_hz
        # the first instant, whichever cycle it is: compiles the kernels of scene and units
        self._start = scene.at(0.0)
        units.quantities(
            self._start.depth_mm, self._start.displacement_mm, self._start.temperature,
            self._start.film_temperature, self._start.hall_temperature,
        )  # fmt: skip

    def counts(self, cycle: int) -> np.ndarray:
        """Counts of a cycle, shape (c, n), int16; those of the last one if it is not stored."""
        if cycle > self.cycle:
            _keep(self._counts, cycle, self.units.counts(self._go_on(cycle)), RECENT)
        # a cycle that all buses skipped: the scene is past it
        return self._counts.get(cycle, self._counts[self.cycle])

    def truth_at(self, cycle: int) -> Truth:
        """Truth of a stored cycle; SkinError for others."""
        if cycle in self.truths:
            return self.truths[cycle]
        known = f"{min(self.truths)} to {max(self.truths)}" if self.truths else "none"
        raise SkinError(f"cycle: must be a stored one ({known}); got {cycle}")

    def _go_on(self, cycle: int) -> Truth:
        """Advance to a cycle without taking its counts."""
        if self.first < 0:
            self.first, truth = cycle, self._start
        else:
            truth = self.scene.at((cycle - self.first) / self._rate_hz)
        if self._history != 0:
            _keep(self.truths, cycle, truth.copy(), self._history)
        self.cycle = cycle
        self.cycles += 1
        return truth


def _keep(kept: dict[int, Any], number: int, value: Any, most: int | None) -> None:
    """Add a value, in place of the oldest one where there are more."""
    kept[number] = value
    if most is not None and len(kept) > most:
        del kept[next(iter(kept))]
