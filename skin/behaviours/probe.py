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
from collections.abc import Generator
from enum import StrEnum

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
BRAKE_S, SETTLE_S = 0.05, 0.06
"""Duration of the harder grip after a dip, which brakes a slide, and of the rest after it
[assumed]."""
SLIDES = 0.1
"""Probability of a slide above which braking goes on, harder and harder [assumed]."""
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
UNFOLLOWED, LEAST_DEPTH = 3, 0.1
"""Dips that the felt load does not show, after which the probe ends; share of the wanted depth that
it must show."""


class Outcome(StrEnum):
    """Outcomes of a probe."""

    DONE = "done"
    DISTURBED = "disturbed"
    UNFOLLOWED = "unfollowed"


class Probe:
    """Waits for an object that hangs still, and dips until its friction is known.

    Parameters
    ----------
    period_s : float
    safety : float
        Relative margin of the grip between dips.
    least_n, most_n : float
        Newton: bounds of the grip.

    Attributes
    ----------
    command_n : float
        Newton: grip that the probe wants now; NaN while it does not.
    response_s : float
        From a command until half of it is felt; NaN until a dip has shown it.
    """

    def __init__(self, period_s: float, safety: float, least_n: float, most_n: float) -> None:
        self._period_s, self._safety, self._least_n, self._most_n = (
            period_s, safety, least_n, most_n,
        )  # fmt: skip
        self.response_s, self._pulse_s, self._unfollowed = math.nan, FIRST_S, 0
        self.restart()

    @property
    def dips(self) -> bool:
        """Whether the probe sets the grip."""
        return not math.isnan(self.command_n)

    def restart(self) -> None:
        """Abort and wait for a load at rest."""
        self.command_n, self._course = math.nan, None

    def update(self, load_n: float, demand: Demand, friction: Friction) -> Outcome | None:
        """Process a cycle, with the grip by pad, newton; returns the outcome when there is one."""
        self._load_n, self._demand, self._friction = load_n, demand, friction
        if self._course is None:
            self._course = self._probed()
        try:
            self.command_n = next(self._course)
        except StopIteration as end:
            self.restart()
            return end.value
        return None

    def _probed(self) -> Generator[float, None, Outcome]:
        """The commands, a cycle a yield."""
        wait, mean = round(WAIT_S / self._period_s), round(MEAN_S / self._period_s)
        count, mean_n = 0, 0.0
        while count < wait + mean:
            demand, count = self._demand, count + 1
            mean_n += (demand.pull_n - mean_n) / min(count, mean)
            if abs(demand.pull_n - mean_n) > STEADY * demand.sigma_n:
                count = 0
            if count < wait + mean:
                yield math.nan
        borne_n, before_n = self._demand.borne_n, self._load_n
        elapsed_s = slid_m = 0.0
        for _ in range(MOST_DIPS):
            low_n = self._low_n(borne_n, before_n)
            if math.isnan(low_n) or slid_m > MOST_SLIDE_M or elapsed_s > MOST_S:
                break
            loads, shears = yield from self._dip(low_n, borne_n, mean_n)
            elapsed_s += self._period_s * len(loads)
            last = round(SETTLE_S / self._period_s) // 2
            after, noise = float(np.mean(shears[-last:])), self._demand.sigma_n / mean_n
            if abs(after - 1.0) > CHANGED + STEADY * noise / math.sqrt(last):
                if after < 1.0:
                    self._friction.take()
                return Outcome.DISTURBED
            self._measure(np.array(loads), low_n)
            slid_m += self._friction.take()
            if self._unfollowed >= UNFOLLOWED:
                return Outcome.UNFOLLOWED
            before_n = float(np.mean(loads[-last:]))
        return Outcome.DONE

    def _low_n(self, borne_n: float, load_n: float) -> float:
        """Command of the next dip; NaN where none is needed. Half of the posterior holds, and the
        slide is within its budget."""
        friction = self._friction
        lower, median = friction.quantile(LOWER), friction.quantile(0.5)
        grips = np.geomspace(1.0 / min(median, STEP * lower), 1.0 / lower, 24)
        slides_m = friction.slide_m(_deeper(grips, load_n / borne_n), self._pulse_s)
        allowed = grips[slides_m <= SLIDE_M]
        wanted_n = max(borne_n * float(allowed[0] if allowed.size else grips[-1]), self._least_n)
        if median / lower - 1.0 <= ENOUGH or wanted_n > 0.97 * borne_n / lower:
            return math.nan
        return float(_deeper(np.array(wanted_n), load_n))

    def _dip(
        self, low_n: float, borne_n: float, mean_n: float
    ) -> Generator[float, None, tuple[list[float], list[float]]]:
        """Dip, brake, settle; loads, and tangential loads over that before, of its cycles."""
        friction, most_n = self._friction, self._most_n
        loads, shears, braked_s = [], [], math.nan
        brakes = (1.0 + BRAKES) / friction.kinetic_if_slides(low_n / borne_n)
        brake_n, command_n = min(brakes * borne_n, most_n), low_n
        known_s = UNKNOWN_S if math.isnan(self.response_s) else self.response_s
        friction.begin()
        while True:
            yield command_n
            demand = self._demand
            loads.append(self._load_n)
            shears.append(demand.pull_n / mean_n)
            friction.watch(borne_n, self._load_n, shears[-1], demand.sigma_n / mean_n)
            since_s = self._period_s * len(loads)
            if since_s < self._pulse_s:
                continue
            # An unnoticed slide ends at this grip, too; and somebody may pull.
            rest_n = (1.0 + self._safety) * borne_n / friction.kinetic_quantile(SLIDES)
            rest_n = max(rest_n, demand.forecast_n / friction.quantile(0.5))
            command_n = rest_n = min(max(rest_n, self._least_n), most_n)
            if math.isnan(braked_s):
                command_n = min(max(brake_n, rest_n), most_n)
                if since_s < self._pulse_s + known_s + BRAKE_S:
                    continue
                if friction.slides > SLIDES:
                    brake_n *= math.exp(BRAKES * self._period_s / BRAKE_S)
                    continue
                braked_s, command_n = since_s, rest_n
            if since_s >= braked_s + known_s + SETTLE_S:
                return loads, shears

    def _measure(self, loads: np.ndarray, low_n: float) -> None:
        """How deep, how late and how long the felt load fell."""
        before_n = max(float(loads[0]), 1e-3)
        lowest = int(np.argmin(loads))
        depth_n, wanted_n = before_n - float(loads[lowest]), before_n - low_n
        self._unfollowed += depth_n < LEAST_DEPTH * wanted_n
        back = lowest + int(np.argmax(loads[lowest:] > before_n - 0.5 * depth_n))
        if depth_n > 0.1 * before_n and back > lowest:
            self.response_s = max(self._period_s * back - self._pulse_s, self._period_s)
        if depth_n < REACHED * wanted_n:
            self._pulse_s = min(LONGER * self._pulse_s, LONGEST_S)


def _deeper(wanted_n: np.ndarray, load_n: float) -> np.ndarray:
    """Command of a dip from one load to another."""
    return np.maximum(wanted_n - DEEPER * (load_n - wanted_n), DEEPEST * wanted_n)
