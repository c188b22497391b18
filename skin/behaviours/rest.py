"""Rest: what pads bear while nobody moves it, as a sum of an object's own load and a person's.

``now = own + drift + lean + noise``: `own` is constant. `lean`, of a person who leans on the
object, pulls or bears it, is zero or constant for long; while there is one, what changes slowly is
the person's. Whose `drift` is remains unknown: of the units, or of a person who leans on the object
more and more. A Kalman filter of a random walk follows the sum. Its gain is its variance over that
of the noise, too: it falls as 1/n while n cycles are learned, down to that of `rest_s`.

A load is seven numbers, newton, skin frame: three of force, three of torque over a lever, and the
sum of the pads' normal forces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skin.behaviours.disturbance_parameters import DisturbanceParameters

__all__ = ["Rest"]

UNKNOWN = 1e12
"""Doubt before the first cycle."""


class Rest:
    """Learns and follows the load at rest.

    Attributes
    ----------
    own, drift, lean, load : list of 7 float
        Loads, see the module; `load` is the sum.
    noise : list of 7 float
        Newton squared: variance of the load of a cycle.
    doubt : float
        Variance of the rest over that of the noise.
    settled, known : bool
        Whether it was learned; whether it is known for the units that are heard.
    """

    def __init__(self, parameters: DisturbanceParameters, period_s: float) -> None:
        self._parameters, self._period_s = parameters, period_s
        self._gain = period_s / (parameters.rest_s + period_s)
        self._walk = self._gain * self._gain / (1.0 - self._gain)
        self.forget()

    def forget(self) -> None:
        """Learn all of it again."""
        self.own, self.drift, self.lean, self.load = ([0.0] * 7 for _ in range(4))
        self.noise, self.doubt, self._cycles = [0.0] * 7, UNKNOWN, 0
        self.settled = self.known = False
        self._left_s = self._parameters.learn_s

    def forget_own(self) -> None:
        """Learn the own load again: other units may measure another one."""
        if self.settled:
            self.known, self.doubt = False, UNKNOWN
            self._left_s = self._parameters.anchor_s

    def follow(self, now: list[float], last: list[float], change: list[float]) -> None:
        """Learn from the load of a cycle, and of the last one, which is a change away from rest."""
        part = self.lean if any(self.lean) else self.drift
        part = part if self.known else self.own
        doubt = self.doubt + self._walk
        self.doubt = gain = doubt / (1.0 + doubt)
        self._cycles += 1
        noise, noise_gain = self.noise, max(self._gain, 1.0 / self._cycles)
        for i, rest in enumerate(self.load):
            off = gain * (now[i] - change[i] - rest)
            part[i] += off
            self.load[i] += off
            step = now[i] - last[i]
            noise[i] += noise_gain * (0.5 * step * step - noise[i])
        self._left_s -= self._period_s
        self.known = self._left_s < 0.5 * self._period_s
        self.settled = self.settled or self.known

    def move(self, change: list[float], share: float, *, leans: bool) -> None:
        """Add a lasting change, of somebody who leans on it from now on, or who has let go."""
        self.load = [a + b for a, b in zip(self.load, change, strict=True)]
        if leans:
            self.lean = [a + b for a, b in zip(self.lean, change, strict=True)]
        else:
            self.lean = [0.0] * 7
            self.drift = [a - b for a, b in zip(self.load, self.own, strict=True)]
        self.doubt += share

    def distance(self, change: Sequence[float], share: float, allowed_n: float = 0.0) -> float:
        """Squared distance of a change from zero, in sigmas; `share` of the noise's variance is in
        it."""
        share, distance = share + self.doubt - self._gain, 0.0  # `wander_n` has what is left
        wander = self._parameters.wander_n**2 + allowed_n * allowed_n
        for i in range(6):
            distance += change[i] * change[i] / (share * self.noise[i] + wander)
        return distance

    def way_back(self, change: Sequence[float], share: float) -> tuple[float, float]:
        """Squared distances, in sigmas, of a change of a load that is leaned on: from the straight
        way back to the own load, and from its end."""
        lean = self.lean[:6]
        square = sum(value * value for value in lean)
        if square == 0.0:
            return math.inf, math.inf
        product = -sum(a * b for a, b in zip(lean, change, strict=False))
        along = min(max(product / square, 0.0), 1.0)
        allowed_n = self._parameters.back * math.sqrt(square)
        way = [change[i] + along * lean[i] for i in range(6)]
        end = [change[i] + lean[i] for i in range(6)]
        return self.distance(way, share, allowed_n), self.distance(end, share, allowed_n)
