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
    "ROUND", "add", "add_faces", "add_first", "arm", "cross", "diagonalise", "orient", "shifted",
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
def cross(x, y):
    """x × y."""
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@jitable
def _dot(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@jitable
def add_first(m, weight, p):
    """Add a weight at p to moments of the first order."""
    m["sum"] += weight
    for a in range(3):
        m["first"][a] += weight * p[a]


@jitable
def add(m, weight, p):
    """Add a weight at p to moments."""
    add_first(m, weight, p)
    for a in range(3):
        for b in range(3):
            m["second"][a, b] += weight * p[a] * p[b]


@jitable
def shifted(m, shift, a, b):
    """An entry of the second moments with all points shifted."""
    first = m["first"]
    return m["second"][a, b] + shift[a] * first[b] + shift[b] * (first[a] + shift[a] * m["sum"])


@jitable
def swept(q, force, factor, out):
    """Add the covariance of a torque p × F by that of the place p, times a factor."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for d in range(3):
            e, f = (d + 1) % 3, (d + 2) % 3
            over = force[b] * (force[e] * q[c, f] - force[f] * q[c, e])
            out[a, d] += factor * (over - force[c] * (force[e] * q[b, f] - force[f] * q[b, e]))


@jitable
def diagonalise(v, m):
    """Turn the axes v into eigenvectors of a symmetric matrix, by Jacobi rotations; `m` is the
    matrix in these axes, and becomes diagonal.

    numpy's `eigh` allocates, and takes twenty times as long in a kernel.
    """
    small = 1e-11 * (m[0, 0] + m[1, 1] + m[2, 2])
    for turn in range(36):
        if abs(m[0, 1]) + abs(m[0, 2]) + abs(m[1, 2]) <= small:
            break
        a, b = (turn % 3) // 2, 1 + (turn % 3 + 1) // 2
        if abs(m[a, b]) <= 1e-3 * small:
            continue
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
def _principal_axes(s, axes):
    """Turn `vectors` into the principal axes of the touched points, from axes of the cycle before
    if there are any, with the second moments along them on the diagonal of `moments`."""
    v, m, touched = s["vectors"], s["moments"], s["touched"]
    first, second = touched["first"], touched["second"]
    known = abs(_dot(axes[0], axes[0]) + _dot(axes[1], axes[1]) + _dot(axes[2], axes[2]) - 3.0)
    share = 1.0 / touched["sum"]
    middle = -share * first[0], -share * first[1], -share * first[2]
    spread = 0.0
    for a in range(3):
        spread += shifted(touched, middle, a, a)
        for b in range(3):
            v[a, b] = axes[a, b] if known < 1e-9 else 1.0 * (a == b)
    if spread <= ONE_POINT * (second[0, 0] + second[1, 1] + second[2, 2]):
        m[:] = 0.0
        return
    for a in range(3):
        for b in range(3):
            total = 0.0
            for c in range(3):
                for d in range(3):
                    total += v[c, a] * share * shifted(touched, middle, c, d) * v[d, b]
            m[a, b] = total
    diagonalise(v, m)


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
    _principal_axes(s, axes)
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
    along = v[:, large] if first > 0.0 else s["load_x"]
    across = _dot(along, normal)
    x, y, z = (
        along[0] - across * normal[0], along[1] - across * normal[1], along[2] - across * normal[2]
    )  # fmt: skip
    length = np.sqrt(x * x + y * y + z * z)
    # The major axis keeps its sign from cycle to cycle.
    if x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0] < 0.0:
        length = -length
    major = x / length, y / length, z / length
    minor = cross(normal, major)
    for a in range(3):
        axes[a, 0], axes[a, 1], axes[a, 2] = major[a], minor[a], normal[a]
    record["extent"][0], record["extent"][1] = np.sqrt(first), np.sqrt(second)
    record["normal_condition"] = condition


@jitable
def arm(record, members, model, units):
    """Load-weighted mean distance of the units from the centre, across the normal, into `arm`.

    When a contact turns about its centre, friction times load acts in every unit at its distance:
    the limit of torsion is friction × load × this arm, for any distribution of the load.
    """
    centre, normal, origin = record["middle"], record["normal"], model.settings[0]["origin"]
    moment, total = 0.0, 0.0
    for i in members:
        position, load = model.poses[i]["position"], units[i]["force"][2]
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
def _place_variance(axis, square, s, members, model, units):
    """Variance of the place of load along an axis, m², by units with faces of this area."""
    if s["units"] < 2.0:
        return square / 20.0
    least, most, mean, mean2 = np.inf, -np.inf, 0.0, 0.0
    for i in members:
        share = units[i]["force"][2] / s["load"]["sum"]
        x = _dot(model.poses[i]["position"], axis)
        least, most = min(least, x), max(most, x)
        mean, mean2 = mean + share * x, mean2 + share * x * x
    span, free = most - least, 1.0
    wide = span / np.sqrt(square)
    if wide > NO_SPAN:
        free = min(max(1.0 - 4.0 * (mean2 - mean * mean) / (span * span), 0.0), 1.0)
    left, rows = min(max(2.0 - wide, 0.0), 1.0), max(s["units"] / (1.0 + wide), 1.0)
    wide = max(wide, 1.0)
    return square * (free * left * left / 40.0 + 1.0 / (360.0 * wide * wide * rows))


@jitable
def add_faces(s, record, members, model, units):
    """Covariance due to the places of load on the faces of units, into `face`: of the centre, times
    the square of the load; and into `face_torque`: of the torque. The axes are those of `record`.
    """
    axes, square, load = record["axes"], s["area"] / s["units"], s["load"]["sum"]
    for axis in range(3):
        # the faces of tilted units extend along the normal
        tilt2 = max(1.0 - _dot(s["load_z"], s["load_z"]) / (load * load), 0.0)
        variance = tilt2 * square / 20.0
        if axis < 2:
            variance = _place_variance(axes[:, axis], square, s, members, model, units)
        for a in range(3):
            for b in range(3):
                s["face"][a, b] += variance * load * load * axes[a, axis] * axes[b, axis]
    swept(s["face"], s["wrench"], 1.0 / (load * load), s["face_torque"])
