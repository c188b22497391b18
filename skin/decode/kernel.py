"""The kernel of decoding: counts in, forces, temperatures and their uncertainty out.

Units are decoded in blocks of `LANES`, a block after the other: each stage is a loop over the lanes
of the block, and the wanted rows of the tile go out in the end. The records stand in `records`, the
stages and their laws in `flags`, `temperature`, `normal`, `field` and `tangential`. The
type of the coefficients, float32 or float64, is the type of all arithmetic.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias, prefetch
from bus.compiled.jit import compiled, jitable
from skin.decode.flags import changes, flags_stage, rest, wake
from skin.decode.normal import normal_stage
from skin.decode.parts import Parts
from skin.decode.plan import LOOK_CYCLES
from skin.decode.records import (
    FLAGS,
    INVALID,
    LANES,
    NOT_NEGATIVE,
    SKIP,
    TANGENTIAL_ROWS,
    UNKNOWN,
    tile_rows,
)
from skin.decode.span import Span, lanes_of
from skin.decode.tangential import tangential_stage
from skin.decode.temperature import (
    lost,
    recall_stage,
    temperature_stage,
)

__all__ = ["DecodeData", "decode", "decode_python"]

TANGENTIAL_BITS = sum(1 << row for row in TANGENTIAL_ROWS)
HELD_BITS = sum(
    1 << row
    for name in ("temperature", "film_above", "temperature_sigma")
    for row in tile_rows(name)
)


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
        Scratch: the block on its way through.
    control : ndarray, shape (1,), record of `CONTROL`
    out : ndarray, shape (t, r, n)
        Written: the wanted rows.
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
    out: np.ndarray
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
    for row in range(data.out.shape[1]):
        _prefetch_row(data.out[cycle, row], start)
    _prefetch_row(state["last_temperature"], 0)
    _prefetch_row(state["film_lag"], 0)


@jitable(inline=True)
def write_results(rows, values, flag, span, out, unknown, kept):
    """Show rows of the tile, given as its `values` one after the other; not those whose bit is
    `kept`, which show the same already, and nothing of units that are `unknown`, if any is."""
    assume_noalias()
    first, _, size = lanes_of(span)
    nothing = out.dtype.type(np.nan)
    for r in range(rows.size):
        if (kept >> rows[r]) & 1:
            continue
        at = (rows[r] * LANES) & NOT_NEGATIVE
        for j in range(size):
            out[span.cycle, r, first + j] = values[at + j]
        if unknown != 0:
            for j in range(size):
                if flag[j] & UNKNOWN != 0:
                    out[span.cycle, r, first + j] = nothing


def rest_stage(parts: Parts) -> Callable:
    """The stage that decides whether a block shows nothing tangential."""
    with_skip, with_look = parts.skip, parts.look
    with_tangential = parts.shear or parts.field

    @jitable(inline=True)
    def resting(seen, touched, turn, every, reuse):
        """Whether units without load are looked at all the same; whether the block rests, and
        whether it is shown so already."""
        look = rests = rested = False
        if with_skip:
            if with_look:
                look = turn % max(every, LOOK_CYCLES) == 0
            rests = with_tangential and touched == 0 and not look
            rested = rests and reuse and seen["rested"][0] != 0
            seen["rested"][0] = rests
        return look, rests, rested

    return resting


def decode_python(parts: Parts) -> Callable:
    """The function that decodes what `parts` say, not compiled: ``decode(model, data)``."""
    with_skip, with_hold, with_shear, with_prefetch = (
        parts.skip, parts.hold, parts.shear, parts.prefetch
    )  # fmt: skip
    with_tangential = parts.shear or parts.field
    warm = parts.temperature or parts.film_compensation or parts.chip_compensation
    judge, normal, resting = flags_stage(parts), normal_stage(parts), rest_stage(parts)
    recall, temperature = recall_stage(parts), temperature_stage(parts)
    tangential = tangential_stage(parts)

    def decode(model, data):
        """Decode the cycles of a `DecodeData` by a `skin.decode.model.DecodeModel`, in turn."""
        assume_noalias()
        counts, status, background, flag = data.counts, data.status, data.background, data.flag
        control, tile, every = data.control[0], data.tile[0], model.temperature_every
        values = data.tile.view(data.out.dtype)
        unit_step = 0 if model.coefficients.size == 1 else 1
        limit_step = 0 if model.limits.size == 1 else 1
        advance, reuse = control["advance"] != 0, control["reuse"] != 0
        phase = control["phase"] - (0 if advance else 1)
        for cycle in range(counts.shape[0]):
            due = advance and (phase + cycle) % every == 0
            for block in range(control["first"], control["last"]):
                first = (block * LANES) & NOT_NEGATIVE
                size = min(LANES, counts.shape[2] - first) & (2 * LANES - 1)
                span = Span(cycle, first, 0, size)
                unit = model.coefficients[(block * unit_step) & NOT_NEGATIVE]
                limits = model.limits[(block * limit_step) & NOT_NEGATIVE]
                state = data.state[block & NOT_NEGATIVE]
                seen = data.seen[block & NOT_NEGATIVE]
                heard, steady = np.int16(0), False
                if with_prefetch:
                    prefetch_block(data, span, data.state[(block + 1) & NOT_NEGATIVE])
                if with_skip:
                    heard, changed = changes(counts, status, background, seen, span)
                    if reuse and not due and changed == 0:
                        continue
                found, touched = judge(counts, status, limits, span, flag, data.loaded)
                look, rests, rested = resting(seen, touched, phase + cycle, every, reuse)
                if warm:
                    fresh = True
                    if with_hold:
                        fresh = due or lost(state, span, flag)
                        steady = with_skip and reuse and heard == 0 and not fresh
                        recall(state, span, tile, not steady, not (steady and rests))
                    if fresh:
                        anew = due if with_hold else advance
                        temperature(unit, counts, span, state, tile, flag, found, anew)
                if with_shear:
                    normal(unit, counts, background, span, tile)
                if with_skip and with_tangential and not look:
                    rest(flag, span, values, rested)
                if with_tangential and not rests:
                    together = SKIP if with_skip and touched != 0 else LANES
                    for part in range((size + together - 1) // together):
                        start = (part * together) & NOT_NEGATIVE
                        lanes = min(together, size - start) & (2 * LANES - 1)
                        some = Span(cycle, first, start, lanes)
                        if with_skip and not look and not wake(flag, data.loaded, some):
                            continue
                        tangential(unit, counts, background, some, tile, flag, state, advance)
                kept = (HELD_BITS if steady else 0) | (TANGENTIAL_BITS if rested else 0)
                write_results(model.rows, values, flag, span, data.out, found & UNKNOWN, kept)
                for j in range(size):
                    data.flags[cycle, first + j] = (flag[j] & FLAGS) | limits["note"][j]
                    data.valid[cycle, first + j] = flag[j] & INVALID == 0
        control["phase"] = phase + (counts.shape[0] if advance else 1)
        control["reuse"] = 1

    return decode


@functools.cache
def decode(parts: Parts) -> Callable:
    """The kernel for `parts`, compiled."""
    return compiled(decode_python(parts), fastmath={"contract"}, made_by=("decode", parts))
