"""Shape of a contact: principal axes of the touched points, normal, arm."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import NORMAL_ASSUMED

__all__ = ["ROUND", "arm", "cross", "orient"]

ROUND = 0.05
"""Second over first extent of the touched points above which they span a plane [assumed]."""
ONE_POINT = 1e-13
"""Spread of points over their square distance from the middle of the array that is a rounding error
[derived: some hundred roundings of float64]."""


@jitable(inline=True)
def _between(m, x, y):
    """x' M y of the symmetric M, an upper triangle."""
    a = m[0] * y[0] + m[1] * y[1] + m[2] * y[2]
    b = m[1] * y[0] + m[3] * y[1] + m[4] * y[2]
    c = m[2] * y[0] + m[4] * y[1] + m[5] * y[2]
    return x[0] * a + x[1] * b + x[2] * c


@jitable(inline=True)
def _start(m, v):
    """The symmetric M in the axes v, an upper triangle; set v to the identity where it has none."""
    x, y, z = (v[0, 0], v[1, 0], v[2, 0]), (v[0, 1], v[1, 1], v[2, 1]), (v[0, 2], v[1, 2], v[2, 2])
    square = 0.0
    for a in range(3):
        square += x[a] * x[a] + y[a] * y[a] + z[a] * z[a]
    if not abs(square - 3.0) < 1e-9:
        for a in range(3):
            for b in range(3):
                v[a, b] = 1.0 if a == b else 0.0
        return m
    return (
        _between(m, x, x), _between(m, x, y), _between(m, x, z), _between(m, y, y),
        _between(m, y, z), _between(m, z, z),
    )  # fmt: skip


@jitable(inline=True)
def _rotate(block, v, a, b, least):
    """Rotate columns a and b of v, so that the entry between them is zero.

    `block` is their diagonal entries, the one between them, and those of both with the third axis,
    which are returned as they are afterwards; all stays as it is where that entry is at `least`.
    """
    p, q, between, x, y = block
    if abs(between) <= least:
        return block
    half = 0.5 * (q - p) / between
    root = np.sqrt(1.0 + half * half)
    t = 1.0 / (abs(half) + root)
    c = np.sqrt(0.5 + 0.5 * abs(half) / root)
    if half < 0.0:
        t = -t
    sn = t * c
    for r in range(3):
        f, g = v[r, a], v[r, b]
        v[r, a], v[r, b] = c * f - sn * g, sn * f + c * g
    return p - t * between, q + t * between, 0.0, c * x - sn * y, sn * x + c * y


@jitable
def _eigen(m, v, values):
    """Eigenvalues of the symmetric m, an upper triangle, and eigenvectors into the columns of v, by
    Jacobi rotations, which start from v if it has axes, such as those of the cycle before."""
    xx, xy, xz, yy, yz, zz = _start(m, v)
    small = 1e-11 * (xx + yy + zz)
    least = 1e-3 * small
    for _ in range(12):
        if abs(xy) + abs(xz) + abs(yz) <= small:
            break
        xx, yy, xy, xz, yz = _rotate((xx, yy, xy, xz, yz), v, 0, 1, least)
        xx, zz, xz, xy, yz = _rotate((xx, zz, xz, xy, yz), v, 0, 2, least)
        yy, zz, yz, xy, xz = _rotate((yy, zz, yz, xy, xz), v, 1, 2, least)
    values[0], values[1], values[2] = xx, yy, zz


@jitable
def cross(a, b, out):
    """Write a × b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@jitable(inline=True)
def _second_moments(s):
    """Second moments of the touched points about their mean, weighted by the load: an upper
    triangle."""
    share, square = 1.0 / s["load"], s["load_touched_square"]
    mean = s["load_touched"]
    x, y, z = share * mean[0], share * mean[1], share * mean[2]
    size = share * (square[0] + square[3] + square[5])
    xx, xy, xz = share * square[0] - x * x, share * square[1] - x * y, share * square[2] - x * z
    yy, yz, zz = share * square[3] - y * y, share * square[4] - y * z, share * square[5] - z * z
    if xx + yy + zz <= ONE_POINT * size:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return xx, xy, xz, yy, yz, zz


@jitable
def _sorted_axes(values):
    """Columns of the eigenvectors of the largest, middle and smallest eigenvalue."""
    large, small = 0, 0
    for a in range(1, 3):
        if values[a] > values[large]:
            large = a
        if values[a] <= values[small]:
            small = a
    if large == small:
        large, small = 0, 2
    return large, 3 - large - small, small


@jitable
def orient(s, record, scratch):
    """Axes and normal: plane through the touched points, or the mean of the units' normals.

    Parameters
    ----------
    s : SUMS
    record : CONTACT
        `axes`, `normal`, `extent`, `normal_condition` and flags are written; the iteration starts
        from the axes of the cycle before, which also give the major axis its sign.
    scratch : Scratch
    """
    v, outward, major = scratch.second, scratch.vectors[0], scratch.vectors[1]
    values = scratch.vectors[2]
    axes, normal = record["axes"], record["normal"]
    for a in range(3):
        for b in range(3):
            v[a, b] = axes[a, b]
    _eigen(_second_moments(s), v, values)
    large, middle, small = _sorted_axes(values)
    first, second = max(values[large], 0.0), max(values[middle], 0.0)
    condition = np.sqrt(second / first) if first > 0.0 else 0.0
    length = 0.0
    for a in range(3):
        outward[a] = -s["load_z"][a]
        length += outward[a] ** 2
    length = np.sqrt(length)
    along = 0.0
    for a in range(3):
        outward[a] /= length
        along += v[a, small] * outward[a]
    planar = s["units"] >= 3.0 and condition > ROUND
    for a in range(3):
        normal[a] = (v[a, small] if along >= 0.0 else -v[a, small]) if planar else outward[a]
    if not planar:
        record["flags"] |= NORMAL_ASSUMED
    # The major axis keeps its sign from cycle to cycle.
    same = 0.0
    across = 0.0
    for a in range(3):
        major[a] = v[a, large] if first > 0.0 else s["load_x"][a]
        across += major[a] * normal[a]
    length = 0.0
    for a in range(3):
        major[a] -= across * normal[a]
        length += major[a] ** 2
        same += major[a] * axes[a, 0]
    length = np.sqrt(length) if same >= 0.0 else -np.sqrt(length)
    for a in range(3):
        major[a] /= length
        axes[a, 0] = major[a]
        axes[a, 2] = normal[a]
    cross(normal, major, outward)
    for a in range(3):
        axes[a, 1] = outward[a]
    record["extent"][0] = np.sqrt(first)
    record["extent"][1] = np.sqrt(second)
    record["normal_condition"] = condition


@jitable
def arm(record, members, load, geometry):
    """Load-weighted mean distance of the units from the centre, across the normal, into `arm`.

    When a contact turns about its centre, friction times load acts in every unit at its distance:
    the limit of torsion is friction × load × this arm, for any distribution of the load.
    """
    first, last = record["begin"], record["end"]
    centre, normal, origin = record["middle"], record["normal"], geometry.origin
    moment, total = 0.0, 0.0
    for at in range(first, last):
        i = members[at]
        position = geometry.pose[i]["position"]
        along, square = 0.0, 0.0
        for a in range(3):
            d = position[a] + origin[a] - centre[a]
            along += d * normal[a]
            square += d * d
        total += load[i]
        moment += load[i] * np.sqrt(max(square - along * along, 0.0))
    # For one unit it is exactly 0, without rounding errors: a torsion is divided by it.
    record["arm"] = moment / total if last - first > 1 else 0.0
