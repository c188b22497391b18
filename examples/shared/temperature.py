"""Temperature inside a held vessel, by the gels that touch it: a Kalman filter of four states.

A gel follows the outer face of the wall with a lag, and that follows the contents. The rate of the
contents is constant until the mean of the innovations is far off: then it is learned again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.linalg import expm

__all__ = ["Kalman", "Temperature"]

INSIDE, RATE, WALL, GEL = range(4)
GEL_LAG_S, WALL_LAG_S, LAG_SIGMA_S = 4.0, 1.0, 0.4
"""Lags of gel and wall, and one-sigma of their sum [1-D heat model and 1 mm of glass, assumed]."""
NOISE_C, UNIT_SIGMA_C = 0.05, 0.24
"""One-sigma of a unit's noise, and of its constants [assumed: a current of 1 %]."""
JUMP_C_PER_S, DRIFT_C_PER_S15 = 2.0, 0.04
"""One-sigma of a jump of the rate, and of its other changes after a second [assumed]."""
TOUCHED, LET_GO = 5.0, 2.0
"""Sigmas of the normal force at which a unit becomes touched, and at which it ceases to be."""
SMOOTH_S, AHEAD_S = 0.2, 2.0
"""Time constant of the temperatures from which a step of their mean is computed; time before a
limit, at this rate, at which it is reported."""
INNOVATION_S, CHANGED, AGES_S = 0.12, 4.0, (0.2, 0.4, 0.6, 0.8)
"""Time constant of the mean of innovations; its sigmas at which a rate has changed, and how long
ago that may have been [assumed]."""
TURN_SIGMAS, JUMPED_S = 4.0, 2.0
"""Rate over its sigma at which a phase begins; half of it so long after a change of the rate."""


class Kalman:
    """States `x` of ``dx/dt = flows @ x`` with white noise on one of them, one of them measured.

    `changed` says that the mean of the innovations is not zero; `jump` then adds the variance of a
    change of one state within the last second, and of what followed from it.
    """

    def __init__(self, flows: np.ndarray, noisy: int, intensity: float, period_s: float) -> None:
        size = len(flows)
        # Van Loan, "Computing integrals involving the matrix exponential", 1978
        block = np.block([[-flows, np.zeros((size, size))], [np.zeros((size, size)), flows.T]])
        block[noisy, size + noisy] = intensity
        both = expm(block * period_s)
        self.step = both[size:, size:].T
        self.noise = self.step @ both[:size, size:]
        self.later = [expm(flows * age_s) for age_s in AGES_S]
        self.gain, self.mean = period_s / INNOVATION_S, 0.0
        self.x, self.cov = np.zeros(size), np.zeros((size, size))

    def update(self, row: int, value: float, variance: float) -> None:
        """Predict a period, and correct by a measurement of a state; none where it is NaN."""
        self.x = self.step @ self.x
        self.cov = self.step @ self.cov @ self.step.T + self.noise
        if math.isnan(value):
            return
        total = self.cov[row, row] + variance
        gain, off = self.cov[row] / total, value - self.x[row]
        self.x = self.x + gain * off
        self.cov = self.cov - np.outer(gain, self.cov[row])
        self.mean += self.gain * (off / math.sqrt(total) - self.mean)

    @property
    def changed(self) -> bool:
        """Whether the model no longer holds."""
        return abs(self.mean) > CHANGED * math.sqrt(self.gain / (2.0 - self.gain))

    def jump(self, row: int, sigma: float) -> None:
        """See the class."""
        led_to = np.mean([np.outer(one[:, row], one[:, row]) for one in self.later], axis=0)
        self.cov, self.mean = self.cov + sigma * sigma * led_to, 0.0

    def sigma(self, row: int) -> float:
        """One-sigma of a state."""
        return math.sqrt(max(self.cov[row, row], 0.0))


