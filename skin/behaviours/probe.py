"""Probe: measures friction by short dips of the grip on an object that hangs still.

A flat face that slides as a whole gives no warning: there is no incipient slip. But the tangential
load of an object that hangs still does not depend on the grip until it slides. So the grip falls
for a moment and rises again, without waiting for an answer: a slide lasts as long as the dip,
however late the gripper is. A dip goes as deep as half of the posterior
(`skin.behaviours.friction`) holds, at most a step beyond what is known to hold, and no deeper than
the slide that it may cost. It is braked until the posterior says that nothing slides. The time
until the felt load rises again is the response time of the gripper.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any

import numpy as np

from skin.behaviours.demand import Demand
from skin.behaviours.friction import BRAKES, LOWER, Friction

__all__ = ["Outcome", "Probe"]

WAIT_S, MEAN_S = 0.12, 0.16
"""Duration after which a load is steady, and of its mean [derived: noise of two pads of 16 units,
0.035 N, in a mean over 40 cycles is 0.006 N]."""

STEADY = 4.0
"""Largest deviation of a steady load from its mean, sigmas [assumed]."""

CHANGED = 0.05
"""Relative change of the load over a dip, beyond noise, above which it is not learned from."""

SLIDE_M, MOST_SLIDE_M = 1e-3, 2.5e-3
"""Slide that a dip may cost, root mean square, and a probe [assumed]."""

FIRST_S, LONGEST_S = 0.016, 0.12
"""Duration of the first dip, and of the longest [assumed]."""
BRAKE_S = 0.05
"""Duration of the harder grip after a dip, which brakes a slide [assumed]."""
SLIDES = 0.1
"""Probability of a slide above which braking goes on, harder and harder [assumed]."""
SETTLE_S = 0.06
"""After that, until pads have come to rest [assumed]."""
UNKNOWN_S = 0.1
"""Response time of a gripper of which nothing is known, for the wait after a dip [assumed]."""

ENOUGH = 0.1
"""Median of friction over its lower bound, minus one, at which a probe ends: less than the other
parts of a margin [assumed]."""
MOST_DIPS, MOST_S = 14, 2.2
"""Of a probe [assumed]."""
DEEPER, DEEPEST, REACHED, LONGER = 0.25, 0.75, 0.7, 1.5
"""A command is deeper than the wanted dip by a share of it, since a gripper lags, down to a share
of the wanted grip; where less than `REACHED` of it is felt, the next dip is `LONGER` [assumed]. The
slide is budgeted for a gripper that follows at once."""
STEP = 1.4
"""A dip's ratio of loads over what is known to hold, at most [assumed]."""
UNFOLLOWED = 3
"""Dips that the felt load does not show, after which the probe ends."""
LEAST_DEPTH = 0.1
"""Share of the wanted depth that the felt load must show."""


class Outcome(StrEnum):
    """Outcomes of a probe."""

    DONE = "done"
    DISTURBED = "disturbed"
    UNFOLLOWED = "unfollowed"


