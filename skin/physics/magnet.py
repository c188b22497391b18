"""Compiled code of the magnetic field: films at their own chips, at others' and at tools.

A film's field is looked up in its own frame, after its displacement and tilt have been undone, and
turned back. Both tables hold Fourier orders of the azimuth over two other coordinates
(`skin.physics.film_table.FilmTable`); between the nodes runs the cubic through four of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable

__all__ = ["FAR", "LANES", "NEAR", "Films", "Rows", "Tables", "Units", "chip_fields",
           "chip_fields_python", "film_fields", "film_fields_python"]  # fmt: skip

LANES = 16
"""Rows of a table are filled up with zeros to a multiple of this."""

NEAR, FAR = 0, 1
"""The two tables, as an index."""

# A signed index may count from the end, and that possibility alone keeps a loop from vectorising.
_0, _1, _2, _3 = (np.uint64(i) for i in range(4))

# the arguments are dozens of words each: a call would cost more than most functions here
_inlined = jitable


class Tables(NamedTuple):
    """Near and far table; along each coordinate the nodes are ``first + i / per_unit``.

    `values` : float32, flat: for each table, from `begin` on, a row of `columns` for each node:
    the three components' orders one after the other, filled up. `orders` : int64, ascending;
    those of a table are ``orders[orders_start[k]:orders_start[k + 1]]``. `first`, `per_unit`,
    `count` : (tables, coordinates); `begin`, `columns` : (tables,). `lowest` : (tables,), node
    of the second coordinate from which on a table holds. `far_mm2` : squared distance from which
    on the far table holds.
    """

    values: np.ndarray
    begin: np.ndarray
    columns: np.ndarray
    orders: np.ndarray
    orders_start: np.ndarray
    first: np.ndarray
    per_unit: np.ndarray
    count: np.ndarray
    lowest: np.ndarray
    far_mm2: float


class Units(NamedTuple):
    """The films of n units: Fourier coefficients of their sectors, and how they sit.

    `real`, `imaginary` : (n, orders of both tables); `centre_mm`, `tilt_rad` : (2, n).
    """

    real: np.ndarray
    imaginary: np.ndarray
    centre_mm: np.ndarray
    tilt_rad: np.ndarray


class Films(NamedTuple):
    """Films at t instants, float64: `displacement_mm`, `tilt_rad` : (t, 2, n), `depth_mm` : (t, n),
    all in unit frames; `strength` : (t, n), factor of each film's field."""

    displacement_mm: np.ndarray
    depth_mm: np.ndarray
    tilt_rad: np.ndarray
    strength: np.ndarray


class Rows(NamedTuple):
    """Who feels whose film, in compressed rows of m pairs: `start` (receivers + 1,), `film` (m,).

    `offset_mm` : (m, 3), from the film at rest to the receiver, in the film's unit frame; `turn` :
    (m, 9), from the film's unit frame to the axes of the receiver; `rest_ut` : (m, 3), field of the
    film while it is at rest, in these axes.
    """

    start: np.ndarray
    film: np.ndarray
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
    power_c, power_s = (c, s) if exponent & 1 else (1.0, 0.0)
    exponent >>= 1
    while exponent > 0:
        c, s = c * c - s * s, 2.0 * c * s
        if exponent & 1:
            power_c, power_s = power_c * c - power_s * s, power_s * c + power_c * s
        exponent >>= 1
    return power_c, power_s


@_inlined
def _along_b(values, at, columns, weights):
    """One column of a table, interpolated over four nodes."""
    w0, w1, w2, w3 = weights
    return (
        w0 * values[at] + w1 * values[at + columns]
        + w2 * values[at + _2 * columns] + w3 * values[at + _3 * columns]
    )  # fmt: skip


