"""Shape of a contact: principal axes of the touched points, normal, arm, and the place of load.

A unit measures its load, not the place of the load on its face, so that the true centre of pressure
differs from that of the loads at the middles of the units; the torque is unknown by as much. The
variances are derived in docs/explanation/derivations.md, "Places of load on the faces".
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import NORMAL_ASSUMED

__all__ = [
    "ROUND",
    "add_faces",
    "add_first",
    "add_second",
    "arm",
    "beside",
    "between",
    "diagonalise",
    "orient",
    "swept",
]  # fmt: skip

ROUND = 0.05
"""Second over first extent of the touched points above which they span a plane [assumed]."""
ONE_POINT = 1e-13
"""Spread of points over their square distance from the middle of the array that is a rounding error
[derived: some hundred roundings of float64]."""
NO_SPAN = 1e-6
"""Span of middles, in widths of a face, that is a rounding error [derived]."""


@jitable
def beside(shift, v):
    """shift × v."""
    x, y, z = shift[0], shift[1], shift[2]
    return y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]


@jitable
def add_first(total, weight, p):
    """Add weight times p."""
    for a in range(3):
        total[a] += weight * p[a]


@jitable
def add_second(total, weight, p):
    """Add weight times p p', an upper triangle."""
    x, y, z = weight * p[0], weight * p[1], weight * p[2]
    total[0] += x * p[0]
    total[1] += x * p[1]
    total[2] += x * p[2]
    total[3] += y * p[1]
    total[4] += y * p[2]
    total[5] += z * p[2]


@jitable
def between(m, x, y):
    """x' M y of the symmetric M, an upper triangle."""
    a = m[0] * y[0] + m[1] * y[1] + m[2] * y[2]
    b = m[1] * y[0] + m[3] * y[1] + m[4] * y[2]
    c = m[2] * y[0] + m[4] * y[1] + m[5] * y[2]
    return x[0] * a + x[1] * b + x[2] * c


@jitable
def swept(q, force):
    """Covariance of a torque p × F by that of the place p, upper triangles."""
    x = beside(force, (q[0], q[1], q[2]))
    y = beside(force, (q[1], q[3], q[4]))
    z = beside(force, (q[2], q[4], q[5]))
    first = beside(force, (x[0], y[0], z[0]))
    second = beside(force, (x[1], y[1], z[1]))
    third = beside(force, (x[2], y[2], z[2]))
    return first[0], first[1], first[2], second[1], second[2], third[2]


@jitable
def _rotate(m, v, a, b, least):
    """Rotate columns a and b of v so that the entry of m between them is zero, unless it is at
    `least`."""
    if abs(m[a, b]) <= least:
        return
    half = 0.5 * (m[b, b] - m[a, a]) / m[a, b]
    t = 1.0 / (abs(half) + np.sqrt(1.0 + half * half))
    t = t if half >= 0.0 else -t
    c = 1.0 / np.sqrt(1.0 + t * t)
    s = t * c
    for r in range(3):
        m[r, a], m[r, b] = c * m[r, a] - s * m[r, b], s * m[r, a] + c * m[r, b]
        v[r, a], v[r, b] = c * v[r, a] - s * v[r, b], s * v[r, a] + c * v[r, b]
    for r in range(3):
        m[a, r], m[b, r] = c * m[a, r] - s * m[b, r], s * m[a, r] + c * m[b, r]
    m[a, b] = m[b, a] = 0.0


@jitable
def diagonalise(triangle, v, m):
    """Turn the axes v into eigenvectors of a symmetric matrix, whose eigenvalues become the
    diagonal of m, by Jacobi rotations.

    numpy's `eigh` allocates, and takes twenty times as long in a kernel.
    """
    for a in range(3):
        for b in range(3):
            m[a, b] = between(triangle, v[:, a], v[:, b])
    small = 1e-11 * (m[0, 0] + m[1, 1] + m[2, 2])
    for _ in range(12):
        if abs(m[0, 1]) + abs(m[0, 2]) + abs(m[1, 2]) <= small:
            break
        _rotate(m, v, 0, 1, 1e-3 * small)
        _rotate(m, v, 0, 2, 1e-3 * small)
        _rotate(m, v, 1, 2, 1e-3 * small)


