"""All compiled code of decoding: counts in, forces and temperatures out.

The lateral field points the way of the tangential displacement: +x force, +x displacement, +Bx.

Units are decoded in blocks of `LANES`. Everything that differs from unit to unit stands in one flat
array of blocks, ``coefficients[(block * rows + row) * LANES + lane]``: one pointer and constant
offsets are what lets the compiler turn the loop over lanes into vector instructions; a row for
each parameter does not. For the same reason nothing branches on a value: both sides are computed
and one is selected, and counts and results pass through small tiles, so that this loop meets few
arrays that might overlap.

What is not wanted is passed as None and is not compiled. The type of `coefficients`, float32 or
float64, is the type of all arithmetic; polynomials are as long as that type needs.

The constants below are this file's own, on purpose: a compiled kernel is cached by the content of
its own file and would not see a change in another one.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = ["LANES", "decode", "decode_python"]

LANES = 16
"""Units in a block: float32 lanes of the widest vector registers."""

# -- channels: rows of the counts, in the order of `topology.CHANNELS` ----------------------------
CHANNELS = 6
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(CHANNELS)

# -- status: bits of `bus.status.Status` ----------------------------------------------------------
NEVER = 1 << 0
DISABLED = 1 << 6
SATURATED = 1 << 8
OUT_OF_RANGE = 1 << 9
EXTRAPOLATED = 1 << 10
NOT_F3T = 1 << 11
UNKNOWN = NEVER | NOT_F3T
SILENT = UNKNOWN | DISABLED
INVALID = 0xAFF
"""Flags with which array features leave a unit out."""

# -- limits: rows of int16; ranges are a row of lower and a row of upper ends, ends included ------
LIMIT_STATUS = 0
"""Flags that a unit has before a count has come: DISABLED, NOT_F3T."""
LIMIT_RAIL = 1
"""Counts off the rails, two rows a channel."""
LIMIT_POSSIBLE = LIMIT_RAIL + 2 * CHANNELS
"""Counts that a working unit produces: gel, frequency, chip temperature."""
LIMIT_CALIBRATED = LIMIT_POSSIBLE + 6
"""Counts within the calibrated range: gel, frequency."""
LIMIT_ROWS = LIMIT_CALIBRATED + 4

# -- coefficients ---------------------------------------------------------------------------------
(
    GEL_SCALE, GEL_OFFSET,  # gel current over its value at 20 °C = scale * count + offset
    ROOT_SCALE, ROOT_OFFSET,  # its fourth root, centred and scaled to [-1, 1]
    DROP_SCALE, DROP_OFFSET,  # fall of the frequency, Hz = scale * count + offset
    DEPTH_PER_HZ, SOFT, BREAK, STIFFER,  # H = DEPTH_PER_HZ * drop; N/Hz, Hz, N/Hz added
    FILM_KEEP, CHIP_KEEP,  # share of its lag behind the gel that is left after one cycle
    FILM_REFERENCE, FILM_DRIFT,
    CHIP_SCALE, CHIP_OFFSET, CHIP_FOLLOWS,  # chip above reference = scale * count + offset
    CHIP_GAIN,  #                             + follows * lagged gel temperature
    X_BX, X_BY, X_OFFSET, X_DRIFT,  # lateral field, 2x2 map, scales and offsets in one
    Y_BX, Y_BY, Y_OFFSET, Y_DRIFT,
    GROWTH, GROWTH_OFFSET, AMPLITUDE_INVERSE,  # 1 / M0 = inverse * exp(growth * drop + offset)
    WAVENUMBER_INVERSE, SHEAR_SOFT, SHEAR_BREAK, SHEAR_STIFFER, SHEAR_GAIN, SHEAR_GAIN_OFFSET,
    FIELD_VARIANCE, AMPLITUDE_VARIANCE,  # µT²; relative, of M0
    REACH,  # mm, end of the calibrated tangential displacement
) = range(38)  # fmt: skip
POLYNOMIAL = 38
"""First row of the temperature polynomial, lowest power first; its degree is that of the type."""
DEGREE_SINGLE = 8
DEGREE_DOUBLE = 16
ROWS_SINGLE = POLYNOMIAL + DEGREE_SINGLE + 1
ROWS_DOUBLE = POLYNOMIAL + DEGREE_DOUBLE + 1

KNOTS = 16
TURN_ROWS = KNOTS + 1
"""Rows after the polynomial, where any unit has a table of directions: correction at -pi, slope of
the first segment, changes of slope at the knots that follow."""

# -- state: rows ----------------------------------------------------------------------------------
LAST_TEMPERATURE, FILM_LAG, CHIP_LAG = range(3)
STATE_ROWS = 3
"""Kept as lag behind the gel, not as a temperature: a float32 lag goes on shrinking where a
float32 temperature would stop as soon as its step is below half a unit in the last place."""

# -- tiles: a chunk of units on its way through, rows of `CHUNK` --------------------------------
CHUNK = 8 * LANES
"""Units that are read, decoded and written together: enough that copying rows is cheap, few enough
that they stay in the nearest cache."""
FLAGS = CHANNELS
INTEGER_ROWS = CHANNELS + 1
TEMPERATURE, FX, FY, FZ, FT, THETA, DX, DY, H = range(9)
REAL_ROWS = 9

GROWTH_MAX = 6.0
"""Bound of ln(M0 / amplitude) for which `_exp` holds."""
GAIN_MIN = 0.1
"""Bound of the gain; only a temperature of a unit that is OUT_OF_RANGE reaches it."""

NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end: it
would turn every load into a gather to be able to do so."""

_OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}


@register_jitable(forceinline=True, **_OPTIONS)
def _exp(x, single):
    """exp(x) for abs(x) <= `GROWTH_MAX`: (exp(x/8))^8, exp(w) = 1 + w + w² Q(w), Q minimax."""
    real = type(x)
    w = x * real(0.125)
    if single:
        q = real(2.50743045481826305e-5)
        q = q * w + real(2.01142780522317605e-4)
        q = q * w + real(1.38881206464640076e-3)
        q = q * w + real(8.33256402633745957e-3)
        q = q * w + real(4.1666672071244184e-2)
        q = q * w + real(0.166666720793071515)
        q = q * w + real(0.5)
    else:
        q = real(1.61885913496451032e-10)
        q = q * w + real(2.10711788316914153e-9)
        q = q * w + real(2.5051287564594897e-8)
        q = q * w + real(2.75560871499112409e-7)
        q = q * w + real(2.7557321619452371e-6)
        q = q * w + real(2.48015908975275596e-5)
        q = q * w + real(1.98412698381107856e-4)
        q = q * w + real(1.38888888841464975e-3)
        q = q * w + real(8.33333333333485668e-3)
        q = q * w + real(4.16666666666895356e-2)
        q = q * w + real(0.166666666666666655)
        q = q * w + real(0.499999999999999821)
    e = real(1.0) + (w + w * w * q)
    e = e * e
    e = e * e
    return e * e


@register_jitable(forceinline=True, **_OPTIONS)
def _asin(x, single):
    """asin(x) for 0 <= x <= 1: x + x z P(z) up to 1/2, half-angle formula above, P minimax."""
    real = type(x)
    large = x > real(0.5)
    half = (real(1.0) - x) * real(0.5)
    z = half if large else x * x
    root = np.sqrt(half)
    s = root if large else x
    if single:
        p = real(0.0421663783)
        p = p * z + real(0.0241794679)
        p = p * z + real(0.0454703867)
        p = p * z + real(0.0749529749)
        p = p * z + real(0.166667521)
    else:
        p = real(0.031912187113470845)
        p = p * z + real(-0.016224133354533925)
        p = p * z + real(0.01952819040788433)
        p = p * z + real(0.0065280018758410675)
        p = p * z + real(0.01216920571244654)
        p = p * z + real(0.013885236330905664)
        p = p * z + real(0.017359704679101626)
        p = p * z + real(0.022371758055878783)
        p = p * z + real(0.030381959136741975)
        p = p * z + real(0.044642856828333854)
        p = p * z + real(0.07500000000337008)
        p = p * z + real(0.16666666666665408)
    r = s + s * (z * p)
    return real(1.5707963267948966) - (r + r) if large else r