@_inlined
def _components(tables, units, i, table, at, azimuth, series):
    """Three components of film i from a table; NaN out of its range.

    `at` : coordinates (a, b) of the table; `azimuth` : its cosine and sine.

    `series` : (6, columns), float32; three rows for each table, overwritten where a component has
    its orders and 0 elsewhere.
    """
    (a, b), (cosine, sine) = at, azimuth
    start = tables.orders_start[table]
    orders = tables.orders_start[table + 1] - start
    c, s, order = 1.0, 0.0, 0
    for k in range(orders):
        next_order = tables.orders[start + k]
        step_c, step_s = _power(cosine, sine, next_order - order)
        c, s, order = c * step_c - s * step_s, s * step_c + c * step_s, next_order
        real, imaginary = units.real[i, start + k], units.imaginary[i, start + k]
        even = np.float32(real * c - imaginary * s)
        series[3 * table, k] = even
        series[3 * table + 1, orders + k] = even
        series[3 * table + 2, 2 * orders + k] = np.float32(real * s + imaginary * c)
    at_a = (a - tables.first[table, 0]) * tables.per_unit[table, 0]
    at_b = (b - tables.first[table, 1]) * tables.per_unit[table, 1]
    count_a, count_b = tables.count[table, 0], tables.count[table, 1]
    # a comparison with NaN is false; below its first node a table goes on to a = 0
    within = (at_a <= count_a - 1) & (at_b >= tables.lowest[table]) & (at_b <= count_b - 1)
    base_a = min(max(int(at_a if within else 0.0) - 1, 0), count_a - 4)
    base_b = min(max(int(at_b if within else 0.0) - 1, 0), count_b - 4)
    u0, u1, u2, u3 = _weights(at_a - base_a if within else np.nan)
    v = _weights(at_b - base_b)
    columns = np.uint64(tables.columns[table])
    down = np.uint64(count_b) * columns
    row_0 = np.uint64(tables.begin[table]) + np.uint64(base_a * count_b + base_b) * columns
    row_1, row_2 = row_0 + down, row_0 + _2 * down
    row_3 = row_2 + down
    values, plane = tables.values, _3 * np.uint64(table)
    first, second, third = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(columns):
        value = (
            u0 * _along_b(values, row_0 + k, columns, v)
            + u1 * _along_b(values, row_1 + k, columns, v)
            + u2 * _along_b(values, row_2 + k, columns, v)
            + u3 * _along_b(values, row_3 + k, columns, v)
        )
        first += series[plane, k] * value
        second += series[plane + _1, k] * value
        third += series[plane + _2, k] * value
    return float(first), float(second), float(third)


@_inlined
def _film_field(tables, units, i, x, y, z, series):
    """Field of film i at (x, y, z) of its frame; NaN in the film and next to it."""
    rho2 = x * x + y * y
    r2 = rho2 + z * z
    rho = np.sqrt(rho2)
    cosine, sine = (x / rho, y / rho) if rho > 0.0 else (1.0, 0.0)
    table, a, b = NEAR, rho, z
    c, s, scale = 1.0, 0.0, 1.0
    if r2 >= tables.far_mm2:
        a = 1.0 / np.sqrt(r2)
        table, b = FAR, np.arctan2(rho, z)
        # the components there are along r and theta: turned to rho and z by the polar angle
        s, c, scale = z * a, rho * a, a * a * a
    first, second, around = _components(tables, units, i, table, (a, b), (cosine, sine), series)
    radial, axial = scale * (first * c + second * s), scale * (first * s - second * c)
    if table == NEAR:
        axial = second
    around *= scale
    return radial * cosine - around * sine, radial * sine + around * cosine, axial


@_inlined
def _place(units, films, t, place):
    """Where the films are: rows of `place` are the middle (3) and the rotation (9), unit frame."""
    displacement, depth, tilt, _ = films
    for i in range(depth.shape[1]):
        place[i, 0] = displacement[t, 0, i] + units.centre_mm[0, i]
        place[i, 1] = displacement[t, 1, i] + units.centre_mm[1, i]
        place[i, 2] = depth[t, i]
        u = tilt[t, 0, i] + units.tilt_rad[0, i]
        v = tilt[t, 1, i] + units.tilt_rad[1, i]
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
def _turned(turn, i, first, x, y, z):
    """A vector times the matrix in row i of `turn` from column `first` on."""
    return (
        turn[i, first] * x + turn[i, first + 1] * y + turn[i, first + 2] * z,
        turn[i, first + 3] * x + turn[i, first + 4] * y + turn[i, first + 5] * z,
        turn[i, first + 6] * x + turn[i, first + 7] * y + turn[i, first + 8] * z,
    )


