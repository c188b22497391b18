"""What friction has to bear on the pads of a gripper: tangential load and torsion, now and soon.

A tangential load and a moment about the normal use friction up together: all faces of a pad slip
where ``hypot(shear, torsion / arm)`` reaches friction times grip, the arm being the mean distance
of the load from its centre (a circle in place of the limit surface, which is exact for either
alone).

Noise must not shake the grip, and a pull must not wait for a mean. So three means of different
length follow the loads, and the demand is the largest of what they tell beyond their noise: the
slow one as it is, the fast one less its noise, and what a load that goes on to rise will be when
the gripper has answered.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.jit import compiled
from skin.behaviours.pads import PadLoads

__all__ = ["Demand"]

SLOW_S, MIDDLE_S, FAST_S = 0.1, 0.04, 0.01
"""Time constants [assumed: a pull by hand rises in 0.1 s or more]."""

SURE = 1.0
"""Sigmas that are taken off a quick mean: their highest in 0.3 s is two [derived: 30 independent
values], and the grip shall stand one above what is needed, for it cannot know better."""

UNKNOWN_SIGMA_N = 0.05
"""Of a pad's force where sigma is not wanted [derived: 16 units of 0.0125 N]."""

SIGNALS = 4
"""Of a pad: three components of the tangential force, and torsion over arm."""


class Means(NamedTuple):
    """Of p pads: three means of the signals, shape (4, p), newton."""

    slow: np.ndarray
    middle: np.ndarray
    fast: np.ndarray


class Weights(NamedTuple):
    """Gains of the three means, the share of the rise that is added, and what noise is left of one
    sigma in the fast mean and in the forecast; shape () each."""

    slow: float
    middle: float
    fast: float
    ahead: float
    fast_noise: float
    soon_noise: float


class Demand:
    """Follows what the pads must bear.

    Parameters
    ----------
    pads : int
        How many.
    period_s : float
    horizon_s : float
        How far ahead the forecast looks.

    Attributes
    ----------
    now_n : float
        Newton by pad, a mean over 0.1 s.
    fast_n : float
        The same over 0.01 s.
    raw_n : float
        The same of this cycle.
    pull_n : float
        Tangential load alone, without torsion, in this cycle, along its mean over 0.1 s.
    sure_n : float
        `fast_n` less its noise: what is borne at least.
    soon_n : float
        What to grip for: the largest that is sure.
    sigma_n : float
        One-sigma of `raw_n`.
    """

    def __init__(self, pads: int, period_s: float, horizon_s: float) -> None:
        slow, middle, fast = (-math.expm1(-period_s / t) for t in (SLOW_S, MIDDLE_S, FAST_S))
        ahead = (FAST_S + horizon_s) / (MIDDLE_S - FAST_S)
        weights = Weights(
            slow, middle, fast, ahead, _left(fast), _left_ahead(fast, middle, ahead)
        )
        self._weights = weights
        self._means = Means(*(np.zeros((SIGNALS, pads)) for _ in Means._fields))
        self._arm_m = np.zeros(1)
        self._loads: PadLoads | None = None
        self._told = np.zeros(7)
        self._is_first = np.ones(1, bool)
        self.now_n = self.fast_n = self.raw_n = self.sure_n = self.soon_n = self.pull_n = 0.0
        self.sigma_n = UNKNOWN_SIGMA_N

    def update(self, loads: PadLoads, arm_m: float) -> None:
        """Go on by a cycle; a pad that is not heard is left out."""
        self._arm_m[0] = arm_m
        if loads is not self._loads:  # those of `Pads` are the same tuple in every cycle
            self._loads = loads
            self._follow = Bound(
                follow, loads, self._arm_m, self._weights, self._means, self._is_first, self._told
            )
        self._follow()
        (
            self.raw_n, self.now_n, self.fast_n, self.sure_n, self.soon_n, self.sigma_n,
            self.pull_n,
        ) = self._told.tolist()  # fmt: skip


def _left(gain: float) -> float:
    """Share of a sigma that an exponential mean leaves."""
    return math.sqrt(gain / (2.0 - gain))


def _left_ahead(fast: float, middle: float, ahead: float) -> float:
    """Share of a sigma in the forecast, by its answer to one sample."""
    age = np.arange(200)
    answer = (1.0 + ahead) * fast * (1.0 - fast) ** age - ahead * middle * (1.0 - middle) ** age
    return float(np.sqrt((answer**2).sum()))


def follow_python(
    loads: PadLoads,
    arm_m: np.ndarray,
    weights: Weights,
    means: Means,
    is_first: np.ndarray,
    told: np.ndarray,
) -> None:
    """Follow the loads; `told` becomes the attributes of `Demand`: raw, slow, fast, sure, soon,
    sigma, pull."""
    pads = loads.load_n.size
    raw, slow, fast, soon, pull, variance, heard = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for pad in range(pads):
        if np.isnan(loads.load_n[pad]):
            continue
        size, size_slow, size_fast, size_soon, along, mean = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(4):
            x = loads.shear_n[row, pad] if row < 3 else loads.torsion_nm[pad] / arm_m[0]
            if is_first[0]:
                means.slow[row, pad] = means.middle[row, pad] = means.fast[row, pad] = x
            means.slow[row, pad] += weights.slow * (x - means.slow[row, pad])
            means.middle[row, pad] += weights.middle * (x - means.middle[row, pad])
            means.fast[row, pad] += weights.fast * (x - means.fast[row, pad])
            quick = means.fast[row, pad]
            ahead = quick + weights.ahead * (quick - means.middle[row, pad])
            size += x * x
            size_slow += means.slow[row, pad] ** 2
            size_fast += quick * quick
            size_soon += ahead * ahead
            if row < 3:
                along += x * means.slow[row, pad]
                mean += means.slow[row, pad] ** 2
        raw += np.sqrt(size)
        slow += np.sqrt(size_slow)
        fast += np.sqrt(size_fast)
        soon += np.sqrt(size_soon)
        pull += along / np.sqrt(mean) if mean > 0.0 else 0.0
        sigma = loads.force_sigma_n[pad]
        sigma = UNKNOWN_SIGMA_N if np.isnan(sigma) else sigma
        variance += sigma * sigma
        heard += 1
    if heard == 0:
        return
    is_first[0] = False
    sigma = np.sqrt(variance) / heard
    told[0], told[1], told[2] = raw / heard, slow / heard, fast / heard
    told[3] = told[2] - SURE * weights.fast_noise * sigma
    told[4] = max(told[1], told[3], soon / heard - SURE * weights.soon_noise * sigma)
    told[5], told[6] = sigma, pull / heard


follow = compiled(follow_python, fastmath={"contract"})