@register_jitable(forceinline=True, **_OPTIONS)
def _atan2(y, x, single):
    """atan2(y, x); 0 at the origin, +pi on the negative x axis whatever the sign of y's zero."""
    real = type(x)
    ax = abs(x)
    ay = abs(y)
    steep = ay > ax
    t = (ax if steep else ay) / max(ay if steep else ax, real(1e-30))
    z = t * t
    if single:
        q = real(0.00292070303)
        q = q * z + real(-0.0163679719)
        q = q * z + real(0.0432119332)
        q = q * z + real(-0.0755222067)
        q = q * z + real(0.106660075)
        q = q * z + real(-0.142110556)
        q = q * z + real(0.199937731)
        q = q * z + real(-0.333331525)
    else:
        q = real(-1.1832505417555692e-05)
        q = q * z + real(0.0001368724853148122)
        q = q * z + real(-0.0007518472526973822)
        q = q * z + real(0.002622977891906089)
        q = q * z + real(-0.006575683344151699)
        q = q * z + real(0.012756172907694298)
        q = q * z + real(-0.020238706986393514)
        q = q * z + real(0.027567942297344678)
        q = q * z + real(-0.033750132001619734)
        q = q * z + real(0.03872640214042632)
        q = q * z + real(-0.04308119655330471)
        q = q * z + real(0.04752086773576656)
        q = q * z + real(-0.05261265735709454)
        q = q * z + real(0.05882074956371294)
        q = q * z + real(-0.06666636435777692)
        q = q * z + real(0.07692305354678655)
        q = q * z + real(-0.09090908969557403)
        q = q * z + real(0.11111111107234799)
        q = q * z + real(-0.14285714285648404)
        q = q * z + real(0.19999999999999554)
        q = q * z + real(-0.3333333333333333)
    a = t + t * (z * q)
    a = real(1.5707963267948966) - a if steep else a
    a = real(3.141592653589793) - a if x < real(0.0) else a
    return -a if y < real(0.0) else a


@register_jitable(forceinline=True, **_OPTIONS)
def _outside(count, limits, at, row):
    """Whether a count is outside a range of `limits`."""
    return (count < limits[at + row * LANES]) | (count > limits[at + (row + 1) * LANES])


@register_jitable(forceinline=True, **_OPTIONS)
def _judge(integers, i, limits, at):
    """Flags of a unit from its counts alone, before anything is clamped."""
    gel = integers[i + GEL * CHUNK]
    frequency = integers[i + FREQUENCY * CHUNK]
    railed = (
        _outside(gel, limits, at, LIMIT_RAIL + 2 * GEL)
        | _outside(frequency, limits, at, LIMIT_RAIL + 2 * FREQUENCY)
        | _outside(integers[i + BX * CHUNK], limits, at, LIMIT_RAIL + 2 * BX)
        | _outside(integers[i + BY * CHUNK], limits, at, LIMIT_RAIL + 2 * BY)
        | _outside(integers[i + CHIP * CHUNK], limits, at, LIMIT_RAIL + 2 * CHIP)
    )
    impossible = (
        _outside(gel, limits, at, LIMIT_POSSIBLE)
        | _outside(frequency, limits, at, LIMIT_POSSIBLE + 2)
        | _outside(integers[i + CHIP * CHUNK], limits, at, LIMIT_POSSIBLE + 4)
    )
    beyond = _outside(gel, limits, at, LIMIT_CALIBRATED) | _outside(
        frequency, limits, at, LIMIT_CALIBRATED + 2
    )
    known = integers[i + FLAGS * CHUNK] | limits[at + LIMIT_STATUS * LANES]
    found = (
        (SATURATED if railed else 0)
        | (OUT_OF_RANGE if impossible else 0)
        | (EXTRAPOLATED if beyond else 0)
    )
    return known if known & SILENT else known | found


