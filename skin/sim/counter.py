"""Counting the periods of the timer: what a board reads of a frequency within a gate."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from skin.errors import SkinError

__all__ = ["Counter", "Gate"]


@dataclass(frozen=True)
class Counter:
    """Reciprocal counting: whole periods within a gate, timed by the ticks of a clock.

    With N periods in M ticks the reading is N clock / M. The clock does not run in step with the
    timer, so that M is the true time rounded up or down by chance: right on average, and off by at
    most one tick, that is by about ``frequency / (gate_s * clock_hz)``, of which 1/sqrt(6) is the
    standard deviation over all frequencies.

    Attributes
    ----------
    gate_s : float
        How long periods are counted. A reading is the mean over the gate, so it is half a gate old.
    clock_hz : float

    Examples
    --------
    >>> float(Counter().read(np.array([4500.0]), 0.5)[0])
    4500.0
    """

    gate_s: float = 0.01
    clock_hz: float = 1e6

    def __post_init__(self) -> None:
        for name in ("gate_s", "clock_hz"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise SkinError(f"{name}: must be above 0; got {getattr(self, name)}")

    def read(self, frequency_hz: np.ndarray, phase: np.ndarray | float) -> np.ndarray:
        """What is counted of a frequency that is steady over the gate.

        Parameters
        ----------
        frequency_hz : ndarray, shape (..., n)
        phase : ndarray, shape (..., n), or float
            When the first edge comes within its tick, 0 to 1; 0.5 rounds to the nearest tick.

        Returns
        -------
        ndarray, shape (..., n)
            Hz; 0 where no whole period fits into the gate, as of a timer that stands still.
        """
        # A frequency that fits a whole number of times must not lose a period to its last bit.
        periods = np.floor(frequency_hz * self.gate_s * (1.0 + 1e-12))
        counted = periods >= 1.0
        steady = np.where(counted, frequency_hz, 1.0)
        ticks = np.floor(periods * self.clock_hz / steady + phase)
        return np.where(counted, periods * self.clock_hz / np.maximum(ticks, 1.0), 0.0)


class Gate:
    """Mean of a frequency over the last `gate_s` seconds, from samples between which it is linear.

    Parameters
    ----------
    gate_s : float
    """

    def __init__(self, gate_s: float) -> None:
        self._gate_s = gate_s
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        """Time, frequency, and periods since the start, of samples from before the gate on."""

    def __call__(self, time_s: float, frequency_hz: np.ndarray) -> np.ndarray:
        """Take a sample, and give the mean over the gate that ends with it.

        Before the first sample the frequency was what it was then; a time that is not after the
        last sample starts anew.

        Parameters
        ----------
        time_s : float
        frequency_hz : ndarray, shape (n,)

        Returns
        -------
        ndarray, shape (n,)
        """
        past, opened_s = self._past, time_s - self._gate_s
        if past and time_s <= past[-1][0]:
            past.clear()
        frequency_hz = frequency_hz.copy()
        if past:
            last_s, last_hz, periods = past[-1]
            periods = periods + 0.5 * (last_hz + frequency_hz) * (time_s - last_s)
        else:
            periods = np.zeros_like(frequency_hz)
        past.append((time_s, frequency_hz, periods))
        while len(past) > 2 and past[1][0] <= opened_s:
            past.popleft()
        return (periods - self._periods_at(opened_s)) / self._gate_s

    def _periods_at(self, time_s: float) -> np.ndarray:
        """Periods up to a time that is before the first remembered sample, or between two."""
        first_s, first_hz, first = self._past[0]
        if time_s <= first_s:
            return first + first_hz * (time_s - first_s)
        samples = iter(self._past)
        before = after = next(samples)
        while after[0] < time_s:
            before, after = after, next(samples)
        since_s, span_s = time_s - before[0], after[0] - before[0]
        slope = (after[1] - before[1]) / span_s
        return before[2] + before[1] * since_s + 0.5 * slope * since_s**2
