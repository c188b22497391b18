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

from skin.behaviours.demand import Demand

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
"""Of Page's test, in sigmas: what is taken off each cycle, and the sum that is a slide [derived: a
false alarm in 500 cycles of white noise, more than a probe takes; Siegmund, 1985]."""

RISE = 8.0
"""The same sum upwards, at which somebody pulls, and the probe is given up [assumed]."""


DOUBTED = 0.3
"""Sigma of friction at rest over what is found of it above that in motion: an onset that is found
late shows both [assumed]."""

OVERLOOKED, HELD_OVERLOOKED = 0.4, 1.1
"""Sigmas of one cycle's load that a slide may lack unseen: Page's sum needs 6 + 0.5 m in m cycles,
1.1 a cycle in ten of them; where a slide was seen, its least squares know it better [derived]."""

LOOKS_BACK = 6
"""Cycles before Page's sum rises, in which a slide may have begun [numeric]."""


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
        What friction bore by pad while it hung still.
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
        self._count, self._mean_n = 0, 0.0
        self._pull_n, self._borne_n = 0.0, 0.0
        self._lack, self._rise = 0.0, 0.0
        self._loads: list[float] = []
        self._shears: list[float] = []
        self._began = 0

    def update(self, load_n: float, demand: Demand, least_n: float) -> Answer | None:
        """Go on by a cycle; an answer where there is one.

        Parameters
        ----------
        load_n : float
            Newton by pad, of this cycle.
        demand : Demand
            Of this cycle.
        least_n : float
            Newton: to which grip it may loosen.
        """
        sigma_n = demand.sigma_n
        if not self.loosens:
            self._watch(demand)
            return None
        self._loads.append(load_n)
        self._shears.append(demand.pull_n)
        off = (demand.pull_n - self._pull_n) / sigma_n
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

    def _watch(self, demand: Demand) -> None:
        """Take the mean of a load that stays, and begin to loosen after it."""
        self._count += 1
        self._mean_n += (demand.pull_n - self._mean_n) / min(self._count, self._mean)
        if abs(demand.pull_n - self._mean_n) > STEADY * demand.sigma_n:
            self._count = 0
        if self._count >= self._wait + self._mean:
            self._pull_n, self._borne_n = self._mean_n, demand.borne_n
            self.factor = math.exp(-LOOSENS_PER_S * self._period_s)

    def _answer(self, outcome: Outcome, sigma_n: float) -> Answer:
        borne_n, relative = self._borne_n, sigma_n / self._pull_n
        noise = relative * math.sqrt(2.0 / self._mean)
        if outcome is Outcome.SLID:
            held_n, share = _onset(self._loads, self._shears, self._pull_n, self._began)
            friction, kinetic = borne_n / held_n, share * borne_n / held_n
            step = LOOSENS_PER_S * self._period_s
            noise = math.hypot(noise, step, DOUBTED * (1.0 - share), OVERLOOKED * relative)
        else:
            last = self._loads[-3:]
            friction = kinetic = borne_n * len(last) / sum(last)
            noise = math.hypot(noise, HELD_OVERLOOKED * relative)
        self.restart()
        return Answer(outcome, friction, friction * noise, kinetic, borne_n)


def _onset(
    loads: list[float], shears: list[float], pull_n: float, began: int
) -> tuple[float, float]:
    """Grip at which a slide began, and friction in motion over that at rest.

    The least squares of a load that stays until then and is in proportion to the grip from then on:
    Page's sum alone tells of a beginning before the true one, where noise had already begun to
    count, or after it, where the load lacks little at first.
    """
    first, best, held_n, share = max(began - LOOKS_BACK, 0), math.inf, loads[-1], 1.0
    before = 0.0
    for i in range(first, len(loads) - 1):
        products = sum(s * n for s, n in zip(shears[i:], loads[i:], strict=True))
        ratio = products / sum(n * n for n in loads[i:])
        ratio = min(ratio, pull_n / loads[i])
        after = sum((s - ratio * n) ** 2 for s, n in zip(shears[i:], loads[i:], strict=True))
        if before + after < best:
            near = loads[max(i - 1, 0) : i + 2]
            best, held_n = before + after, sum(near) / len(near)
            share = min(ratio * held_n / pull_n, 1.0)
        before += (shears[i] - pull_n) ** 2
    return held_n, share