@_inlined
def _turned_back(turn, i, first, x, y, z):
    """A vector times the transposed matrix."""
    return (
        turn[i, first] * x + turn[i, first + 3] * y + turn[i, first + 6] * z,
        turn[i, first + 1] * x + turn[i, first + 4] * y + turn[i, first + 7] * z,
        turn[i, first + 2] * x + turn[i, first + 5] * y + turn[i, first + 8] * z,
    )


@_inlined
def _placed_field(tables, units, i, place, x, y, z, series):
    """Field of film i, where it is, at (x, y, z) of its unit's frame, in that frame."""
    x, y, z = x - place[i, 0], y - place[i, 1], z - place[i, 2]
    x, y, z = _turned_back(place, i, 3, x, y, z)
    x, y, z = _film_field(tables, units, i, x, y, z, series)
    return _turned(place, i, 3, x, y, z)


def film_fields_python(tables, units, film, points_mm, out):
    """Field of films at points of their own frames.

    Parameters
    ----------
    tables : Tables
    units : Units
    film : ndarray, shape (m,), int
        Whose field each point is in.
    points_mm : ndarray, shape (m, 3)
    out : ndarray, shape (m, 3), float64
        Microtesla; NaN where a point is in or next to the film.
    """
    series = np.zeros((6, tables.columns.max()), np.float32)
    for m in range(film.size):
        x, y, z = points_mm[m, 0], points_mm[m, 1], points_mm[m, 2]
        x, y, z = _film_field(tables, units, film[m], x, y, z, series)
        out[m, 0], out[m, 1], out[m, 2] = x, y, z


def chip_fields_python(tables, units, rows, films, out):
    """Field of the films at all receivers, in the axes of these: chips, or tools.

    Parameters
    ----------
    tables : Tables
    units : Units
    rows : Rows
    films : Films
    out : ndarray, shape (t, 3, receivers), float64
        Microtesla; NaN where a receiver is out of the tables' range.
    """
    displacement, depth, tilt, strength = films
    cycles, n = depth.shape
    start, film, offset, turn, rest = rows
    place = np.empty((n, 12))
    moved = np.empty(n, np.bool_)
    series = np.zeros((6, tables.columns.max()), np.float32)
    for t in range(cycles):
        _place(units, films, t, place)
        for i in range(n):
            x, y, z = displacement[t, 0, i], displacement[t, 1, i], depth[t, i]
            u, v = tilt[t, 0, i], tilt[t, 1, i]
            moved[i] = (x != 0.0) | (y != 0.0) | (z != 0.0) | (u != 0.0) | (v != 0.0)
        for receiver in range(start.size - 1):
            bx, by, bz = 0.0, 0.0, 0.0
            for pair in range(start[receiver], start[receiver + 1]):
                j = film[pair]
                # what is at rest need not be looked up
                x, y, z = rest[pair, 0], rest[pair, 1], rest[pair, 2]
                if moved[j]:
                    x, y, z = offset[pair, 0], offset[pair, 1], offset[pair, 2]
                    x, y, z = _placed_field(tables, units, j, place, x, y, z, series)
                    x, y, z = _turned(turn, pair, 0, x, y, z)
                bx += strength[t, j] * x
                by += strength[t, j] * y
                bz += strength[t, j] * z
            out[t, 0, receiver], out[t, 1, receiver], out[t, 2, receiver] = bx, by, bz


film_fields = compiled(film_fields_python, fastmath=("contract", "reassoc"))
chip_fields = compiled(chip_fields_python, fastmath=("contract", "reassoc"))