class Temperature:
    """Follows what two pads hold; `inside_c`, `sigma_c`, `rate_c_per_s`, `rate_sigma`, `gel_c`.

    `phase` is "unknown", "steady", "heating" or "cooling", and `began_s` when the rate
    was last within its sigma of zero; `changes` counts jumps of the rate.
    """

    def __init__(self, topology: Any) -> None:
        self._period_s = 1.0 / topology.cycle_rate_hz
        flows = np.zeros((4, 4))
        flows[INSIDE, RATE] = 1.0
        flows[WALL, [WALL, INSIDE]] = -1.0 / WALL_LAG_S, 1.0 / WALL_LAG_S
        flows[GEL, [GEL, WALL]] = -1.0 / GEL_LAG_S, 1.0 / GEL_LAG_S
        self._filter = Kalman(flows, RATE, DRIFT_C_PER_S15**2, self._period_s)
        self._touched = np.zeros(topology.n, bool)
        self._members = self._touched
        self._smooth = np.full(topology.n, np.nan)
        self.inside_c = self.sigma_c = self.rate_c_per_s = self.rate_sigma = self.gel_c = math.nan
        self.phase, self.began_s, self.changes = "unknown", math.nan, 0
        self._crossed_s, self._jumped_s, self._was_rising = 0.0, -math.inf, False

    def update(self, state: Any, time_s: float) -> None:
        """Process a cycle."""
        units, own = state.units, self._filter
        least = np.where(self._touched, LET_GO, TOUCHED) * np.maximum(units.force_sigma[2], 0.005)
        self._touched = np.where(units.valid, units.force[2] > least, self._touched)
        heard = units.valid & np.isfinite(units.temperature)
        known = np.where(np.isnan(self._smooth), units.temperature, self._smooth)
        gain = self._period_s / SMOOTH_S
        self._smooth = np.where(heard, known + gain * (units.temperature - known), self._smooth)
        members = self._touched & heard
        self.gel_c = float(units.temperature[members].mean()) if members.any() else math.nan
        if not own.cov.any():
            if members.any():
                own.x = np.array([self.gel_c, 0.0, self.gel_c, self.gel_c])
                own.cov = np.diag([900.0, 1.0, 904.0, NOISE_C**2])
                own.cov[INSIDE, WALL] = own.cov[WALL, INSIDE] = 900.0
                self._members = members
            return
        variance = NOISE_C**2 / max(members.sum(), 1)
        if members.any() and not self._members.any():  # gels were free: their mean is a new one
            own.cov[GEL, :] = own.cov[:, GEL] = 0.0
            own.x[GEL], own.cov[GEL, GEL] = self.gel_c, variance
        elif members.any() and (members != self._members).any():  # another set, another mean
            step_c = self._smooth[members].mean() - self._smooth[self._members].mean()
            step_c *= math.exp(-SMOOTH_S / GEL_LAG_S)  # differences decay with the lag
            own.x[GEL] += step_c
            own.cov[GEL, GEL] += variance + (0.02 * step_c) ** 2
        self._members = members
        own.update(GEL, self.gel_c, variance)
        if own.changed:
            own.jump(RATE, JUMP_C_PER_S)
            self.changes, self._jumped_s = self.changes + 1, time_s
        self.inside_c, self.rate_c_per_s = own.x[:2].tolist()
        self.rate_sigma = own.sigma(RATE)
        self.sigma_c = math.hypot(
            own.sigma(INSIDE), UNIT_SIGMA_C / math.sqrt(max(members.sum(), 1)),
            LAG_SIGMA_S * self.rate_c_per_s,
        )  # fmt: skip
        self._turn(time_s)

    def _turn(self, time_s: float) -> None:
        """Heating, cooling or steady, where the rate exceeds its noise."""
        if self._filter.sigma(INSIDE) > 3.0:
            return
        rate, rises = self.rate_c_per_s, self.rate_c_per_s > 0.0
        sigmas = abs(rate) / self.rate_sigma
        if rises != self._was_rising or sigmas < 1.0:
            self._was_rising, self._crossed_s = rises, time_s
        jumped = time_s - self._jumped_s < JUMPED_S
        if sigmas > TURN_SIGMAS * (0.5 if jumped else 1.0):
            now, began_s = "heating" if rises else "cooling", self._crossed_s
        elif sigmas < 0.5 * TURN_SIGMAS and not jumped:
            now, began_s = "steady", time_s
        else:
            return
        if now != self.phase:
            self.phase, self.began_s = now, began_s

    def is_near(self, limit_c: float) -> bool:
        """Whether a limit is reached, or will be within `AHEAD_S` at this rate; what is not known
        to 1 °C counts as one sigma more."""
        rising = max(self.rate_c_per_s - 2.0 * self.rate_sigma, 0.0)
        unsure = self.sigma_c if self.sigma_c > 1.0 else 0.0
        return self.inside_c + AHEAD_S * rising + unsure >= limit_c
