"""Probe: what friction there is, found by loosening the grip on what hangs still.

A flat face that slides all alike gives no warning: no unit is ahead of the others. But what hangs
still has a tangential load that stays, whatever the grip is, until friction gives: from then on the
load is friction times grip, and falls with it. So the grip is loosened, quickly, since what falls
freely for 30 ms falls 4 mm at most, and Page's sum of what the load lacks tells the moment when it
began to lack: the ratio of the loads at that moment is friction at rest, their ratio after it,
friction in motion. Then the grip goes up again at once.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

__all__ = ["Answer", "Outcome", "Probe"]

WAIT_S, MEAN_S = 0.12, 0.16
"""Until a load counts as steady; what its mean is over [derived: noise of two pads of 16 units,
0.035 N, in a mean over 40 cycles is 0.006 N]."""

STEADY = 4.0
"""Sigmas that a load may leave its mean by and still be steady [assumed]."""

LOOSENS_PER_S = 4.0
"""How fast the grip falls, as a share of itself [derived: with friction the same in motion, a slide
after t is g t^3 4/6, 0.4 mm in 40 ms; slower, it would be as far before the load tells]."""

DRIFT, LIMIT = 0.5, 6.0
"""Of Page's test, in sigmas: what is taken off each cycle, and the sum that is a slide [derived: one
false alarm in 500 cycles of white noise, more than a probe takes; Siegmund, 1985]."""

RISE = 8.0
"""The same sum upwards, at which somebody pulls, and the probe is given up [assumed]."""


class Outcome(Enum):
    """What a probe has found."""

    SLID = "slid"
    HELD = "held"
    DISTURBED = "disturbed"


class Answer(NamedTuple):
    """What a probe tells.

    Attributes
    ----------
    outcome : Outcome
    friction : float
        Ratio of the loads at which it began to slide; where it held, the largest that it bore.
    sigma : float
        One-sigma of `friction`.
    kinetic : float
        Ratio while it slid; `friction` where it held.
    shear_n : float
        Tangential load by pad that hung still.
    """

    outcome: Outcome
    friction: float
    sigma: float
    kinetic: float
    shear_n: float


class Probe:
    """Looks for a load that hangs still, and loosens it once.

    Attributes
    ----------
    factor : float
        What the grip is to be multiplied by, now.
    """

    def __init__(self, period_s: float) -> None:
        self.factor = 1.0
        self._period_s = period_s
        self._wait = round(WAIT_S / period_s)
        self._mean = round(MEAN_S / period_s)
        self.restart()

    @property
    def loosens(self) -> bool:
        """Whether it loosens the grip now."""
        return self.factor < 1.0

    def restart(self) -> None:
        """Forget what it was at."""
        self.factor = 1.0
        self._count, self._sum, self._hung_n = 0, 0.0, 0.0
        self._lack, self._rise = 0.0, 0.0
        self._loads: list[float] = []
        self._shears: list[float] = []
        self._began = 0

    def update(self, load_n: float, shear_n: float, sigma_n: float, least_n: float) -> Answer | None:
        """Go on by a cycle; an answer where there is one.

        Parameters
        ----------
        load_n, shear_n : float
            Newton by pad, of this cycle.
        sigma_n : float
            One-sigma of `shear_n`.
        least_n : float
            Newton: to which grip it may loosen.
        """
        if not self.loosens:
            self._watch(shear_n, sigma_n)
            return None
        self._loads.append(load_n)
        self._shears.append(shear_n)
        off = (shear_n - self._hung_n) / sigma_n
        self._rise = max(self._rise + off - DRIFT, 0.0)
        self._lack = max(self._lack - off - DRIFT, 0.0)
        if self._lack == 0.0:
            self._began = len(self._loads)
        if self._rise > RISE:
            return self._answer(Outcome.DISTURBED, sigma_n)
        if self._lack > LIMIT:
            return self._answer(Outcome.SLID, sigma_n)
        if load_n <= least_n:
            return self._answer(Outcome.HELD, sigma_n)
        self.factor *= math.exp(-LOOSENS_PER_S * self._period_s)
        return None

    def _watch(self, shear_n: float, sigma_n: float) -> None:
        """Take the mean of a load that stays, and begin to loosen after it."""
        self._count += 1
        self._sum += (shear_n - self._sum) / min(self._count, self._mean)
        if abs(shear_n - self._sum) > STEADY * sigma_n:
            self._count = 0
        if self._count >= self._wait + self._mean:
            self._hung_n = self._sum
            self.factor = math.exp(-LOOSENS_PER_S * self._period_s)

    def _answer(self, outcome: Outcome, sigma_n: float) -> Answer:
        loads, hung_n, began = self._loads, self._hung_n, self._began
        near = loads[max(began - 2, 0) : began + 2]
        grip_n = sum(near) / len(near) if outcome is Outcome.SLID else min(loads)
        friction = hung_n / grip_n
        shears, after = self._shears[began:], loads[began:]
        kinetic = sum(shears) / sum(after) if outcome is Outcome.SLID else friction
        noise = sigma_n / (hung_n * math.sqrt(0.5 * self._mean))
        steps = LOOSENS_PER_S * self._period_s * math.sqrt(2.0) * max(len(after), 1) / 2.0
        sigma = friction * math.hypot(noise, 0.5 * steps)
        self.restart()
        return Answer(outcome, friction, sigma, kinetic, hung_n)
