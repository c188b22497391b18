"""Electronics of a unit's board: what counts the periods of its timer, and what converts gel and
field; the Hall chip is `skin.sim.hall`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Counter", "Divider", "Gate", "HallConverter"]


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
        # a frequency with a whole number of periods must not lose one to rounding
        periods = np.floor(frequency_hz * self.gate_s * (1.0 + 1e-12))
        counted = periods >= 1.0
        steady = np.where(counted, frequency_hz, 1.0)
        ticks = np.floor(periods * self.clock_hz / steady + phase)
        return np.where(counted, periods * self.clock_hz / np.maximum(ticks, 1.0), 0.0)


class Gate:
    """Mean of a frequency over the last `gate_s` seconds, from samples between which it is
    linear."""

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


@dataclass(frozen=True)
class Divider:
    """The gel between the reference and a resistor to ground; the converter measures across the
    resistor.

    The gel's current of its law is what the reference drives through the gel alone. The converter
    has the same reference, so only the resistor matters. A step has the same size in temperature at
    both ends of a range if the resistor is the geometric mean of the gel's resistances there.

    Attributes
    ----------
    reference_v : float
    series_ohm : float
        The default is for a gel of 10 µA at 20 °C and 120 µA at 80 °C: a step of 12 bits is
        0.034 °C at both.
    bits : int

    Examples
    --------
    >>> Divider(bits=12).read(np.array([10.0, 120.0])).round(2)
    array([ 10.01, 119.92])
    """

    reference_v: float = 3.3
    series_ohm: float = 95_000.0
    bits: int = 12

    def read(self, current_ua: np.ndarray) -> np.ndarray:
        """The current that a board computes from the code for a gel of this current, µA.

        Below 0 is read as an open gel. Infinite at the converter's upper end, so that the board
        sends the rail of the wire and a short circuit is not read as a temperature.
        """
        alone_ua, steps = 1e6 * self.reference_v / self.series_ohm, 2.0**self.bits
        gel = np.maximum(current_ua, 0.0)
        code = np.clip(np.rint(steps * gel / (gel + alone_ua)), 0.0, steps - 1.0)
        at_end = code >= steps - 1.0
        return np.where(at_end, np.inf, alone_ua * code / np.where(at_end, 1.0, steps - code))


@dataclass(frozen=True)
class HallConverter:
    """The converter of a Hall chip: its step and its range.

    Attributes
    ----------
    lsb_ut : float
        One step, µT; the default is a common chip's.
    range_ut : float
        Largest measurable field of either sign, µT.
    """

    lsb_ut: float = 98.0
    range_ut: float = 130_000.0

    def read(self, field_ut: np.ndarray) -> np.ndarray:
        """The field in whole steps, shape as given.

        Infinite beyond the range, so that the board sends the rail of the wire and a lower bound is
        not taken for a reading.
        """
        steps = self.lsb_ut * np.rint(field_ut / self.lsb_ut)
        return np.where(np.abs(field_ut) > self.range_ut, np.copysign(np.inf, field_ut), steps)
