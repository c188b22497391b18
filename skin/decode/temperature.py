"""Temperatures of gel, film and Hall chip.

The gel's follows from its current; the film, and a chip whose temperature is not on the wire,
follow the gel with a lag of first order. Nothing here branches on a value: both sides are computed
and one is selected, so that a loop over lanes becomes vector instructions.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.functions import log2
from skin.decode.parts import Parts
from skin.decode.records import CHIP, GEL, INVALID, UNKNOWN
from skin.decode.span import lanes_of

__all__ = ["EXTRAPOLATION", "lost", "recall_stage", "temperature_stage"]

CURRENT_MIN = 1e-6
"""Bound of the gel current over its value at 20 °C."""
EXTRAPOLATION = 0.2
"""What lies beyond the calibrated range adds this share of it to its one-sigma [assumed]: straight,
for a law that goes on otherwise than it is taken to is wrong the same way in every reading."""


@jitable(inline=True)
def gel_law(gel, unit, j):
    """Gel temperature from the logarithm of its current (`topology.gel`), and its current."""
    real = type(gel)
    current = max(unit["gel_scale"][j] * gel + unit["gel_offset"][j], real(CURRENT_MIN))
    octaves, power = log2(current), unit["gel_octaves"]
    rise = (power[2, j] * octaves + power[1, j]) * octaves + power[0, j]
    return real(20.0) + rise * octaves, current


def lag_law(parts: Parts, calm: bool) -> Callable:
    """Film and chip temperature above reference; both follow the gel. `calm`: all units are kept,
    and advance; a state that is stored for some lanes alone costs more than all else here."""
    with_film, with_chip = parts.film_compensation, parts.chip_compensation
    with_lag = parts.chip_lags

    @jitable(inline=True)
    def follow(t, chip_count, unit, state, j, keep, advance):
        """A unit that is invalid leaves no trace in the state. Without `advance`, the state is
        already that of this cycle."""
        real = type(t)
        if calm:
            keep = advance = True
        now = advance | (not keep)
        film_above = real(0.0)
        chip_above = real(0.0)
        if with_film or with_lag:
            last = state["last_temperature"][j]
            # NaN: no cycle before this one
            step = last - t if (last == last) & now else real(0.0)  # noqa: PLR0124
            state["last_temperature"][j] = t if keep & now else last
            if with_film:
                was = state["film_lag"][j]
                lag = (unit["film_keep"][j] if now else real(1.0)) * (was + step)
                state["film_lag"][j] = lag if keep else was
                film_above = (t - unit["film_reference"][j]) + lag
            if with_lag:
                was = state["chip_lag"][j]
                lag = (unit["chip_keep"][j] if now else real(1.0)) * (was + step)
                state["chip_lag"][j] = lag if keep else was
                chip_above = unit["chip_follows"][j] * (t + lag)
        if with_chip:
            chip_above += unit["chip_scale"][j] * chip_count + unit["chip_offset"][j]
        return film_above, chip_above

    return follow


@jitable(inline=True)
def lost(state, span, flag):
    """Whether a unit is known that was not when temperatures were due: it is decoded now."""
    assume_noalias()
    _, _, size = lanes_of(span)
    unheard = np.int16(0)
    for j in range(size):
        t = state["temperature"][j]
        missing = (t != t) & (flag[j] & UNKNOWN == 0)  # noqa: PLR0124
        unheard = np.int16(unheard | (1 if missing else 0))
    return unheard != 0


def recall_stage(parts: Parts) -> Callable:
    """The stage that shows temperatures which are held."""
    with_sigma = parts.sigma

    @jitable(inline=True)
    def recall(state, span, tile, shown, needed):
        """From the state, what is `shown` and what further stages need."""
        assume_noalias()
        _, _, size = lanes_of(span)
        if shown:
            for j in range(size):
                tile["temperature"][j] = state["temperature"][j]
            if with_sigma:
                for j in range(size):
                    tile["temperature_sigma"][j] = state["temperature_sigma"][j]
        if needed:
            for j in range(size):
                tile["film_above"][j] = state["film_above"][j]
            for j in range(size):
                tile["chip_above"][j] = state["chip_above"][j]

    return recall


def temperature_stage(parts: Parts) -> Callable:
    """The stage that decodes temperatures; those that are held and not `due` stay as they are."""
    with_hold, sigma = parts.hold, sigma_stage(parts)
    with_sigma = parts.sigma and parts.temperature
    calmly, carefully = gel_stage(parts, calm=True), gel_stage(parts, calm=False)

    @jitable(inline=True)
    def temperature(unit, counts, span, state, tile, flag, found, anew):
        """`found` are all flags of the block's units, in one; `anew`: those that are held are due;
        where none is held, the state goes on by a cycle."""
        if not with_hold and anew and found & INVALID == 0:
            calmly(unit, counts, span, state, tile, flag, True, True)
        else:
            carefully(unit, counts, span, state, tile, flag, anew, anew | with_hold)
        if with_sigma:
            sigma(unit, counts, span, state, tile, flag, anew)

    return temperature


def gel_stage(parts: Parts, calm: bool) -> Callable:
    """The stage that decodes the gel's temperature, and what follows it."""
    with_hold, follow = parts.hold, lag_law(parts, calm)

    @jitable(inline=True)
    def gel(unit, counts, span, state, tile, flag, due, advance):
        assume_noalias()
        first, _, size = lanes_of(span)
        real = tile["temperature"].dtype.type
        nothing = real(np.nan)
        for j in range(size):
            flags = flag[j]
            i = first + j
            t, _ = gel_law(real(counts[span.cycle, GEL, i]), unit, j)
            keep = flags & INVALID == 0
            held = False
            if with_hold:
                old = tile["temperature"][j]
                held = (not due) & (old == old)  # noqa: PLR0124
                keep = keep & (not held)
            film_above, chip_above = follow(
                t, real(counts[span.cycle, CHIP, i]), unit, state, j, keep, advance
            )
            if with_hold:
                t = tile["temperature"][j] if held else t
                film_above = tile["film_above"][j] if held else film_above
                chip_above = tile["chip_above"][j] if held else chip_above
                state["temperature"][j] = t if flags & UNKNOWN == 0 else nothing
                state["film_above"][j] = film_above
                state["chip_above"][j] = chip_above
            tile["temperature"][j] = t
            tile["film_above"][j] = film_above
            tile["chip_above"][j] = chip_above

    return gel


