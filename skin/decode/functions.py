"""Rows of numbers, and elementary functions for decoding, in float32 or float64: polynomials alone,
without a branch.

A mathematical library is called for one number at a time; these are computed for a whole vector.
The type of the argument chooses the polynomial: float32 needs fewer terms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from bus.compiled.jit import jitable

__all__ = [
    "OCTAVES_MAX", "Rows", "asin", "atan", "atan2", "exp2", "log2", "read", "rows_of", "sin_cos",
    "sinc", "write",
]  # fmt: skip

OCTAVES_MAX = 24.0
"""Bound of the exponent of `exp2`."""


class Rows(NamedTuple):
    """Rows of a cycle, as the stages see them: from a block's first unit on.

    Attributes
    ----------
    values : ndarray, shape (r * n,)
    units : uintp
        n, from one row to the next.
    first : uintp
        Place of lane 0 in row 0.
    """

    values: np.ndarray
    units: np.unsignedinteger
    first: np.unsignedinteger


@jitable
def rows_of(values, first):
    """Rows of an array of shape (r, n), from a unit on."""
    return Rows(values.reshape(values.size), np.uintp(values.shape[1]), np.uintp(first))


# places are unsigned, so that the compiler knows that none counts from the end of the array
@jitable
def read(rows, row, lane):
    """The number of a lane in a row."""
    return rows.values[rows.first + np.uintp(row) * rows.units + np.uintp(lane)]


@jitable
def write(rows, row, lane, value):
    """Set the number of a lane in a row."""
    rows.values[rows.first + np.uintp(row) * rows.units + np.uintp(lane)] = value


def _by_type(single: Callable[[Any], Any], double: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function that is `single` for float32, else `double`; only one of them is compiled."""

    def chosen(x):
        return single(x) if x.dtype == np.float32 else double(x)

    @overload(chosen, jit_options={"forceinline": True})
    def _choose(x):
        return single if x == types.float32 else double

    return chosen


# -- exponent and mantissa, x = mantissa * 2^exponent, mantissa in [sqrt(1/2), sqrt(2)] ------------


def _split_single(x):
    bits = np.float32(x).view(np.int32)
    exponent = np.int32(np.int32(bits - np.int32(0x3F3504F3)) >> np.int32(23))
    mantissa = np.int32(bits - np.int32(exponent << np.int32(23))).view(np.float32)
    return np.float32(exponent), mantissa


