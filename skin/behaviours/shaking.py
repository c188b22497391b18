"""Shaking: frequency and amplitude of a held object's oscillation.

Vertical acceleration changes the weight. A sine is fitted to the weight of the last seconds, with
mean and trend, every quarter of a second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from skin.behaviours.decision import Decisions
from skin.behaviours.numbers import check_pair, unit_vector
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.sine_fit import FIT_SIZE, fit_sine
from skin.errors import check_kind, check_number, check_numbers
from skin.state import State
from topology import Topology

__all__ = ["Shaking", "ShakingSettings"]

SAMPLES_PER_PERIOD = 8
"""Averaging window as a fraction of the period of the highest frequency: it attenuates by 3 %,
which is corrected [derived]."""

FITS_PER_S = 4.0


@dataclass(frozen=True)
class ShakingSettings:
    """Search range and thresholds.

    Attributes
    ----------
    window_s : float
        Length of the fitted window [derived: 5 s of 1 Hz, a tenth of a newton over noise of half
        that, leave 0.003 Hz].
    band_hz : (float, float)
        Lowest and highest frequency, exclusive [derived: three periods in the window, and the range
        of hands].
    sigmas : float
        Amplitude over its sigma above which there is an oscillation; below half of it, there is
        none [derived: the largest of a hundred of noise stays below 4].
    least_share : float
        Fraction of the variance, without the trend, that the sine must explain [assumed: the
        largest of noise alone explains a tenth].
    direction : tuple of 3 float
        Of the oscillation, skin frame: force on the pads.
    """

    window_s: float = 5.0
    band_hz: tuple[float, float] = (0.6, 4.0)
    sigmas: float = 8.0
    least_share: float = 0.3
    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def __post_init__(self) -> None:
        check_numbers(0.1, 1e3, window_s=self.window_s)
        low_hz, high_hz = check_pair("band_hz", self.band_hz)
        check_number("band_low", low_hz, 1.0 / self.window_s, 1e3)
        check_number("band_high", high_hz, low_hz, 1e3)
        check_numbers(0.0, 1e3, sigmas=self.sigmas)
        check_numbers(0.0, 1.0, least_share=self.least_share)
        unit_vector("direction", self.direction)


class Shaking:
    """Monitors the force on pads along a direction.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches that hold it; all of them if not given.
    settings : ShakingSettings

    Raises
    ------
    OptionError
        The pads are invalid, or the cycle rate is too low for the band.

    Attributes
    ----------
    frequency_hz, frequency_sigma_hz : float
        NaN without an oscillation.
    amplitude_n, amplitude_sigma_n : float
        Of the force: mass times acceleration.
    shaken : bool
    decisions : Decisions
    """

    def __init__(
        self, topology: Topology, names: Iterable[str] | None = None,
        settings: ShakingSettings = ShakingSettings(),
    ) -> None:  # fmt: skip
        check_kind("topology", topology, Topology)
        check_kind("settings", settings, ShakingSettings)
        rate_hz = topology.cycle_rate_hz
        check_number("band_high", settings.band_hz[1], 0.0, rate_hz / SAMPLES_PER_PERIOD)
        self.settings = settings
        self.decisions = Decisions()
        self._pads = Pads(topology, names)
        self._along = unit_vector("direction", settings.direction)
        self._cycles = max(1, round(rate_hz / (SAMPLES_PER_PERIOD * settings.band_hz[1])))
        self._sample_s = self._cycles / rate_hz
        self._period_ns = 1e9 / rate_hz
        count = max(16, round(settings.window_s / self._sample_s))
        self._every = max(1, round(1.0 / (FITS_PER_S * self._sample_s)))
        self._value, self._weight = np.zeros(count), np.zeros(count)
        self._scratch = np.zeros((5, 5)), np.zeros(5)
        self._fit = np.full(FIT_SIZE, np.nan)
        self._first_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Clear the window."""
        self._weight[:] = 0.0
        self._sample, self._sum, self._heard = -1, 0.0, 0
        self._lose()
        self.shaken = False

    def update(self, state: State, loads: PadLoads | None = None) -> None:
        """Process a cycle; `loads` are those of the same pads, if they were read already."""
        loads = self._pads.read(state) if loads is None else loads
        if self._first_ns is None:
            self._first_ns = state.stamp_ns
        cycle = round((state.stamp_ns - self._first_ns) / self._period_ns)
        sample = cycle // self._cycles
        if sample != self._sample:
            self._next(sample)
        x, y, z = self._along
        force = loads.force_n
        value = x * sum(force[0].tolist()) + y * sum(force[1].tolist()) + z * sum(force[2].tolist())
        if math.isfinite(value):
            self._sum += value
            self._heard += 1

    def _next(self, sample: int) -> None:
        """Write a mean into the ring, and leave gaps for missing ones."""
        count = self._value.size
        before = self._sample
        if before >= 0:
            place = before % count
            self._value[place] = self._sum / self._heard if self._heard else 0.0
            self._weight[place] = self._heard / self._cycles
            for missed in range(max(before + 1, sample - count), sample):
                self._weight[missed % count] = 0.0
            if sample // self._every != before // self._every:
                self._evaluate(sample)
        self._sample, self._sum, self._heard = sample, 0.0, 0

    def _evaluate(self, sample: int) -> None:
        fit_sine(
            self._value, self._weight, sample % self._value.size, self._sample_s,
            self.settings.band_hz, *self._scratch, self._fit,
        )  # fmt: skip
        hz, hz_sigma, amplitude, sigma, _, _, share, _ = self._fit.tolist()
        need = self.settings.sigmas * (0.5 if self.shaken else 1.0)
        low_hz, high_hz = self.settings.band_hz
        is_within = low_hz < hz < high_hz  # at an end, the true frequency is outside
        shaken = is_within and amplitude > need * sigma and share > self.settings.least_share
        if shaken:
            angle = math.pi * hz * self._sample_s
            damped = math.sin(angle) / angle
            self.frequency_hz, self.frequency_sigma_hz = hz, hz_sigma
            self.amplitude_n, self.amplitude_sigma_n = amplitude / damped, sigma / damped
        else:
            self._lose()
        if shaken != self.shaken:
            self.shaken = shaken
            self.decisions.add(
                1e-9 * self._period_ns * sample * self._cycles,
                "shaken" if shaken else "not shaken",
                f"{hz:.3f} ± {hz_sigma:.3f} Hz, {amplitude:.3f} ± {sigma:.3f} N, "
                f"{share:.0%} of what moves",
            )  # fmt: skip

    def _lose(self) -> None:
        self.frequency_hz = self.frequency_sigma_hz = math.nan
        self.amplitude_n = self.amplitude_sigma_n = math.nan
