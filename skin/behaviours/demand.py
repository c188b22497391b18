"""Demand on the friction of a gripper's pads: tangential load and torsion, now and forecast.

Torsion loads the faces far from its axis more than others, and these slip first; where kinetic
friction is less than static friction, the others follow at once. So the demand of a pad is that of
its most loaded face: the tangential load, and the torsion over an arm.

Noise must not shake the grip, and a pull must not wait for a mean. So three low-pass filters of
different time constants follow the loads. The demand is the maximum of the slow one, the fast one,
and a forecast over the response time of the gripper, less the noise of the forecast.
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
"""Sigmas subtracted from a forecast and from a torsion: both only ever add to the demand, and would
add their noise [assumed]."""

MOVING, MOVING_SHARE = 3.5, 0.04
"""Sigmas, and fraction of the load, by which the fast and slow mean of a moving load differ
[assumed: an oscillation of 4 % counts as rest]."""

FURTHEST = 1.4
"""Largest forecast relative to the fast mean: a lift from a support loads stiff pads within 10 ms,
which must not be extrapolated [assumed]."""

FARTHEST = 1.25
"""Torsion of the most loaded face over that of the mean one: mean distance times largest over mean
square of 4 x 4, 2 x 4 and 1 x 4 units, 1.27, 1.21, 1.2 [derived]."""

UNKNOWN_SIGMA_N = 0.05
"""One-sigma of a pad's force where sigma is not wanted [derived: 16 units of 0.0125 N]."""

SIGNALS = 4
"""Signals of a pad: three components of the tangential force, and torsion over arm."""


class Means(NamedTuple):
    """Three low-pass filters of the signals of p pads, shape (4, p), newton."""

    slow: np.ndarray
    middle: np.ndarray
    fast: np.ndarray


class Weights(NamedTuple):
    """Gains of the three means, the fraction of the rise that is added, and the remaining noise per
    sigma in the slow mean, the fast one and the forecast."""

    slow: float
    middle: float
    fast: float
    forecast: float
    slow_noise: float
    fast_noise: float
    soon_noise: float


class Demand:
    """Follows the demand on the pads.

    Parameters
    ----------
    pads : int
        Number of pads.
    period_s : float
    horizon_s : float
        Horizon of the forecast.

    Attributes
    ----------
    now_n : float
        Newton per pad, a mean over 0.1 s.
    fast_n : float
        The same over 0.01 s.
    raw_n : float
        Tangential load alone, of this cycle.
    pull_n : float
        The same along its mean over 0.1 s.
    lower_n : float
        `fast_n` minus two of its sigmas: a lower bound of the load.
    forecast_n : float
        The demand: the maximum of the lower bounds of means and forecast.
    noise_n : float
        One-sigma of the demand: of `fast_n` while the load moves, else of `now_n`.
    fast_noise_n : float
        One-sigma of `fast_n`.
    is_moving : bool
        Whether the load rises or falls: fast and slow mean differ by more than noise.
    borne_n : float
        Newton per pad, a mean over 0.1 s: the load of all faces together when all slip, the root of
        the squares of tangential load and torsion over arm.
    sigma_n : float
        One-sigma of `raw_n`.
    """

    def __init__(self, pads: int, period_s: float, horizon_s: float) -> None:
        self._weights = _weights(period_s, horizon_s)
        self._means = Means(*(np.zeros((SIGNALS, pads)) for _ in Means._fields))
        self._arm_m = np.zeros(1)
        self._loads: PadLoads | None = None
        self._out = np.zeros(8)
        self._is_first = np.ones(1, bool)
        self.now_n = self.fast_n = self.raw_n = self.lower_n = self.forecast_n = self.pull_n = 0.0
        self.borne_n = 0.0
        self.is_moving = False
        self.noise_n = self.fast_noise_n = 0.0
        self.sigma_n = UNKNOWN_SIGMA_N

    def set_horizon(self, period_s: float, horizon_s: float) -> None:
        """Forecast so many seconds from now on."""
        self._weights, self._loads = _weights(period_s, horizon_s), None

    def update(self, loads: PadLoads, arm_m: float) -> None:
        """Process a cycle; a pad that is silent is left out."""
        self._arm_m[0] = arm_m
        if loads is not self._loads:  # those of `Pads` are the same tuple in every cycle
            self._loads = loads
            self._follow = Bound(
                follow, loads, self._arm_m, self._weights, self._means, self._is_first, self._out
            )
        self._follow()
        (
            self.raw_n, self.now_n, self.fast_n, self.lower_n, self.forecast_n, self.sigma_n,
            self.pull_n, self.borne_n,
        ) = self._out.tolist()  # fmt: skip
        self.noise_n = self.fast_noise_n = self._weights.fast_noise * self.sigma_n
        least_n = MOVING * self.noise_n + MOVING_SHARE * self.now_n
        self.is_moving = abs(self.fast_n - self.now_n) > least_n
        if not self.is_moving:
            self.noise_n = self._weights.slow_noise * self.sigma_n


def _weights(period_s: float, horizon_s: float) -> Weights:
    slow, middle, fast = (-math.expm1(-period_s / t) for t in (SLOW_S, MIDDLE_S, FAST_S))
    forecast = (FAST_S + horizon_s) / (MIDDLE_S - FAST_S)
    noise = _left_forecast(fast, middle, forecast)
    return Weights(slow, middle, fast, forecast, _left(slow), _left(fast), noise)


def _left(gain: float) -> float:
    """Fraction of a sigma that an exponential mean leaves."""
    return math.sqrt(gain / (2.0 - gain))


def _left_forecast(fast: float, middle: float, forecast: float) -> float:
    """Fraction of a sigma in the forecast, by its response to one sample."""
    age = np.arange(200)
    answer = (1.0 + forecast) * fast * (1.0 - fast) ** age - forecast * middle * (
        1.0 - middle
    ) ** age
    return float(np.sqrt((answer**2).sum()))


@jitable
def _beyond(torsion, noise):
    """Contribution of a torsion, as a force, at the most loaded face."""
    return FARTHEST * max(abs(torsion) - DOUBT * noise, 0.0)


def follow_python(
    loads: PadLoads,
    arm_m: np.ndarray,
    weights: Weights,
    means: Means,
    is_first: np.ndarray,
    found: np.ndarray,
) -> None:
    """Update the means; `found` becomes the attributes of `Demand`: raw, slow, fast, lower,
    forecast, sigma, pull, borne."""
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
    found[0], found[1], found[2] = raw / heard, slow / heard, fast / heard
    found[3] = found[2] - 2.0 * weights.fast_noise * sigma
    forecast = min(soon / heard - DOUBT * weights.soon_noise * sigma, FURTHEST * found[2])
    found[4] = max(found[1], found[2], forecast)
    found[5], found[6], found[7] = sigma, pull / heard, borne / heard


follow = compiled(follow_python, fastmath={"contract"})
