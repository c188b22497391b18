"""What friction has to bear on the pads of a gripper: tangential load and torsion, now and soon.

A moment about the normal loads the faces that are far from its axis more than the others, and these
slip first; where friction is less in motion than at rest, the others follow at once. So a pad's
demand is what its most loaded face asks for: the tangential load, and the torsion over an arm.

Noise must not shake the grip, and a pull must not wait for a mean. So three means of different
length follow the loads, and the demand is the largest of the slow one, the fast one, and what a
load that goes on to rise will be when the gripper has answered, less the noise of that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.jit import compiled, jitable
from skin.behaviours.pads import PadLoads

__all__ = ["Demand"]

SLOW_S, MIDDLE_S, FAST_S = 0.1, 0.025, 0.01
"""Time constants [assumed: a pull by hand rises in 0.1 s or more]."""

DOUBT = 1.0
"""Sigmas that are taken off a forecast and off a torsion: both only ever add to the demand, and
would add their noise [assumed]."""

MOVING, MOVING_SHARE = 3.5, 0.04
"""Sigmas, and share of itself, by which the fast mean of a load that moves is off the slow one
[assumed: what swings by 4 % is at rest]."""

FURTHEST = 1.4
"""What a forecast may be of the fast mean: a hand that lifts what stands loads stiff pads within
10 ms, and a straight line through that leads nowhere [assumed]."""

FARTHEST = 1.25
"""Torsion of the most loaded face, of the mean one: mean distance times farthest over mean square
of 4 x 4, 2 x 4 and 1 x 4 units, 1.27, 1.21, 1.2 [derived]."""

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
    sigma in the slow mean, in the fast one and in the forecast."""

    slow: float
    middle: float
    fast: float
    forecast: float
    slow_noise: float
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
        How far the forecast looks.

    Attributes
    ----------
    now_n : float
        Newton by pad, a mean over 0.1 s.
    fast_n : float
        The same over 0.01 s.
    raw_n : float
        Tangential load alone, in this cycle.
    pull_n : float
        The same along its mean over 0.1 s.
    sure_n : float
        `fast_n` less two of its sigmas: what is borne at least.
    soon_n : float
        What to grip for: the largest that is sure.
    noise_n : float
        One-sigma of what is followed: of `fast_n` while the load moves, else of `now_n`.
    is_moving : bool
        Whether the load rises or falls: the fast mean is off the slow one by more than noise.
    borne_n : float
        Newton by pad, a mean over 0.1 s: what all faces together bear where all of them slip, the
        root of the squares of tangential load and torsion over arm.
    sigma_n : float
        One-sigma of `raw_n`.
    """

    def __init__(self, pads: int, period_s: float, horizon_s: float) -> None:
        slow, middle, fast = (-math.expm1(-period_s / t) for t in (SLOW_S, MIDDLE_S, FAST_S))
        forecast = (FAST_S + horizon_s) / (MIDDLE_S - FAST_S)
        weights = Weights(
            slow,
            middle,
            fast,
            forecast,
            _left(slow),
            _left(fast),
            _left_forecast(fast, middle, forecast),
        )
        self._weights = weights
        self._means = Means(*(np.zeros((SIGNALS, pads)) for _ in Means._fields))
        self._arm_m = np.zeros(1)
        self._loads: PadLoads | None = None
        self._told = np.zeros(8)
        self._is_first = np.ones(1, bool)
        self.now_n = self.fast_n = self.raw_n = self.sure_n = self.soon_n = self.pull_n = 0.0
        self.borne_n = 0.0
        self.is_moving = False
        self.noise_n = 0.0
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
            self.pull_n, self.borne_n,
        ) = self._told.tolist()  # fmt: skip
        self.noise_n = self._weights.fast_noise * self.sigma_n
        least_n = MOVING * self.noise_n + MOVING_SHARE * self.now_n
        self.is_moving = abs(self.fast_n - self.now_n) > least_n
        if not self.is_moving:
            self.noise_n = self._weights.slow_noise * self.sigma_n


def _left(gain: float) -> float:
    """Share of a sigma that an exponential mean leaves."""
    return math.sqrt(gain / (2.0 - gain))


def _left_forecast(fast: float, middle: float, forecast: float) -> float:
    """Share of a sigma in the forecast, by its answer to one sample."""
    age = np.arange(200)
    answer = (1.0 + forecast) * fast * (1.0 - fast) ** age - forecast * middle * (
        1.0 - middle
    ) ** age
    return float(np.sqrt((answer**2).sum()))


@jitable
def _beyond(torsion, noise):
    """What a torsion, as a force, adds at the most loaded face."""
    return FARTHEST * max(abs(torsion) - DOUBT * noise, 0.0)


def follow_python(
    loads: PadLoads,
    arm_m: np.ndarray,
    weights: Weights,
    means: Means,
    is_first: np.ndarray,
    told: np.ndarray,
) -> None:
    """Follow the loads; `told` becomes the attributes of `Demand`: raw, slow, fast, sure, soon,
    sigma, pull, borne."""
    pads = loads.load_n.size
    raw, slow, fast, soon, pull, borne, variance, heard = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for pad in range(pads):
        if np.isnan(loads.load_n[pad]):
            continue
        sigma = loads.force_sigma_n[pad]
        sigma = UNKNOWN_SIGMA_N if np.isnan(sigma) else sigma
        size, size_slow, size_fast, size_soon, along = 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(4):
            x = loads.shear_n[row, pad] if row < 3 else loads.torsion_nm[pad] / arm_m[0]
            if is_first[0]:
                means.slow[row, pad] = means.middle[row, pad] = means.fast[row, pad] = x
            means.slow[row, pad] += weights.slow * (x - means.slow[row, pad])
            means.middle[row, pad] += weights.middle * (x - means.middle[row, pad])
            means.fast[row, pad] += weights.fast * (x - means.fast[row, pad])
            quick = means.fast[row, pad]
            forecast = quick + weights.forecast * (quick - means.middle[row, pad])
            if row < 3:
                size += x * x
                size_slow += means.slow[row, pad] ** 2
                size_fast += quick * quick
                size_soon += forecast * forecast
                along += x * means.slow[row, pad]
        torsion = means.slow[3, pad]
        borne += np.sqrt(size_slow + torsion**2)
        raw += np.sqrt(size)
        slow += np.sqrt(size_slow) + _beyond(torsion, weights.slow_noise * sigma)
        fast += np.sqrt(size_fast) + _beyond(means.fast[3, pad], weights.fast_noise * sigma)
        soon += np.sqrt(size_soon) + _beyond(forecast, weights.soon_noise * sigma)
        pull += along / np.sqrt(size_slow) if size_slow > 0.0 else 0.0
        variance += sigma * sigma
        heard += 1
    if heard == 0:
        return
    is_first[0] = False
    sigma = np.sqrt(variance) / heard
    told[0], told[1], told[2] = raw / heard, slow / heard, fast / heard
    told[3] = told[2] - 2.0 * weights.fast_noise * sigma
    forecast = min(soon / heard - DOUBT * weights.soon_noise * sigma, FURTHEST * told[2])
    told[4] = max(told[1], told[2], forecast)
    told[5], told[6], told[7] = sigma, pull / heard, borne / heard


follow = compiled(follow_python, fastmath={"contract"})
