"""Rest: what pads bear while nobody moves it, as a sum of an object's own load and a person's.

``now = own + lean + noise``: `own` is constant but for a drift, and `lean`, of a person who leans
on the object, pulls or bears it, is zero or constant for long. A Kalman filter of a random walk
follows their sum. Its gain is its variance over that of the noise, too: it falls as 1/n while n
cycles are learned, down to that of `rest_s`. What drifts is the person's where one leans, else the
object's.

A load is a list of numbers, newton, skin frame: three of force, three of torque over a lever, the
sum of the pads' normal forces (`LOAD`), and from `PADS` on the force of each pad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skin.behaviours.disturbance_parameters import DisturbanceParameters

__all__ = ["LOAD", "PADS", "Rest"]

LOAD, PADS = 6, 7

UNKNOWN = 1e12
"""Doubt before the first cycle."""


class Rest:
    """Learns and follows the load at rest.

    Attributes
    ----------
    own, lean : list of float
        Loads, see the module.
    noise : list of 6 float
        Newton squared: variance of force, and of torque over lever, of a cycle.
    doubt : float
        Variance of the rest over that of the noise.
    settled, known : bool
        Whether it was learned; whether it is known for the units that are heard.
    """

    def __init__(self, parameters: DisturbanceParameters, period_s: float, pads: int) -> None:
        self._parameters, self._period_s = parameters, period_s
        self._gain = period_s / (parameters.rest_s + period_s)
        self._drift = self._gain * self._gain / (1.0 - self._gain)
        self._size = PADS + 3 * pads
        self.forget()

    def forget(self) -> None:
        """Learn all anew."""
        self.own, self.lean = [0.0] * self._size, [0.0] * self._size
        self.noise, self.doubt, self._cycles = [0.0] * 6, UNKNOWN, 0
        self.settled = self.known = False
        self._left_s = self._parameters.learn_s

    def forget_own(self) -> None:
        """Learn the own load anew: other units may measure another one."""
        if self.settled:
            self.known, self.doubt = False, UNKNOWN
            self._left_s = self._parameters.anchor_s

    @property
    def load(self) -> list[float]:
        """The sum of `own` and `lean`."""
        return [own + lean for own, lean in zip(self.own, self.lean, strict=True)]

    def follow(self, now: list[float], last: list[float], change: list[float]) -> None:
        """Learn from the load of a cycle, and of the last one, which is a change away from rest."""
        part = self.lean if self.known and any(self.lean) else self.own
        doubt = self.doubt + self._drift
        self.doubt = gain = doubt / (1.0 + doubt)
        for i, rest in enumerate(self.load):
            part[i] += gain * (now[i] - change[i] - rest)
        self._cycles += 1
        gain = max(self._gain, 1.0 / self._cycles)
        for i in range(6):
            step = now[i] - last[i]
            self.noise[i] += gain * (0.5 * step * step - self.noise[i])
        self._left_s -= self._period_s
        self.known = self._left_s < 0.5 * self._period_s
        self.settled = self.settled or self.known

    def move(self, change: list[float], share: float, *, leans: bool) -> None:
        """Add a lasting change, of somebody who leans on it from now on, or who has let go."""
        load = [a + b for a, b in zip(self.load, change, strict=True)]
        self.own = self.own if leans else load
        self.lean = [a - b for a, b in zip(load, self.own, strict=True)]
        self.doubt += share

    def distance(self, change: Sequence[float], share: float, allowed_n: float = 0.0) -> float:
        """Squared distance of a change from zero, in sigmas; `share` of the noise's variance is in
        it."""
        share += self.doubt
        wander = self._parameters.wander_n**2 + allowed_n * allowed_n
        return sum(a * a / (share * b + wander) for a, b in zip(change, self.noise, strict=False))

    def way_back(self, change: Sequence[float], share: float) -> tuple[float, float]:
        """Squared distances, in sigmas, of a change of a load that is leaned on: from the straight
        way back to the own load, and from its end."""
        lean = self.lean[:6]
        square = sum(value * value for value in lean)
        if square == 0.0:
            return math.inf, math.inf
        along = -sum(a * b for a, b in zip(lean, change, strict=False)) / square
        allowed_n = self._parameters.back * math.sqrt(square)
        way, end = (
            [a + part * b for a, b in zip(change, lean, strict=False)]
            for part in (min(max(along, 0.0), 1.0), 1.0)
        )
        return self.distance(way, share, allowed_n), self.distance(end, share, allowed_n)
