"""Compiled code of the magnetic field: films at their own chips, at others' and anywhere else.

A film's field is looked up in its own frame, after its displacement and tilt have been undone, and
turned back. Both tables hold Fourier orders of the azimuth over two other coordinates
(`skin.sim.film_table.FilmTable`); between the nodes runs the cubic through four of them each way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = ["Arrays", "Grid", "Units", "chip_fields", "chip_fields_python", "rest_fields",
           "rest_fields_python", "skin_fields", "skin_fields_python"]  # fmt: skip

LANES = 16
"""Rows of a table are filled up with zeros to a multiple of this."""

# A signed index may count from the end, and that possibility alone keeps a loop from vectorising.
_0, _1, _2, _3 = (np.uint64(i) for i in range(4))

_FLAGS = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}
# a table is a dozen values to hand over: a call would cost more than most functions here
_inlined = register_jitable(forceinline=True, **_FLAGS)


class Grid(NamedTuple):
    """One table: nodes ``first + i / per_unit`` along two coordinates.

    `values` has shape (count_a * count_b, columns), float32: a row for each node, the three
    components' orders one after the other, filled up. `orders` : int64, ascending.
    """

    values: np.ndarray
    orders: np.ndarray
    first_a: float
    per_unit_a: float
    count_a: int
    first_b: float
    per_unit_b: float
    count_b: int


class Units(NamedTuple):
    """The films of n units: Fourier coefficients of their sectors, and how they sit.

    `near_real`, `near_imaginary` : (n, orders of the near table), `far_real`, `far_imaginary` :
    (n, orders of the far table); `centre_mm`, `tilt_rad` : (2, n); `chip_mm` : from the middle of
    the film at rest to the chip.
    """

    near_real: np.ndarray
    near_imaginary: np.ndarray
    far_real: np.ndarray
    far_imaginary: np.ndarray
    centre_mm: np.ndarray
    tilt_rad: np.ndarray
    chip_mm: float


class Arrays(NamedTuple):
    """Who feels whose film, in compressed rows: `start` (n + 1,), `index` (m,).

    `offset_mm` : (m, 3), from the film at rest to the other unit's chip, in the film's unit frame;
    `turn` : (m, 9), from the film's unit frame to the axes of that chip; `rest_ut` : (m, 3), field
    of the film while it is at rest, in the axes of that chip.
    """

    start: np.ndarray
    index: np.ndarray
    offset_mm: np.ndarray
    turn: np.ndarray
    rest_ut: np.ndarray


@_inlined
def _weights(t):
    """Cubic through nodes at 0, 1, 2, 3."""
    a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
    return (
        np.float32(b * c * d * (-1.0 / 6.0)),
        np.float32(a * c * d * 0.5),
        np.float32(a * b * d * -0.5),
        np.float32(a * b * c * (1.0 / 6.0)),
    )


@_inlined
def _power(c, s, exponent):
    """Cosine and sine of a multiple of the angle of which `c` and `s` are cosine and sine."""
    if exponent == 1:
        return c, s
    power_c, power_s = 1.0, 0.0
    while exponent > 0:
        if exponent & 1:
            power_c, power_s = power_c * c - power_s * s, power_s * c + power_c * s
        c, s = c * c - s * s, 2.0 * c * s
        exponent >>= 1
    return power_c, power_s


@_inlined
def _along_b(values, row, column, weights):
    """One column of the table, interpolated over four nodes from `row` on."""
    w0, w1, w2, w3 = weights
    return (
        w0 * values[row, column] + w1 * values[row + _1, column]
        + w2 * values[row + _2, column] + w3 * values[row + _3, column]
    )  # fmt: skip


@_inlined
def _components(grid, a, b, cosine, sine, real, imaginary, i, series):
    """The table's three components at (a, b) and an azimuth; NaN out of the table's range.

    `real`, `imaginary` : row i holds the film's coefficients. `series` : (3, columns), float32,
    is overwritten where a component has its orders and must be 0 elsewhere.
    """
    at_a = (a - grid.first_a) * grid.per_unit_a
    at_b = (b - grid.first_b) * grid.per_unit_b
    # a comparison with NaN is false; below its first node the table goes on to a = 0
    within = (at_a <= grid.count_a - 1) & (at_b >= 0.0) & (at_b <= grid.count_b - 1)
    at_a, at_b = (at_a, at_b) if within else (np.nan, np.nan)
    orders = grid.orders.size
    c, s, order = 1.0, 0.0, 0
    for k in range(orders):
        step_c, step_s = _power(cosine, sine, grid.orders[k] - order)
        c, s, order = c * step_c - s * step_s, s * step_c + c * step_s, grid.orders[k]
        even = real[i, k] * c - imaginary[i, k] * s
        series[0, k] = even
        series[1, orders + k] = even
        series[2, 2 * orders + k] = real[i, k] * s + imaginary[i, k] * c
    base_a = min(max(int(at_a if within else 0.0) - 1, 0), grid.count_a - 4)
    base_b = min(max(int(at_b if within else 0.0) - 1, 0), grid.count_b - 4)
    u0, u1, u2, u3 = _weights(at_a - base_a)
    v = _weights(at_b - base_b)
    values, count_b = grid.values, np.uint64(grid.count_b)
    row_0 = np.uint64(base_a * grid.count_b + base_b)
    row_1, row_2 = row_0 + count_b, row_0 + count_b + count_b
    row_3 = row_2 + count_b
    first, second, third = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(np.uint64(series.shape[1])):
        value = (
            u0 * _along_b(values, row_0, k, v) + u1 * _along_b(values, row_1, k, v)
            + u2 * _along_b(values, row_2, k, v) + u3 * _along_b(values, row_3, k, v)
        )  # fmt: skip
        first += series[_0, k] * value
        second += series[_1, k] * value
        third += series[_2, k] * value
    return first, second, third


@_inlined
def _azimuth(x, y):
    """Distance from the axis, cosine and sine of the azimuth; on the axis the azimuth is 0."""
    rho = np.sqrt(x * x + y * y)
    if rho > 0.0:
        return rho, x / rho, y / rho
    return rho, 1.0, 0.0


@_inlined
def _near(grid, x, y, z, real, imaginary, i, series):
    """Field at (x, y, z) of the film frame, under the film."""
    rho, cosine, sine = _azimuth(x, y)
    radial, axial, around = _components(grid, rho, z, cosine, sine, real, imaginary, i, series)
    return radial * cosine - around * sine, radial * sine + around * cosine, axial


@_inlined
def _far(grid, x, y, z, real, imaginary, i, series):
    """Field at (x, y, z) of the film frame, well outside the sphere around the film."""
    rho, cosine, sine = _azimuth(x, y)
    inverse = 1.0 / np.sqrt(rho * rho + z * z)
    outward, down, around = _components(
        grid, inverse, np.arctan2(rho, z), cosine, sine, real, imaginary, i, series
    )
    sin_theta, cos_theta = rho * inverse, z * inverse
    radial = outward * sin_theta + down * cos_theta
    cube = inverse * inverse * inverse
    return (
        cube * (radial * cosine - around * sine),
        cube * (radial * sine + around * cosine),
        cube * (outward * cos_theta - down * sin_theta),
    )


@_inlined
def _anywhere(near, far, units, i, x, y, z, near_series, far_series):
    """Field of film i at (x, y, z) of its frame; NaN in or beside the film."""
    farthest = far.first_a + (far.count_a - 1) / far.per_unit_a
    if (x * x + y * y + z * z) * farthest * farthest >= 1.0:
        return _far(far, x, y, z, units.far_real, units.far_imaginary, i, far_series)
    return _near(near, x, y, z, units.near_real, units.near_imaginary, i, near_series)


@_inlined
def _place(units, displacement, depth, tilt, place):
    """Where the films are: rows of `place` are the middle (3) and the rotation (9), unit frame."""
    for i in range(depth.size):
        place[i, 0] = displacement[0, i] + units.centre_mm[0, i]
        place[i, 1] = displacement[1, i] + units.centre_mm[1, i]
        place[i, 2] = depth[i]
        u = tilt[0, i] + units.tilt_rad[0, i]
        v = tilt[1, i] + units.tilt_rad[1, i]
        half = 0.5 * np.sqrt(u * u + v * v)
        sinc = np.sin(half) / half if half > 0.0 else 1.0
        k = 0.5 * sinc * sinc
        s = sinc * np.cos(half)
        place[i, 3] = 1.0 - k * v * v
        place[i, 4] = k * u * v
        place[i, 5] = s * v
        place[i, 6] = k * u * v
        place[i, 7] = 1.0 - k * u * u
        place[i, 8] = -s * u
        place[i, 9] = -s * v
        place[i, 10] = s * u
        place[i, 11] = 1.0 - k * (u * u + v * v)


@_inlined
def _in_film(place, i, x, y, z):
    """A point of the unit frame in the film's."""
    x, y, z = x - place[i, 0], y - place[i, 1], z - place[i, 2]
    return (
        place[i, 3] * x + place[i, 6] * y + place[i, 9] * z,
        place[i, 4] * x + place[i, 7] * y + place[i, 10] * z,
        place[i, 5] * x + place[i, 8] * y + place[i, 11] * z,
    )


