"""Probe: what friction there is, found by loosening the grip on what hangs still.

A flat face that slides all alike gives no warning: no unit is ahead of the others. But what hangs
still has a tangential load that stays, whatever the grip is, until friction gives: from then on the
load is friction times grip, and falls with it. So the grip is loosened, quickly, since what falls
freely for 30 ms falls 4 mm at most. Where Page's sum of what the load lacks rises, the posterior of
the moment at which it began to lack is looked at: has it slid, the grip goes up again at once. The
ratio of the loads at that moment is friction at rest, their ratio after it, friction in motion.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

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

DRIFT, LIMIT = 0.5, 2.0
"""Of Page's test, in sigmas: what is taken off each cycle, and the sum from which on the posterior
is worth its time [numeric]."""

RISE = 8.0
"""The same sum upwards, at which somebody pulls, and the probe is given up [assumed]."""

STILL = 0.1
"""Probability that nothing slid, below which it has [assumed: one slide in ten that is none; it
costs grip, a later one costs way]."""

MOST_FRICTION = 1.2
"""Coefficient that friction at rest may have [assumed: silicone on clean glass]."""

LEAST_SHARE = 0.5
"""Friction in motion over that at rest, at least [assumed]."""

LEAST_N = 1e-3
"""Newton, of a load that is divided by [numeric]."""


class Outcome(StrEnum):
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
        Ratio of the loads at which it began to slide, mean of its posterior; where it held, hardly
        more than the largest that it bore.
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
        if self._rise > RISE:
            self.restart()
            return Answer(Outcome.DISTURBED, math.nan, math.nan, math.nan, math.nan)
        ends = load_n <= least_n
        if ends or self._lack > LIMIT:
            onset = self._onset(sigma_n)
            if onset.held < STILL:
                return self._answer(Outcome.SLID, sigma_n, onset)
            if ends:
                return self._answer(Outcome.HELD, sigma_n, onset)
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

    def _onset(self, sigma_n: float) -> _Onset:
        loads = np.maximum(self._loads, LEAST_N)
        further = math.log(max(MOST_FRICTION * float(loads[-1]) / self._borne_n, 1.0))
        later = 1.0 + further / (LOOSENS_PER_S * self._period_s)
        return _onset(loads, np.array(self._shears), self._pull_n, sigma_n, self._mean, later)

    def _answer(self, outcome: Outcome, sigma_n: float, onset: _Onset) -> Answer:
        borne_n, relative = self._borne_n, sigma_n / self._pull_n
        friction, kinetic = borne_n * onset.per_load, borne_n * onset.kinetic_per_load
        kinetic = kinetic if outcome is Outcome.SLID else friction
        noise = math.hypot(
            relative * math.sqrt(2.0 / self._mean), LOOSENS_PER_S * self._period_s,
            onset.sigma_per_load / onset.per_load,
        )  # fmt: skip
        self.restart()
        return Answer(outcome, friction, friction * noise, kinetic, borne_n)


class _Onset(NamedTuple):
    """Where a slide began: mean and one-sigma of one over the load there, in 1/N; what friction in
    motion bore over pull and load; the probability that it held all the time."""

    per_load: float
    sigma_per_load: float
    kinetic_per_load: float
    held: float


def _onset(
    loads: np.ndarray, shears: np.ndarray, pull_n: float, sigma_n: float, known: int, later: float
) -> _Onset:
    """When a load that stayed began to be in proportion to the grip: posterior over the cycles, of
    shapes (m,), and over none of them.

    Until then the load is what it was, `pull_n` in the mean of the `known` cycles before these;
    from then on it is the grip times some ratio, at most that at which it began. Noise is white.
    Any cycle is as likely, and so are the `later` ones that would come while friction can be as
    high.
    """
    smooth = np.convolve(np.pad(loads, 1, "edge"), np.full(3, 1.0 / 3.0), "valid")
    products, squares, energy = (
        np.cumsum(x[::-1])[::-1] for x in (shears * loads, loads * loads, shears * shears)
    )
    count = known + np.arange(loads.size + 1)
    pulls = (known * pull_n + np.concatenate([[0.0], np.cumsum(shears)])) / count
    errors = np.concatenate([[0.0], np.cumsum(shears**2)]) - count * pulls**2
    most, ratio = pulls[:-1] / smooth, products / squares
    errors[:-1] += energy - ratio * products
    chance = np.concatenate([_within(ratio, sigma_n / np.sqrt(squares), most), [later]])
    weights = chance * np.exp(-0.5 * (errors - errors.min()) / sigma_n**2)
    weights /= weights.sum()
    at = 1.0 / np.concatenate([smooth, loads[-1:]])
    mean = float(weights @ at)
    sigma = math.sqrt(max(float(weights @ (at - mean) ** 2), 0.0))
    slid = max(1.0 - float(weights[-1]), 1e-9)
    kinetic = float(weights[:-1] @ np.clip(ratio, LEAST_SHARE * most, most)) / (pull_n * slid)
    return _Onset(mean, sigma, min(kinetic, mean), float(weights[-1]))


def _within(ratio: np.ndarray, sigma: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Mean likelihood, of a normal one, over all ratios that friction in motion may have."""
    low, high = (ndtr((share * most - ratio) / sigma) for share in (LEAST_SHARE, 1.0))
    return np.sqrt(2.0 * np.pi) * sigma * (high - low) / ((1.0 - LEAST_SHARE) * most)
