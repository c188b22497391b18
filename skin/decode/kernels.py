"""The kernel of decoding: counts in, forces, temperatures and their uncertainty out.

Units are decoded in blocks of `LANES`, a block after the other: its counts are copied into a tile,
loops over the lanes compute rows of a second tile, and the wanted rows go out. What stands where is
told in `layout`, what is computed in `laws`.

`Parts` says what is compiled; the type of `coefficients`, float32 or float64, is the type of all
arithmetic, and polynomials are as long as that type needs.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from bus.compiled.intrinsics import assume_noalias, prefetch
from bus.compiled.jit import compiled
from skin.decode import laws
from skin.decode.functions import INLINED, atan2, exp2
from skin.decode.laws import EXTRAPOLATION, FIELD_MIN, component

from skin.decode.layout import (  # isort: skip
    ADVANCE, ALL_FLAGS, ANGLE_VARIANCE, BX, BY, BZ, CHANNELS, CHIP, CHIP_ABOVE, DEPTH_OFFSET,
    DEPTH_SCALE, DX, DX_SIGMA, DY, DY_SIGMA, EXTRAPOLATED, FIELD_VARIANCE, FIELD_X, FIELD_Y,
    FIELD_Z, FILM_ABOVE, FILM_LAG, FILM_X, FILM_Y, FIRST, FREQUENCY, FT, FT_SIGMA, FX, FX_SIGMA,
    FY, FY_SIGMA, FZ, FZ_SIGMA, GEL, H, HELD, HELD_BITS, H_SIGMA, IDLE, INVALID, LANES, LAST,
    LIMIT_IDLE, LIMIT_ROWS, LIMIT_STATUS, LIMIT_USUAL, MAP_XX, MAP_XY, MAP_YX, MAP_YY, PER_HZ,
    PHASE, REACH, RESTED, REUSE, ROWS, SEEN_FLAGS, SEEN_ROWS, SHEAR_GAIN, SHEAR_GAIN_OFFSET,
    SILENT, SKIP, STATE_ROWS, TANGENTIAL, TANGENTIAL_BITS, TEMPERATURE, TEMPERATURE_SIGMA,
    THETA, THETA_SIGMA, UNKNOWN,
)  # fmt: skip

__all__ = ["Parts", "decode", "decode_python"]

FAR = 1 << 17
"""Units from which on the next block is fetched ahead: they do not fit the second cache."""
LOOK_CYCLES = 4
"""Cycles, at least, from one look at units without load to the next."""

NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end: it
would turn every load into a gather to be able to do so."""


class Parts(NamedTuple):
    """What is compiled.

    Attributes
    ----------
    temperature, force, tangential, theta, displacement, field
        Quantities that are wanted.
    sigma
        Their one-sigma.
    angle
        R from the angle of the field (`field-angle`); else from its strength (`sine`).
    anomaly
        Hold the field against its model.
    turning
        Correct directions by tables.
    centring
        Take off where films sit beside their chips' axes.
    film, chip
        Compensate temperatures of film and Hall chip.
    lagging
        Chips without a temperature of their own follow the gel.
    held
        Temperatures are decoded every few cycles and held between.
    skipping
        Leave out the inversion of units without load, and blocks that did not change.
    looking
        Look at units without load all the same, every few cycles, a block after the other: for who
        follows the ambient field.
    """

    temperature: bool = False
    force: bool = False
    tangential: bool = False
    theta: bool = False
    displacement: bool = False
    field: bool = False
    sigma: bool = False
    angle: bool = False
    anomaly: bool = False
    turning: bool = False
    centring: bool = False
    film: bool = False
    chip: bool = False
    lagging: bool = False
    held: bool = False
    skipping: bool = False
    looking: bool = False


