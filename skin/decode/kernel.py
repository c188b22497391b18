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
from typing import NamedTuple

import numpy as np
from numba import literal_unroll

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.flags import flags_stage
from skin.decode.parts import Parts
from skin.decode.records import FLAGS, INVALID, LANES, UNKNOWN
from skin.decode.span import Span, lanes_of
from skin.decode.tangential import units_stage
from skin.decode.temperature import temperature_stage

__all__ = ["DecodeData", "decode", "decode_python"]


class DecodeData(NamedTuple):
    """What changes between cycles: t cycles of n units.

    Attributes
    ----------
    counts : ndarray, shape (t, c, n), int16
    status : ndarray, shape (t, n), uint16
        Flags of the bus.
    background : ndarray, shape (t, 5, n), or None
        What is not the unit's own signal: Hz of fall of the frequency, the field in µT, in the axes
        of the chip, and µT² of an axis, variance of what is not known of it.
    state : ndarray, shape (b,), records of `skin.decode.records.state`
        Kept from one cycle to the next.
    flag : ndarray, shape (LANES,), int16
        Scratch: flags of a block's units.
    tile : ndarray, shape (1,), record of `skin.decode.records.tile`
        Scratch: what one stage leaves to the next.
    control : ndarray, shape (1,), record of `CONTROL`
    out : tuple of ndarray, shape (m,)
        Written: the wanted rows, in the order of `skin.decode.records.RESULT_ROWS`; each from its
        first number on to the end of the array of shape (t, r, n) that they make.
    flags : ndarray, shape (t, n), uint16
        Written: flags of the bus and of the decoder.
    valid : ndarray, shape (t, n), bool
        Written: whether array features may use the unit.
    """

    counts: np.ndarray
    status: np.ndarray
    background: np.ndarray | None
    state: np.ndarray
    flag: np.ndarray
    tile: np.ndarray
    control: np.ndarray
    out: tuple[np.ndarray, ...]
    flags: np.ndarray
    valid: np.ndarray


@jitable(inline=True)
def hide(flag, span, out):
    """Show nothing of units that are UNKNOWN."""
    assume_noalias()
    span = lanes_of(span)
    for row in out:
        nothing = row.dtype.type(np.nan)
        for j in range(span.size):
            if flag[j] & UNKNOWN != 0:
                row[span.shown + j] = nothing


def clear_stage(parts: Parts) -> Callable:
    """The stage that shows nothing tangential."""
    rows = parts.tangential_rows

    @jitable(inline=True)
    def clear(span, out):
        assume_noalias()
        span = lanes_of(span)
        for row in literal_unroll(rows):
            nothing = out[row].dtype.type(np.nan)
            for lane in range(span.size):
                out[row][span.shown + lane] = nothing

    return clear


def block_stage(parts: Parts) -> Callable:
    """All stages, for the units of a block."""
    with_warmth = parts.temperature or parts.film_compensation or parts.chip_compensation
    with_skip = parts.skip and (parts.shear or parts.field)
    judge, clear = flags_stage(parts), clear_stage(parts)
    units, rest = units_stage(parts, loaded=True), units_stage(parts, loaded=False)
    temperature = temperature_stage(parts)

    @jitable(inline=True)
    def decode_block(model, data, span, look, advance, block):
        """`look`: at units without load as well; `advance` as of `skin.decode.records.CONTROL`."""
        assume_noalias()
        flag, out, tile = data.flag, data.out, data.tile[0]
        unit = model.coefficients[block if model.coefficients.size > 1 else 0]
        limits = model.limits[block if model.limits.size > 1 else 0]
        state = data.state[block]
        found, touched = judge(data.counts, data.status, limits, span, flag)
        if with_warmth:
            temperature(unit, data, span, state, tile, found, advance)
        if with_skip and not (look or touched):
            rest(unit, data, span, tile, state, advance)
            clear(span, out)
        else:
            units(unit, data, span, tile, state, advance)
        if found & UNKNOWN != 0:
            hide(flag, span, out)
        write_flags(flag, limits, span, data.flags, data.valid)

    return decode_block


@jitable(inline=True)
def write_flags(flag, limits, span, flags, valid):
    """Show the flags of a block, and what they mean."""
    assume_noalias()
    span = lanes_of(span)
    for j in range(span.size):
        flags[span.cycle, span.first + j] = (flag[j] & FLAGS) | limits["note"][j]
        valid[span.cycle, span.first + j] = flag[j] & INVALID == 0


def decode_python(parts: Parts) -> Callable:
    """The function that decodes what `parts` say, not compiled: ``decode(model, data)``."""
    with_look, with_skip = parts.look, parts.skip
    decode_block = block_stage(parts)

    def decode(model, data):
        """Decode the cycles of a `DecodeData` by a `skin.decode.model.DecodeModel`, in turn."""
        assume_noalias()
        control, n = data.control[0], data.counts.shape[2]
        advance = control["advance"] != 0
        phase = control["phase"] - (0 if advance else 1)
        for cycle in range(data.counts.shape[0]):
            look = with_look and (phase + cycle) % model.look_every == 0
            for block in range(data.state.size):
                first = block * LANES
                shown = cycle * len(data.out) * n + first
                # a whole block has nothing left over of its vectors, if the compiler knows
                if with_skip or n - first < LANES:
                    span = Span(cycle, first, shown, n - first)
                    decode_block(model, data, span, look, advance, block)
                else:
                    whole = Span(cycle, first, shown, LANES)
                    decode_block(model, data, whole, look, advance, block)
        control["phase"] = phase + (data.counts.shape[0] if advance else 1)

    return decode


@functools.cache
def decode(parts: Parts) -> Callable:
    """The kernel for `parts`, compiled."""
    return compiled(
        decode_python(parts), fastmath={"contract"}, allocates=False, made_by=("decode", parts)
    )
