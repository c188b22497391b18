"""Counter of the timer's periods: the frequency within a gate, as a board measures it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Counter", "Gate"]


@dataclass(frozen=True)
class Counter:
    """Reciprocal counting: whole periods within a gate, timed by the ticks of a clock.

    With N periods in M ticks the reading is N clock / M. The clock is not synchronous with the
    timer, so M is the true time rounded up or down at random: unbiased, with an error of at most
    one tick, that is about ``frequency / (gate_s * clock_hz)``, of which 1/sqrt(6) is the standard
    deviation over all frequencies.

    Attributes
    ----------
    gate_s : float
        Counting time. A reading is the mean over the gate, so it is half a gate old.
    clock_hz : float

    Examples
    --------
    >>> float(Counter().read(np.array([4500.0]), 0.5)[0])
    4500.0
    """

    gate_s: float = 0.01
    clock_hz: float = 1e6

    def read(self, frequency_hz: np.ndarray, phase: np.ndarray | float) -> np.ndarray:
        """Reading of a frequency that is constant over the gate.

        Parameters
        ----------
        frequency_hz : ndarray, shape (..., n)
        phase : ndarray, shape (..., n), or float
            Position of the first edge within its tick, 0 to 1; 0.5 rounds to the nearest tick.

        Returns
        -------
        ndarray, shape (..., n)
            Hz; 0 where no whole period fits into the gate, such as for a stopped timer.
        """
        # A frequency with a whole number of periods must not lose one to rounding.
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
        # samples from the last one before the gate on
        self._time_s, self._frequency_hz = np.empty(0), np.empty((0, 0))

    def __call__(self, time_s: float | np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
        """Add samples; returns the mean over the gate that ends with each.

        Before the first sample the frequency is constant; a time that is not after the last sample
        restarts the gate.

        Parameters
        ----------
        time_s : float, or ndarray, shape (t,)
            Ascending.
        frequency_hz : ndarray, shape (n,), or (t, n)

        Returns
        -------
        ndarray, shape of `frequency_hz`
        """
        at_s = np.atleast_1d(time_s)
        hz = frequency_hz.reshape(at_s.size, -1)
        past_s, past_hz = self._time_s, self._frequency_hz
        if not past_s.size or at_s[0] <= past_s[-1]:
            past_s, past_hz = at_s[:1] - self._gate_s, hz[:1]
        times, hz = np.concatenate([past_s, at_s]), np.concatenate([past_hz, hz])
        step_s = np.diff(times)[:, np.newaxis]
        change = np.diff(hz, axis=0)
        periods = np.zeros_like(hz)
        np.cumsum(step_s * (hz[:-1] + 0.5 * change), axis=0, out=periods[1:])
        opened_s = at_s - self._gate_s
        last = np.maximum(np.searchsorted(times, opened_s, side="right") - 1, 0)
        since_s = (opened_s - times[last])[:, np.newaxis]
        opened = periods[last] + since_s * (hz[last] + 0.5 * since_s * (change / step_s)[last])
        self._time_s, self._frequency_hz = times[last[-1] :], hz[last[-1] :]
        return ((periods[past_s.size :] - opened) / self._gate_s).reshape(frequency_hz.shape)