@register_jitable(**INLINED)
def _fetch(row, start):
    """Begin to fetch what stands in a row for `LANES` units."""
    for j in range(0, LANES, 64 // row.itemsize):
        prefetch(row, start + j)


def decode_python(parts: Parts) -> Callable:
    """The function that decodes what `parts` say, not compiled: see `decode` within.

    Parts are truth values around it, not arguments: what they leave out is cut away before the
    compiler looks at it, which takes it longer than to compile what is left.
    """
    (
        with_temperature, with_force, with_tangential, with_theta, with_displacement, with_field,
        with_sigma, with_angle, with_anomaly, with_turning, with_centring, with_film, with_chip,
        with_lagging, with_held, with_skipping, with_looking,
    ) = parts  # fmt: skip
    warm = with_temperature or with_film or with_chip
    lateral = with_force or with_tangential or with_theta or with_displacement
    upright = with_angle or with_anomaly or with_field
    looked = lateral or with_field

    def decode(
        counts, incoming, background, coefficients, limits, rows, state, seen, every,
        flag, loaded, tile, moment, out, status, valid,
    ):  # fmt: skip
        """Decode t cycles of n units, one cycle after the other.

        Parameters
        ----------
        counts : ndarray, shape (t, c, n), int16
        incoming : ndarray, shape (t, n), uint16
            Status flags of the bus.
        background : ndarray, shape (t, 5, n), or None
            What is not the unit's own signal: Hz of fall of the frequency, the field in µT, in the
            axes of the chip, and µT² of an axis, variance of what is not known of it; None is not
            compiled.
        coefficients : ndarray, shape (b * ROWS * LANES,), float32 or float64
            Calibration, a block for every `LANES` units, or a single block that all share.
        limits : ndarray, shape (b * LIMIT_ROWS * LANES,), int16
            Ranges of counts, blocked in the same way, shared or not.
        rows : ndarray, shape (r,), int64
            Rows of the tile that go out, in this order.
        state : ndarray, shape (b * STATE_ROWS * LANES,), or (b * HELD * LANES,) without `held`
            What one cycle leaves to the next, always a block for every `LANES` units.
        seen : ndarray, shape (b * SEEN_ROWS * LANES,), int16
            Counts (where there is no background) and flags of the cycle before, for `skipping`.
        every : int
            Temperatures are new where the number of the cycle is a multiple of this. Only with
            `held`.
        flag, loaded : ndarray, shape (LANES,), int16
        tile : ndarray, shape (TILE_ROWS * LANES,)
            Room to work in.
        moment : ndarray, shape (MOMENT,), int64
            `PHASE`, number of the next cycle, which is kept. `ADVANCE`, 0 where the cycle before is
            decoded again: its temperatures stay as they are. `REUSE`, whether `out`, `status` and
            `valid` hold the cycle before, decoded by this kernel; set for the next call, and used
            with `skipping` only. `FIRST` and `LAST`, the blocks that are decoded.
        out : ndarray, shape (t, r, n)
        status : ndarray, shape (t, n), uint16
        valid : ndarray, shape (t, n), bool
        """
        assume_noalias()
        real = coefficients.dtype.type
        zero = real(0.0)
        one = real(1.0)
        nothing = real(np.nan)
        single = np.finfo(coefficients.dtype).bits == 32
        units = counts.shape[2]
        blocks = (units + LANES - 1) // LANES
        block_step = 0 if coefficients.size < blocks * ROWS * LANES else ROWS * LANES
        limit_step = 0 if limits.size < blocks * LIMIT_ROWS * LANES else LIMIT_ROWS * LANES
        state_step = (HELD if not with_held else STATE_ROWS) * LANES
        advance, reuse = moment[ADVANCE] != 0, moment[REUSE] != 0
        phase = moment[PHASE] - (0 if advance else 1)
        far = units >= FAR
        for cycle in range(counts.shape[0]):
            due = advance and (phase + cycle) % every == 0
            for block in range(moment[FIRST], moment[LAST]):
                first = (block * LANES) & NOT_NEGATIVE
                count = min(LANES, units - first) & (2 * LANES - 1)
                k = (block * block_step) & NOT_NEGATIVE
                k_limits = (block * limit_step) & NOT_NEGATIVE
                k_state = (block * state_step) & NOT_NEGATIVE

                if far:
                    there = first + LANES
                    for channel in range(CHANNELS):
                        _fetch(counts[cycle, channel], there)
                    _fetch(incoming[cycle], there)
                    _fetch(status[cycle], there)
                    _fetch(valid[cycle], there)
                    for r in range(rows.size):
                        _fetch(out[cycle, r], there)
                    for r in range(FILM_LAG + 1):
                        _fetch(state, k_state + state_step + r * LANES)

                heard = np.int16(0)  # whether the flags of the bus are others
                if with_skipping:
                    k_seen = (block * SEEN_ROWS * LANES) & NOT_NEGATIVE
                    for j in range(count):
                        at = k_seen + SEEN_FLAGS * LANES + j
                        now = np.int16(incoming[cycle, first + j])
                        heard = np.int16(heard | (now ^ seen[at]))
                        seen[at] = now
                    if background is None:
                        changed = heard
                        for channel in range(CHANNELS):
                            for j in range(count):
                                at = k_seen + channel * LANES + j
                                now = counts[cycle, channel, first + j]
                                changed = np.int16(changed | (now ^ seen[at]))
                                seen[at] = now
                        if reuse and not due and changed == 0:
                            continue

                # -- flags of the counts; most blocks have none, which takes fewer limits to see
                doubt = touched = np.int16(0)
                usual = k_limits + LIMIT_USUAL * LANES
                low_x, width_x = laws.range_of(limits, usual, BX)
                low_y, width_y = laws.range_of(limits, usual, BY)
                low_z, width_z = laws.range_of(limits, usual, BZ)
                low_chip, width_chip = laws.range_of(limits, usual, CHIP)
                for j in range(count):
                    at = k_limits + j
                    gel = counts[cycle, GEL, first + j]
                    frequency = counts[cycle, FREQUENCY, first + j]
                    unusual = (
                        laws.outside(gel, limits, at, LIMIT_USUAL + 2 * GEL)
                        | laws.outside(frequency, limits, at, LIMIT_USUAL + 2 * FREQUENCY)
                        | laws.beyond(counts[cycle, BX, first + j], low_x, width_x)
                        | laws.beyond(counts[cycle, BY, first + j], low_y, width_y)
                        | laws.beyond(counts[cycle, BZ, first + j], low_z, width_z)
                        | laws.beyond(counts[cycle, CHIP, first + j], low_chip, width_chip)
                    )
                    known = np.int16(incoming[cycle, first + j]) | limits[at + LIMIT_STATUS * LANES]
                    doubt = np.int16(doubt | known | np.int16(1 if unusual else 0))
                    flag[j] = np.int16(0)
                    if with_skipping:
                        pressed = laws.outside(frequency, limits, at, LIMIT_IDLE)
                        loaded[j] = np.int16(1 if pressed else 0)
                        touched = np.int16(touched | loaded[j])
                if doubt != 0:
                    touched = np.int16(0)
                    for j in range(count):
                        flags = np.int16(
                            laws.judge(
                                incoming[cycle, first + j], counts[cycle, GEL, first + j],
                                counts[cycle, FREQUENCY, first + j],
                                counts[cycle, BX, first + j], counts[cycle, BY, first + j],
                                counts[cycle, BZ, first + j], counts[cycle, CHIP, first + j],
                                limits, k_limits + j,
                            )
                        )  # fmt: skip
                        flag[j] = flags
                        if with_skipping:
                            loaded[j] = np.int16(loaded[j] if flags & SILENT == 0 else 0)
                            touched = np.int16(touched | loaded[j])
                look = resting = rested = False  # block without load; shown as that already
                if with_skipping:
                    if with_looking:
                        look = (phase + cycle + block) % max(every, LOOK_CYCLES) == 0
                    resting = looked and touched == 0 and not look
                    rested = resting and reuse and seen[k_seen + RESTED * LANES] != 0
                    seen[k_seen + RESTED * LANES] = resting

                # -- temperature
                steady = False  # what is shown of temperatures stays as it is
                if warm:
                    fresh = True
                    if with_held:
                        # a unit that was not known when temperatures were due is decoded now
                        unheard = np.int16(0)
                        for j in range(count):
                            t = state[k_state + HELD * LANES + j]
                            known = flag[j] & UNKNOWN == 0
                            lost = (t != t) & known  # noqa: PLR0124
                            unheard = np.int16(unheard | (1 if lost else 0))
                        fresh = due or unheard != 0
                        if with_skipping:
                            steady = reuse and not fresh and heard == 0
                        if not steady:
                            for j in range(count):
                                tile[TEMPERATURE * LANES + j] = state[k_state + HELD * LANES + j]
                            if with_sigma:
                                for j in range(count):
                                    sigma = state[k_state + (HELD + 3) * LANES + j]
                                    tile[TEMPERATURE_SIGMA * LANES + j] = sigma
                        if not (steady and resting):
                            for j in range(count):
                                tile[FILM_ABOVE * LANES + j] = state[
                                    k_state + (HELD + 1) * LANES + j
                                ]
                            for j in range(count):
                                tile[CHIP_ABOVE * LANES + j] = state[
                                    k_state + (HELD + 2) * LANES + j
                                ]
                    if fresh:
                        for j in range(count):
                            flags = flag[j]
                            t, current = laws.temperature(
                                real(counts[cycle, GEL, first + j]), coefficients, k + j, single
                            )
                            keep = flags & INVALID == 0
                            held = False
                            if with_held:
                                old = tile[TEMPERATURE * LANES + j]
                                held = (not due) & (old == old)  # noqa: PLR0124
                                keep = keep & (not held)
                            film_above, chip_above = laws.follow(
                                t, real(counts[cycle, CHIP, first + j]), coefficients, k + j,
                                state, k_state + j, keep, advance | with_held,
                                with_film, with_chip, with_lagging,
                            )  # fmt: skip
                            if with_held:
                                t = tile[TEMPERATURE * LANES + j] if held else t
                                film_above = tile[FILM_ABOVE * LANES + j] if held else film_above
                                chip_above = tile[CHIP_ABOVE * LANES + j] if held else chip_above
                                known = flags & UNKNOWN == 0
                                state[k_state + HELD * LANES + j] = t if known else nothing
                                state[k_state + (HELD + 1) * LANES + j] = film_above
                                state[k_state + (HELD + 2) * LANES + j] = chip_above
                            tile[TEMPERATURE * LANES + j] = t
                            tile[FILM_ABOVE * LANES + j] = film_above
                            tile[CHIP_ABOVE * LANES + j] = chip_above
                    if fresh and with_sigma and with_temperature:
                        for j in range(count):
                            t, current = laws.temperature(
                                real(counts[cycle, GEL, first + j]), coefficients, k + j, single
                            )
                            sigma = laws.temperature_sigma(
                                tile[TEMPERATURE * LANES + j], current, coefficients, k + j
                            )
                            if with_held:
                                old = tile[TEMPERATURE_SIGMA * LANES + j]
                                held = (not due) & (old == old)  # noqa: PLR0124
                                sigma = old if held else sigma
                                known = flag[j] & UNKNOWN == 0
                                state[k_state + (HELD + 3) * LANES + j] = (
                                    sigma if known else nothing
                                )
                            tile[TEMPERATURE_SIGMA * LANES + j] = sigma

                # -- normal force
                if lateral:
                    for j in range(count):
                        c = k + j
                        frequency = real(counts[cycle, FREQUENCY, first + j])
                        depth = (
                            coefficients[c + DEPTH_SCALE * LANES] * frequency
                            + coefficients[c + DEPTH_OFFSET * LANES]
                        )
                        if background is not None:
                            fall = background[cycle, 0, first + j]
                            depth -= coefficients[c + PER_HZ * LANES] * fall
                        fz = laws.normal(depth, coefficients, c)
                        tile[H * LANES + j] = depth
                        tile[FZ * LANES + j] = fz
                        if with_sigma:
                            sigma = laws.depth_sigma(depth, coefficients, c)
                            tile[H_SIGMA * LANES + j] = sigma
                            tile[FZ_SIGMA * LANES + j] = laws.normal_sigma(
                                depth, sigma, fz, coefficients, c
                            )

                # -- what is not looked at shows nothing
                if with_skipping and looked and not look:
                    if not rested:
                        for row in TANGENTIAL:
                            for j in range(LANES):
                                tile[row * LANES + j] = nothing
                    for j in range(count):
                        flags = flag[j]
                        flag[j] = flags if flags & SILENT else flags | IDLE

                # -- field, tangential displacement and force, some lanes at a time
                if looked and not resting:
                    together = LANES
                    if with_skipping and touched != 0:
                        together = SKIP
                    for part in range((count + together - 1) // together):
                        start = (part * together) & NOT_NEGATIVE
                        size = min(together, count - start) & (2 * LANES - 1)
                        if with_skipping and not look:
                            busy = np.int16(0)
                            for lane in range(size):
                                busy = np.int16(busy | loaded[start + lane])
                            if busy == 0:
                                continue
                            for lane in range(size):
                                flag[start + lane] &= ~np.int16(IDLE)
                        for lane in range(size):
                            j = start + lane
                            c = k + j
                            film_above = tile[FILM_ABOVE * LANES + j]
                            chip_above = tile[CHIP_ABOVE * LANES + j]
                            x, y = laws.lateral(
                                real(counts[cycle, BX, first + j]),
                                real(counts[cycle, BY, first + j]),
                                chip_above, coefficients, c, with_chip,
                            )  # fmt: skip
                            z = zero
                            if upright:
                                z = laws.vertical(
                                    real(counts[cycle, BZ, first + j]), chip_above, coefficients, c,
                                    with_chip,
                                )  # fmt: skip
                            gain = laws.chip_gain(chip_above, coefficients, c, with_chip)
                            if background is not None:
                                bx = gain * background[cycle, 1, first + j]
                                by = gain * background[cycle, 2, first + j]
                                x -= (coefficients[c + MAP_XX * LANES] * bx
                                      + coefficients[c + MAP_XY * LANES] * by)  # fmt: skip
                                y -= (coefficients[c + MAP_YX * LANES] * bx
                                      + coefficients[c + MAP_YY * LANES] * by)  # fmt: skip
                                z -= gain * background[cycle, 3, first + j]
                            if with_field:
                                each = one / gain
                                tile[FIELD_X * LANES + j] = x * each
                                tile[FIELD_Y * LANES + j] = y * each
                                tile[FIELD_Z * LANES + j] = z * each
                            if not lateral:
                                continue

                            field2 = coefficients[c + FIELD_VARIANCE * LANES]
                            if background is not None:
                                field2 += background[cycle, 4, first + j]
                            depth = tile[H * LANES + j]
                            depth_sigma = tile[H_SIGMA * LANES + j]
                            gain *= laws.film_gain(film_above, coefficients, c, with_film)
                            strength = np.sqrt(x * x + y * y)
                            solid = max(strength, real(FIELD_MIN))
                            if with_angle:
                                reach, along, found, each = laws.by_angle(
                                    solid, z, field2, depth, depth_sigma, coefficients, c,
                                    with_sigma, single,
                                )  # fmt: skip
                                if with_anomaly:
                                    amplitude = gain * exp2(
                                        laws.octaves(depth, coefficients, c), single
                                    )
                                    found |= laws.anomaly(
                                        solid, z, reach, amplitude, one, coefficients, c
                                    )
                            else:
                                reach, along, found, each, inverse = laws.by_strength(
                                    solid, field2, depth, depth_sigma, gain, coefficients, c,
                                    with_sigma, single,
                                )  # fmt: skip
                                if with_anomaly:
                                    other, _, _, _ = laws.by_angle(
                                        solid, z, field2, depth, depth_sigma, coefficients, c,
                                        with_sigma, single,
                                    )  # fmt: skip
                                    found |= laws.anomaly(
                                        solid, z, other, one, inverse, coefficients, c
                                    )
                            limit = coefficients[c + REACH * LANES]
                            found |= EXTRAPOLATED if reach > limit else 0
                            flags = flag[j]
                            flag[j] = flags if flags & SILENT else flags | found

                            x *= each
                            y *= each
                            if with_turning:
                                x, y = laws.turn(x, y, coefficients, c, single)
                            outer = reach  # from the chip's axis
                            share = one if strength > zero else zero
                            if with_centring:
                                dx = reach * x - coefficients[c + FILM_X * LANES]
                                dy = reach * y - coefficients[c + FILM_Y * LANES]
                                reach = np.sqrt(dx * dx + dy * dy)
                                away = one / max(reach, real(FIELD_MIN))
                                x = dx * away
                                y = dy * away
                                share = one
                            law = laws.shear(reach, coefficients, c)
                            stiffening = (
                                coefficients[c + SHEAR_GAIN * LANES] * depth
                                + coefficients[c + SHEAR_GAIN_OFFSET * LANES]
                            )
                            ft = law * stiffening
                            if with_force:
                                tile[FX * LANES + j] = ft * x
                                tile[FY * LANES + j] = ft * y
                            if with_tangential:
                                tile[FT * LANES + j] = ft * share
                            if with_theta:
                                tile[THETA * LANES + j] = atan2(y, x, single)
                            if with_displacement:
                                tile[DX * LANES + j] = reach * x
                                tile[DY * LANES + j] = reach * y
                            if with_sigma:
                                beyond = real(EXTRAPOLATION) * max(outer - limit, zero)
                                along += beyond
                                along2 = along * along
                                # across the direction, R sigma / S, which has a limit at R = 0
                                aside = each * outer
                                across2 = min(field2 * (aside * aside), limit * limit)
                                across2 += coefficients[c + ANGLE_VARIANCE * LANES]
                                rate = one / max(reach, real(1e-12))
                                turned2 = across2 * (rate * rate)
                                if with_theta:
                                    most = real(1.8137993642342178)  # pi / sqrt(3)
                                    tile[THETA_SIGMA * LANES + j] = min(np.sqrt(turned2), most)
                                if with_displacement:
                                    tile[DX_SIGMA * LANES + j] = component(x, along2, across2)
                                    tile[DY_SIGMA * LANES + j] = component(y, along2, across2)
                                if with_force or with_tangential:
                                    along2 = laws.shear_variance(
                                        reach, along, law, stiffening, depth_sigma, coefficients, c,
                                    )  # fmt: skip
                                    across2 = ft * ft * turned2
                                    if with_tangential:
                                        tile[FT_SIGMA * LANES + j] = np.sqrt(along2)
                                    if with_force:
                                        tile[FX_SIGMA * LANES + j] = component(x, along2, across2)
                                        tile[FY_SIGMA * LANES + j] = component(y, along2, across2)

                # -- out
                for r in range(rows.size):
                    if steady and (HELD_BITS >> rows[r]) & 1:
                        continue
                    if rested and (TANGENTIAL_BITS >> rows[r]) & 1:
                        continue
                    at = (rows[r] * LANES) & NOT_NEGATIVE
                    for j in range(count):
                        out[cycle, r, first + j] = tile[at + j]
                    if doubt != 0:
                        for j in range(count):
                            if flag[j] & UNKNOWN != 0:
                                out[cycle, r, first + j] = nothing
                for j in range(count):
                    status[cycle, first + j] = flag[j] & ALL_FLAGS
                    valid[cycle, first + j] = flag[j] & INVALID == 0
        moment[PHASE] = phase + (counts.shape[0] if advance else 1)
        moment[REUSE] = 1

    return decode


@functools.cache
def decode(parts: Parts) -> Callable:
    """The kernel for `parts`, compiled."""
    return compiled(decode_python(parts), fastmath={"contract"})