def _split_double(x):
    bits = np.float64(x).view(np.int64)
    exponent = (bits - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    return np.float64(exponent), np.int64(bits - (exponent << np.int64(52))).view(np.float64)


_split = _by_type(_split_single, _split_double)


# -- 2^exponent, for a whole number that the type of the result holds ------------------------------


def _power_single(x):
    return np.int32((np.int32(x) + np.int32(127)) << np.int32(23)).view(np.float32)


def _power_double(x):
    return np.int64((np.int64(x) + np.int64(1023)) << np.int64(52)).view(np.float64)


_power = _by_type(_power_single, _power_double)


# -- log2(x), x > 0: log2(1 + f) = f P(f), or s P(s²) with s = f / (2 + f); P minimax --------------


def _log2_single(x):
    exponent, mantissa = _split(x)
    f = mantissa - np.float32(1.0)
    p = np.float32(-0.14581172087755081)
    p = p * f + np.float32(0.2340423629738389)
    p = p * f + np.float32(-0.2488768532369355)
    p = p * f + np.float32(0.28709870130108107)
    p = p * f + np.float32(-0.36023964083131366)
    p = p * f + np.float32(0.4809232422051029)
    p = p * f + np.float32(-0.72135278803747874)
    p = p * f + np.float32(1.4426949619877482)
    return exponent + f * p


def _log2_double(x):
    exponent, mantissa = _split(x)
    f = mantissa - 1.0
    s = f / (2.0 + f)
    z = s * s
    p = 0.21367078472987187
    p = p * z + 0.2209118661176815
    p = p * z + 0.26233440178471734
    p = p * z + 0.32059853392543478
    p = p * z + 0.41219858585107806
    p = p * z + 0.57707801634547034
    p = p * z + 0.96179669392598982
    p = p * z + 2.8853900817779268
    return exponent + s * p


log2 = _by_type(_log2_single, _log2_double)


# -- 2^x for abs(x) <= OCTAVES_MAX: the nearest whole power, and a minimax polynomial --------------


def _exp2_single(x):
    whole = np.floor(x + np.float32(0.5))
    f = x - whole
    p = np.float32(0.0013276472631950876)
    p = p * f + np.float32(0.0096755413431213274)
    p = p * f + np.float32(0.055507132718556442)
    p = p * f + np.float32(0.2402211972371072)
    p = p * f + np.float32(0.69314696706503521)
    p = p * f + np.float32(1.0000000716547141)
    return p * _power(whole)


def _exp2_double(x):
    whole = np.floor(x + 0.5)
    f = x - whole
    p = 4.4352827069572772e-10
    p = p * f + 7.0741056135081428e-9
    p = p * f + 1.0178198021671931e-7
    p = p * f + 1.3215433089676399e-6
    p = p * f + 1.5252733489988526e-5
    p = p * f + 0.00015403530462514432
    p = p * f + 0.0013333558146789922
    p = p * f + 0.0096181291075883352
    p = p * f + 0.055504108664819922
    p = p * f + 0.24022650695910156
    p = p * f + 0.69314718055994533
    p = p * f + 1.0
    return p * _power(whole)


exp2 = _by_type(_exp2_single, _exp2_double)


# -- asin(x), 0 <= x <= 1: x + x z P(z) to 1/2, z = x², half-angle formula above, P minimax --------


def _asin_poly_single(x):
    p = np.float32(0.0421663783)
    p = p * x + np.float32(0.0241794679)
    p = p * x + np.float32(0.0454703867)
    p = p * x + np.float32(0.0749529749)
    return p * x + np.float32(0.166667521)


def _asin_poly_double(x):
    p = 0.031912187113470845
    p = p * x + -0.016224133354533925
    p = p * x + 0.01952819040788433
    p = p * x + 0.0065280018758410675
    p = p * x + 0.01216920571244654
    p = p * x + 0.013885236330905664
    p = p * x + 0.017359704679101626
    p = p * x + 0.022371758055878783
    p = p * x + 0.030381959136741975
    p = p * x + 0.044642856828333854
    p = p * x + 0.07500000000337008
    return p * x + 0.16666666666665408


_asin_poly = _by_type(_asin_poly_single, _asin_poly_double)


@jitable
def asin(x):
    """asin(x) for 0 <= x <= 1."""
    real = type(x)
    large = x > real(0.5)
    half = (real(1.0) - x) * real(0.5)
    z = half if large else x * x
    root = np.sqrt(half)
    s = root if large else x
    r = s + s * (z * _asin_poly(z))
    return real(1.5707963267948966) - (r + r) if large else r


# -- atan(t), 0 <= t <= 1: t + t z Q(z), z = t², Q minimax -----------------------------------------


def _atan_single(x):
    z = x * x
    q = np.float32(0.00292070303)
    q = q * z + np.float32(-0.0163679719)
    q = q * z + np.float32(0.0432119332)
    q = q * z + np.float32(-0.0755222067)
    q = q * z + np.float32(0.106660075)
    q = q * z + np.float32(-0.142110556)
    q = q * z + np.float32(0.199937731)
    q = q * z + np.float32(-0.333331525)
    return x + x * (z * q)


def _atan_double(x):
    z = x * x
    q = -1.1832505417555692e-05
    q = q * z + 0.0001368724853148122
    q = q * z + -0.0007518472526973822
    q = q * z + 0.002622977891906089
    q = q * z + -0.006575683344151699
    q = q * z + 0.012756172907694298
    q = q * z + -0.020238706986393514
    q = q * z + 0.027567942297344678
    q = q * z + -0.033750132001619734
    q = q * z + 0.03872640214042632
    q = q * z + -0.04308119655330471
    q = q * z + 0.04752086773576656
    q = q * z + -0.05261265735709454
    q = q * z + 0.05882074956371294
    q = q * z + -0.06666636435777692
    q = q * z + 0.07692305354678655
    q = q * z + -0.09090908969557403
    q = q * z + 0.11111111107234799
    q = q * z + -0.14285714285648404
    q = q * z + 0.19999999999999554
    q = q * z + -0.3333333333333333
    return x + x * (z * q)


atan = _by_type(_atan_single, _atan_double)


@jitable
def atan2(y, x):
    """atan2(y, x); 0 at the origin, +pi on the negative x axis for either sign of y's zero."""
    real = type(x)
    ax = abs(x)
    ay = abs(y)
    steep = ay > ax
    a = atan((ax if steep else ay) / max(ay if steep else ax, real(1e-30)))
    a = real(1.5707963267948966) - a if steep else a
    a = real(3.141592653589793) - a if x < real(0.0) else a
    return -a if y < real(0.0) else a


# -- sine and cosine of abs(x) <= 1 rad: Taylor series ---------------------------------------------


def _sin_cos_tails_single(x):
    return np.float32(-1 / 5040), np.float32(1 / 40320)


def _sin_cos_tails_double(x):
    sine = -1 / 1307674368000
    sine = sine * x + 1 / 6227020800
    sine = sine * x + -1 / 39916800
    sine = sine * x + 1 / 362880
    sine = sine * x + -1 / 5040
    cosine = 1 / 20922789888000
    cosine = cosine * x + -1 / 87178291200
    cosine = cosine * x + 1 / 479001600
    cosine = cosine * x + -1 / 3628800
    cosine = cosine * x + 1 / 40320
    return sine, cosine


_sin_cos_tails = _by_type(_sin_cos_tails_single, _sin_cos_tails_double)


@jitable
def sin_cos(x):
    """sin(x) and cos(x) for abs(x) <= 1."""
    real = type(x)
    z = x * x
    sine, cosine = _sin_cos_tails(z)
    sine = (sine * z + real(1 / 120)) * z + real(-1 / 6)
    cosine = ((cosine * z + real(-1 / 720)) * z + real(1 / 24)) * z + real(-1 / 2)
    return x + x * (z * sine), real(1.0) + z * cosine


@jitable
def sinc(x):
    """sin(x) / x for abs(x) <= 2.5, within 1e-6."""
    real = type(x)
    z = x * x
    p = real(2.3491531600972428e-6)
    p = p * z + real(-0.00019594609593602644)
    p = p * z + real(0.008326980398387261)
    p = p * z + real(-0.16666065747441654)
    return p * z + real(0.99999901365734746)
