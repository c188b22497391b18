"""Impacts and vibration of contacts, with thresholds by the allowed false alarms.

The second difference of a hand's force is negligible at the rate of a bus; that of noise has a
known variance; the rest is a shock. For uneven samples it is the difference from a linear
extrapolation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.errors import SkinError

__all__ = ["ShockData", "Shocks", "follow_shocks", "shock_data"]

TIME_S = 0.1
"""Averaging time of vibration [assumed]."""


class ShockData(NamedTuple):
    """State of each record, float64."""

    seen: np.ndarray  # (s,) samples since the contact began
    force: np.ndarray  # (2, s, 3) N, of the last sample and the one before
    values: np.ndarray  # (3, s), see `IMPACT`
    elapsed_s: np.ndarray  # (1,) between the last two samples


IMPACT, VIBRATION, WEIGHT = 0, 1, 2
"""Rows of `ShockData.values`: the square of the second difference in variances, chi-square with
three degrees of freedom; its mean over time; the sum of the squares of the weights that samples
have in this mean."""


def shock_data(records: int, period_s: float) -> ShockData:
    """For so many records, and cycles of this period."""
    return ShockData(
        np.zeros(records), np.zeros((2, records, 3)), np.zeros((3, records)),
        np.full(1, period_s),
    )  # fmt: skip


@jitable
def follow_shocks(count, dt_s, slots, records, data):
    """Second differences of the force on each contact, and their smoothed square.

    Parameters
    ----------
    count : int
        Contacts.
    dt_s : float
        Time since the cycle before.
    slots : ndarray, shape (s,), int32
        Records of the contacts.
    records : ndarray, shape (s,), CONTACT
        A contact that is new, back, merged or split starts again.
    data : ShockData
    """
    gain, ratio = 1.0 - math.exp(-dt_s / TIME_S), dt_s / data.elapsed_s[0]
    data.elapsed_s[0] = dt_s
    variance = 1.0 + (1.0 + ratio) ** 2 + ratio**2
    impact, vibration, weight = data.values[IMPACT], data.values[VIBRATION], data.values[WEIGHT]
    for k in range(count):
        slot = slots[k]
        record, last, before = records[slot], data.force[0, slot], data.force[1, slot]
        if record["event"]:
            data.seen[slot] = 0.0
            vibration[slot] = 3.0
        square = 0.0
        for a in range(3):
            here, sigma = record["wrench"][a], record["wrench_sigma"][a]
            jump = here - last[a] - ratio * (last[a] - before[a])
            square += jump * jump / (variance * sigma * sigma)
            before[a] = last[a]
            last[a] = here
        data.seen[slot] += 1.0
        if data.seen[slot] > 2.0:
            if data.seen[slot] == 3.0:
                weight[slot] = gain / (2.0 - gain)
            impact[slot] = square
            vibration[slot] += gain * (square - vibration[slot])
            weight[slot] = (1.0 - gain) ** 2 * weight[slot] + gain**2
        else:
            impact[slot] = 0.0


class Shocks:
    """Impacts and vibration of contacts.

    Parameters
    ----------
    data : ShockData
        Kept, and read.
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        Onsets of alarms, of each kind, for one contact, under white Gaussian noise of the given
        variance.

    Attributes
    ----------
    values : ndarray, shape (3, records), float64
        Impact, vibration and the weight of the vibration; see `IMPACT`.
    impact, vibration : ndarray, shape (records,), float64
        Rows of these.
    impact_limit, vibration_limit : float
        Thresholds above noise; that of the vibration for samples at the nominal rate.
    """

    def __init__(
        self,
        data: ShockData,
        rate_hz: float,
        *,
        false_alarms_per_hour: float = 1.0,
    ) -> None:
        from scipy.special import chdtri

        self._chance = chance = false_alarms_per_hour / (3600.0 * rate_hz)
        if not 0.0 < chance < 0.1:
            raise SkinError(
                "false_alarms_per_hour, rate_hz: must leave each sample a chance between 0 and "
                f"0.1; got {chance:g}"
            )
        self.values = data.values
        self.impact, self.vibration = data.values[IMPACT], data.values[VIBRATION]
        self.impact_limit = float(chdtri(3.0, chance))
        # Second differences of white noise are correlated -2/3 and 1/6 with the next two, their
        # squares by the squares of that, which adds to the variance of the mean. For longer steps
        # it is less.
        keep = math.exp(-1.0 / (rate_hz * TIME_S))
        self._tied = 1.0 + 2.0 * (keep * 4.0 / 9.0 + keep**2 / 36.0)
        self.vibration_limit = self._limit((1.0 - keep) / (1.0 + keep))

    def vibrates(self, vibration: float, weight: float) -> bool:
        """Whether a vibration is above noise, for any spacing of samples."""
        return bool(vibration > self._limit(weight))

    def _limit(self, weight: float) -> float:
        """Threshold of a mean whose squared weights have this sum."""
        from scipy.special import gammainccinv

        if not weight:
            return math.inf
        variance = 6.0 * weight * self._tied
        return float(gammainccinv(9.0 / variance, self._chance) * (variance / 3.0))
