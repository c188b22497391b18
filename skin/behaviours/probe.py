"""Probe: measures friction by loosening the grip on an object that hangs still.

A flat face that slides as a whole gives no warning: there is no incipient slip. But the tangential
load of an object that hangs still does not depend on the grip until it slides: from then on it is
friction times grip. So the grip is loosened quickly: an object in free fall for 30 ms falls 4 mm.
When Page's cumulative sum of the missing load rises, the posterior of the onset is computed: if the
object slides, the grip rises at once. The ratio of the loads at the onset is static friction, their
ratio after it kinetic friction.
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
"""Duration after which a load is steady, and of its mean [derived: noise of two pads of 16 units,
0.035 N, in a mean over 40 cycles is 0.006 N]."""

STEADY = 4.0
"""Largest deviation of a steady load from its mean, sigmas [assumed]."""

LOOSENS_PER_S = 4.0
"""Relative rate of loosening [derived: with equal static and kinetic friction, a slide after t is
g t^3 4/6, 0.4 mm in 40 ms; slower, it would be as far before the load shows it]."""

DRIFT, LIMIT = 0.5, 2.0
"""Of Page's test, in sigmas: the allowance per cycle, and the sum at which the posterior is
computed [numeric]."""

RISE = 8.0
"""The same sum upwards, which shows a pull and aborts the probe [assumed]."""

STILL = 0.1
"""Probability of no slide below which one is reported [assumed: one false slide in ten; it costs
grip, a late one costs travel]."""

MOST_FRICTION = 1.2
"""Largest coefficient of static friction [assumed: silicone on clean glass]."""

LEAST_SHARE = 0.5
"""Smallest ratio of kinetic to static friction [assumed]."""

LEAST_N = 1e-3
"""Newton, lower bound of a divisor [numeric]."""


class Outcome(StrEnum):
    """Outcomes of a probe."""

    SLID = "slid"
    HELD = "held"
    DISTURBED = "disturbed"


class Answer(NamedTuple):
    """Result of a probe.

    Attributes
    ----------
    outcome : Outcome
    friction : float
        Ratio of the loads at the onset of the slide, mean of its posterior; where it held, about
        the largest ratio that it bore.
    sigma : float
        One-sigma of `friction`.
    kinetic : float
        Ratio while it slid; `friction` where it held.
    shear_n : float
        Load of friction per pad while the object hung still.
    """

    outcome: Outcome
    friction: float
    sigma: float
    kinetic: float
    shear_n: float


class Probe:
    """Waits for an object that hangs still, and loosens it once.

    Attributes
    ----------
    factor : float
        Factor for the grip, now.
    """

    def __init__(self, period_s: float) -> None:
        self.factor = 1.0
        self._period_s = period_s
        self._wait = round(WAIT_S / period_s)
        self._mean = round(MEAN_S / period_s)
        self.restart()

    @property
    def loosens(self) -> bool:
        """Whether the grip is being loosened."""
        return self.factor < 1.0

    def restart(self) -> None:
        """Abort and start again."""
        self.factor = 1.0
        self._count, self._mean_n = 0, 0.0
        self._pull_n, self._borne_n = 0.0, 0.0
        self._lack, self._rise = 0.0, 0.0
        self._loads: list[float] = []
        self._shears: list[float] = []

    def update(self, load_n: float, demand: Demand, least_n: float) -> Answer | None:
        """Process a cycle; returns the answer when there is one.

        Parameters
        ----------
        load_n : float
            Newton by pad, of this cycle.
        demand : Demand
            Of this cycle.
        least_n : float
            Newton: lower bound of the loosened grip.
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
        """Average a steady load, then start to loosen."""
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
    """Onset of a slide: mean and one-sigma of one over the load there, in 1/N; load of kinetic
    friction over pull and load; the probability of no slide."""

    per_load: float
    sigma_per_load: float
    kinetic_per_load: float
    held: float


def _onset(
    loads: np.ndarray, shears: np.ndarray, pull_n: float, sigma_n: float, known: int, later: float
) -> _Onset:
    """Posterior of the cycle from which a steady load is proportional to the grip, shapes (m,), and
    of no such cycle.

    Before it the load is constant, `pull_n` in the mean of the `known` cycles before these; after
    it, it is the grip times a ratio, at most that of the onset. Noise is white. All cycles have the
    same prior, also the `later` ones within the bound of friction.
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
    """Mean of a normal likelihood over all ratios that kinetic friction may have."""
    low, high = (ndtr((share * most - ratio) / sigma) for share in (LEAST_SHARE, 1.0))
    return np.sqrt(2.0 * np.pi) * sigma * (high - low) / ((1.0 - LEAST_SHARE) * most)
