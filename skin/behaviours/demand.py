"""What friction has to bear on the pads of a gripper: tangential load and torsion, now and soon.

A moment about the normal loads the faces that are far from its axis more than the others, and these
slip first. Whether the others follow is a matter of friction in motion. So a pad holds where either
of two things holds: its most loaded face, which bears the tangential load and, on top of it, the
torsion over an arm, by friction at rest; or all faces together, which bear the root of the squares
of both (the limit surface), by friction in motion. The demand is the lesser of the two, as a force
that friction at rest must bear [derived; springs with Coulomb friction on 2 x 4 and 4 x 4 units,
friction in motion 0.7 to 1, are within 10 % of it].

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


class Contact(NamedTuple):
    """Of pads and what they hold: the arm of the torsion, friction in motion over that at rest."""

    arm_m: np.ndarray
    kinetic_share: np.ndarray


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
    first_n : float
        The same of the most loaded faces alone: where these begin to slip.
    borne_n : float
        The same of all faces together, where all of them slip.
    soon_borne_n : float
        `borne_n`, as far as `soon_n` looks.
    pull_n : float
        Tangential load alone, in this cycle, along its mean over 0.1 s.
    sure_n : float
        `fast_n` less two of its sigmas: what is borne at least.
    soon_n : float
        What to grip for: the largest that is sure.
    noise_n : float
        One-sigma of what is followed: of `fast_n` while the load moves, else of `now_n`.
    is_moving : bool
        Whether the load rises or falls: the fast mean is off the slow one by more than noise.
    sigma_n : float
        One-sigma of the tangential load, in one cycle.
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
        self._contact = Contact(np.zeros(1), np.zeros(1))
        self._loads: PadLoads | None = None
        self._told = np.zeros(9)
        self._is_first = np.ones(1, bool)
        self.now_n = self.fast_n = self.sure_n = self.soon_n = self.pull_n = 0.0
        self.first_n = self.borne_n = self.soon_borne_n = 0.0
        self.is_moving = False
        self.noise_n = 0.0
        self.sigma_n = UNKNOWN_SIGMA_N

    def update(self, loads: PadLoads, arm_m: float, kinetic_share: float) -> None:
        """Go on by a cycle; a pad that is not heard is left out.

        Parameters
        ----------
        loads : PadLoads
        arm_m : float
            Mean distance of the load from its centre.
        kinetic_share : float
            Friction in motion over that at rest.
        """
        self._contact.arm_m[0], self._contact.kinetic_share[0] = arm_m, kinetic_share
        if loads is not self._loads:  # those of `Pads` are the same tuple in every cycle
            self._loads = loads
            self._follow = Bound(
                follow, loads, self._contact, self._weights, self._means, self._is_first, self._told
            )
        self._follow()
        (
            self.now_n, self.fast_n, self.sure_n, self.soon_n, self.sigma_n, self.pull_n,
            self.first_n, self.borne_n, self.soon_borne_n,
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
def _faces(size, torsion, noise):
    """What the most loaded face asks for, and what all of them ask for together."""
    turn = FARTHEST * max(abs(torsion) - DOUBT * noise, 0.0)
    return size + turn, np.sqrt(size * size + turn * turn)


def follow_python(
    loads: PadLoads,
    contact: Contact,
    weights: Weights,
    means: Means,
    is_first: np.ndarray,
    told: np.ndarray,
) -> None:
    """Follow the loads; `told` becomes the attributes of `Demand`: slow, fast, sure, soon, sigma,
    pull, first, borne, soon borne."""
    pads, share = loads.load_n.size, contact.kinetic_share[0]
    slow, fast, soon, pull, variance, heard = 0.0, 0.0, 0.0, 0.0, 0.0, 0
    first, borne, fast_borne, soon_borne = 0.0, 0.0, 0.0, 0.0
    for pad in range(pads):
        if np.isnan(loads.load_n[pad]):
            continue
        sigma = loads.force_sigma_n[pad]
        sigma = UNKNOWN_SIGMA_N if np.isnan(sigma) else sigma
        size_slow, size_fast, size_soon, along = 0.0, 0.0, 0.0, 0.0
        for row in range(4):
            x = loads.shear_n[row, pad] if row < 3 else loads.torsion_nm[pad] / contact.arm_m[0]
            if is_first[0]:
                means.slow[row, pad] = means.middle[row, pad] = means.fast[row, pad] = x
            means.slow[row, pad] += weights.slow * (x - means.slow[row, pad])
            means.middle[row, pad] += weights.middle * (x - means.middle[row, pad])
            means.fast[row, pad] += weights.fast * (x - means.fast[row, pad])
            quick = means.fast[row, pad]
            forecast = quick + weights.forecast * (quick - means.middle[row, pad])
            if row < 3:
                size_slow += means.slow[row, pad] ** 2
                size_fast += quick * quick
                size_soon += forecast * forecast
                along += x * means.slow[row, pad]
        size_slow = np.sqrt(size_slow)
        most, all_of = _faces(size_slow, means.slow[3, pad], weights.slow_noise * sigma)
        first += most
        borne += all_of
        slow += min(most, all_of / share)
        most, all_of = _faces(np.sqrt(size_fast), means.fast[3, pad], weights.fast_noise * sigma)
        fast_borne += all_of
        fast += min(most, all_of / share)
        most, all_of = _faces(np.sqrt(size_soon), forecast, weights.soon_noise * sigma)
        soon_borne += all_of
        soon += min(most, all_of / share)
        pull += along / size_slow if size_slow > 0.0 else 0.0
        variance += sigma * sigma
        heard += 1
    if heard == 0:
        return
    is_first[0] = False
    sigma = np.sqrt(variance) / heard
    slow, fast, borne, fast_borne = slow / heard, fast / heard, borne / heard, fast_borne / heard
    doubt = DOUBT * weights.soon_noise * sigma
    told[0], told[1], told[2] = slow, fast, fast - 2.0 * weights.fast_noise * sigma
    told[3] = max(slow, fast, min(soon / heard - doubt, FURTHEST * fast))
    told[4], told[5], told[6], told[7] = sigma, pull / heard, first / heard, borne
    told[8] = max(borne, fast_borne, min(soon_borne / heard - doubt, FURTHEST * fast_borne))


follow = compiled(follow_python, fastmath={"contract"})
