"""Impacts and vibration of contacts, sized by the false alarms that one is willing to bear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.errors import SkinError

__all__ = ["Shocks", "shock", "shock_python"]


class ShockData(NamedTuple):
    """What is kept of each record, float64."""

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


def shock_python(count, slots, events, force, sigma, smooth, data):
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
        Gain of the low-pass.
    data : ShockData
    """
    for k in range(count):
        slot = slots[k]
        last, before = data.last[slot], data.before[slot]
        if events[slot]:
            data.seen[slot] = 0.0
            data.vibration[slot] = 3.0
        square = 0.0
        for a in range(3):
            here = force[slot, a]
            jump = here - 2.0 * last[a] + before[a]
            square += jump * jump / (6.0 * sigma[slot, a] * sigma[slot, a])
            before[a] = last[a]
            last[a] = here
        data.seen[slot] += 1.0
        if data.seen[slot] > 2.0:
            data.impact[slot] = square
            data.vibration[slot] += smooth * (square - data.vibration[slot])
        else:
            data.impact[slot] = 0.0


shock = compiled(shock_python, fastmath={"contract"})


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
        from scipy.special import chdtri, gammainccinv

        chance = false_alarms_per_hour / (3600.0 * rate_hz)
        if not 0.0 < chance < 0.1:
            raise SkinError(
                "false_alarms_per_hour, rate_hz: must leave each sample a chance between 0 and "
                f"0.1; got {chance:g}"
            )
        self._data = ShockData(
            np.zeros(records), *np.zeros((2, records, 3)), *np.zeros((2, records))
        )
        self.impact, self.vibration = self._data.impact, self._data.vibration
        self.impact_limit = float(chdtri(3.0, chance))
        self._smooth = smooth = 1.0 - float(np.exp(-1.0 / (time_s * rate_hz)))
        # Variance of the average: second differences of white noise are correlated -2/3 and 1/6
        # with the next two, their squares by the squares of that.
        keep = 1.0 - smooth
        tied = 1.0 + 2.0 * (keep * 4.0 / 9.0 + keep**2 / 36.0)
        variance = 6.0 * smooth / (2.0 - smooth) * tied
        self.vibration_limit = float(gammainccinv(9.0 / variance, chance) * (variance / 3.0))

    def update(
        self, count: int, slots: np.ndarray, events: np.ndarray, force: np.ndarray,
        sigma: np.ndarray,
    ) -> None:  # fmt: skip
        """Take the next cycle; arrays as `shock_python` describes them."""
        shock(count, slots, events, force, sigma, self._smooth, self._data)
