"""Impacts and vibration of contacts, with thresholds by the allowed false alarms.

The second difference of a hand's force is negligible at the rate of a bus; that of noise has a
known variance; the rest is a shock. For uneven samples it is the difference from a linear
extrapolation.
"""

from __future__ import annotations

import math

from bus.compiled.jit import jitable
from skin.errors import SkinError

__all__ = ["Shocks", "follow_shocks"]

TIME_S = 0.1
"""Averaging time of vibration [assumed]."""


@jitable
def follow_shocks(count, data):
    """Second differences of the force on each contact, and their smoothed square: chi-square with
    three degrees of freedom under noise.

    Parameters
    ----------
    count : int
        Contacts. One that is new, back, merged or split starts again.
    data : ContactData
        Of `slots`, the fields of shocks are written.
    """
    dt_s = data.cycle[0]["elapsed_s"]
    gain, ratio = 1.0 - math.exp(-dt_s / TIME_S), dt_s / data.cycle[0]["elapsed_before_s"]
    variance = 1.0 + (1.0 + ratio) ** 2 + ratio**2
    for k in range(count):
        slot = data.slots[k]["present"]
        record, kept = data.contacts[slot], data.slots[slot]
        if record["event"]:
            kept["samples"], kept["vibration"] = 0.0, 3.0
        square = 0.0
        for a in range(3):
            here, sigma, last = record["wrench"][a], record["wrench_sigma"][a], kept["last"][a]
            jump = here - last - ratio * (last - kept["last_but_one"][a])
            square += jump * jump / (variance * sigma * sigma)
            kept["last_but_one"][a] = last
            kept["last"][a] = here
        kept["samples"] += 1.0
        kept["impact"] = 0.0
        if kept["samples"] > 2.0:
            if kept["samples"] == 3.0:
                kept["weight"] = gain / (2.0 - gain)
            kept["impact"] = square
            kept["vibration"] += gain * (square - kept["vibration"])
            kept["weight"] = (1.0 - gain) ** 2 * kept["weight"] + gain**2


class Shocks:
    """Thresholds of impacts and vibration.

    Parameters
    ----------
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        Onsets of alarms, of each kind, for one contact, under white Gaussian noise of the given
        variance.

    Attributes
    ----------
    impact_limit, vibration_limit : float
        Thresholds above noise; that of the vibration for samples at the nominal rate.
    """

    def __init__(self, rate_hz: float, *, false_alarms_per_hour: float = 1.0) -> None:
        from scipy.special import chdtri

        self._chance = chance = false_alarms_per_hour / (3600.0 * rate_hz)
        if not 0.0 < chance < 0.1:
            raise SkinError(
                "false_alarms_per_hour, rate_hz: must leave each sample a chance between 0 and "
                f"0.1; got {chance:g}"
            )
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
