"""The laws of a unit, one unit at a time: from counts to temperature, depth, field, force, sigma.

Each takes the coefficients `c`, and `at`, where the unit's stand in them; they are inlined into the
kernel, where a loop runs over the lanes. So nothing here branches on a value: both sides are
computed and one is selected. The lateral field points the way of the tangential displacement: +x
force, +x displacement, +Bx.
"""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable

from skin.decode.functions import INLINED, OCTAVES_MAX, asin, atan, atan2, exp2, log2, sinc

from skin.decode.layout import (  # isort: skip
    ALL_FLAGS, AMPLITUDE_VARIANCE, ANGLE, ANGLE_END, ANGLE_VARIANCE, ANOMALY_FIELD,
    ANOMALY_SHARE, BX, BY, BZ, CHIP, CHIP_FOLLOWS, CHIP_GAIN, CHIP_KEEP, CHIP_LAG, CHIP_OFFSET,
    CHIP_SCALE, DEPTH_HIGH, DEPTH_LOW, DEPTH_SIGMA, EXTRAPOLATED, FILM_DRIFT, FILM_KEEP,
    FILM_LAG, FILM_REFERENCE, FREQUENCY, GEL, GEL_HIGH, GEL_LOW, GEL_OFFSET, GEL_SCALE,
    GEL_STEP, GEL_VARIANCE, GROWTH_0, GROWTH_1, GROWTH_2, KNOTS, LANES, LAST_TEMPERATURE,
    LIMIT_CALIBRATED, LIMIT_POSSIBLE, LIMIT_RAIL, LIMIT_STATUS, MAGNETIC_ANOMALY,
    NORMAL_VARIANCE, OUT_OF_RANGE, PER_OCTAVE, SATURATED, SHEAR_GAIN, SHEAR_SOFT,
    SHEAR_VARIANCE, SILENT, SOFT, TURN, WAVENUMBER, WAVENUMBER_INVERSE, X_BX, X_BY, X_DRIFT,
    X_OFFSET, Y_BX, Y_BY, Y_DRIFT, Y_OFFSET, Z_BZ, Z_DRIFT, Z_OFFSET,
)  # fmt: skip

CURRENT_MIN = 1e-6
"""Bound of the gel current over its value at 20 °C."""
GAIN_MIN = 0.1
"""Bound of the gain; only a temperature of a unit that is OUT_OF_RANGE reaches it."""
FIELD_MIN = 1e-6
"""µT: a lateral field below it has no direction, and is divided by this."""
DEPTH_MIN, DEPTH_MAX = -0.5, 4.0
"""mm: bounds of H in R(psi, H), whose cubics in H mean nothing far beyond their fit."""
EXTRAPOLATION = 0.2
"""What lies beyond the calibrated range adds this share of it to its one-sigma [assumed]: straight,
for a law that goes on otherwise than it is taken to is wrong the same way in every reading."""


# -- counts ----------------------------------------------------------------------------------------


@register_jitable(**INLINED)
def outside(count, limits, at, row):
    """Whether a count is outside a range of `limits`: one comparison modulo 2^16."""
    return beyond(count, limits[at + row * LANES], limits[at + (row + 1) * LANES])


@register_jitable(**INLINED)
def beyond(count, low, width):
    return (int(count) - int(low)) & 0xFFFF > int(width) & 0xFFFF


@register_jitable(**INLINED)
def range_of(limits, at, channel):
    """Lower end and width of the counts of a channel, of a block's first unit."""
    row = at + 2 * channel * LANES
    return limits[row], limits[row + LANES]


@register_jitable(**INLINED)
def judge(incoming, gel, frequency, bx, by, bz, chip, limits, at):
    """Flags of a unit from its counts alone, before anything is clamped."""
    railed = (
        outside(gel, limits, at, LIMIT_RAIL + 2 * GEL)
        | outside(frequency, limits, at, LIMIT_RAIL + 2 * FREQUENCY)
        | outside(bx, limits, at, LIMIT_RAIL + 2 * BX)
        | outside(by, limits, at, LIMIT_RAIL + 2 * BY)
        | outside(bz, limits, at, LIMIT_RAIL + 2 * BZ)
        | outside(chip, limits, at, LIMIT_RAIL + 2 * CHIP)
    )
    impossible = (
        outside(gel, limits, at, LIMIT_POSSIBLE)
        | outside(frequency, limits, at, LIMIT_POSSIBLE + 2)
        | outside(chip, limits, at, LIMIT_POSSIBLE + 4)
    )
    beyond = outside(gel, limits, at, LIMIT_CALIBRATED) | outside(
        frequency, limits, at, LIMIT_CALIBRATED + 2
    )
    known = int(incoming) | int(limits[at + LIMIT_STATUS * LANES])
    found = (
        (SATURATED if railed else 0)
        | (OUT_OF_RANGE if impossible else 0)
        | (EXTRAPOLATED if beyond else 0)
    )
    return (known if known & SILENT else known | found) & ALL_FLAGS


