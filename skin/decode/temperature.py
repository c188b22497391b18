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
from skin.decode.plan import Plan
from skin.decode.records import CHIP, GEL, INVALID, LANES
from skin.decode.rows import read, write

__all__ = ["EXTRAPOLATION", "temperature_stage"]

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


def lag_law(plan: Plan, calm: bool) -> Callable:
    """Film and chip temperature above reference; both follow the gel. `calm`: all units are kept,
    and advance; a state that is stored for some lanes alone costs more than all else here."""
    with_film, with_chip = plan.film_compensation, plan.chip_compensation
    with_lag = plan.chip_lags

    @jitable
    def follow(t, chip_count, unit, state, j, keep, advance):
        """A unit that is not to `keep` leaves no trace in the state. Without `advance`, the state
        is already that of this cycle."""
        real = type(t)
        if calm:
            keep = advance = True
        now = advance | (not keep)
        film_above = real(0.0)
        chip_above = real(0.0)
        if with_film or with_lag:
            last = state["last_temperature"][j]
            # NaN: no cycle before this one
            step = last - t if last == last else real(0.0)  # noqa: PLR0124
            state["last_temperature"][j] = t if keep & now else last
            if with_film:
                was, share = state["film_lag"][j], unit["film_keep"][j]
                lag = share * (was + step) if now else was
                state["film_lag"][j] = lag if keep else was
                film_above = (t - unit["film_reference"][j]) + lag
            if with_lag:
                was, share = state["chip_lag"][j], unit["chip_keep"][j]
                lag = share * (was + step) if now else was
                state["chip_lag"][j] = lag if keep else was
                chip_above = unit["chip_follows"][j] * (t + lag)
        if with_chip:
            chip_above += unit["chip_scale"][j] * chip_count + unit["chip_offset"][j]
        return film_above, chip_above

    return follow


@jitable
def sigma_law(t, current, unit, j):
    """One-sigma of the gel's temperature."""
    real = type(t)
    step, power = unit["gel_step"][j] / current, unit["gel_rate"]
    above = t - real(20.0)
    rate = (power[2, j] * above + power[1, j]) * above + power[0, j]
    over = max(t - unit["gel_high"][j], unit["gel_low"][j] - t)
    noise2 = rate * rate * (unit["gel_noise"][j] + step * step)
    sigma = np.sqrt(unit["gel_variance"][j] + noise2)
    return sigma + real(EXTRAPOLATION) * max(over, real(0.0))


def temperature_stage(plan: Plan) -> Callable:
    """The stage that decodes temperatures."""
    with_compensation = plan.film_compensation or plan.chip_compensation
    calmly, carefully = gel_stage(plan, calm=True), gel_stage(plan, calm=False)

    @jitable
    def temperature(unit, counts, size, state, above, flag, out, found, advance):
        """`found` are all flags of the block's units, in one; with `advance` the state goes on by a
        cycle."""
        if with_compensation and advance and found & INVALID == 0:
            calmly(unit, counts, size, state, above, flag, out, True)
        else:
            carefully(unit, counts, size, state, above, flag, out, advance)

    return temperature


def gel_stage(plan: Plan, calm: bool) -> Callable:
    """The stage that decodes the gel's temperature, and what follows it."""
    with_temperature, with_film = "temperature" in plan.results, "film_above" in plan.results
    with_compensation = plan.film_compensation or plan.chip_compensation
    with_sigma, follow = "temperature" in plan.results and plan.sigma, lag_law(plan, calm)
    row, sigma_row = plan.row("temperature"), plan.row("temperature_sigma")
    film_row = plan.row("film_above")

    @jitable
    def gel(unit, counts, size, state, above, flag, out, advance):
        assume_noalias()
        real = unit["gel_scale"].dtype.type
        sigma = real(0.0)
        for j in range(min(size, LANES)):
            flags = flag[j]
            t, current = gel_law(real(read(counts, GEL, j)), unit, j)
            if with_sigma:
                sigma = sigma_law(t, current, unit, j)
            keep = flags & INVALID == 0
            chip_count = real(read(counts, CHIP, j))
            film_above, chip_above = follow(t, chip_count, unit, state, j, keep, advance)
            if with_temperature:
                write(out, row, j, t)
            if with_sigma:
                write(out, sigma_row, j, sigma)
            if with_compensation:
                above["film_above"][j] = film_above
                above["chip_above"][j] = chip_above
            if with_film:
                write(out, film_row, j, film_above)

    return gel
