"""Kalman filter of a few states, one of which is measured: scalars in and out, compiled."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from bus.compiled.jit import compiled

__all__ = ["Kalman", "Noise"]

NOISE_S = 2.0
"""Time constant of the noise that is learned [assumed]."""

INNOVATION_S = 0.12
"""Time constant of the mean of innovations that detects a change [assumed: an eighth of the second
in which changes are to be detected]."""

OPEN_SIGMAS = 4.0
"""Threshold of that mean, above which a constant has changed [derived: once in half an hour, by
Gaussian noise; it costs a second of precision then]."""

OPEN_S = (0.2, 0.4, 0.6, 0.8)
"""Age of a jump when it is detected, at most [assumed: the second in which changes are to be
detected]."""

MOST_STEPS = 100_000
"""Maximum number of steps predicted at once; a longer silence adds nothing [numeric]."""


class Noise:
    """Variance of white noise on a slowly changing value, from differences of neighbours.

    Parameters
    ----------
    variance : float
        Initial value.
    period_s : float

    Attributes
    ----------
    variance : float
    """

    def __init__(self, variance: float, period_s: float) -> None:
        self.variance = variance
        self._gain = min(1.0, period_s / NOISE_S)
        self._last = float("nan")

    def update(self, value: float, kept: bool = True) -> None:
        """Add the next value; NaN for none; not `kept` where it may have jumped."""
        off = value - self._last
        self._last = value if math.isfinite(value) else math.nan
        if kept and math.isfinite(off):
            self.variance += self._gain * (0.5 * off * off - self.variance)


class Kalman:
    """Filters m states of ``dx/dt = flows @ x + noise``, and detects jumps.

    The mean of the innovations over an eighth of a second, in sigmas, is 0 while the model holds.
    Where it is far off, a constant has changed: `changed` is True, and the owner inflates the
    covariance of that state.

    Parameters
    ----------
    flows : ndarray, shape (m, m)
        1/s.
    intensity : ndarray, shape (m, m)
        Of the white noise, square of the states' units per second.
    period_s : float
    innovation_s : tuple of float
        Time constants of the means of innovations that detect a change: a long one detects a
        smaller change, later.

    Attributes
    ----------
    x : ndarray, shape (m,)
    covariance : ndarray, shape (m, m)

    Examples
    --------
    >>> level = Kalman(np.zeros((1, 1)), np.zeros((1, 1)), 0.01)
    >>> level.begin(np.zeros(1), np.array([[100.0]]))
    >>> level.update(0, 5.0, 1.0)
    >>> level.x.round(2), level.covariance.round(2)
    (array([4.95]), array([[0.99]]))
    """

    def __init__(
        self, flows: np.ndarray, intensity: np.ndarray, period_s: float,
        innovation_s: tuple[float, ...] = (INNOVATION_S,),
    ) -> None:  # fmt: skip
        count = len(flows)
        # Van Loan, "Computing integrals involving the matrix exponential", 1978
        block = np.zeros((2 * count, 2 * count))
        block[:count, :count], block[:count, count:] = -flows, intensity
        block[count:, count:] = flows.T
        both = expm(block * period_s)
        self._step = np.ascontiguousarray(both[count:, count:].T)
        noise = self._step @ both[:count, count:]
        self._noise = np.ascontiguousarray(0.5 * (noise + noise.T))
        self._scratch = np.zeros((count, count))
        later = np.stack([expm(flows * since_s) for since_s in OPEN_S])
        self._inflation = np.einsum("tak,tbk->kab", later, later) / len(OPEN_S)
        self._gains = [min(1.0, period_s / one_s) for one_s in innovation_s]
        self._scales = [((2.0 - gain) / gain) ** 0.5 for gain in self._gains]
        self._calm = [0.0] * len(innovation_s)
        self._means = list(self._calm)
        self.x = np.zeros(count)
        self.covariance = np.zeros((count, count))

    def begin(self, x: np.ndarray, covariance: np.ndarray) -> None:
        """Initialise state and covariance."""
        self.x[:], self.covariance[:] = x, covariance
        self._means[:] = self._calm

    @property
    def disagreement(self) -> float:
        """The largest mean of the innovations, in its own sigmas."""
        scaled = [scale * mean for scale, mean in zip(self._scales, self._means, strict=True)]
        return max(scaled, key=abs)

    @property
    def lag(self) -> float:
        """Excess of a mean of innovations over its noise, in sigmas of one innovation: the lag of
        the filter behind the measurement, before a change is detected."""
        beyond = max(m * m - k**-2 for m, k in zip(self._means, self._scales, strict=True))
        return math.sqrt(max(beyond, 0.0))

    @property
    def changed(self) -> bool:
        """Whether the model no longer holds."""
        return abs(self.disagreement) > OPEN_SIGMAS

    def inflate(self, row: int, sigma: float) -> None:
        """Add the variance of a jump of one state within the last second, and of its
        consequences."""
        self.covariance += sigma * sigma * self._inflation[row]
        self._means[:] = self._calm

    def jump(self, row: int, sigma: float, steps: int) -> None:
        """Add the variance of a jump of one state this many periods ago."""
        led_to = sigma * np.linalg.matrix_power(self._step, steps)[:, row]
        self.covariance += np.outer(led_to, led_to)

    def restart(self, row: int, value: float, variance: float) -> None:
        """Set one state to its measurement, without correlations."""
        self.covariance[row, :] = self.covariance[:, row] = 0.0
        self.x[row], self.covariance[row, row] = value, variance
        self._means[:] = self._calm

    def equate(self, row: int, other: int, more: float) -> None:
        """Set one state to another plus an offset."""
        self.x[row] = self.x[other] + more
        self.covariance[row, :] = self.covariance[other, :]
        self.covariance[:, row] = self.covariance[row, :]
        self.covariance[row, row] = self.covariance[other, other]

    def scale(self, row: int, by: float) -> None:
        """Change the unit of one state."""
        self.x[row] *= by
        self.covariance[row, :] *= by
        self.covariance[:, row] *= by

    def shift(self, row: int, by: float, variance: float) -> None:
        """Shift the zero of one state."""
        self.x[row] += by
        self.covariance[row, row] += variance

    def update(self, row: int, measured: float, variance: float, steps: int = 1) -> None:
        """Predict some periods, and update by a measurement of one state; none where it is not
        finite."""
        off = _follow(  # plain numbers: each enumeration would compile separately
            self._step, self._noise, self._scratch, self.x, self.covariance,
            (int(min(steps, MOST_STEPS)), int(row)), (float(measured), float(variance)),
        )  # fmt: skip
        for k, gain in enumerate(self._gains):
            self._means[k] += gain * (off - self._means[k])

    def settled_sigma(self, row: int, measured: int, variance: float) -> float:
        """Steady-state one-sigma of a state, where another is measured with this variance."""
        picked = np.zeros((len(self.x), 1))
        picked[measured] = 1.0
        settled = solve_discrete_are(self._step.T, picked, self._noise, np.eye(1) * variance)
        column = settled @ picked
        left = settled - column @ column.T / (settled[measured, measured] + variance)
        return float(left[row, row]) ** 0.5

    def sigma(self, row: int) -> float:
        """One-sigma of a state."""
        return math.sqrt(max(float(self.covariance[row, row]), 0.0))


def follow_python(step, noise, scratch, x, covariance, what, measured):
    """Predict `what[0]` periods, and update by a measurement of state `what[1]`.

    Parameters
    ----------
    step, noise, scratch, covariance : ndarray, shape (m, m)
    x : ndarray, shape (m,)
        Updated in place, as `covariance` is.
    what : (int, int)
    measured : (float, float)
        Value and variance; no measurement where one of them is not finite.

    Returns
    -------
    float
        Innovation over its sigma; 0 where nothing is measured.
    """
    count = x.size
    row = what[1]
    for _ in range(what[0]):
        for a in range(count):
            scratch[0, a] = 0.0
            for b in range(count):
                scratch[0, a] += step[a, b] * x[b]
        for a in range(count):
            x[a] = scratch[0, a]
        for a in range(count):
            for b in range(count):
                scratch[a, b] = 0.0
                for c in range(count):
                    scratch[a, b] += step[a, c] * covariance[c, b]
        for a in range(count):
            for b in range(a, count):
                now = noise[a, b]
                for c in range(count):
                    now += scratch[a, c] * step[b, c]
                covariance[a, b] = covariance[b, a] = now
    value, variance = measured
    if not np.isfinite(value + variance):
        return 0.0
    total = covariance[row, row] + variance
    off = value - x[row]
    for a in range(count):
        scratch[0, a] = covariance[a, row]
    for a in range(count):
        gain = scratch[0, a] / total
        x[a] += gain * off
        for b in range(count):
            covariance[a, b] -= gain * scratch[0, b]
    return off / np.sqrt(total)


_follow = compiled(follow_python, fastmath=("contract",))
