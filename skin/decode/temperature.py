"""Temperatures of gel, film and Hall chip.

The gel's follows from its current; the film, and a chip whose temperature is not on the wire,
follow the gel with a lag of first order. Nothing here branches on a value: both sides are computed
and one is selected, so that a loop over lanes becomes vector instructions.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.functions import log2, read
from skin.decode.records import CHIP, FILM_ABOVE, GEL, INVALID, LANES, SIGMA, TEMPERATURE

__all__ = ["EXTRAPOLATION", "decode_temperatures"]

CURRENT_MIN = 1e-6
"""Bound of the gel current over its value at 20 °C."""
EXTRAPOLATION = 0.2
"""What lies beyond the calibrated range adds this share of it to its one-sigma [assumed]: straight,
for a law that goes on otherwise than it is taken to is wrong the same way in every reading."""


@jitable
def gel_law(gel, unit, j):
    """Gel temperature from the logarithm of its current (`topology.gel`), and its current."""
    real = type(gel)
    current = max(unit["gel_scale"][j] * gel + unit["gel_offset"][j], real(CURRENT_MIN))
    octaves, power = log2(current), unit["gel_octaves"]
    rise = (power[2, j] * octaves + power[1, j]) * octaves + power[0, j]
    return real(20.0) + rise * octaves, current


@jitable
def gel_sigma(t, current, unit, j):
    """One-sigma of the gel's temperature."""
    real = type(t)
    step, power = unit["gel_step"][j] / current, unit["gel_rate"]
    above = t - real(20.0)
    rate = (power[2, j] * above + power[1, j]) * above + power[0, j]
    over = max(t - unit["gel_high"][j], unit["gel_low"][j] - t)
    noise2 = rate * rate * (unit["gel_noise"][j] + step * step)
    sigma = np.sqrt(unit["gel_variance"][j] + noise2)
    return sigma + real(EXTRAPOLATION) * max(over, real(0.0))


@jitable
def decode_temperatures(wants, unit, counts, size, state, tile, flag, advance):
    """Temperatures of a block's units, and of film and chip above their references.

    A unit that is INVALID leaves no trace in the state; without `advance` the state is already that
    of this cycle.
    """
    assume_noalias()
    real, out = unit["gel_scale"].dtype.type, tile["result"]
    for j in range(min(size, LANES)):
        keep = flag[j] & INVALID == 0
        now = advance | (not keep)
        t, current = gel_law(real(read(counts, GEL, j)), unit, j)
        last = state["last_temperature"][j]
        # NaN: no cycle before this one
        step = last - t if last == last else real(0.0)  # noqa: PLR0124
        state["last_temperature"][j] = t if keep & now else last
        was = state["film_lag"][j]
        film_lag = unit["film_keep"][j] * (was + step) if now else was
        state["film_lag"][j] = film_lag if keep else was
        film_above = (t - unit["film_reference"][j]) + film_lag
        chip_count = real(read(counts, CHIP, j))
        chip_above = unit["chip_scale"][j] * chip_count + unit["chip_offset"][j]
        if wants.chip is not None:
            was = state["chip_lag"][j]
            chip_lag = unit["chip_keep"][j] * (was + step) if now else was
            state["chip_lag"][j] = chip_lag if keep else was
            chip_above += unit["chip_follows"][j] * (t + chip_lag)
        tile["film_above"][j] = film_above
        tile["chip_above"][j] = chip_above
        out[TEMPERATURE, j] = t
        out[FILM_ABOVE, j] = film_above
        if wants.sigma is not None:
            out[SIGMA + TEMPERATURE, j] = gel_sigma(t, current, unit, j)
