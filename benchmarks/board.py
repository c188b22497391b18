"""Electronics of a unit's board: a counter of the timer's periods, a divider for the gel, and the
converter of the Hall chip."""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.sim.truth import Truth
from skin.sim.unit import FREQUENCY, GEL, UnitSimulator
from topology import CHANNELS, Topology

__all__ = ["BoardUnits"]

FIELD = slice(CHANNELS.index("bx"), CHANNELS.index("bz") + 1)
GATE_S, CLOCK_HZ = 0.01, 1e6
"""How long periods are counted, and the clock that times them [assumed: a microcontroller's]."""
ALONE_UA, CODES = 1e6 * 3.3 / 95e3, 2.0**12
"""Current of the resistor below the gel alone, and codes of its ADC [derived: geometric mean of the
gel's resistances at 20 and 80 °C, where a step is 0.034 °C at both]."""
LSB_UT, RANGE_UT = 98.0, 130e3
"""Step and range of the Hall chip [assumed: a common one]."""


class BoardUnits(UnitSimulator):
    """Units whose boards do not measure exactly; the arguments are those of `UnitSimulator`."""

    def __init__(self, topology: Topology, *, seed: int = 0, **options: Any) -> None:
        super().__init__(topology, seed=seed, **options)
        self._phase = np.random.default_rng((seed, 1))
        self._before: tuple[float, np.ndarray] | None = None

    def values(self, truth: Truth) -> np.ndarray:
        """One sample of all units; frequencies are means over the gate that ends now, linear since
        the sample before, shape (c, n)."""
        values = self.quantities(
            truth.depth_mm, truth.displacement_mm, truth.temperature, truth.film_temperature,
            truth.hall_temperature,
        )  # fmt: skip
        time_s, now = float(truth.time_s), values[FREQUENCY].copy()
        if self._before is not None:
            step_s = time_s - self._before[0]
            assert step_s >= GATE_S, "cycles are longer than the gate"
            values[FREQUENCY] -= 0.5 * GATE_S / step_s * (now - self._before[1])
        self._before = time_s, now
        return self.disturb(values)

    def quantise(self, values: np.ndarray) -> np.ndarray:
        """Counts on the wire of what the boards read, shape (..., c, n)."""
        hz, gel, field = values[..., FREQUENCY, :], values[..., GEL, :], values[..., FIELD, :]
        # N whole periods in M ticks of a clock that is not synchronous; a frequency with a whole
        # number of periods must not lose one to rounding
        periods = np.floor(hz * GATE_S * (1.0 + 1e-12))
        ticks = np.floor(periods * CLOCK_HZ / hz + self._phase.random(hz.shape))
        code = np.rint(CODES * gel / (gel + ALONE_UA)).clip(0.0, CODES - 2.0)
        read = values.copy()
        read[..., FREQUENCY, :] = periods * CLOCK_HZ / ticks
        read[..., GEL, :] = ALONE_UA * code / (CODES - code)
        # beyond the range the board sends the rail of the wire, and no reading
        beyond = np.where(np.abs(field) > RANGE_UT, np.copysign(np.inf, field), 0.0)
        read[..., FIELD, :] = LSB_UT * np.rint(field / LSB_UT) + beyond
        return super().quantise(read)
