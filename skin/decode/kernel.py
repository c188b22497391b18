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

from bus.compiled.intrinsics import assume_noalias, prefetch
from bus.compiled.jit import compiled, jitable
from skin.decode.flags import any_of, changes, flags_stage, mark
from skin.decode.parts import Parts
from skin.decode.plan import LOOK_CYCLES
from skin.decode.records import FLAGS, INVALID, LANES, SKIP, UNKNOWN
from skin.decode.span import Span, lanes_of
from skin.decode.tangential import units_stage
from skin.decode.temperature import lost, recall_stage, temperature_stage

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
    seen : ndarray, shape (b,), records of `SEEN`
        Likewise, with `skip` only.
    flag, loaded : ndarray, shape (LANES,), int16
        Scratch: flags of a block's units, whether they are under load.
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
    seen: np.ndarray
    flag: np.ndarray
    loaded: np.ndarray
    tile: np.ndarray
    control: np.ndarray
    out: tuple[np.ndarray, ...]
    flags: np.ndarray
    valid: np.ndarray


@jitable(inline=True)
def _prefetch_row(row, start):
    """Begin to load what stands in a row for `LANES` units."""
    for j in range(0, LANES, 64 // row.itemsize):
        prefetch(row, start + j)


@jitable(inline=True)
def prefetch_block(data, span, state):
    """Begin to load the next block; `state` is its record."""
    cycle, start = span.cycle, span.first + LANES
    for channel in range(data.counts.shape[1]):
        _prefetch_row(data.counts[cycle, channel], start)
    _prefetch_row(data.status[cycle], start)
    _prefetch_row(data.flags[cycle], start)
    _prefetch_row(data.valid[cycle], start)
    for row in data.out:
        _prefetch_row(row, span.shown + LANES)
    _prefetch_row(state["last_temperature"], 0)
    _prefetch_row(state["film_lag"], 0)


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
        for row in rows:
            nothing = out[row].dtype.type(np.nan)
            for lane in range(span.size):
                out[row][span.shown + span.start + lane] = nothing

    return clear


class Turn(NamedTuple):
    """What is to be done in a cycle.

    Attributes
    ----------
    due : bool
        Decode temperatures that are held.
    look : bool
        Look at units without load all the same.
    advance, reuse : bool
        As of `skin.decode.records.CONTROL`.
    """

    due: bool
    look: bool
    advance: bool
    reuse: bool


def block_stage(parts: Parts) -> Callable:
    """All stages, for the units of a block."""
    with_warmth = parts.temperature or parts.film_compensation or parts.chip_compensation
    sees_changes, with_hold = parts.skip, parts.hold and with_warmth
    with_skip = parts.skip and (parts.shear or parts.field)
    judge, clear = flags_stage(parts), clear_stage(parts)
    units, rest = units_stage(parts, loaded=True), units_stage(parts, loaded=False)
    recall, temperature = recall_stage(parts), temperature_stage(parts)

    @jitable(inline=True)
    def decode_block(model, data, span, turn, block):
        assume_noalias()
        counts, flag, out = data.counts, data.flag, data.out
        unit = model.coefficients[block if model.coefficients.size > 1 else 0]
        limits = model.limits[block if model.limits.size > 1 else 0]
        state, advance = data.state[block], turn.advance
        heard = np.int16(1)
        if sees_changes:
            seen = data.seen[block]
            heard, changed = changes(counts, data.status, data.background, seen, span)
            if turn.reuse and not turn.due and changed == 0:
                return
        found, touched = judge(counts, data.status, limits, span, flag, data.loaded)
        if with_hold:
            above, anew = state, turn.due
            warm = anew or lost(state, span, flag)
            if not warm and not (turn.reuse and heard == 0):
                recall(state, span, out)
        else:
            above, anew, warm = data.tile[0], advance, with_warmth
        if warm:
            temperature(unit, data, span, state, above, found, anew)
        if with_skip:
            rests, shows = touched == 0 and not turn.look, seen["shows"]
            together = SKIP if touched != 0 and not turn.look else LANES
            for start in range(0, span.size, together):
                some = Span(
                    span.cycle, span.first, span.shown, start, min(together, span.size - start)
                )  # fmt: skip
                if turn.look or (not rests and any_of(data.loaded, some)):
                    units(unit, data, some, above, state, advance)
                    mark(shows, some, 1)
                else:
                    rest(unit, data, some, above, state, advance)
                    if not turn.reuse or any_of(shows, some):
                        clear(some, out)
                        mark(shows, some, 0)
        else:
            units(unit, data, span, above, state, advance)
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
    with_skip, with_look, with_prefetch = parts.skip, parts.look, parts.prefetch
    decode_block = block_stage(parts)

    def decode(model, data):
        """Decode the cycles of a `DecodeData` by a `skin.decode.model.DecodeModel`, in turn."""
        assume_noalias()
        control, n, every = data.control[0], data.counts.shape[2], model.temperature_every
        advance, reuse = control["advance"] != 0, control["reuse"] != 0
        phase = control["phase"] - (0 if advance else 1)
        for cycle in range(data.counts.shape[0]):
            look = False
            if with_look:
                look = (phase + cycle) % max(every, LOOK_CYCLES) == 0
            turn = Turn(advance and (phase + cycle) % every == 0, look, advance, reuse)
            for block in range(control["first"], control["last"]):
                first = block * LANES
                shown = cycle * len(data.out) * n + first
                if with_prefetch:
                    prefetch_block(data, Span(cycle, first, shown, 0, LANES), data.state[block + 1])
                # a whole block has nothing left over of its vectors, if the compiler knows
                if with_skip or n - first < LANES:
                    span = Span(cycle, first, shown, 0, min(LANES, n - first))
                    decode_block(model, data, span, turn, block)
                else:
                    whole = Span(cycle, first, shown, 0, LANES)
                    decode_block(model, data, whole, turn, block)
        control["phase"] = phase + (data.counts.shape[0] if advance else 1)
        control["reuse"] = 1

    return decode


@functools.cache
def decode(parts: Parts) -> Callable:
    """The kernel for `parts`, compiled."""
    return compiled(
        decode_python(parts), fastmath={"contract"}, allocates=False, made_by=("decode", parts)
    )
