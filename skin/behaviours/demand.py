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

import numpy as np

from skin.behaviours.pads import PadLoads

__all__ = ["FAST_S", "SLOW_S", "Demand"]

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


class Demand:
    """Follows the demand on the pads, newton per pad.

    Parameters
    ----------
    pads : int
        Number of pads.
    period_s : float
    horizon_s : float
        Horizon of the forecast.

    Attributes
    ----------
    now_n, fast_n : float
        Means over 0.1 s and over 0.01 s.
    pull_n : float
        Tangential load along its mean over 0.1 s.
    lower_n : float
        `fast_n` minus two of its sigmas: a lower bound of the load.
    forecast_n : float
        The demand: the maximum of means and forecast.
    noise_n, fast_noise_n : float
        One-sigma of the demand: of `fast_n` while the load moves, else of `now_n`; of `fast_n`.
    is_moving : bool
        Whether the load rises or falls: fast and slow mean differ by more than noise.
    borne_n : float
        Mean over 0.1 s of the load of all faces together when all slip: the root of the squares of
        tangential load and torsion over arm.
    sigma_n : float
        One-sigma of the load of a cycle.
    """

    def __init__(self, pads: int, period_s: float, horizon_s: float) -> None:
        self._gains = np.array([-math.expm1(-period_s / t) for t in (SLOW_S, MIDDLE_S, FAST_S)])
        self._means = np.full((3, 4, pads), np.nan)
        self.now_n = self.fast_n = self.lower_n = self.forecast_n = self.pull_n = 0.0
        self.borne_n = self.noise_n = self.fast_noise_n = 0.0
        self.sigma_n, self.is_moving = UNKNOWN_SIGMA_N, False
        self.set_horizon(horizon_s)

    def set_horizon(self, horizon_s: float) -> None:
        """Forecast so many seconds from now on."""
        share = (FAST_S + horizon_s) / (MIDDLE_S - FAST_S)
        # The slow mean, the fast one and the forecast, from the three means; and the fraction of a
        # sigma that is in each, by its response to one sample.
        self._mix = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -share, 1.0 + share]])
        age = np.arange(round(20.0 * SLOW_S / FAST_S))[:, np.newaxis]
        responses = self._gains * (1.0 - self._gains) ** age
        self._left = np.linalg.norm(responses @ self._mix.T, axis=0)

    def update(self, loads: PadLoads, arm_m: float) -> None:
        """Process a cycle; a pad that is silent is left out."""
        heard = np.isfinite(loads.load_n)
        if not heard.any():
            return
        x = np.concatenate([loads.shear_n, [loads.torsion_nm / arm_m]])[:, heard]
        means = self._means[:, :, heard]
        means = np.where(np.isnan(means), x, means)
        means += self._gains[:, np.newaxis, np.newaxis] * (x - means)
        self._means[:, :, heard] = means
        sigma = loads.sigma_n[heard]
        sigma = np.where(np.isnan(sigma), UNKNOWN_SIGMA_N, sigma)
        self.sigma_n = math.sqrt(sigma @ sigma) / sigma.size
        signals = (self._mix @ means.reshape(3, -1)).reshape(means.shape)
        sizes = np.sqrt((signals[:, :3] ** 2).sum(axis=1))
        torsion = np.abs(signals[:, 3]) - DOUBT * self._left[:, np.newaxis] * sigma
        faces = (sizes + FARTHEST * np.maximum(torsion, 0.0)).sum(axis=1) / sigma.size
        self.now_n, self.fast_n, soon_n = faces.tolist()
        slow_noise_n, self.fast_noise_n, soon_noise_n = (self._left * self.sigma_n).tolist()
        soon_n = min(soon_n - DOUBT * soon_noise_n, FURTHEST * self.fast_n)
        self.forecast_n = max(self.now_n, self.fast_n, soon_n)
        along = (x[:3] * means[0, :3]).sum(axis=0) / np.maximum(sizes[0], 1e-12)
        self.pull_n = float(along.sum()) / sigma.size
        self.borne_n = float(np.hypot(sizes[0], means[0, 3]).sum()) / sigma.size
        self.lower_n = self.fast_n - 2.0 * self.fast_noise_n
        least_n = MOVING * self.fast_noise_n + MOVING_SHARE * self.now_n
        self.is_moving = abs(self.fast_n - self.now_n) > least_n
        self.noise_n = self.fast_noise_n if self.is_moving else slow_noise_n
