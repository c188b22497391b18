"""All compiled code of decoding: counts in, forces, temperatures and their uncertainty out.

The lateral field points the way of the tangential displacement: +x force, +x displacement, +Bx.

Units are decoded in blocks of `LANES`, a block after the other: its counts are copied into a tile,
loops over the lanes compute rows of a second tile, and the wanted rows go out. Everything that
differs from unit to unit stands in one flat array of blocks, ``coefficients[(block * ROWS + row) *
LANES + lane]``: one pointer and constant offsets are what lets the compiler turn the loops over
lanes into vector instructions; a row that is not read is never fetched. For the same reason nothing
in these loops branches on a value: both sides are computed and one is selected.

`Parts` says what is compiled; the type of `coefficients`, float32 or float64, is the type of all
arithmetic, and polynomials are as long as that type needs.

The constants below are this file's own, on purpose: a compiled kernel is cached by the content of
its own file and would not see a change in another one.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload, register_jitable

from bus.jit import ahead, apart

__all__ = ["LANES", "Parts", "decode", "decode_python"]

LANES = 128
"""Units in a block: enough that what is done once for a block is cheap, few enough that it stays in
the nearest cache."""
SKIP = 16
"""Units that are left out together; a vector of float32."""
FAR = 1 << 17
"""Units from which on the next block is fetched ahead: they do not fit the second cache."""
LOOK_CYCLES = 4
"""Cycles, at least, from one look at units without load to the next."""

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
MAGNETIC_ANOMALY = 1 << 12
IDLE = 1 << 13
UNKNOWN = NEVER | NOT_F3T
SILENT = UNKNOWN | DISABLED
INVALID = 0x1AFF
ALL_FLAGS = 0x3FFF
"""Flags with which array features leave a unit out."""

# -- limits: rows of int16; a range is a row of lower ends and one of widths, modulo 2^16 ----------
LIMIT_STATUS = 0
"""Flags that a unit has before a count has come: DISABLED, NOT_F3T."""
LIMIT_RAIL = 1
"""Counts off the rails, two rows a channel."""
LIMIT_POSSIBLE = LIMIT_RAIL + 2 * CHANNELS
"""Counts that a working unit produces: gel, frequency, chip temperature."""
LIMIT_CALIBRATED = LIMIT_POSSIBLE + 6
"""Counts within the calibrated range: gel, frequency."""
LIMIT_IDLE = LIMIT_CALIBRATED + 4
"""Frequency counts of a unit without load."""
LIMIT_USUAL = LIMIT_IDLE + 2
"""Counts that raise no flag, two rows a channel: the unit's own of gel and frequency, those of all
units of the others, of which one lane is read."""
LIMIT_ROWS = LIMIT_USUAL + 2 * CHANNELS
UNUSUAL = 1 << 14
"""In `LIMIT_STATUS`: no counts are usual."""

# -- coefficients ---------------------------------------------------------------------------------
(
    GEL_SCALE, GEL_OFFSET, PER_OCTAVE,  # I / I(20 °C) = scale * count + offset; °C an octave
    DEPTH_SCALE, DEPTH_OFFSET,  # H in mm = scale * count + offset
    SOFT, BREAK, STIFFER,  # N/mm, mm, N/mm added beyond
    FILM_KEEP, CHIP_KEEP,  # share of its lag behind the gel that is left after one step
    FILM_REFERENCE, FILM_DRIFT,
    CHIP_SCALE, CHIP_OFFSET, CHIP_FOLLOWS,  # chip above reference = scale * count + offset
    CHIP_GAIN,  #                             + follows * lagged gel temperature
    X_BX, X_BY, X_OFFSET, X_DRIFT,  # field; lateral with its 2x2 map, scales and offsets in one
    Y_BX, Y_BY, Y_OFFSET, Y_DRIFT,
    Z_BZ, Z_OFFSET, Z_DRIFT,
    GROWTH_0, GROWTH_1, GROWTH_2,  # log2(M0 / µT) in powers of H
    WAVENUMBER, WAVENUMBER_INVERSE,
    ANGLE_END,  # rad, beyond which R from the angle is a lower bound
    SHEAR_SOFT, SHEAR_BREAK, SHEAR_STIFFER, SHEAR_GAIN, SHEAR_GAIN_OFFSET,
    REACH,  # mm, end of the calibrated tangential displacement
    FIELD_VARIANCE, AMPLITUDE_VARIANCE,  # µT²; relative, of M0 at a known depth
    DEPTH_SIGMA, DEPTH_LOW, DEPTH_HIGH,  # mm; ends of the calibrated range
    ANOMALY_SHARE, ANOMALY_FIELD,  # squared tolerance of the field: relative, µT²
    PER_HZ, MAP_XX, MAP_XY, MAP_YX, MAP_YY,  # for a background: mm/Hz, the 2x2 map alone
    GEL_VARIANCE, GEL_STEP, GEL_LOW, GEL_HIGH,  # °C²; °C at I(20 °C); ends of the range
    NORMAL_VARIANCE, ANGLE_VARIANCE, SHEAR_VARIANCE,  # relative; mm², of a component; relative
    FILM_X, FILM_Y,  # mm, middle of the film off the chip's axis
) = range(60)  # fmt: skip
ANGLE = 60
"""First of 16 rows of R(psi, H), entry 4 i + j of ``psi^(2 i + 1) H^j``."""
KNOTS = 16
TURN = ANGLE + 16
"""First of 17 rows of the direction's correction: at -pi, slope of the first segment, changes of
slope at the knots that follow."""
ROWS = TURN + KNOTS + 1

# -- state: rows ----------------------------------------------------------------------------------
LAST_TEMPERATURE, FILM_LAG, CHIP_LAG, HELD = range(4)
STATE_ROWS = HELD + 4
"""Kept as lag behind the gel, not as a temperature: a float32 lag goes on shrinking where a
float32 temperature would stop as soon as its step is below half a unit in the last place. From
`HELD` on, there where a plan holds temperatures: rows `TEMPERATURE` to `CHIP_ABOVE` and
`TEMPERATURE_SIGMA` of the tile."""

# -- what differs from call to call ----------------------------------------------------------------
MOMENT = 5
PHASE, ADVANCE, REUSE, FIRST, LAST = range(MOMENT)

# -- tiles: one block on its way through -----------------------------------------------------------
SEEN_FLAGS, RESTED = CHANNELS, CHANNELS + 1
"""Of `seen`, beside the counts: the flags; one lane that says whether the block showed nothing
tangential."""
SEEN_ROWS = CHANNELS + 2
(
    TEMPERATURE, FILM_ABOVE, CHIP_ABOVE,
    FX, FY, FZ, FT, THETA, DX, DY, H,
    TEMPERATURE_SIGMA, FX_SIGMA, FY_SIGMA, FZ_SIGMA, FT_SIGMA, THETA_SIGMA,
    DX_SIGMA, DY_SIGMA, H_SIGMA,
    FIELD_X, FIELD_Y, FIELD_Z,
) = range(23)  # fmt: skip
TILE_ROWS = 23
TANGENTIAL = (FX, FY, FT, THETA, DX, DY, FX_SIGMA, FY_SIGMA, FT_SIGMA, THETA_SIGMA, DX_SIGMA,
              DY_SIGMA, FIELD_X, FIELD_Y, FIELD_Z)  # fmt: skip
"""What a block without load does not show."""
HELD_BITS = 1 << TEMPERATURE | 1 << FILM_ABOVE | 1 << TEMPERATURE_SIGMA
TANGENTIAL_BITS = sum(1 << row for row in TANGENTIAL)

CURRENT_MIN = 1e-6
"""Bound of the gel current over its value at 20 °C."""
OCTAVES_MAX = 24.0
"""Bound of log2(M0 / µT)."""
GAIN_MIN = 0.1
"""Bound of the gain; only a temperature of a unit that is OUT_OF_RANGE reaches it."""
FIELD_MIN = 1e-6
"""µT: a lateral field below it has no direction, and is divided by this."""
DEPTH_MIN, DEPTH_MAX = -0.5, 4.0
"""mm: bounds of H in R(psi, H), whose cubics in H mean nothing far beyond their fit."""
EXTRAPOLATION = 0.2
"""What lies beyond the calibrated range adds this share of it to its one-sigma [assumed]: straight,
for a law that goes on otherwise than it is taken to is wrong the same way in every reading."""

NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end: it
would turn every load into a gather to be able to do so."""

_OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}


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


# -- elementary functions --------------------------------------------------------------------------


def _split(x):
    """Exponent and mantissa, x = mantissa * 2^exponent, mantissa in [sqrt(1/2), sqrt(2)]."""
    return _split_single(x) if x.dtype == np.float32 else _split_double(x)


@register_jitable(forceinline=True, **_OPTIONS)
def _split_single(x):
    bits = np.float32(x).view(np.int32)
    exponent = np.int32(np.int32(bits - np.int32(0x3F3504F3)) >> np.int32(23))
    mantissa = np.int32(bits - np.int32(exponent << np.int32(23))).view(np.float32)
    return np.float32(exponent), mantissa


@register_jitable(forceinline=True, **_OPTIONS)
def _split_double(x):
    bits = np.float64(x).view(np.int64)
    exponent = (bits - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    return np.float64(exponent), np.int64(bits - (exponent << np.int64(52))).view(np.float64)


@overload(_split, jit_options={"forceinline": True, **_OPTIONS})
def _split_of(x):
    return _split_single if x == types.float32 else _split_double


def _power(exponent):
    """2^exponent, for a whole number that the type of the result holds, as float32 or float64."""
    return _power_single(exponent) if exponent.dtype == np.float32 else _power_double(exponent)


@register_jitable(forceinline=True, **_OPTIONS)
def _power_single(exponent):
    return np.int32((np.int32(exponent) + np.int32(127)) << np.int32(23)).view(np.float32)


@register_jitable(forceinline=True, **_OPTIONS)
def _power_double(exponent):
    return np.int64((np.int64(exponent) + np.int64(1023)) << np.int64(52)).view(np.float64)


@overload(_power, jit_options={"forceinline": True, **_OPTIONS})
def _power_of(exponent):
    return _power_single if exponent == types.float32 else _power_double


@register_jitable(forceinline=True, **_OPTIONS)
def _log2(x, single):
    """log2(x), x > 0: log2(1 + f) = f P(f), or s P(s²) with s = f / (2 + f); P minimax."""
    real = type(x)
    exponent, mantissa = _split(x)
    f = mantissa - real(1.0)
    if single:
        p = real(-0.14581172087755081)
        p = p * f + real(0.2340423629738389)
        p = p * f + real(-0.2488768532369355)
        p = p * f + real(0.28709870130108107)
        p = p * f + real(-0.36023964083131366)
        p = p * f + real(0.4809232422051029)
        p = p * f + real(-0.72135278803747874)
        p = p * f + real(1.4426949619877482)
        return exponent + f * p
    s = f / (real(2.0) + f)
    z = s * s
    p = real(0.21367078472987187)
    p = p * z + real(0.2209118661176815)
    p = p * z + real(0.26233440178471734)
    p = p * z + real(0.32059853392543478)
    p = p * z + real(0.41219858585107806)
    p = p * z + real(0.57707801634547034)
    p = p * z + real(0.96179669392598982)
    p = p * z + real(2.8853900817779268)
    return exponent + s * p


@register_jitable(forceinline=True, **_OPTIONS)
def _exp2(x, single):
    """2^x for abs(x) <= `OCTAVES_MAX`: the nearest whole power, and a minimax polynomial."""
    real = type(x)
    whole = np.floor(x + real(0.5))
    f = x - whole
    if single:
        p = real(0.0013276472631950876)
        p = p * f + real(0.0096755413431213274)
        p = p * f + real(0.055507132718556442)
        p = p * f + real(0.2402211972371072)
        p = p * f + real(0.69314696706503521)
        p = p * f + real(1.0000000716547141)
    else:
        p = real(4.4352827069572772e-10)
        p = p * f + real(7.0741056135081428e-9)
        p = p * f + real(1.0178198021671931e-7)
        p = p * f + real(1.3215433089676399e-6)
        p = p * f + real(1.5252733489988526e-5)
        p = p * f + real(0.00015403530462514432)
        p = p * f + real(0.0013333558146789922)
        p = p * f + real(0.0096181291075883352)
        p = p * f + real(0.055504108664819922)
        p = p * f + real(0.24022650695910156)
        p = p * f + real(0.69314718055994533)
        p = p * f + real(1.0)
    return p * _power(whole)


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
def _atan(t, single):
    """atan(t) for 0 <= t <= 1: t + t z Q(z), z = t², Q minimax."""
    real = type(t)
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
    return t + t * (z * q)


@register_jitable(forceinline=True, **_OPTIONS)
def _atan2(y, x, single):
    """atan2(y, x); 0 at the origin, +pi on the negative x axis whatever the sign of y's zero."""
    real = type(x)
    ax = abs(x)
    ay = abs(y)
    steep = ay > ax
    a = _atan((ax if steep else ay) / max(ay if steep else ax, real(1e-30)), single)
    a = real(1.5707963267948966) - a if steep else a
    a = real(3.141592653589793) - a if x < real(0.0) else a
    return -a if y < real(0.0) else a


@register_jitable(forceinline=True, **_OPTIONS)
def _sinc(x):
    """sin(x) / x for abs(x) <= 2.5, within 1e-6."""
    real = type(x)
    z = x * x
    p = real(2.3491531600972428e-6)
    p = p * z + real(-0.00019594609593602644)
    p = p * z + real(0.008326980398387261)
    p = p * z + real(-0.16666065747441654)
    return p * z + real(0.99999901365734746)


# -- counts ----------------------------------------------------------------------------------------


@register_jitable(forceinline=True, **_OPTIONS)
def _outside(count, limits, at, row):
    """Whether a count is outside a range of `limits`: one comparison modulo 2^16."""
    return _beyond(count, limits[at + row * LANES], limits[at + (row + 1) * LANES])


@register_jitable(forceinline=True, **_OPTIONS)
def _beyond(count, low, width):
    return (int(count) - int(low)) & 0xFFFF > int(width) & 0xFFFF


@register_jitable(forceinline=True, **_OPTIONS)
def _range(limits, at, channel):
    """Lower end and width of the counts of a channel, of a block's first unit."""
    row = at + 2 * channel * LANES
    return limits[row], limits[row + LANES]


@register_jitable(forceinline=True, **_OPTIONS)
def _judge(incoming, gel, frequency, bx, by, bz, chip, limits, at):
    """Flags of a unit from its counts alone, before anything is clamped."""
    railed = (
        _outside(gel, limits, at, LIMIT_RAIL + 2 * GEL)
        | _outside(frequency, limits, at, LIMIT_RAIL + 2 * FREQUENCY)
        | _outside(bx, limits, at, LIMIT_RAIL + 2 * BX)
        | _outside(by, limits, at, LIMIT_RAIL + 2 * BY)
        | _outside(bz, limits, at, LIMIT_RAIL + 2 * BZ)
        | _outside(chip, limits, at, LIMIT_RAIL + 2 * CHIP)
    )
    impossible = (
        _outside(gel, limits, at, LIMIT_POSSIBLE)
        | _outside(frequency, limits, at, LIMIT_POSSIBLE + 2)
        | _outside(chip, limits, at, LIMIT_POSSIBLE + 4)
    )
    beyond = _outside(gel, limits, at, LIMIT_CALIBRATED) | _outside(
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


@register_jitable(forceinline=True, **_OPTIONS)
def _temperature(gel, c, at, single):
    """Gel temperature from the exponential law of its current, and its current."""
    real = c.dtype.type
    current = max(c[at + GEL_SCALE * LANES] * gel + c[at + GEL_OFFSET * LANES], real(CURRENT_MIN))
    return real(20.0) + c[at + PER_OCTAVE * LANES] * _log2(current, single), current


@register_jitable(forceinline=True, **_OPTIONS)
def _temperature_sigma(t, current, c, at):
    real = c.dtype.type
    step = c[at + GEL_STEP * LANES] / current
    over = max(t - c[at + GEL_HIGH * LANES], c[at + GEL_LOW * LANES] - t)
    beyond = real(EXTRAPOLATION) * max(over, real(0.0))
    return np.sqrt(c[at + GEL_VARIANCE * LANES] + step * step) + beyond


@register_jitable(forceinline=True, **_OPTIONS)
def _follow(t, chip_count, c, at, state, kept, keep, advance, film, chip, lagging):
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


@register_jitable(forceinline=True, **_OPTIONS)
def _bent(x, c, at):
    """Force of a piecewise linear law whose three rows begin at `at`; not clipped at zero."""
    real = c.dtype.type
    return c[at] * x + c[at + 2 * LANES] * max(x - c[at + LANES], real(0.0))


@register_jitable(forceinline=True, **_OPTIONS)
def _normal(depth, c, at):
    """Normal force at a depth."""
    return _bent(depth, c, at + SOFT * LANES)


@register_jitable(forceinline=True, **_OPTIONS)
def _depth_sigma(depth, c, at):
    real = c.dtype.type
    over = max(depth - c[at + DEPTH_HIGH * LANES], c[at + DEPTH_LOW * LANES] - depth)
    return c[at + DEPTH_SIGMA * LANES] + real(EXTRAPOLATION) * max(over, real(0.0))


@register_jitable(forceinline=True, **_OPTIONS)
def _normal_sigma(depth, sigma, force, c, at):
    """Half of what the force changes over the interval of the depth, and of the law itself."""
    real = c.dtype.type
    half = (_normal(depth + sigma, c, at) - _normal(depth - sigma, c, at)) * real(0.5)
    return np.sqrt(half * half + c[at + NORMAL_VARIANCE * LANES] * (force * force))


# -- field -----------------------------------------------------------------------------------------


@register_jitable(forceinline=True, **_OPTIONS)
def _lateral(bx, by, chip_above, c, at, chip):
    """Lateral field without the chip's offset and its drift, mapped; the gain is left in."""
    x = c[at + X_BX * LANES] * bx + c[at + X_BY * LANES] * by + c[at + X_OFFSET * LANES]
    y = c[at + Y_BX * LANES] * bx + c[at + Y_BY * LANES] * by + c[at + Y_OFFSET * LANES]
    if chip:
        x += c[at + X_DRIFT * LANES] * chip_above
        y += c[at + Y_DRIFT * LANES] * chip_above
    return x, y


@register_jitable(forceinline=True, **_OPTIONS)
def _vertical(bz, chip_above, c, at, chip):
    z = c[at + Z_BZ * LANES] * bz + c[at + Z_OFFSET * LANES]
    if chip:
        z += c[at + Z_DRIFT * LANES] * chip_above
    return z


@register_jitable(forceinline=True, **_OPTIONS)
def _chip_gain(chip_above, c, at, chip):
    real = c.dtype.type
    if chip:
        return max(real(1.0) + c[at + CHIP_GAIN * LANES] * chip_above, real(GAIN_MIN))
    return real(1.0)


@register_jitable(forceinline=True, **_OPTIONS)
def _film_gain(film_above, c, at, film):
    real = c.dtype.type
    if film:
        return max(real(1.0) + c[at + FILM_DRIFT * LANES] * film_above, real(GAIN_MIN))
    return real(1.0)


@register_jitable(forceinline=True, **_OPTIONS)
def _octaves(depth, c, at):
    """log2(M0 / µT) at a depth, without the gains of film and chip."""
    real = c.dtype.type
    x = c[at + GROWTH_2 * LANES] * depth + c[at + GROWTH_1 * LANES]
    x = x * depth + c[at + GROWTH_0 * LANES]
    return min(max(x, real(-OCTAVES_MAX)), real(OCTAVES_MAX))


@register_jitable(forceinline=True, **_OPTIONS)
def _amplitude_variance(depth, sigma, c, at):
    """Relative variance of M0 at a depth that has a sigma."""
    real = c.dtype.type
    slope = real(2.0) * c[at + GROWTH_2 * LANES] * depth + c[at + GROWTH_1 * LANES]
    growth = real(0.6931471805599453) * slope * sigma
    return c[at + AMPLITUDE_VARIANCE * LANES] + growth * growth


# -- tangential displacement and force -------------------------------------------------------------


@register_jitable(forceinline=True, **_OPTIONS)
def _by_strength(solid, field2, depth, depth_sigma, gain, c, at, with_sigma, single):
    """R = asin(S / M0) / k, its sigma, its flags, 1 / S and 1 / M0.

    The sigma is half of the interval of the arcsine, which has no slope at the crest.
    """
    real = c.dtype.type
    one = real(1.0)
    scale = c[at + WAVENUMBER_INVERSE * LANES]
    each = one / (solid * gain)  # one division for both quotients
    inverse = solid * each * _exp2(-_octaves(depth, c, at), single)
    ratio = min(solid * inverse, one)
    reach = scale * _asin(ratio, single)
    noise2 = field2 * (inverse * inverse)
    square = ratio * ratio
    near2 = noise2 + square * _amplitude_variance(depth, c[at + DEPTH_SIGMA * LANES], c, at)
    below = one - ratio
    found = SATURATED if near2 >= below * below else 0
    sigma = real(0.0)
    if with_sigma:
        s = np.sqrt(noise2 + square * _amplitude_variance(depth, depth_sigma, c, at))
        low = ratio - s
        lower = _asin(min(abs(low), one), single)
        lower = lower if low > real(0.0) else -lower
        sigma = real(0.5) * scale * (_asin(min(ratio + s, one), single) - lower)
    return reach, sigma, found, each * gain, inverse


@register_jitable(forceinline=True, **_OPTIONS)
def _angle_row(i, h, c, at):
    """Factor of psi^(2 i + 1) in R(psi, H), a cubic in H."""
    row = at + (ANGLE + 4 * i) * LANES
    q = c[row + 3 * LANES] * h + c[row + 2 * LANES]
    return (q * h + c[row + LANES]) * h + c[row]


@register_jitable(forceinline=True, **_OPTIONS)
def _angle_slope(i, h, c, at):
    """Its derivative by H."""
    real = c.dtype.type
    row = at + (ANGLE + 4 * i) * LANES
    q = real(3.0) * c[row + 3 * LANES] * h + real(2.0) * c[row + 2 * LANES]
    return q * h + c[row + LANES]


@register_jitable(forceinline=True, **_OPTIONS)
def _by_angle(solid, z, field2, depth, depth_sigma, c, at, with_sigma, single):
    """R(psi, H), psi = atan2(S, Bz), its sigma, its flags and 1 / S."""
    real = c.dtype.type
    upright = abs(z)
    big = max(solid, upright)
    quotient = real(1.0) / (solid * big)  # one division for both quotients
    psi = _atan(min(solid, upright) * (solid * quotient), single)
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


@register_jitable(forceinline=True, **_OPTIONS)
def _anomaly(solid, z, reach, amplitude, inverse, c, at):
    """Flag of a field that is not the film's: S against M0 sin(k R), R from the angle.

    At R = 0 this is Bz against the M0 that makes this R of this angle, so it is a check of the
    strength everywhere. Either M0 or its inverse is 1.
    """
    u = c[at + WAVENUMBER * LANES] * reach
    model = amplitude * (u * _sinc(u))
    measured = solid * inverse
    off = measured - model
    square = solid * solid + z * z
    allowed = c[at + ANOMALY_SHARE * LANES] * (model * model) * square
    allowed += c[at + ANOMALY_FIELD * LANES] * (measured * measured)
    return 0 if off * off * square <= allowed else MAGNETIC_ANOMALY


@register_jitable(forceinline=True, **_OPTIONS)
def _shear(reach, c, at):
    """Tangential force at a tangential displacement at the reference depth."""
    return _bent(reach, c, at + SHEAR_SOFT * LANES)


@register_jitable(forceinline=True, **_OPTIONS)
def _shear_variance(reach, sigma, law, stiffening, depth_sigma, c, at):
    """Variance of the tangential force along its direction."""
    real = c.dtype.type
    half = _shear(reach + sigma, c, at) - _shear(reach - sigma, c, at)
    half *= real(0.5) * stiffening
    deeper = law * c[at + SHEAR_GAIN * LANES] * depth_sigma
    force = law * stiffening
    return half * half + deeper * deeper + c[at + SHEAR_VARIANCE * LANES] * (force * force)


@register_jitable(forceinline=True, **_OPTIONS)
def _component(part, along2, across2):
    """Sigma of a component whose share of the direction is `part`; both are equal at R = 0."""
    return np.sqrt(across2 + part * part * (along2 - across2))


@register_jitable(forceinline=True, **_OPTIONS)
def _turn(x, y, c, at, single):
    """Correct a direction by the unit's table, linear in theta between knots: a sum of ramps."""
    real = c.dtype.type
    along = _atan2(y, x, single) + real(np.pi)
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


@register_jitable(forceinline=True, **_OPTIONS)
def _fetch(row, start):
    """Begin to fetch what stands in a row for `LANES` units."""
    for j in range(0, LANES, 64 // row.itemsize):
        ahead(row, start + j)


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
        apart()
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
                low_x, width_x = _range(limits, usual, BX)
                low_y, width_y = _range(limits, usual, BY)
                low_z, width_z = _range(limits, usual, BZ)
                low_chip, width_chip = _range(limits, usual, CHIP)
                for j in range(count):
                    at = k_limits + j
                    gel = counts[cycle, GEL, first + j]
                    frequency = counts[cycle, FREQUENCY, first + j]
                    unusual = (
                        _outside(gel, limits, at, LIMIT_USUAL + 2 * GEL)
                        | _outside(frequency, limits, at, LIMIT_USUAL + 2 * FREQUENCY)
                        | _beyond(counts[cycle, BX, first + j], low_x, width_x)
                        | _beyond(counts[cycle, BY, first + j], low_y, width_y)
                        | _beyond(counts[cycle, BZ, first + j], low_z, width_z)
                        | _beyond(counts[cycle, CHIP, first + j], low_chip, width_chip)
                    )
                    known = np.int16(incoming[cycle, first + j]) | limits[at + LIMIT_STATUS * LANES]
                    doubt = np.int16(doubt | known | np.int16(1 if unusual else 0))
                    flag[j] = np.int16(0)
                    if with_skipping:
                        pressed = _outside(frequency, limits, at, LIMIT_IDLE)
                        loaded[j] = np.int16(1 if pressed else 0)
                        touched = np.int16(touched | loaded[j])
                if doubt != 0:
                    touched = np.int16(0)
                    for j in range(count):
                        flags = np.int16(
                            _judge(
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
                            t, current = _temperature(
                                real(counts[cycle, GEL, first + j]), coefficients, k + j, single
                            )
                            keep = flags & INVALID == 0
                            held = False
                            if with_held:
                                old = tile[TEMPERATURE * LANES + j]
                                held = (not due) & (old == old)  # noqa: PLR0124
                                keep = keep & (not held)
                            film_above, chip_above = _follow(
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
                            t, current = _temperature(
                                real(counts[cycle, GEL, first + j]), coefficients, k + j, single
                            )
                            sigma = _temperature_sigma(
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
                        fz = _normal(depth, coefficients, c)
                        tile[H * LANES + j] = depth
                        tile[FZ * LANES + j] = fz
                        if with_sigma:
                            sigma = _depth_sigma(depth, coefficients, c)
                            tile[H_SIGMA * LANES + j] = sigma
                            tile[FZ_SIGMA * LANES + j] = _normal_sigma(
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
                            x, y = _lateral(
                                real(counts[cycle, BX, first + j]),
                                real(counts[cycle, BY, first + j]),
                                chip_above, coefficients, c, with_chip,
                            )  # fmt: skip
                            z = zero
                            if upright:
                                z = _vertical(
                                    real(counts[cycle, BZ, first + j]), chip_above, coefficients, c,
                                    with_chip,
                                )  # fmt: skip
                            gain = _chip_gain(chip_above, coefficients, c, with_chip)
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
                            gain *= _film_gain(film_above, coefficients, c, with_film)
                            strength = np.sqrt(x * x + y * y)
                            solid = max(strength, real(FIELD_MIN))
                            if with_angle:
                                reach, along, found, each = _by_angle(
                                    solid, z, field2, depth, depth_sigma, coefficients, c,
                                    with_sigma, single,
                                )  # fmt: skip
                                if with_anomaly:
                                    amplitude = gain * _exp2(
                                        _octaves(depth, coefficients, c), single
                                    )
                                    found |= _anomaly(
                                        solid, z, reach, amplitude, one, coefficients, c
                                    )
                            else:
                                reach, along, found, each, inverse = _by_strength(
                                    solid, field2, depth, depth_sigma, gain, coefficients, c,
                                    with_sigma, single,
                                )  # fmt: skip
                                if with_anomaly:
                                    other, _, _, _ = _by_angle(
                                        solid, z, field2, depth, depth_sigma, coefficients, c,
                                        with_sigma, single,
                                    )  # fmt: skip
                                    found |= _anomaly(
                                        solid, z, other, one, inverse, coefficients, c
                                    )
                            limit = coefficients[c + REACH * LANES]
                            found |= EXTRAPOLATED if reach > limit else 0
                            flags = flag[j]
                            flag[j] = flags if flags & SILENT else flags | found

                            x *= each
                            y *= each
                            if with_turning:
                                x, y = _turn(x, y, coefficients, c, single)
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
                            law = _shear(reach, coefficients, c)
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
                                tile[THETA * LANES + j] = _atan2(y, x, single)
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
                                    tile[DX_SIGMA * LANES + j] = _component(x, along2, across2)
                                    tile[DY_SIGMA * LANES + j] = _component(y, along2, across2)
                                if with_force or with_tangential:
                                    along2 = _shear_variance(
                                        reach, along, law, stiffening, depth_sigma, coefficients, c,
                                    )  # fmt: skip
                                    across2 = ft * ft * turned2
                                    if with_tangential:
                                        tile[FT_SIGMA * LANES + j] = np.sqrt(along2)
                                    if with_force:
                                        tile[FX_SIGMA * LANES + j] = _component(x, along2, across2)
                                        tile[FY_SIGMA * LANES + j] = _component(y, along2, across2)

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
    return njit(decode_python(parts), nogil=True, cache=True, **_OPTIONS)