# -- temperature -----------------------------------------------------------------------------------


@register_jitable(**INLINED)
def temperature(gel, c, at, single):
    """Gel temperature from the exponential law of its current, and its current."""
    real = c.dtype.type
    current = max(c[at + GEL_SCALE * LANES] * gel + c[at + GEL_OFFSET * LANES], real(CURRENT_MIN))
    return real(20.0) + c[at + PER_OCTAVE * LANES] * log2(current, single), current


@register_jitable(**INLINED)
def temperature_sigma(t, current, c, at):
    real = c.dtype.type
    step = c[at + GEL_STEP * LANES] / current
    over = max(t - c[at + GEL_HIGH * LANES], c[at + GEL_LOW * LANES] - t)
    beyond = real(EXTRAPOLATION) * max(over, real(0.0))
    return np.sqrt(c[at + GEL_VARIANCE * LANES] + step * step) + beyond


@register_jitable(**INLINED)
def follow(t, chip_count, c, at, state, kept, keep, advance, film, chip, lagging):
    """Film and chip temperature above reference; both follow the gel.

    A unit that is invalid leaves no trace in the state. Without `advance`, the state is already
    that of this cycle.
    """
    real = c.dtype.type
    now = advance | (not keep)
    film_above = real(0.0)
    chip_above = real(0.0)
    if film or lagging:
        last = state[kept + LAST_TEMPERATURE * LANES]
        # NaN: no cycle before this one
        step = last - t if (last == last) & now else real(0.0)  # noqa: PLR0124
        state[kept + LAST_TEMPERATURE * LANES] = t if keep & now else last
        if film:
            was = state[kept + FILM_LAG * LANES]
            lag = (c[at + FILM_KEEP * LANES] if now else real(1.0)) * (was + step)
            state[kept + FILM_LAG * LANES] = lag if keep else was
            film_above = (t - c[at + FILM_REFERENCE * LANES]) + lag
        if lagging:
            was = state[kept + CHIP_LAG * LANES]
            lag = (c[at + CHIP_KEEP * LANES] if now else real(1.0)) * (was + step)
            state[kept + CHIP_LAG * LANES] = lag if keep else was
            chip_above = c[at + CHIP_FOLLOWS * LANES] * (t + lag)
    if chip:
        chip_above += c[at + CHIP_SCALE * LANES] * chip_count + c[at + CHIP_OFFSET * LANES]
    return film_above, chip_above


# -- normal force ----------------------------------------------------------------------------------


@register_jitable(**INLINED)
def _bent(x, c, at):
    """Force of a piecewise linear law whose three rows begin at `at`; not clipped at zero."""
    real = c.dtype.type
    return c[at] * x + c[at + 2 * LANES] * max(x - c[at + LANES], real(0.0))


@register_jitable(**INLINED)
def normal(depth, c, at):
    """Normal force at a depth."""
    return _bent(depth, c, at + SOFT * LANES)


@register_jitable(**INLINED)
def depth_sigma(depth, c, at):
    real = c.dtype.type
    over = max(depth - c[at + DEPTH_HIGH * LANES], c[at + DEPTH_LOW * LANES] - depth)
    return c[at + DEPTH_SIGMA * LANES] + real(EXTRAPOLATION) * max(over, real(0.0))


@register_jitable(**INLINED)
def normal_sigma(depth, sigma, force, c, at):
    """Half of what the force changes over the interval of the depth, and of the law itself."""
    real = c.dtype.type
    half = (normal(depth + sigma, c, at) - normal(depth - sigma, c, at)) * real(0.5)
    return np.sqrt(half * half + c[at + NORMAL_VARIANCE * LANES] * (force * force))


# -- field -----------------------------------------------------------------------------------------


@register_jitable(**INLINED)
def lateral(bx, by, chip_above, c, at, chip):
    """Lateral field without the chip's offset and its drift, mapped; the gain is left in."""
    x = c[at + X_BX * LANES] * bx + c[at + X_BY * LANES] * by + c[at + X_OFFSET * LANES]
    y = c[at + Y_BX * LANES] * bx + c[at + Y_BY * LANES] * by + c[at + Y_OFFSET * LANES]
    if chip:
        x += c[at + X_DRIFT * LANES] * chip_above
        y += c[at + Y_DRIFT * LANES] * chip_above
    return x, y


