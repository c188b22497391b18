"""The kernel of decoding: counts in, forces, temperatures and their uncertainty out.

Units are decoded in blocks of `LANES`, a block after the other: each stage is a loop over the lanes
of the block, and the wanted rows of the tile go out in the end. The records are told in `records`,
the stages and their laws stand in `flags`, `temperature`, `normal`, `field` and `tangential`. The
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
from skin.decode.records import (
    ALL_FLAGS,
    INVALID,
    LANES,
    NOT_NEGATIVE,
    SKIP,
    UNKNOWN,
    Span,
    tile_rows,
)
from skin.decode.tangential import tangential_stage
from skin.decode.temperature import (
    lost,
    recall_stage,
    temperature_sigma_stage,
    temperature_stage,
)

__all__ = ["DecodeData", "DecodeModel", "decode", "decode_python"]

LOOK_CYCLES = 4
"""Cycles, at least, from one look at units without load to the next."""

TANGENTIAL = (
    "tangential", "theta", "tangential_sigma", "theta_sigma", "field",
    "force", "displacement", "force_sigma", "displacement_sigma",
)  # fmt: skip
TANGENTIAL_ROWS = tuple(
    row for name in TANGENTIAL
    for row in (tile_rows(name) if name == "field" else tile_rows(name)[:2])
)  # fmt: skip
"""What a block without load does not show."""
TANGENTIAL_BITS = sum(1 << row for row in TANGENTIAL_ROWS)
HELD_BITS = sum(
    1 << row
    for name in ("temperature", "film_above", "temperature_sigma")
    for row in tile_rows(name)
)


class DecodeModel(NamedTuple):
    """What does not change between cycles.

    Attributes
    ----------
    coefficients : ndarray, shape (b,) or (1,), records of `skin.decode.records.coefficients`
        Calibration, a block for every `LANES` units, or a single block that all share.
    limits : ndarray, shape (b,) or (1,), records of `LIMITS`
        Ranges of counts.
    rows : ndarray, shape (r,), int64
        Rows of the tile that go out, in this order.
    temperature_every : int
        Temperatures are new where the number of the cycle is a multiple of this. Only with `hold`.
    """

    coefficients: np.ndarray
    limits: np.ndarray
    rows: np.ndarray
    temperature_every: int


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


def skip_stage(parts: Parts) -> Callable:
    """The stage that decodes what is tangential, where a block may be left out, or a part of it."""
    with_skip, tangential = parts.skip, tangential_stage(parts)

    @jitable(inline=True)
    def stage(unit, data, background, span, tile, touched, look):
        together = LANES
        if with_skip and touched != 0:
            together = SKIP
        for part in range((span.count + together - 1) // together):
            start = (part * together) & NOT_NEGATIVE
            size = min(together, span.count - start) & (2 * LANES - 1)
            some = Span(span.cycle, span.first, start, size)
            if with_skip and not look and not wake(data.flag, data.loaded, some):
                continue
            tangential(unit, data.counts, background, some, tile, data.flag)

    return stage


@jitable(inline=True)
def hand_out(rows, values, data, span, doubt, kept):
    """Rows of the tile, given as its `values` one after the other; not those whose bit is `kept`,
    which show the same already."""
    nothing = data.out.dtype.type(np.nan)
    for r in range(rows.size):
        if (kept >> rows[r]) & 1:
            continue
        at = (rows[r] * LANES) & NOT_NEGATIVE
        for j in range(span.count):
            data.out[span.cycle, r, span.first + j] = values[at + j]
        if doubt != 0:
            for j in range(span.count):
                if data.flag[j] & UNKNOWN != 0:
                    data.out[span.cycle, r, span.first + j] = nothing
    for j in range(span.count):
        data.flags[span.cycle, span.first + j] = data.flag[j] & ALL_FLAGS
        data.valid[span.cycle, span.first + j] = data.flag[j] & INVALID == 0


def temperatures_stage(parts: Parts) -> Callable:
    """The stage of all that is about temperatures."""
    with_hold, with_skip = parts.hold, parts.skip
    with_sigma = parts.sigma and parts.temperature
    warm = parts.temperature or parts.film_compensation or parts.chip_compensation
    recall, decode_now = recall_stage(parts), temperature_stage(parts)
    decode_sigma = temperature_sigma_stage(parts)

    @jitable(inline=True)
    def temperatures(unit, data, span, state, tile, due, advance, kept):
        """Whether what is shown of temperatures stays as it is; `kept` are whether it may, and
        whether nothing else needs them."""
        steady = False
        if warm:
            fresh = True
            if with_hold:
                fresh = due or lost(state, span, data.flag)
                if with_skip:
                    steady = kept[0] and not fresh
                recall(state, span, tile, not steady, not (steady and kept[1]))
            if fresh:
                decode_now(unit, data.counts, span, state, tile, data.flag, due, advance)
                if with_sigma:
                    decode_sigma(unit, data.counts, span, state, tile, data.flag, due)
        return steady

    return temperatures


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
    with_skip, with_shear, with_prefetch = parts.skip, parts.shear, parts.prefetch
    with_tangential = parts.shear or parts.field
    judge, temperatures, normal = flags_stage(parts), temperatures_stage(parts), normal_stage(parts)
    resting, tangential = rest_stage(parts), skip_stage(parts)

    def decode(model, data):
        """Decode t cycles of n units, one cycle after the other.

        Parameters
        ----------
        model : DecodeModel
        data : DecodeData
        """
        assume_noalias()
        control, tile = data.control[0], data.tile[0]
        values = data.tile.view(data.out.dtype)
        nothing = data.out.dtype.type(np.nan)
        counts, background, every = data.counts, data.background, model.temperature_every
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
                if with_prefetch:
                    prefetch_block(data, span, data.state[(block + 1) & NOT_NEGATIVE])
                heard = np.int16(0)
                if with_skip:
                    heard, changed = changes(counts, data.status, background, seen, span)
                    if reuse and not due and changed == 0:
                        continue
                doubt, touched = judge(
                    counts, data.status, limits, span, data.flag, data.loaded
                )  # fmt: skip
                look, rests, rested = resting(seen, touched, phase + cycle + block, every, reuse)
                steady = temperatures(
                    unit, data, span, state, tile, due, advance, (reuse and heard == 0, rests)
                )
                if with_shear:
                    normal(unit, counts, background, span, tile)
                if with_skip and with_tangential and not look:
                    if not rested:
                        for row in TANGENTIAL_ROWS:
                            for j in range(LANES):
                                values[row * LANES + j] = nothing
                    rest(data.flag, span)
                if with_tangential and not rests:
                    tangential(unit, data, background, span, tile, touched, look)
                kept = (HELD_BITS if steady else 0) | (TANGENTIAL_BITS if rested else 0)
                hand_out(model.rows, values, data, span, doubt, kept)
        control["phase"] = phase + (counts.shape[0] if advance else 1)
        control["reuse"] = 1

    return decode


@functools.cache
def decode(parts: Parts) -> Callable:
    """The kernel for `parts`, compiled."""
    return compiled(decode_python(parts), fastmath={"contract"})