class Probe:
    """Waits for an object that hangs still, and dips until its friction is known.

    Attributes
    ----------
    command_n : float
        Newton: grip that the probe wants now; NaN while it does not.
    response_s : float
        From a command until half of it is felt; NaN until a dip has shown it.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._wait, self._mean = round(WAIT_S / period_s), round(MEAN_S / period_s)
        self.response_s = math.nan
        self._pulse, self._unfollowed = FIRST_S, 0
        self.restart()

    @property
    def dips(self) -> bool:
        """Whether the probe sets the grip."""
        return not math.isnan(self.command_n)

    def restart(self) -> None:
        """Abort and wait for a load at rest."""
        self.command_n = math.nan
        self._count, self._mean_n, self._borne_n = 0, 0.0, 0.0
        self._dips, self._elapsed_s, self._slid_m = 0, 0.0, 0.0
        self._loads: list[float] = []
        self._shears: list[float] = []
        self._brake_n = self._low_n = 0.0
        self._braked_s = math.nan

    def update(
        self, load_n: float, demand: Demand, friction: Friction, safety: float, least_n: float,
        most_n: float,
    ) -> Outcome | None:  # fmt: skip
        """Process a cycle; returns the outcome when there is one.

        Parameters
        ----------
        load_n : float
            Newton by pad, of this cycle.
        demand : Demand
            Of this cycle.
        friction : Friction
            Learns.
        safety : float
            Relative margin of the grip between dips.
        least_n, most_n : float
            Newton: bounds of the grip.
        """
        if not self.dips:
            self._watch(demand)
            if self._count < self._wait + self._mean:
                return None
            self._borne_n = demand.borne_n
            return self._next(load_n, friction, least_n, most_n)
        self._elapsed_s += self._period_s
        self._loads.append(load_n)
        self._shears.append(demand.pull_n / self._mean_n)
        noise = demand.sigma_n / self._mean_n
        friction.watch(self._borne_n, load_n, self._shears[-1], noise)
        since_s = self._period_s * len(self._loads)
        # An unnoticed slide ends at this grip, too.
        rest_n = (1.0 + safety) * self._borne_n / friction.quantile(SLIDES, kinetic=True)
        rest_n = max(rest_n, demand.forecast_n / friction.quantile(0.5))  # somebody may pull
        rest_n = self.command_n = min(max(rest_n, least_n), most_n)
        known_s = UNKNOWN_S if math.isnan(self.response_s) else self.response_s
        if since_s < self._pulse:
            self.command_n = self._low_n
            return None
        if math.isnan(self._braked_s):
            self.command_n = min(max(self._brake_n, rest_n), most_n)
            if since_s < self._pulse + known_s + BRAKE_S:
                return None
            if friction.slides > SLIDES:
                self._brake_n *= math.exp(BRAKES * self._period_s / BRAKE_S)
                return None
            self._braked_s = since_s
            self.command_n = rest_n
        if since_s < self._braked_s + known_s + SETTLE_S:
            return None
        return self._ends(noise, friction, least_n, most_n)

    def _watch(self, demand: Demand) -> None:
        """Average a steady load."""
        self._count += 1
        self._mean_n += (demand.pull_n - self._mean_n) / min(self._count, self._mean)
        if abs(demand.pull_n - self._mean_n) > STEADY * demand.sigma_n:
            self._count = 0

    def _ends(
        self, noise: float, friction: Friction, least_n: float, most_n: float
    ) -> Outcome | None:
        """A dip is over: learn from it, and begin the next."""
        last = round(SETTLE_S / self._period_s) // 2
        after = float(np.mean(self._shears[-last:]))
        if abs(after - 1.0) > CHANGED + STEADY * noise / math.sqrt(last):
            if after < 1.0:
                friction.take()
            self.restart()
            return Outcome.DISTURBED
        self._measure()
        self._slid_m += friction.take()
        if self._unfollowed >= UNFOLLOWED:
            self.restart()
            return Outcome.UNFOLLOWED
        return self._next(float(np.mean(self._loads[-last:])), friction, least_n, most_n)

    def _measure(self) -> None:
        """How deep, how late and how long the felt load fell."""
        loads = np.array(self._loads)
        before = max(float(loads[0]), 1e-3)
        lowest = int(np.argmin(loads))
        depth, wanted = before - float(loads[lowest]), before - self._low_n
        if depth < LEAST_DEPTH * wanted:
            self._unfollowed += 1
        half = before - 0.5 * depth
        back = lowest + int(np.argmax(loads[lowest:] > half))
        if depth > 0.1 * before and back > lowest:
            self.response_s = max(self._period_s * back - self._pulse, self._period_s)
        if depth < REACHED * wanted:
            self._pulse = min(LONGER * self._pulse, LONGEST_S)

    def _next(
        self, load_n: float, friction: Friction, least_n: float, most_n: float
    ) -> Outcome | None:
        """Plan a dip, or end."""
        borne_n = self._borne_n
        lower, median = friction.quantile(LOWER), friction.quantile(0.5)
        steepest = min(median, STEP * lower)
        wanted_n = self._target(friction, load_n, borne_n, steepest, least_n)
        done = median / lower - 1.0 <= ENOUGH or wanted_n > 0.97 * borne_n / lower
        done |= self._slid_m > MOST_SLIDE_M
        if done or self._dips >= MOST_DIPS or self._elapsed_s > MOST_S:
            self.restart()
            return Outcome.DONE
        self._dips += 1
        self._low_n = float(_deeper(wanted_n, load_n))
        brakes = (1.0 + BRAKES) / friction.kinetic_if_slides(self._low_n / borne_n)
        self._brake_n = min(brakes * borne_n, most_n)
        self.command_n = self._low_n
        self._loads, self._shears, self._braked_s = [], [], math.nan
        friction.begin()
        return None

    def _target(
        self, friction: Friction, load_n: float, borne_n: float, ratio: float, least_n: float
    ) -> float:
        """Grip of the next dip: half of the posterior holds, and the slide is within its budget."""
        grips = np.geomspace(1.0 / ratio, 1.0 / friction.quantile(LOWER), 24)
        slides = friction.slide_m(_deeper(grips, load_n / borne_n), self._pulse)
        allowed = grips[slides <= SLIDE_M]
        return max(borne_n * float(allowed[0] if allowed.size else grips[-1]), least_n)


def _deeper(wanted_n: Any, load_n: float) -> Any:
    """Command of a dip from one load to another."""
    return np.maximum(wanted_n - DEEPER * (load_n - wanted_n), DEEPEST * wanted_n)