@register_jitable(**INLINED)
def vertical(bz, chip_above, c, at, chip):
    z = c[at + Z_BZ * LANES] * bz + c[at + Z_OFFSET * LANES]
    if chip:
        z += c[at + Z_DRIFT * LANES] * chip_above
    return z


@register_jitable(**INLINED)
def chip_gain(chip_above, c, at, chip):
    real = c.dtype.type
    if chip:
        return max(real(1.0) + c[at + CHIP_GAIN * LANES] * chip_above, real(GAIN_MIN))
    return real(1.0)


@register_jitable(**INLINED)
def film_gain(film_above, c, at, film):
    real = c.dtype.type
    if film:
        return max(real(1.0) + c[at + FILM_DRIFT * LANES] * film_above, real(GAIN_MIN))
    return real(1.0)


@register_jitable(**INLINED)
def octaves(depth, c, at):
    """log2(M0 / µT) at a depth, without the gains of film and chip."""
    real = c.dtype.type
    x = c[at + GROWTH_2 * LANES] * depth + c[at + GROWTH_1 * LANES]
    x = x * depth + c[at + GROWTH_0 * LANES]
    return min(max(x, real(-OCTAVES_MAX)), real(OCTAVES_MAX))


@register_jitable(**INLINED)
def _amplitude_variance(depth, sigma, c, at):
    """Relative variance of M0 at a depth that has a sigma."""
    real = c.dtype.type
    slope = real(2.0) * c[at + GROWTH_2 * LANES] * depth + c[at + GROWTH_1 * LANES]
    growth = real(0.6931471805599453) * slope * sigma
    return c[at + AMPLITUDE_VARIANCE * LANES] + growth * growth


# -- tangential displacement and force -------------------------------------------------------------


@register_jitable(**INLINED)
def by_strength(solid, field2, depth, depth_sigma, gain, c, at, with_sigma, single):
    """R = asin(S / M0) / k, its sigma, its flags, 1 / S and 1 / M0.

    The sigma is half of the interval of the arcsine, which has no slope at the crest.
    """
    real = c.dtype.type
    one = real(1.0)
    scale = c[at + WAVENUMBER_INVERSE * LANES]
    each = one / (solid * gain)  # one division for both quotients
    inverse = solid * each * exp2(-octaves(depth, c, at), single)
    ratio = min(solid * inverse, one)
    reach = scale * asin(ratio, single)
    noise2 = field2 * (inverse * inverse)
    square = ratio * ratio
    near2 = noise2 + square * _amplitude_variance(depth, c[at + DEPTH_SIGMA * LANES], c, at)
    below = one - ratio
    found = SATURATED if near2 >= below * below else 0
    sigma = real(0.0)
    if with_sigma:
        s = np.sqrt(noise2 + square * _amplitude_variance(depth, depth_sigma, c, at))
        low = ratio - s
        lower = asin(min(abs(low), one), single)
        lower = lower if low > real(0.0) else -lower
        sigma = real(0.5) * scale * (asin(min(ratio + s, one), single) - lower)
    return reach, sigma, found, each * gain, inverse


@register_jitable(**INLINED)
def _angle_row(i, h, c, at):
    """Factor of psi^(2 i + 1) in R(psi, H), a cubic in H."""
    row = at + (ANGLE + 4 * i) * LANES
    q = c[row + 3 * LANES] * h + c[row + 2 * LANES]
    return (q * h + c[row + LANES]) * h + c[row]


@register_jitable(**INLINED)
def _angle_slope(i, h, c, at):
    """Its derivative by H."""
    real = c.dtype.type
    row = at + (ANGLE + 4 * i) * LANES
    q = real(3.0) * c[row + 3 * LANES] * h + real(2.0) * c[row + 2 * LANES]
    return q * h + c[row + LANES]


