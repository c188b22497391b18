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


@jitable
def _start(m, v):
    """Rotate m into the axes v; set v to the identity where it has none."""
    square = 0.0
    for a in range(3):
        for b in range(3):
            square += v[a, b] * v[a, b]
    if not abs(square - 3.0) < 1e-9:
        for a in range(3):
            for b in range(3):
                v[a, b] = 1.0 if a == b else 0.0
        return
    for a in range(3):
        x, y, z = m[a, 0], m[a, 1], m[a, 2]
        for b in range(3):
            m[a, b] = x * v[0, b] + y * v[1, b] + z * v[2, b]
    for b in range(3):
        x, y, z = m[0, b], m[1, b], m[2, b]
        for a in range(3):
            m[a, b] = x * v[0, a] + y * v[1, a] + z * v[2, a]


@jitable
def _eigen(m, v):
    """Eigenvectors of the symmetric m into the columns of v, by Jacobi rotations; m is destroyed.

    The eigenvalues are left on the diagonal of m. The iteration starts from v if it has axes, such
    as those of the cycle before.
    """
    _start(m, v)
    scale = m[0, 0] + m[1, 1] + m[2, 2]
    for _ in range(12):
        if abs(m[0, 1]) + abs(m[0, 2]) + abs(m[1, 2]) <= 1e-11 * scale:
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if abs(m[p, q]) <= 1e-20 * scale:
                    continue
                half = 0.5 * (m[q, q] - m[p, p]) / m[p, q]
                t = 1.0 / (abs(half) + np.sqrt(1.0 + half * half))
                if half < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(1.0 + t * t)
                sn = t * c
                for r in range(3):
                    x, y = m[r, p], m[r, q]
                    m[r, p], m[r, q] = c * x - sn * y, sn * x + c * y
                for r in range(3):
                    x, y = m[p, r], m[q, r]
                    m[p, r], m[q, r] = c * x - sn * y, sn * x + c * y
                for r in range(3):
                    x, y = v[r, p], v[r, q]
                    v[r, p], v[r, q] = c * x - sn * y, sn * x + c * y


@jitable
def cross(a, b, out):
    """Write a × b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@jitable
def _second_moments(s, m):
    """Second moments of the touched points about their mean, weighted by the load."""
    load, mean, square = s["load"], s["load_touched"], s["load_touched_square"]
    size = (square[0] + square[3] + square[5]) / load
    row = 0
    for a in range(3):
        for b in range(a, 3):
            second = square[row] / load - mean[a] * mean[b] / (load * load)
            m[a, b] = second
            m[b, a] = second
            row += 1
    if m[0, 0] + m[1, 1] + m[2, 2] <= ONE_POINT * size:
        m[:] = 0.0


@jitable
def _sorted_axes(m):
    """Columns of the largest, middle and smallest eigenvector."""
    large, small = 0, 0
    for a in range(1, 3):
        if m[a, a] > m[large, large]:
            large = a
        if m[a, a] <= m[small, small]:
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
    m, v, outward, major = scratch.first, scratch.second, scratch.vectors[0], scratch.vectors[1]
    axes, normal = record["axes"], record["normal"]
    _second_moments(s, m)
    for a in range(3):
        for b in range(3):
            v[a, b] = axes[a, b]
    _eigen(m, v)
    large, middle, small = _sorted_axes(m)
    first, second = max(m[large, large], 0.0), max(m[middle, middle], 0.0)
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