@jitable
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
def _sorted_axes(m):
    """Columns of the largest, middle and smallest number on the diagonal."""
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
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jitable
def orient(s, record):
    """Axes and normal: plane through the touched points, or the mean of the units' normals.

    Parameters
    ----------
    s : SUMS
        `vectors` and `moments` are scratch.
    record : CONTACT
        `axes`, `normal`, `extent`, `normal_condition` and flags are written; the iteration starts
        from the axes of the cycle before, which also give the major axis its sign.
    """
    axes, normal, v, m = record["axes"], record["normal"], s["vectors"], s["moments"]
    square = _dot(axes[:, 0], axes[:, 0]) + _dot(axes[:, 1], axes[:, 1])
    known = abs(square + _dot(axes[:, 2], axes[:, 2]) - 3.0) < 1e-9
    for a in range(3):
        for b in range(3):
            v[a, b] = axes[a, b] if known else 0.0
        v[a, a] = axes[a, a] if known else 1.0
    diagonalise(_second_moments(s), v, m)
    large, middle, small = _sorted_axes(m)
    first, second = max(m[large, large], 0.0), max(m[middle, middle], 0.0)
    length = -np.sqrt(_dot(s["load_z"], s["load_z"]))
    condition = np.sqrt(second / first) if first > 0.0 else 0.0
    # depths that differ along a row of units are no second direction of their face
    deep = _dot(v[:, middle], s["load_z"]) / length
    sign = 1.0 if _dot(v[:, small], s["load_z"]) / length >= 0.0 else -1.0
    planar = s["units"] >= 3.0 and condition * np.sqrt(max(1.0 - deep * deep, 0.0)) > ROUND
    for a in range(3):
        normal[a] = sign * v[a, small] if planar else s["load_z"][a] / length
    if not planar:
        record["flags"] |= NORMAL_ASSUMED
    x, y, z = s["load_x"][0], s["load_x"][1], s["load_x"][2]
    if first > 0.0:
        x, y, z = v[0, large], v[1, large], v[2, large]
    across = x * normal[0] + y * normal[1] + z * normal[2]
    x, y, z = x - across * normal[0], y - across * normal[1], z - across * normal[2]
    length = np.sqrt(x * x + y * y + z * z)
    # The major axis keeps its sign from cycle to cycle.
    if x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0] < 0.0:
        length = -length
    major = x / length, y / length, z / length
    minor = beside(normal, major)
    for a in range(3):
        axes[a, 0], axes[a, 1], axes[a, 2] = major[a], minor[a], normal[a]
    record["extent"][0], record["extent"][1] = np.sqrt(first), np.sqrt(second)
    record["normal_condition"] = condition


@jitable
def arm(record, members, origin, poses, units):
    """Load-weighted mean distance of the units from the centre, across the normal, into `arm`.

    When a contact turns about its centre, friction times load acts in every unit at its distance:
    the limit of torsion is friction × load × this arm, for any distribution of the load.
    """
    centre, normal = record["middle"], record["normal"]
    moment, total = 0.0, 0.0
    for i in members:
        position, load = poses[i]["position"], units[i]["force"][2]
        along, square = 0.0, 0.0
        for a in range(3):
            d = position[a] + origin[a] - centre[a]
            along += d * normal[a]
            square += d * d
        total += load
        moment += load * np.sqrt(max(square - along * along, 0.0))
    # For one unit it is exactly 0, without rounding errors: a torsion is divided by it.
    record["arm"] = moment / total if members.size > 1 else 0.0


@jitable
def _variance(square, units, span, extent2):
    """Of the place of load along an axis, m², for more than one unit."""
    side = np.sqrt(square)
    wide = span / side
    free, left = 1.0, min(max(2.0 - wide, 0.0), 1.0)
    if wide > NO_SPAN:
        free = min(max(1.0 - 4.0 * extent2 / (span * span), 0.0), 1.0)
    rows = max(units / (1.0 + wide), 1.0)
    wide = max(wide, 1.0)
    return square * (free * left * left / 40.0 + 1.0 / (360.0 * wide * wide * rows))


@jitable
def _along(axis, square, s, members, poses, units):
    """The same for the units of a contact."""
    least, most, mean, mean2 = np.inf, -np.inf, 0.0, 0.0
    for i in members:
        x, share = _dot(poses[i]["position"], axis), units[i]["force"][2] / s["load"]
        least, most = min(least, x), max(most, x)
        mean, mean2 = mean + share * x, mean2 + share * x * x
    return _variance(square, s["units"], most - least, mean2 - mean * mean)


@jitable
def add_faces(s, record, members, poses, units, out):
    """Add the covariance due to the places of load on the faces of units: of the centre, times the
    square of the load, and of the torque.

    Parameters
    ----------
    s : SUMS
        Of the units.
    record : CONTACT
        Its axes are read.
    members : ndarray, int32
        The units.
    poses : ndarray, shape (n,), POSE
    units : ndarray, shape (n,), UNIT
    out : SUMS
        `face` and `face_torque` are written.
    """
    if members.size == 0:
        return
    axes, square, total = record["axes"], s["area"] / s["units"], s["load"]
    u, v, w = axes[:, 0], axes[:, 1], axes[:, 2]
    along, across = square / 20.0, square / 20.0
    tilt2 = max(1.0 - _dot(s["load_z"], s["load_z"]) / (total * total), 0.0)
    upright = tilt2 * square / 20.0
    if members.size > 1:
        along = _along(u, square, s, members, poses, units)
        across = _along(v, square, s, members, poses, units)
    place = (
        along * u[0] * u[0] + across * v[0] * v[0] + upright * w[0] * w[0],
        along * u[0] * u[1] + across * v[0] * v[1] + upright * w[0] * w[1],
        along * u[0] * u[2] + across * v[0] * v[2] + upright * w[0] * w[2],
        along * u[1] * u[1] + across * v[1] * v[1] + upright * w[1] * w[1],
        along * u[1] * u[2] + across * v[1] * v[2] + upright * w[1] * w[2],
        along * u[2] * u[2] + across * v[2] * v[2] + upright * w[2] * w[2],
    )
    torque = swept(place, s["wrench"])
    for row in range(6):
        out["face"][row] += place[row] * total * total
        out["face_torque"][row] += torque[row]