@register_jitable(forceinline=True, **_OPTIONS)
def _temperature(gel, c, at, single):
    """Gel temperature: a polynomial in the fourth root of the current."""
    real = c.dtype.type
    current = c[at + GEL_SCALE * LANES] * gel + c[at + GEL_OFFSET * LANES]
    root = np.sqrt(np.sqrt(max(current, real(0.0))))
    z = c[at + ROOT_SCALE * LANES] * root + c[at + ROOT_OFFSET * LANES]
    degree = DEGREE_SINGLE if single else DEGREE_DOUBLE
    t = c[at + (POLYNOMIAL + degree) * LANES]
    for p in range(degree):
        t = t * z + c[at + (POLYNOMIAL + degree - 1 - p) * LANES]
    return t


@register_jitable(forceinline=True, **_OPTIONS)
def _follow(t, chip, c, at, state, kept, keep):
    """Film and chip temperature above reference; both follow the gel.

    A unit that is invalid leaves no trace in the state.
    """
    real = c.dtype.type
    last = state[kept + LAST_TEMPERATURE * LANES]
    film_was = state[kept + FILM_LAG * LANES]
    chip_was = state[kept + CHIP_LAG * LANES]
    step = last - t if last == last else real(0.0)  # noqa: PLR0124 - NaN: no cycle before this one
    film_lag = c[at + FILM_KEEP * LANES] * (film_was + step)
    chip_lag = c[at + CHIP_KEEP * LANES] * (chip_was + step)
    state[kept + LAST_TEMPERATURE * LANES] = t if keep else last
    state[kept + FILM_LAG * LANES] = film_lag if keep else film_was
    state[kept + CHIP_LAG * LANES] = chip_lag if keep else chip_was
    film_above = (t - c[at + FILM_REFERENCE * LANES]) + film_lag
    chip_above = (c[at + CHIP_SCALE * LANES] * chip + c[at + CHIP_OFFSET * LANES]
                  + c[at + CHIP_FOLLOWS * LANES] * (t + chip_lag))  # fmt: skip
    return film_above, chip_above


@register_jitable(forceinline=True, **_OPTIONS)
def _normal(frequency, c, at):
    """Fall of the frequency and normal force: piecewise linear, and not clipped at zero."""
    real = c.dtype.type
    drop = c[at + DROP_SCALE * LANES] * frequency + c[at + DROP_OFFSET * LANES]
    stiffer = c[at + STIFFER * LANES] * max(drop - c[at + BREAK * LANES], real(0.0))
    return drop, c[at + SOFT * LANES] * drop + stiffer


@register_jitable(forceinline=True, **_OPTIONS)
def _field(bx, by, chip_above, c, at):
    """Lateral field without the chip's offset and its drift, mapped; the gain is left in."""
    x = (c[at + X_BX * LANES] * bx + c[at + X_BY * LANES] * by
         + (c[at + X_OFFSET * LANES] + c[at + X_DRIFT * LANES] * chip_above))  # fmt: skip
    y = (c[at + Y_BX * LANES] * bx + c[at + Y_BY * LANES] * by
         + (c[at + Y_OFFSET * LANES] + c[at + Y_DRIFT * LANES] * chip_above))  # fmt: skip
    return x, y


@register_jitable(forceinline=True, **_OPTIONS)
def _crest_inverse(drop, film_above, chip_above, c, at, single):
    """1 / M0 as the chip would measure it, at this depth and these temperatures."""
    real = c.dtype.type
    growth = c[at + GROWTH * LANES] * drop + c[at + GROWTH_OFFSET * LANES]
    growth = min(max(growth, real(-GROWTH_MAX)), real(GROWTH_MAX))
    gain = (real(1.0) + c[at + CHIP_GAIN * LANES] * chip_above) * (
        real(1.0) + c[at + FILM_DRIFT * LANES] * film_above
    )
    return c[at + AMPLITUDE_INVERSE * LANES] * _exp(growth, single) / max(gain, real(GAIN_MIN))


