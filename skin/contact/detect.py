"""Change detectors for sudden events, sized by the false alarms that one is willing to bear."""

from __future__ import annotations

import numpy as np
from numba import njit

from skin.errors import SkinError

__all__ = ["Cusum", "Shocks", "cusum_limit", "cusum_run_length"]


def cusum_run_length(limit: float, drift: float = 0.5) -> float:
    """Mean number of samples until a one-sided CUSUM alarms on standard normal noise (Siegmund).

    Examples
    --------
    >>> round(cusum_run_length(5.0))
    938
    """
    reach = 2.0 * drift * (limit + 1.166)
    return float((np.exp(reach) - reach - 1.0) / (2.0 * drift**2))


def cusum_limit(run_length: float, drift: float = 0.5) -> float:
    """Limit at which a one-sided CUSUM alarms once in `run_length` samples of noise alone.

    Parameters
    ----------
    run_length : float
        Samples.
    drift : float
        Sigmas that are subtracted from each sample: half the shift that is to be seen soonest.

    Examples
    --------
    >>> round(cusum_limit(938.0), 2)
    5.0
    """
    from scipy.optimize import brentq

    shortest = cusum_run_length(0.0, drift)
    if not run_length > shortest:
        raise SkinError(f"run_length: must be above {shortest:.3g} samples; got {run_length}")
    high = 1.0
    while cusum_run_length(high, drift) < run_length:
        high *= 2.0
    return float(brentq(lambda limit: cusum_run_length(limit, drift) - run_length, 0.0, high))


def _per_sample(false_alarms_per_hour: float, rate_hz: float, channels: int) -> float:
    """Chance of a false alarm in one sample of one channel."""
    chance = false_alarms_per_hour / (3600.0 * rate_hz * channels)
    if not 0.0 < chance < 0.1:
        raise SkinError(
            "false_alarms_per_hour, rate_hz: must leave each sample a chance between 0 and 0.1; "
            f"got {chance:g}"
        )
    return chance


class Cusum:
    """Bank of CUSUM charts: a lasting shift of a mean, as soon as possible.

    For one lightly touched unit among many, for instance: its load is within the noise in every
    cycle, and has long been there when the sum of a few of them is not.

    Parameters
    ----------
    channels : int
    rate_hz : float
        Samples a second.
    false_alarms_per_hour : float
        Of all channels together, on white Gaussian noise.
    drift : float
        See `cusum_limit`.
    two_sided : bool
        Look for falls as well as for rises.

    Attributes
    ----------
    limit : float
    level : ndarray, shape (2, channels)
        Sums for rises and falls, 0 where nothing speaks for a change.
    """

    def __init__(
        self,
        channels: int,
        rate_hz: float,
        *,
        false_alarms_per_hour: float = 1.0,
        drift: float = 0.5,
        two_sided: bool = True,
    ) -> None:
        sides = 2 if two_sided else 1
        chance = _per_sample(false_alarms_per_hour, rate_hz, channels * sides)
        self.limit = cusum_limit(1.0 / chance, drift)
        self.level = np.zeros((2, channels))
        self._drift = drift
        self._sides = sides

    def update(self, value: np.ndarray) -> np.ndarray:
        """Take a sample of each channel; returns 1 for a rise, -1 for a fall, 0 for no change.

        A chart that has alarmed begins anew.

        Parameters
        ----------
        value : ndarray, shape (channels,)
            In sigmas from the expected mean; NaN leaves a chart as it is.

        Returns
        -------
        ndarray, shape (channels,), int64
        """
        level = self.level
        known = np.isfinite(value)
        shift = np.where(known, value, 0.0)
        drift = np.where(known, self._drift, 0.0)
        np.maximum(level[0] + shift - drift, 0.0, out=level[0])
        if self._sides == 2:
            np.maximum(level[1] - shift - drift, 0.0, out=level[1])
        change = (level[0] > self.limit).astype(np.int64) - (level[1] > self.limit)
        level[:, change != 0] = 0.0
        return change


def shock_python(count, slots, events, force, sigma, smooth, memory, impact, vibration):
    """Second differences of the force on each contact, and their smoothed square.

    The second difference of what a hand does is next to nothing at the rate of a bus; that of
    noise has a known variance; what is left is a shock.

    Parameters
    ----------
    count : int
        Contacts.
    slots : ndarray, shape (s,), int32
        Records of the contacts.
    events : ndarray, shape (s,), int32
        `Event` of each record: one that is new, back, merged or split begins anew.
    force, sigma : ndarray, shape (s, 3)
        Newton, force on each record's contact and its one-sigma.
    smooth : float
        Gain of the smoothing.
    memory : ndarray, shape (s, 7), float64
        Kept: samples seen, last two forces.
    impact, vibration : ndarray, shape (s,), float64
        Written: square of the second difference in variances, and kept, its smoothed value;
        chi-square with three degrees of freedom, and its mean over time.
    """
    for k in range(count):
        slot = slots[k]
        past = memory[slot]
        if events[slot]:
            past[0] = 0.0
            vibration[slot] = 3.0
        square = 0.0
        for a in range(3):
            here = force[slot, a]
            jump = here - 2.0 * past[1 + a] + past[4 + a]
            square += jump * jump / (6.0 * sigma[slot, a] * sigma[slot, a])
            past[4 + a] = past[1 + a]
            past[1 + a] = here
        past[0] += 1.0
        if past[0] > 2.0:
            impact[slot] = square
            vibration[slot] += smooth * (square - vibration[slot])
        else:
            impact[slot] = 0.0


shock = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(shock_python)


class Shocks:
    """Impacts and vibration of contacts.

    Parameters
    ----------
    records : int
        Contacts that can be told apart.
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        Alarms that begin, of each kind, for one contact, on white Gaussian noise of the variance
        given.
    time_s : float
        Over which vibration is averaged.

    Attributes
    ----------
    impact, vibration : ndarray, shape (records,), float64
        Square of the shock in variances: one cycle's, and averaged.
    impact_limit, vibration_limit : float
        Above which they are none of noise.
    """

    def __init__(
        self,
        records: int,
        rate_hz: float,
        *,
        false_alarms_per_hour: float = 1.0,
        time_s: float = 0.1,
    ) -> None:
        from scipy.stats import chi2, gamma

        chance = _per_sample(false_alarms_per_hour, rate_hz, 1)
        self.impact = np.zeros(records)
        self.vibration = np.zeros(records)
        self.impact_limit = float(chi2.isf(chance, 3))
        self._smooth = smooth = 1.0 - float(np.exp(-1.0 / (time_s * rate_hz)))
        # Variance of the average: second differences of white noise are correlated -2/3 and 1/6
        # with the next two, their squares by the squares of that.
        keep = 1.0 - smooth
        tied = 1.0 + 2.0 * (keep * 4.0 / 9.0 + keep**2 / 36.0)
        variance = 6.0 * smooth / (2.0 - smooth) * tied
        self.vibration_limit = float(gamma.isf(chance, 9.0 / variance, scale=variance / 3.0))
        self._memory = np.zeros((records, 7))

    def update(
        self, count: int, slots: np.ndarray, events: np.ndarray, force: np.ndarray,
        sigma: np.ndarray,
    ) -> None:  # fmt: skip
        """Take the next cycle; arrays as `shock_python` describes them."""
        shock(
            count, slots, events, force, sigma, self._smooth, self._memory, self.impact,
            self.vibration,
        )  # fmt: skip