@_inlined
def _turned(turn, i, first, x, y, z):
    """A vector times the matrix in row i of `turn` from column `first` on."""
    return (
        turn[i, first] * x + turn[i, first + 1] * y + turn[i, first + 2] * z,
        turn[i, first + 3] * x + turn[i, first + 4] * y + turn[i, first + 5] * z,
        turn[i, first + 6] * x + turn[i, first + 7] * y + turn[i, first + 8] * z,
    )


@_inlined
def _stray(near, far, units, j, offset, turn, pair, place, near_series, far_series):
    """Field of film j, in the axes of the chip that feels it."""
    x, y, z = _in_film(place, j, offset[pair, 0], offset[pair, 1], offset[pair, 2])
    x, y, z = _anywhere(near, far, units, j, x, y, z, near_series, far_series)
    x, y, z = _turned(place, j, 3, x, y, z)
    return _turned(turn, pair, 0, x, y, z)


def rest_fields_python(near, far, units, arrays):
    """Fill in `arrays.rest_ut`."""
    n = arrays.start.size - 1
    place = np.empty((n, 12))
    near_series = np.zeros((3, near.values.shape[1]), np.float32)
    far_series = np.zeros((3, far.values.shape[1]), np.float32)
    _place(units, np.zeros((2, n)), np.zeros(n), np.zeros((2, n)), place)
    _, index, offset, turn, rest = arrays
    for pair in range(index.size):
        rest[pair] = _stray(
            near, far, units, index[pair], offset, turn, pair, place, near_series, far_series
        )