@register_jitable(forceinline=True, **_OPTIONS)
def _shear(reach, drop, c, at):
    """Tangential force at a tangential displacement: piecewise linear, stiffening with depth."""
    real = c.dtype.type
    stiffer = c[at + SHEAR_STIFFER * LANES] * max(reach - c[at + SHEAR_BREAK * LANES], real(0.0))
    gain = c[at + SHEAR_GAIN * LANES] * drop + c[at + SHEAR_GAIN_OFFSET * LANES]
    return (c[at + SHEAR_SOFT * LANES] * reach + stiffer) * gain


@register_jitable(forceinline=True, **_OPTIONS)
def _doubt(ratio, inverse, reach, c, at):
    """Flags of the tangential displacement: within one sigma of the crest, beyond calibration."""
    real = c.dtype.type
    variance = c[at + FIELD_VARIANCE * LANES] * (inverse * inverse) + c[
        at + AMPLITUDE_VARIANCE * LANES
    ] * (ratio * ratio)
    below = real(1.0) - ratio
    return (SATURATED if variance >= below * below else 0) | (
        EXTRAPOLATED if reach > c[at + REACH * LANES] else 0
    )


@register_jitable(forceinline=True, **_OPTIONS)
def _turn(x, y, c, at, single):
    """Correct a direction by the unit's table, linear in theta between knots: a sum of ramps."""
    real = c.dtype.type
    along = _atan2(y, x, single) + real(np.pi)
    rows = ROWS_SINGLE if single else ROWS_DOUBLE
    turn = c[at + rows * LANES] + c[at + (rows + 1) * LANES] * along
    for p in range(1, KNOTS):
        ramp = max(along - real(p) * real(2.0 * np.pi / KNOTS), real(0.0))
        turn += c[at + (rows + 1 + p) * LANES] * ramp
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


