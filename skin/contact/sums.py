"""Sums over the units of a contact, in float64: loads, wrenches, temperatures.

Lengths are about the middle of the array. The units of a contact are summed along rows
(`skin.contact.touched`), with running sums that the compiler keeps in registers.
"""

from __future__ import annotations

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.model import ADDED

__all__ = ["add_total", "add_units", "clear", "moments", "store"]


@jitable
def store(values, total):
    for k in range(len(values)):
        total[k] += values[k]


@jitable(inline=True)
def _first_moment(length, weight, place):
    """Σ w p."""
    assume_noalias()
    x = y = z = 0.0
    for j in range(length):
        x += weight[j] * place[0, j]
        y += weight[j] * place[1, j]
        z += weight[j] * place[2, j]
    return x, y, z


@jitable(inline=True)
def moments(length, weight, place):
    """Σ w, Σ w p, and Σ w p p', an upper triangle."""
    assume_noalias()
    total = x = y = z = xx = xy = xz = yy = yz = zz = 0.0
    for j in range(length):
        w, px, py, pz = weight[j], place[0, j], place[1, j], place[2, j]
        wx, wy, wz = w * px, w * py, w * pz
        total, x, y, z = total + w, x + wx, y + wy, z + wz
        xx, xy, xz = xx + wx * px, xy + wx * py, xz + wx * pz
        yy, yz, zz = yy + wy * py, yz + wy * pz, zz + wz * pz
    return total, (x, y, z), (xx, xy, xz, yy, yz, zz)


@jitable
def _add_loads(units, length, touched, s):
    """Add the units' loads and their first and second moments."""
    load = touched.force[2]
    peak, peak_unit, area = s["peak"], s["peak_unit"], touched.area
    area_sum = 0.0
    for j in range(units.size):
        area_sum += area[j]
        if load[j] > peak * area[j]:
            peak = load[j] / area[j]
            peak_unit = units[j]
    s["units"] += units.size
    s["area"] += area_sum
    s["peak"], s["peak_unit"] = peak, peak_unit
    load_sum, load_touched, touched_square = moments(length, load, touched.point)
    s["load"] += load_sum
    store(load_touched, s["load_touched"])
    store(touched_square, s["load_touched_square"])
    store(_first_moment(length, load, touched.position), s["load_position"])
    store(_first_moment(length, load, touched.z), s["load_z"])
    store(_first_moment(length, load, touched.x), s["load_x"])
    variance, position, square = moments(length, touched.variance[2], touched.position)
    s["load_variance"] += variance
    store(position, s["variance_position"])
    store(square, s["variance_position_square"])


@jitable(inline=True)
def _wrench(length, touched):
    """Σ (F, p × F), with F the force of a unit in the skin frame."""
    assume_noalias()
    p, ex, ey, ez, force = touched.position, touched.x, touched.y, touched.z, touched.force
    fx = fy = fz = mx = my = mz = 0.0
    for j in range(length):
        u, v, w = force[0, j], force[1, j], force[2, j]
        x = u * ex[0, j] + v * ey[0, j] + w * ez[0, j]
        y = u * ex[1, j] + v * ey[1, j] + w * ez[1, j]
        z = u * ex[2, j] + v * ey[2, j] + w * ez[2, j]
        fx, fy, fz = fx + x, fy + y, fz + z
        mx += p[1, j] * z - p[2, j] * y
        my += p[2, j] * x - p[0, j] * z
        mz += p[0, j] * y - p[1, j] * x
    return fx, fy, fz, mx, my, mz