def sigma_stage(parts: Parts) -> Callable:
    """The stage of the one-sigma of the gel's temperature."""
    with_hold = parts.hold

    @jitable(inline=True)
    def sigma_of(unit, counts, span, state, tile, flag, due):
        assume_noalias()
        first, _, size = lanes_of(span)
        real = tile["temperature"].dtype.type
        nothing = real(np.nan)
        for j in range(size):
            t = tile["temperature"][j]
            _, current = gel_law(real(counts[span.cycle, GEL, first + j]), unit, j)
            step, power = unit["gel_step"][j] / current, unit["gel_rate"]
            above = t - real(20.0)
            rate = (power[2, j] * above + power[1, j]) * above + power[0, j]
            over = max(t - unit["gel_high"][j], unit["gel_low"][j] - t)
            noise2 = rate * rate * (unit["gel_noise"][j] + step * step)
            sigma = np.sqrt(unit["gel_variance"][j] + noise2)
            sigma += real(EXTRAPOLATION) * max(over, real(0.0))
            if with_hold:
                old = tile["temperature_sigma"][j]
                held = (not due) & (old == old)  # noqa: PLR0124
                sigma = old if held else sigma
                state["temperature_sigma"][j] = sigma if flag[j] & UNKNOWN == 0 else nothing
            tile["temperature_sigma"][j] = sigma

    return sigma_of
