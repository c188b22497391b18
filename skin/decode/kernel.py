"""The kernel of decoding: counts in, forces, temperatures and their uncertainty out.

Units are decoded in blocks of `LANES`, a block after the other: each stage is a loop over the lanes
of the block, in which all laws of the stage are computed and each result goes to its own row. There
are few stages, for what is computed stays in registers; but none in which a unit takes so many
instructions in a row that the processor cannot look ahead to the next one. The records stand in
`records`, fields and forces in `tangential`; flags by counts and temperatures here. The gel's
temperature follows from its current; the film, and a chip whose temperature is not on the wire,
follow the gel with a lag of first order. The type of the coefficients, float32 or float64, is the
type of all arithmetic; what is not wanted is None, so that the compiler leaves it out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.functions import log2, read, rows_from, rows_of, write
from skin.decode.tangential import (
    EXTRAPOLATION,
    check_fields,
    decode_unloaded,
    hide,
    invert_units,
    show_units,
)

from skin.decode.records import (  # isort: skip
    BX, BY, BZ, CHIP, EXTRAPOLATED, FILM_ABOVE, FLAGS, FREQUENCY, GEL, INVALID, LANES, OUT_OF_RANGE,
    SATURATED, SIGMA, SILENT, TEMPERATURE, UNKNOWN,
)  # fmt: skip

__all__ = ["DecodeData", "decode", "decode_python"]


CURRENT_MIN = 1e-6
"""Bound of the gel current over its value at 20 °C."""


class DecodeData(NamedTuple):
    """What changes between cycles, of n units.

    Attributes
    ----------
    counts : ndarray, shape (c, n), int16
    status : ndarray, shape (n,), uint16
        Flags of the bus.
    background : ndarray, shape (5, n), or None
        What is not the unit's own signal: Hz of fall of the frequency, the field in µT, in the axes
        of the chip, and µT² of an axis, variance of what is not known of it.
    state : ndarray, shape (b,), records of `skin.decode.records.state`
        Kept from one cycle to the next.
    flag : ndarray, shape (LANES,), int16
        Scratch: flags of a block's units.
    tile : ndarray, shape (1,), record of `skin.decode.records.tile`
        Scratch: what one stage leaves to the next.
    values : ndarray, shape (RESULTS, n)
        Written: `DecodeModel.rows` of it, which are as in `skin.decode.records`.
    flags : ndarray, shape (n,), uint16
        Written: flags of the bus and of the decoder.
    valid : ndarray, shape (n,), bool
        Written: whether array features may use the unit.
    """

    counts: np.ndarray
    status: np.ndarray
    background: np.ndarray | None
    state: np.ndarray
    flag: np.ndarray
    tile: np.ndarray
    values: np.ndarray
    flags: np.ndarray
    valid: np.ndarray


@jitable
def outside(count, ends, j):
    """Whether a count is outside a range: one comparison modulo 2^16."""
    return (int(count) - int(ends[0, j])) & 0xFFFF > int(ends[1, j]) & 0xFFFF


@jitable
def find_flags(counts, status, limits, size, flag):
    """Flags of the units of a block from their counts alone, before anything is clamped, or from
    the bus; all of them in one."""
    assume_noalias()
    all_found = np.int16(0)
    for j in range(min(size, LANES)):
        gel, frequency = read(counts, GEL, j), read(counts, FREQUENCY, j)
        chip = read(counts, CHIP, j)
        railed = (
            outside(gel, limits["rail_gel"], j)
            | outside(frequency, limits["rail_frequency"], j)
            | outside(read(counts, BX, j), limits["rail_bx"], j)
            | outside(read(counts, BY, j), limits["rail_by"], j)
            | outside(read(counts, BZ, j), limits["rail_bz"], j)
            | outside(chip, limits["rail_chip"], j)
        )
        impossible = (
            outside(gel, limits["possible_gel"], j)
            | outside(frequency, limits["possible_frequency"], j)
            | outside(chip, limits["possible_chip"], j)
        )
        uncalibrated = outside(gel, limits["calibrated_gel"], j) | outside(
            frequency, limits["calibrated_frequency"], j
        )
        known = int(status[j]) | int(limits["status"][j])
        found = (
            (SATURATED if railed else 0)
            | (OUT_OF_RANGE if impossible else 0)
            | (EXTRAPOLATED if uncalibrated else 0)
        )
        flag[j] = np.int16((known if known & SILENT else known | found) & FLAGS)
        all_found = np.int16(all_found | flag[j])
    return all_found


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


@jitable
def are_pressed(counts, limits, size, flag):
    """Whether something presses any unit of a block that is heard of."""
    assume_noalias()
    touched = np.int16(0)
    for j in range(min(size, LANES)):
        pressed = outside(read(counts, FREQUENCY, j), limits["idle_frequency"], j)
        touched = np.int16(touched | (1 if pressed and flag[j] & SILENT == 0 else 0))
    return touched != 0


@jitable
def show_rows(rows, tile, size, out):
    """Copy the rows of a block's results that anyone reads.

    The stages write them into the tile, whose rows are apart by a constant: of those of all units
    the compiler would ask at run time whether they overlap.
    """
    assume_noalias()
    for k in range(rows.size):
        row = np.uintp(rows[k])
        for j in range(min(size, LANES)):
            write(out, row, j, tile["result"][row, j])


@jitable
def write_flags(flag, limits, size, flags, valid):
    """Show the flags of a block, and what they mean."""
    assume_noalias()
    for j in range(min(size, LANES)):
        flags[j] = (flag[j] & FLAGS) | limits["note"][j]
        valid[j] = flag[j] & INVALID == 0


@jitable
def decode_block(model, data, rows, block, size, look, advance):
    """All stages, for the units of a block. `rows`: of counts, background and values; `look`: at
    units without load as well; `advance` as of `decode`."""
    assume_noalias()
    wants, first = model.wants, block * LANES
    flag, tile, state = data.flag, data.tile[0], data.state[block]
    unit = model.coefficients[block if model.coefficients.size > 1 else 0]
    limits = model.limits[block if model.limits.size > 1 else 0]
    counts, background = rows_from(rows[0], first), rows_from(rows[1], first)
    here = slice(first, first + size)
    found = find_flags(counts, data.status[here], limits, size, flag)
    decode_temperatures(wants, unit, counts, size, state, tile, flag, advance)
    if wants.field is not None or wants.shear is not None:
        if look or are_pressed(counts, limits, size, flag):
            invert_units(wants, unit, counts, background, size, tile, flag)
            if wants.check is not None:
                check_fields(wants, unit, size, tile, flag, state, advance)
                if wants.sigma is not None:
                    show_units(wants, unit, size, tile)
        else:
            decode_unloaded(wants, unit, counts, background, size, tile, flag)
    if found & UNKNOWN != 0:
        hide(flag, UNKNOWN, tile)
    show_rows(model.rows, tile, size, rows_from(rows[2], first))
    write_flags(flag, limits, size, data.flags[here], data.valid[here])


@jitable
def age(lag, keep, periods):
    """Let the lags of a block fade for some periods."""
    for j in range(LANES):
        if keep[j] > 0.0:
            lag[j] *= keep[j] ** periods


def decode_python(model, data, phase, advance, missing):
    """Decode the cycle of a `DecodeData`.

    Parameters
    ----------
    model : skin.decode.model.DecodeModel
    data : DecodeData
    phase : int
        Number of the cycle, by which units without load are looked at.
    advance : bool
        False: the same cycle once more; its temperatures stay as they are.
    missing : float
        Periods since the cycle before, less one, that lags age by. A change of the gel's
        temperature in them counts as if it came at their end.
    """
    assume_noalias()
    n = data.counts.shape[1]
    if missing != 0.0:
        for block in range(data.state.size):
            unit = model.coefficients[block if model.coefficients.size > 1 else 0]
            age(data.state[block]["film_lag"], unit["film_keep"], missing)
            age(data.state[block]["chip_lag"], unit["chip_keep"], missing)
    rows = rows_of(data.counts), rows_of(data.background), rows_of(data.values)
    look = model.look_every > 0 and phase % model.look_every == 0
    for block in range(data.state.size):
        left = n - block * LANES
        # a whole block has nothing left over of its vectors, if the compiler knows
        if left < LANES:
            decode_block(model, data, rows, block, left, look, advance)
        else:
            decode_block(model, data, rows, block, LANES, look, advance)


decode = compiled(decode_python, fastmath={"contract"}, allocates=False)