@jitable(inline=True)
def _covariance(length, touched):
    """Upper triangle of the covariance of that, by the variances of the units' forces.

    The force of a unit has the covariance V = R diag(v) R', which is that with its torque times P,
    V P', and of the torque P V P', where P is the matrix of p ×.
    """
    assume_noalias()
    p, ex, ey, ez, variance = touched.position, touched.x, touched.y, touched.z, touched.variance
    s00 = s01 = s02 = s03 = s04 = s05 = s11 = s12 = s13 = s14 = s15 = s22 = s23 = s24 = s25 = 0.0
    s33 = s34 = s35 = s44 = s45 = s55 = 0.0
    for j in range(length):
        px, py, pz = p[0, j], p[1, j], p[2, j]
        u, v, w = variance[0, j], variance[1, j], variance[2, j]
        a, b, c = u * ex[0, j], v * ey[0, j], w * ez[0, j]
        xx = a * ex[0, j] + b * ey[0, j] + c * ez[0, j]
        xy = a * ex[1, j] + b * ey[1, j] + c * ez[1, j]
        xz = a * ex[2, j] + b * ey[2, j] + c * ez[2, j]
        a, b, c = u * ex[1, j], v * ey[1, j], w * ez[1, j]
        yy = a * ex[1, j] + b * ey[1, j] + c * ez[1, j]
        yz = a * ex[2, j] + b * ey[2, j] + c * ez[2, j]
        zz = u * ex[2, j] * ex[2, j] + v * ey[2, j] * ey[2, j] + w * ez[2, j] * ez[2, j]
        x3, x4, x5 = py * xz - pz * xy, pz * xx - px * xz, px * xy - py * xx
        y3, y4, y5 = py * yz - pz * yy, pz * xy - px * yz, px * yy - py * xy
        z3, z4, z5 = py * zz - pz * yz, pz * xz - px * zz, px * yz - py * xz
        s00, s01, s02, s11, s12, s22 = s00 + xx, s01 + xy, s02 + xz, s11 + yy, s12 + yz, s22 + zz
        s03, s04, s05 = s03 + x3, s04 + x4, s05 + x5
        s13, s14, s15 = s13 + y3, s14 + y4, s15 + y5
        s23, s24, s25 = s23 + z3, s24 + z4, s25 + z5
        s33 += py * z3 - pz * y3
        s34 += py * z4 - pz * y4
        s35 += py * z5 - pz * y5
        s44 += pz * x4 - px * z4
        s45 += pz * x5 - px * z5
        s55 += px * y5 - py * x5
    return (
        s00, s01, s02, s03, s04, s05, s11, s12, s13, s14, s15, s22, s23, s24, s25,
        s33, s34, s35, s44, s45, s55,
    )  # fmt: skip


@jitable
def _add_temperatures(units, length, touched, s):
    area, warmth = touched.warm_area, touched.warmth
    hot, hot_unit, total = s["hot"], s["hot_unit"], 0.0
    for j in range(units.size):
        if area[j] > 0.0 and (hot_unit < 0.0 or warmth[j] > hot):
            hot, hot_unit = warmth[j], units[j]
    s["hot"], s["hot_unit"] = hot, hot_unit
    area_sum, position, square = moments(length, area, touched.position)
    s["warm_area"] += area_sum
    store(position, s["warm_position"])
    store(square, s["warm_position_square"])
    for j in range(length):
        warmth[j] *= area[j]
        total += warmth[j]
    s["warm_temperature"] += total
    weighted = _first_moment(length, warmth, touched.position)
    store(weighted, s["warm_temperature_position"])


@jitable(inline=True)
def add_units(units, length, touched, has_temperature, s):
    """Add the gathered units to the sums of a contact.

    Parameters
    ----------
    units : ndarray, int32
    length : int
        Padded.
    touched : Touched
        Of the units.
    has_temperature : bool
    s : SUMS
    """
    _add_loads(units, length, touched, s)
    store(_wrench(length, touched), s["wrench"])
    store(_covariance(length, touched), s["wrench_covariance"])
    if has_temperature:
        _add_temperatures(units, length, touched, s)


@jitable
def clear(k, sums):
    """Reset a row of the sums."""
    sums.columns[k, :] = 0.0
    sums.rows[k]["peak_unit"] = -1.0
    sums.rows[k]["hot_unit"] = -1.0


@jitable
def add_total(count, sums):
    """Add the first `count` rows to the row after them."""
    total = sums.rows[count]
    for k in range(count):
        s = sums.rows[k]
        for column in range(ADDED):
            sums.columns[count, column] += sums.columns[k, column]
        if s["peak"] > total["peak"]:
            total["peak"] = s["peak"]
            total["peak_unit"] = s["peak_unit"]
        if s["hot_unit"] >= 0.0 and (total["hot_unit"] < 0.0 or s["hot"] > total["hot"]):
            total["hot"] = s["hot"]
            total["hot_unit"] = s["hot_unit"]
