"""Electronics of a unit's board: what counts the periods of its timer, and what converts gel and
field; the Hall chip is `skin.sim.hall`."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

__all__ = ["Counter", "Divider", "Gate", "HallConverter"]


class Counter(Struct, frozen=True, forbid_unknown_fields=True):
    """Reciprocal counting: whole periods within a gate, timed by the ticks of a clock.

    With N periods in M ticks the reading is N clock / M. The clock is not synchronous with the
    timer, so M is the true time rounded up or down at random: unbiased, with an error of at most
    one tick, that is about ``frequency / (gate_s * clock_hz)``, of which 1/sqrt(6) is the standard
    deviation over all frequencies.
    A reading is the mean over the gate, so it is half a gate old.

    Examples
    --------
    >>> float(Counter().read(np.array([4500.0]), 0.5)[0])
    4500.0
    """

    gate_s: Annotated[float, Meta(ge=1e-6, le=1, description="How long periods are counted")] = 0.01
    clock_hz: Annotated[float, Meta(ge=1e3, le=1e10, description="That times the periods")] = 1e6

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


class Divider(Struct, frozen=True, forbid_unknown_fields=True):
    """The gel between the reference and a resistor to ground; the converter measures across the
    resistor.

    The gel's current of its law is what the reference drives through the gel alone. The converter
    has the same reference, so only the resistor matters. A step has the same size in temperature at
    both ends of a range if the resistor is the geometric mean of the gel's resistances there. The
    default is for a gel of 10 µA at 20 °C and 120 µA at 80 °C: 12 bits are 0.034 °C at both.

    Examples
    --------
    >>> Divider(bits=12).read(np.array([10.0, 120.0])).round(2)
    array([ 10.01, 119.92])
    """

    reference_v: Annotated[float, Meta(ge=1e-3, le=100, description="Of divider and ADC")] = 3.3
    series_ohm: Annotated[float, Meta(ge=1, le=1e9, description="In series with the gel")] = 95e3
    bits: Annotated[int, Meta(ge=1, le=32, description="Of the ADC")] = 12

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


class HallConverter(Struct, frozen=True, forbid_unknown_fields=True):
    """The converter of a Hall chip: its step and its range, by default those of a common one."""

    lsb_ut: Annotated[float, Meta(ge=1e-3, le=1e5, description="Step, µT")] = 98.0
    range_ut: Annotated[
        float, Meta(ge=1, le=1e7, description="Largest field of either sign, µT")
    ] = 130e3

    def read(self, field_ut: np.ndarray) -> np.ndarray:
        """The field in whole steps, shape as given.

        Infinite beyond the range, so that the board sends the rail of the wire and a lower bound is
        not taken for a reading.
        """
        steps = self.lsb_ut * np.rint(field_ut / self.lsb_ut)
        return np.where(np.abs(field_ut) > self.range_ut, np.copysign(np.inf, field_ut), steps)
