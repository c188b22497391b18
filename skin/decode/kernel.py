"""The kernel of decoding: counts in, forces, temperatures and their uncertainty out.

Units are decoded in blocks of `LANES`, a block after the other: each stage is a loop over the lanes
of the block, in which all laws of the stage are computed and each result goes to its own row. There
are few stages, for what is computed stays in registers; but none in which a unit takes so many
instructions in a row that the processor cannot look ahead to the next one. The records stand in
`records`, the stages and their laws in `flags`, `temperature`, `normal`, `field` and `tangential`.
The type of the coefficients, float32 or float64, is the type of all arithmetic.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.flags import flags_stage
from skin.decode.plan import Plan
from skin.decode.records import FLAGS, INVALID, LANES, UNKNOWN
from skin.decode.rows import rows_of, write
from skin.decode.tangential import units_stage
from skin.decode.temperature import temperature_stage

__all__ = ["DecodeData", "decode", "decode_python"]

WITH_LOOK = WITH_SKIP = WITH_FILM = WITH_CHIP = False
decode_block: Any = None
"""Constants and stages of a kernel; see `decode_python`."""


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
    values : ndarray, shape (r, n)
        Written: the wanted rows, in the order of `skin.decode.records.RESULT_ROWS`.
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
def hide(flag, size, out, rows):
    """Show nothing of units that are UNKNOWN."""
    assume_noalias()
    nothing = out.values.dtype.type(np.nan)
    for row in range(rows):
        for j in range(min(size, LANES)):
            if flag[j] & UNKNOWN != 0:
                write(out, row, j, nothing)


def clear_stage(plan: Plan) -> Callable:
    """The stage that shows nothing tangential."""
    rows = plan.tangential_rows

    @jitable
    def clear(size, out):
        assume_noalias()
        nothing = out.values.dtype.type(np.nan)
        for row in rows:
            for j in range(min(size, LANES)):
                write(out, row, j, nothing)

    return clear


@jitable
def background_of(values, first):
    """Rows of a background, where there is one."""
    if values is None:
        return None
    return rows_of(values, first)


def block_stage(plan: Plan) -> Callable:
    """All stages, for the units of a block."""
    with_warmth = "temperature" in plan.results or plan.film_compensation or plan.chip_compensation
    with_skip = plan.skip and (plan.shear or "field" in plan.results)
    judge, clear = flags_stage(plan), clear_stage(plan)
    units, rest = units_stage(plan, loaded=True), units_stage(plan, loaded=False)
    temperature = temperature_stage(plan)

    @jitable
    def decode_block(model, data, block, size, look, advance):
        """`look`: at units without load as well; `advance` as of `decode`."""
        assume_noalias()
        first = block * LANES
        flag, tile, state = data.flag, data.tile[0], data.state[block]
        unit = model.coefficients[block if model.coefficients.size > 1 else 0]
        limits = model.limits[block if model.limits.size > 1 else 0]
        counts, out = rows_of(data.counts, first), rows_of(data.values, first)
        background = background_of(data.background, first)
        here = slice(first, first + size)
        found, touched = judge(counts, data.status[here], limits, size, flag)
        if with_warmth:
            temperature(unit, counts, size, state, tile, flag, out, found, advance)
        if with_skip and not (look or touched):
            rest(unit, counts, background, size, tile, flag, state, out, advance)
            clear(size, out)
        else:
            units(unit, counts, background, size, tile, flag, state, out, advance)
        if found & UNKNOWN != 0:
            hide(flag, size, out, data.values.shape[0])
        write_flags(flag, limits, size, data.flags[here], data.valid[here])

    return decode_block


@jitable
def write_flags(flag, limits, size, flags, valid):
    """Show the flags of a block, and what they mean."""
    assume_noalias()
    for j in range(min(size, LANES)):
        flags[j] = (flag[j] & FLAGS) | limits["note"][j]
        valid[j] = flag[j] & INVALID == 0


@jitable
def age(lag, keep, periods):
    """Let the lags of a block fade for some periods."""
    for j in range(LANES):
        if keep[j] > 0.0:
            lag[j] *= keep[j] ** periods


def _decode(model, data, phase, advance, missing):
    """Decode the cycle of a `DecodeData`.

    Parameters
    ----------
    model : skin.decode.model.DecodeModel
    data : DecodeData
    phase : int
        Number of the cycle, by which units without load are looked at.
    advance : bool
        False: the cycle before once more; its temperatures stay as they are.
    missing : float
        Periods since the cycle before, less one, that lags age by. A change of the gel's
        temperature in them counts as if it came at their end.
    """
    assume_noalias()
    n = data.counts.shape[1]
    if missing != 0.0:
        for block in range(data.state.size):
            unit = model.coefficients[block if model.coefficients.size > 1 else 0]
            if WITH_FILM:
                age(data.state[block]["film_lag"], unit["film_keep"], missing)
            if WITH_CHIP:
                age(data.state[block]["chip_lag"], unit["chip_keep"], missing)
    phase -= 0 if advance else 1
    look = WITH_LOOK and phase % model.look_every == 0
    for block in range(data.state.size):
        left = n - block * LANES
        # a whole block has nothing left over of its vectors, if the compiler knows
        if WITH_SKIP or left < LANES:
            decode_block(model, data, block, min(left, LANES), look, advance)
        else:
            decode_block(model, data, block, LANES, look, advance)


def decode_python(plan: Plan) -> Callable:
    """The function that decodes as a plan says, not compiled: `_decode`, with its constants and
    stages among its globals, for numba finds no closure again in its cache."""
    constants = {
        "WITH_LOOK": plan.look, "WITH_SKIP": plan.skip, "WITH_FILM": plan.film_compensation,
        "WITH_CHIP": plan.chip_lags, "decode_block": block_stage(plan),
    }  # fmt: skip
    return FunctionType(_decode.__code__, globals() | constants, "decode")


@functools.cache
def decode(plan: Plan) -> Callable:
    """The kernel of a `Plan.kernel`, compiled."""
    kernel = decode_python(plan)
    return compiled(kernel, fastmath={"contract"}, allocates=False, made_by=("decode", plan))