def chip_fields_python(near, far, units, arrays, displacement, depth, tilt, strength, out):
    """Field of the films at all chips, in the axes of the chips.

    Parameters
    ----------
    near, far : Grid
    units : Units
    arrays : Arrays
    displacement, depth, tilt : ndarray, shape (t, 2, n), (t, n), (t, 2, n), float64
        Of the films: mm and radian, unit frame.
    strength : ndarray, shape (t, n), float64
        Factor of each film's field.
    out : ndarray, shape (t, 3, n), float64
        Microtesla; NaN where a chip is out of a table's range.
    """
    cycles, n = depth.shape
    place = np.empty((n, 12))
    moved = np.empty(n, np.bool_)
    start, index, offset, turn, rest = arrays
    near_series = np.zeros((3, near.values.shape[1]), np.float32)
    far_series = np.zeros((3, far.values.shape[1]), np.float32)
    for t in range(cycles):
        _place(units, displacement[t], depth[t], tilt[t], place)
        for i in range(n):
            x, y, z = displacement[t, 0, i], displacement[t, 1, i], depth[t, i]
            u, v = tilt[t, 0, i], tilt[t, 1, i]
            moved[i] = x != 0.0 or y != 0.0 or z != 0.0 or u != 0.0 or v != 0.0
        for i in range(n):
            x, y, z = _in_film(place, i, 0.0, 0.0, units.chip_mm)
            bx, by, bz = _near(near, x, y, z, units.near_real, units.near_imaginary, i, near_series)
            bx, by, bz = _turned(place, i, 3, bx, by, bz)
            # the chip is mounted half a turn about z from the unit's axes
            bx, by, bz = -strength[t, i] * bx, -strength[t, i] * by, strength[t, i] * bz
            for pair in range(start[i], start[i + 1]):
                j = index[pair]
                if moved[j]:
                    x, y, z = _stray(
                        near, far, units, j, offset, turn, pair, place, near_series, far_series
                    )
                else:
                    x, y, z = rest[pair, 0], rest[pair, 1], rest[pair, 2]
                bx += strength[t, j] * x
                by += strength[t, j] * y
                bz += strength[t, j] * z
            out[t, 0, i] = bx
            out[t, 1, i] = by
            out[t, 2, i] = bz


def skin_fields_python(
    near, far, units, rest, turn, point, displacement, depth, tilt, strength, out
):
    """Field of all films together at one point, in the skin frame.

    Parameters
    ----------
    near, far : Grid
    units : Units
    rest : ndarray, shape (n, 3)
        Middle of each film at rest, mm, skin frame.
    turn : ndarray, shape (n, 9)
        Rotation of each unit, R_skin_unit.
    point : ndarray, shape (3,)
        Millimetre, skin frame.
    displacement, depth, tilt, strength
        As in `chip_fields_python`.
    out : ndarray, shape (t, 3), float64
        Microtesla; NaN where the point is in or beside a film.
    """
    cycles, n = depth.shape
    place = np.empty((n, 12))
    near_series = np.zeros((3, near.values.shape[1]), np.float32)
    far_series = np.zeros((3, far.values.shape[1]), np.float32)
    for t in range(cycles):
        _place(units, displacement[t], depth[t], tilt[t], place)
        bx, by, bz = 0.0, 0.0, 0.0
        for i in range(n):
            x, y, z = point[0] - rest[i, 0], point[1] - rest[i, 1], point[2] - rest[i, 2]
            x, y, z = (
                turn[i, 0] * x + turn[i, 3] * y + turn[i, 6] * z,
                turn[i, 1] * x + turn[i, 4] * y + turn[i, 7] * z,
                turn[i, 2] * x + turn[i, 5] * y + turn[i, 8] * z,
            )
            x, y, z = _in_film(place, i, x, y, z)
            x, y, z = _anywhere(near, far, units, i, x, y, z, near_series, far_series)
            x, y, z = _turned(place, i, 3, x, y, z)
            x, y, z = _turned(turn, i, 0, x, y, z)
            bx += strength[t, i] * x
            by += strength[t, i] * y
            bz += strength[t, i] * z
        out[t, 0] = bx
        out[t, 1] = by
        out[t, 2] = bz


rest_fields = njit(rest_fields_python, nogil=True, cache=True, **_FLAGS)
chip_fields = njit(chip_fields_python, nogil=True, cache=True, **_FLAGS)
skin_fields = njit(skin_fields_python, nogil=True, cache=True, **_FLAGS)
