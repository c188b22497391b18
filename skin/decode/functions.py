"""Rows of numbers, and elementary functions for decoding, in float32 or float64.

A mathematical library is called for one number at a time; in float32 these are polynomials alone,
without a branch, computed for a whole vector. In float64, the type of reference, they are those of
the library.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from bus.compiled.jit import jitable

__all__ = [
    "OCTAVES_MAX", "Rows", "asin", "atan", "atan2", "exp2", "log2", "read", "rows_from", "rows_of",
    "sin_cos", "sinc", "write",
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
def rows_of(values):
    """Rows of an array of shape (r, n): once a cycle, since numba calls a function for a reshape;
    None for None."""
    if values is None:
        return None
    return Rows(values.reshape(values.size), np.uintp(values.shape[1]), np.uintp(0))


@jitable
def rows_from(rows, first):
    """The same rows from a unit on."""
    if rows is None:
        return None
    return Rows(rows.values, rows.units, np.uintp(first))


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


# -- log2(x), x > 0: of x = mantissa * 2^exponent, mantissa in [sqrt(1/2), sqrt(2)], log2(1 + f) = f
# P(f), P minimax


def _log2_single(x):
    bits = np.float32(x).view(np.int32)
    exponent = np.int32(np.int32(bits - np.int32(0x3F3504F3)) >> np.int32(23))
    mantissa = np.int32(bits - np.int32(exponent << np.int32(23))).view(np.float32)
    f = mantissa - np.float32(1.0)
    p = np.float32(-0.14581172087755081)
    p = p * f + np.float32(0.2340423629738389)
    p = p * f + np.float32(-0.2488768532369355)
    p = p * f + np.float32(0.28709870130108107)
    p = p * f + np.float32(-0.36023964083131366)
    p = p * f + np.float32(0.4809232422051029)
    p = p * f + np.float32(-0.72135278803747874)
    p = p * f + np.float32(1.4426949619877482)
    return np.float32(exponent) + f * p


def _log2_double(x):
    return np.log2(x)


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
    power = np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)
    return p * power


def _exp2_double(x):
    return np.exp2(x)


exp2 = _by_type(_exp2_single, _exp2_double)


# -- asin(x), 0 <= x <= 1: x + x z P(z) to 1/2, z = x², half-angle formula above, P minimax --------


def _asin_single(x):
    half = (np.float32(1.0) - x) * np.float32(0.5)
    large = x > np.float32(0.5)
    z = half if large else x * x
    s = np.sqrt(half) if large else x
    p = np.float32(0.0421663783)
    p = p * z + np.float32(0.0241794679)
    p = p * z + np.float32(0.0454703867)
    p = p * z + np.float32(0.0749529749)
    r = s + s * (z * (p * z + np.float32(0.166667521)))
    return np.float32(1.5707963267948966) - (r + r) if large else r


def _asin_double(x):
    return np.arcsin(x)


asin = _by_type(_asin_single, _asin_double)


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
    return np.arctan(x)


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


def _sin_cos_single(x):
    z = x * x
    sine = (z * np.float32(-1 / 5040) + np.float32(1 / 120)) * z + np.float32(-1 / 6)
    cosine = (z * np.float32(1 / 40320) + np.float32(-1 / 720)) * z + np.float32(1 / 24)
    cosine = cosine * z + np.float32(-1 / 2)
    return x + x * (z * sine), np.float32(1.0) + z * cosine


def _sin_cos_double(x):
    return np.sin(x), np.cos(x)


sin_cos = _by_type(_sin_cos_single, _sin_cos_double)


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
