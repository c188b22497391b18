"""Elementary functions against mpmath: all bits but the last two, or what is documented."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpmath import mp

from skin.decode import functions

LAST = {np.float32: 2.0**-23, np.float64: 2.0**-52}
"""Rounding, as a share."""
real = pytest.mark.parametrize("real", [np.float32, np.float64])


def missed(function, exact, points, real):
    """Largest error as a share of the value, in roundings; of values below 1e-3 as one of that."""
    with mp.workdps(30):
        off = [
            abs(float(mp.mpf(float(function(real(x)))) - exact(mp.mpf(float(real(x))))))
            / max(abs(float(exact(mp.mpf(float(real(x)))))), 1e-3)
            for x in points
        ]
    return max(off) / LAST[real]


@real
def test_logarithm(real):
    """Mantissas from end to end, and exponents of all that a gel's current may be."""
    points = [*np.linspace(0.5, 2.0, 61), *np.geomspace(1e-6, 1e6, 60)]
    # beside 1 the logarithm is small, and so is what is lost
    assert missed(functions.log2, lambda x: mp.log(x, 2), points, real) < 4.0


@real
def test_power(real):
    points = [*np.linspace(-1.0, 1.0, 61), *np.linspace(-24.0, 24.0, 60), -0.5, 0.5, 1.5]
    assert missed(functions.exp2, lambda x: mp.mpf(2) ** x, points, real) < 3.0


@real
def test_arcsine(real):
    points = [*np.linspace(0.0, 1.0, 121), 0.5, 0.51, 0.999, 0.9999, 1.0]
    assert missed(functions.asin, mp.asin, points, real) < 3.0
    assert functions.asin(real(1.0)) == real(np.pi / 2.0)
    assert functions.asin(real(0.0)) == 0.0


@real
def test_arctangent_of_all_directions(real):
    for angle in np.linspace(-3.1, 3.1, 125):
        for length in (1e-6, 1.0, 3e4):
            y, x = real(length * np.sin(angle)), real(length * np.cos(angle))
            exact = np.arctan2(np.float64(y), np.float64(x))
            assert abs(functions.atan2(y, x) - exact) < 4.0 * LAST[real] * max(abs(exact), 0.1)


@real
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_arctangent_on_the_axes(real, zero):
    y = real(zero)
    assert functions.atan2(y, real(0.0)) == 0.0
    assert functions.atan2(y, real(2.0)) == 0.0
    assert functions.atan2(y, real(-2.0)) == real(np.pi)
    assert functions.atan2(real(2.0), y) == real(np.pi / 2.0)
    assert functions.atan2(real(-2.0), y) == real(-np.pi / 2.0)


@pytest.mark.parametrize(("real", "terms"), [(np.float32, 4), (np.float64, 8)])
def test_sine_and_cosine_miss_what_their_series_leave_out(real, terms):
    for x in map(real, np.linspace(-1.0, 1.0, 81)):
        sine, cosine = functions.sin_cos(x)
        left = abs(x) ** (2 * terms + 1) / math.factorial(2 * terms + 1)
        assert abs(sine - np.sin(np.float64(x))) <= 1.05 * left + LAST[real] * abs(x)
        left = abs(x) ** (2 * terms + 2) / math.factorial(2 * terms + 2)
        assert abs(cosine - np.cos(np.float64(x))) <= 1.05 * left + LAST[real]


@real
def test_sine_over_its_argument_is_told_within_a_millionth(real):
    for x in np.linspace(-2.5, 2.5, 101):
        assert abs(functions.sinc(real(x)) - np.sinc(x / np.pi)) < 1.2e-6