def decode_python(
    counts, incoming, coefficients, limits, turning, state,
    temperature, force, tangential, theta, displacement, status, valid,
):  # fmt: skip
    """Decode t cycles of n units, one cycle after the other.

    Parameters
    ----------
    counts : ndarray, shape (t, c, n), int16
    incoming : ndarray, shape (t, n), uint16
        Status flags of the bus.
    coefficients : ndarray, shape (b * rows * LANES,), float32 or float64
        Calibration, a block for every `LANES` units, or a single block that all share.
    limits : ndarray, shape (b * LIMIT_ROWS * LANES,), int16
        Ranges of counts, blocked in the same way.
    turning : bool or None
        Whether the blocks hold corrections of the direction; None where no unit has a table.
    state : ndarray, shape (b * STATE_ROWS * LANES,)
        What one cycle leaves to the next, always a block for every `LANES` units.
    temperature : ndarray, shape (t, n), or None
    force : ndarray, shape (t, 3, n), or None
    tangential : ndarray, shape (t, n), or None
    theta : ndarray, shape (t, n), or None
    displacement : ndarray, shape (t, 3, n), or None
        Outputs; None is not computed.
    status : ndarray, shape (t, n), uint16
    valid : ndarray, shape (t, n), bool
    """
    real = coefficients.dtype.type
    one = real(1.0)
    nothing = real(np.nan)
    single = np.finfo(coefficients.dtype).bits == 32
    rows = ROWS_SINGLE if single else ROWS_DOUBLE
    if turning is not None:
        rows += TURN_ROWS
    units = counts.shape[2]
    chunks = (units + CHUNK - 1) // CHUNK
    shared = coefficients.size < (units + LANES - 1) // LANES * rows * LANES
    integers = np.zeros(INTEGER_ROWS * CHUNK, np.int32)
    tile = np.empty(REAL_ROWS * CHUNK, coefficients.dtype)
    for cycle in range(counts.shape[0]):
        for chunk in range(chunks):
            first = chunk * CHUNK
            count = min(CHUNK, units - first)
            for channel in range(CHANNELS):
                for j in range(count):
                    integers[channel * CHUNK + j] = counts[cycle, channel, first + j]
            for j in range(count):
                integers[FLAGS * CHUNK + j] = incoming[cycle, first + j]

            for b in range((count + LANES - 1) // LANES):
                k = 0 if shared else chunk * (CHUNK // LANES) + b
                at = (k * LIMIT_ROWS * LANES) & NOT_NEGATIVE
                for j in range(LANES):
                    i = b * LANES + j
                    integers[i + FLAGS * CHUNK] = _judge(integers, i, limits, at + j)

            for b in range((count + LANES - 1) // LANES):
                block = chunk * (CHUNK // LANES) + b
                start = b * LANES
                k = 0 if shared else block
                k_coefficients = (k * rows * LANES) & NOT_NEGATIVE
                k_state = (block * STATE_ROWS * LANES) & NOT_NEGATIVE
                for j in range(LANES):
                    i = start + j
                    c = k_coefficients + j
                    flags = integers[i + FLAGS * CHUNK]
                    unknown = flags & UNKNOWN != 0
                    t = _temperature(real(integers[i + GEL * CHUNK]), coefficients, c, single)
                    if temperature is not None:
                        tile[i + TEMPERATURE * CHUNK] = nothing if unknown else t
                    if (
                        force is not None
                        or tangential is not None
                        or theta is not None
                        or displacement is not None
                    ):
                        film_above, chip_above = _follow(
                            t, real(integers[i + CHIP * CHUNK]), coefficients, c,
                            state, k_state + j, flags & INVALID == 0,
                        )  # fmt: skip
                        drop, fz = _normal(real(integers[i + FREQUENCY * CHUNK]), coefficients, c)
                        x, y = _field(
                            real(integers[i + BX * CHUNK]), real(integers[i + BY * CHUNK]),
                            chip_above, coefficients, c,
                        )  # fmt: skip
                        inverse = _crest_inverse(
                            drop, film_above, chip_above, coefficients, c, single
                        )
                        strength = np.sqrt(x * x + y * y)
                        ratio = min(strength * inverse, one)
                        reach = coefficients[c + WAVENUMBER_INVERSE * LANES] * _asin(ratio, single)
                        ft = _shear(reach, drop, coefficients, c)
                        found = _doubt(ratio, inverse, reach, coefficients, c)
                        integers[i + FLAGS * CHUNK] = flags if flags & SILENT else flags | found
                        each = one / max(strength, real(1e-30))
                        x *= each
                        y *= each
                        if turning is not None:
                            x, y = _turn(x, y, coefficients, c, single)
                        if force is not None:
                            tile[i + FX * CHUNK] = nothing if unknown else ft * x
                            tile[i + FY * CHUNK] = nothing if unknown else ft * y
                            tile[i + FZ * CHUNK] = nothing if unknown else fz
                        if tangential is not None:
                            tile[i + FT * CHUNK] = nothing if unknown else ft
                        if theta is not None:
                            tile[i + THETA * CHUNK] = nothing if unknown else _atan2(y, x, single)
                        if displacement is not None:
                            h = coefficients[c + DEPTH_PER_HZ * LANES] * drop
                            tile[i + DX * CHUNK] = nothing if unknown else reach * x
                            tile[i + DY * CHUNK] = nothing if unknown else reach * y
                            tile[i + H * CHUNK] = nothing if unknown else h

            for j in range(count):
                status[cycle, first + j] = integers[FLAGS * CHUNK + j]
            for j in range(count):
                valid[cycle, first + j] = integers[FLAGS * CHUNK + j] & INVALID == 0
            if temperature is not None:
                for j in range(count):
                    temperature[cycle, first + j] = tile[TEMPERATURE * CHUNK + j]
            if force is not None:
                for i in range(3):
                    for j in range(count):
                        force[cycle, i, first + j] = tile[(FX + i) * CHUNK + j]
            if tangential is not None:
                for j in range(count):
                    tangential[cycle, first + j] = tile[FT * CHUNK + j]
            if theta is not None:
                for j in range(count):
                    theta[cycle, first + j] = tile[THETA * CHUNK + j]
            if displacement is not None:
                for i in range(3):
                    for j in range(count):
                        displacement[cycle, i, first + j] = tile[(DX + i) * CHUNK + j]


decode = njit(decode_python, nogil=True, cache=True, **_OPTIONS)