@register_jitable(**INLINED)
def by_angle(solid, z, field2, depth, depth_sigma, c, at, with_sigma, single):
    """R(psi, H), psi = atan2(S, Bz), its sigma, its flags and 1 / S."""
    real = c.dtype.type
    upright = abs(z)
    big = max(solid, upright)
    quotient = real(1.0) / (solid * big)  # one division for both quotients
    psi = atan(min(solid, upright) * (solid * quotient), single)
    psi = real(1.5707963267948966) - psi if solid > upright else psi
    psi = real(3.141592653589793) - psi if z < real(0.0) else psi
    end = c[at + ANGLE_END * LANES]
    found = SATURATED if psi > end else 0
    p = min(psi, end)
    p2 = p * p
    h = min(max(depth, real(DEPTH_MIN)), real(DEPTH_MAX))
    q0 = _angle_row(0, h, c, at)
    q1 = _angle_row(1, h, c, at)
    q2 = _angle_row(2, h, c, at)
    q3 = _angle_row(3, h, c, at)
    reach = p * (((q3 * p2 + q2) * p2 + q1) * p2 + q0)
    sigma = real(0.0)
    if with_sigma:
        slope = ((real(7.0) * q3 * p2 + real(5.0) * q2) * p2 + real(3.0) * q1) * p2 + q0
        d3 = _angle_slope(3, h, c, at) * p2 + _angle_slope(2, h, c, at)
        d1 = (d3 * p2 + _angle_slope(1, h, c, at)) * p2 + _angle_slope(0, h, c, at)
        deeper = p * d1 * depth_sigma
        further = slope * (psi - p)
        turned2 = field2 / (solid * solid + z * z + field2)
        sigma = np.sqrt(
            slope * slope * turned2
            + deeper * deeper
            + further * further
            + c[at + ANGLE_VARIANCE * LANES]
        )
    return reach, sigma, found, big * quotient


@register_jitable(**INLINED)
def anomaly(solid, z, reach, amplitude, inverse, c, at):
    """Flag of a field that is not the film's: S against M0 sin(k R), R from the angle.

    At R = 0 this is Bz against the M0 that makes this R of this angle, so it is a check of the
    strength everywhere. Either M0 or its inverse is 1.
    """
    u = c[at + WAVENUMBER * LANES] * reach
    model = amplitude * (u * sinc(u))
    measured = solid * inverse
    off = measured - model
    square = solid * solid + z * z
    allowed = c[at + ANOMALY_SHARE * LANES] * (model * model) * square
    allowed += c[at + ANOMALY_FIELD * LANES] * (measured * measured)
    return 0 if off * off * square <= allowed else MAGNETIC_ANOMALY


@register_jitable(**INLINED)
def shear(reach, c, at):
    """Tangential force at a tangential displacement at the reference depth."""
    return _bent(reach, c, at + SHEAR_SOFT * LANES)


@register_jitable(**INLINED)
def shear_variance(reach, sigma, law, stiffening, depth_sigma, c, at):
    """Variance of the tangential force along its direction."""
    real = c.dtype.type
    half = shear(reach + sigma, c, at) - shear(reach - sigma, c, at)
    half *= real(0.5) * stiffening
    deeper = law * c[at + SHEAR_GAIN * LANES] * depth_sigma
    force = law * stiffening
    return half * half + deeper * deeper + c[at + SHEAR_VARIANCE * LANES] * (force * force)


@register_jitable(**INLINED)
def component(part, along2, across2):
    """Sigma of a component whose share of the direction is `part`; both are equal at R = 0."""
    return np.sqrt(across2 + part * part * (along2 - across2))


@register_jitable(**INLINED)
def turn(x, y, c, at, single):
    """Correct a direction by the unit's table, linear in theta between knots: a sum of ramps."""
    real = c.dtype.type
    along = atan2(y, x, single) + real(np.pi)
    turn = c[at + TURN * LANES] + c[at + (TURN + 1) * LANES] * along
    for p in range(1, KNOTS):
        ramp = max(along - real(p) * real(2.0 * np.pi / KNOTS), real(0.0))
        turn += c[at + (TURN + 1 + p) * LANES] * ramp
    z = turn * turn
    if single:
        sine = real(-1 / 5040)
        cosine = real(1 / 40320)
    else:
        sine = real(-1 / 1307674368000)
        sine = sine * z + real(1 / 6227020800)
        sine = sine * z + real(-1 / 39916800)
        sine = sine * z + real(1 / 362880)
        sine = sine * z + real(-1 / 5040)
        cosine = real(1 / 20922789888000)
        cosine = cosine * z + real(-1 / 87178291200)
        cosine = cosine * z + real(1 / 479001600)
        cosine = cosine * z + real(-1 / 3628800)
        cosine = cosine * z + real(1 / 40320)
    sine = (sine * z + real(1 / 120)) * z + real(-1 / 6)
    cosine = ((cosine * z + real(-1 / 720)) * z + real(1 / 24)) * z + real(-1 / 2)
    sine = turn + turn * (z * sine)
    cosine = real(1.0) + z * cosine
    return x * cosine - y * sine, x * sine + y * cosine
