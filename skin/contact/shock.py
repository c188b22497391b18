"""Impacts and vibration of contacts, with thresholds by the allowed false alarms."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.jit import compiled
from skin.errors import SkinError

__all__ = ["Shocks", "shock", "shock_python"]


class ShockData(NamedTuple):
    """State of each record, float64."""

    seen: np.ndarray
    """shape (s,), samples since the contact began"""
    last: np.ndarray
    """shape (s, 3), newton: force a sample ago"""
    before: np.ndarray
    """shape (s, 3), and two samples ago"""
    impact: np.ndarray
    """shape (s,), square of the second difference in variances: chi-square with three degrees of
    freedom"""
    vibration: np.ndarray
    """shape (s,), its mean over time"""
    weight: np.ndarray
    """shape (s,), sum of the squares of the weights that samples have in this mean"""


def shock_python(timing, slots, events, force, sigma, data):
    """Second differences of the force on each contact, and their smoothed square.

    The second difference of a hand's force is negligible at the rate of a bus; that of noise has a
    known variance; the rest is a shock. For uneven samples it is the difference from a linear
    extrapolation.

    Parameters
    ----------
    timing : ndarray, shape (3,), float64
        Number of contacts; gain of the low-pass, for the time since the sample before; this time
        over the one before it.
    slots : ndarray, shape (s,), int32
        Records of the contacts.
    events : ndarray, shape (s,), int32
        `Event` of each record: one that is new, back, merged or split starts again.
    force, sigma : ndarray, shape (s, 3)
        Newton, force on each record's contact and its one-sigma.
    data : ShockData
    """
    count, gain, ratio = int(timing[0]), timing[1], timing[2]
    variance = 1.0 + (1.0 + ratio) ** 2 + ratio**2
    for k in range(count):
        slot = slots[k]
        last, before = data.last[slot], data.before[slot]
        if events[slot]:
            data.seen[slot] = 0.0
            data.vibration[slot] = 3.0
        square = 0.0
        for a in range(3):
            here = force[slot, a]
            jump = here - last[a] - ratio * (last[a] - before[a])
            square += jump * jump / (variance * sigma[slot, a] * sigma[slot, a])
            before[a] = last[a]
            last[a] = here
        data.seen[slot] += 1.0
        if data.seen[slot] > 2.0:
            if data.seen[slot] == 3.0:
                data.weight[slot] = gain / (2.0 - gain)
            data.impact[slot] = square
            data.vibration[slot] += gain * (square - data.vibration[slot])
            data.weight[slot] = (1.0 - gain) ** 2 * data.weight[slot] + gain**2
        else:
            data.impact[slot] = 0.0


shock = compiled(shock_python, fastmath={"contract"})


class Shocks:
    """Impacts and vibration of contacts.

    Parameters
    ----------
    records : int
        Number of records.
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        Onsets of alarms, of each kind, for one contact, under white Gaussian noise of the given
        variance.
    time_s : float
        Averaging time of vibration.

    Attributes
    ----------
    impact, vibration : ndarray, shape (records,), float64
        Square of the shock in variances: one cycle's, and averaged.
    impact_limit, vibration_limit : float
        Thresholds above noise; that of the vibration for samples at the nominal rate.
    """

    def __init__(
        self,
        records: int,
        rate_hz: float,
        *,
        false_alarms_per_hour: float = 1.0,
        time_s: float = 0.1,
    ) -> None:
        from scipy.special import chdtri

        self._chance = chance = false_alarms_per_hour / (3600.0 * rate_hz)
        if not 0.0 < chance < 0.1:
            raise SkinError(
                "false_alarms_per_hour, rate_hz: must leave each sample a chance between 0 and "
                f"0.1; got {chance:g}"
            )
        self._data = ShockData(
            np.zeros(records), *np.zeros((2, records, 3)), *np.zeros((3, records))
        )
        self.impact, self.vibration = self._data.impact, self._data.vibration
        self._timing = np.zeros(3)
        self.impact_limit = float(chdtri(3.0, chance))
        self._time_s, self._elapsed_s = time_s, 1.0 / rate_hz
        self._stamp_ns: int | None = None
        # Second differences of white noise are correlated -2/3 and 1/6 with the next two, their
        # squares by the squares of that, which adds to the variance of the mean. For longer steps
        # it is less.
        keep = math.exp(-self._elapsed_s / time_s)
        self._tied = 1.0 + 2.0 * (keep * 4.0 / 9.0 + keep**2 / 36.0)
        self.vibration_limit = self._limit((1.0 - keep) / (1.0 + keep))

    def update(
        self, count: int, slots: np.ndarray, events: np.ndarray, force: np.ndarray,
        sigma: np.ndarray, stamp_ns: int | None = None,
    ) -> None:  # fmt: skip
        """Process the next cycle, one period later if no stamp is given; arrays as in
        `shock_python`."""
        self._take(
            functools.partial(shock, *self._inputs(slots, events, force, sigma)), count, stamp_ns
        )

    def bind(
        self, slots: np.ndarray, events: np.ndarray, force: np.ndarray, sigma: np.ndarray
    ) -> Callable[[int, int | None], None]:
        """`update` on fixed arrays: takes the number of contacts and the stamp."""
        call = Bound(shock, *self._inputs(slots, events, force, sigma))
        return functools.partial(self._take, call)

    def _inputs(self, *arrays: np.ndarray) -> tuple:
        return self._timing, *arrays, self._data

    def _take(self, call: Callable[[], None], count: int, stamp_ns: int | None) -> None:
        before_s = self._elapsed_s
        if stamp_ns is not None:
            if self._stamp_ns is not None:
                self._elapsed_s = 1e-9 * (stamp_ns - self._stamp_ns)
            self._stamp_ns = stamp_ns
        gain = 1.0 - math.exp(-self._elapsed_s / self._time_s)
        self._timing[:] = count, gain, self._elapsed_s / before_s
        call()

    @property
    def values(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Impact, vibration and the weight of the vibration, of all records."""
        return self.impact, self.vibration, self._data.weight

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
