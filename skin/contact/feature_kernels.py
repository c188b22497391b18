"""All compiled code of what a contact is: wrench, centre, shape, warmth, path.

One pass over the units of the contacts adds up moments about the middle of the array, in float64;
everything else follows from the sums, and the sums of the skin are those of its contacts. The
constants are this file's own: a cached kernel does not see another file change.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = [
    "DEPTH",
    "GEOMETRY",
    "SUMS",
    "WARMTH",
    "WAYPOINTS",
    "WEAK_SIGMAS",
    "describe",
    "describe_python",
]

WEAK, NORMAL_ASSUMED, TORSION_BLIND = 1, 2, 4
BORN = 1
BRIDGE, SILENT = 2, 3
KIND, LABEL, MEMBERS = range(3)

POSITION, ROTATION, AREA = 0, 3, 12
GEOMETRY = 16
"""Columns of `geometry`: position about the middle of the array; rotation, row by row; area. Units
are picked here and there: what belongs to one lies together."""

DEPTH, WARMTH = 1, 2
"""What the caller has: pressed depths; temperatures."""

WEAK_SIGMAS = 5.0
"""Below this many sigmas of its load, a contact has no centre."""
ROUND = 0.05
"""Second over first extent of the touched points, above which they span a plane."""
ONE_POINT = 1e-13
"""Spread of points over their square distance from the middle of the array that is rounding."""
STEP_SIGMAS = 3.0
STEP_M = 2e-4
"""A centre that moved this far, in its sigmas and at least, has really moved."""
WAYPOINTS = 128
"""Centres of a contact that are remembered."""

# Sums over the units of a contact; symmetric matrices as upper triangles, row by row.
(LOAD, LOAD_VARIANCE, UNITS, SURFACE, PEAK, PEAK_UNIT) = range(6)
(LOAD_P, LOAD_S, LOAD_SS, VAR_P, VAR_PP, LOAD_Z, LOAD_X) = (6, 9, 12, 18, 21, 27, 30)
FORCE, MOMENT, COVARIANCE = 33, 36, 39
WARM, WARM_T, WARM_P, WARM_TP, WARM_PP, HOT, HOT_UNIT = 60, 61, 62, 65, 68, 74, 75
SILENT_AREA = 76
SUMS = 77


@register_jitable
def _add_loads(units, force, force_sigma, displacement, geometry, have, s):
    """Add the units' loads and their moments to the sums.

    Over the load: places p, touched points s, axes x and z; over its variance: places v. Sums are
    local variables: an array's would go to memory with each unit.
    """
    loads = variances = surface = px = py = pz = sx = sy = sz = sxx = sxy = sxz = syy = 0.0
    syz = szz = vx = vy = vz = vxx = vxy = vxz = vyy = vyz = vzz = zx = zy = zz = xx = xy = 0.0
    xz = 0.0
    peak, peak_unit = s[PEAK], s[PEAK_UNIT]
    for j in range(units.size):
        i = units[j]
        load, variance = np.float64(force[2, i]), np.float64(force_sigma[2, i]) ** 2
        area = geometry[i, AREA]
        loads += load
        variances += variance
        surface += area
        if load > peak * area:
            peak = load / area
            peak_unit = i
        depth = 1e-3 * displacement[2, i] if have & DEPTH else 0.0
        depth = depth if np.isfinite(depth) else 0.0
        place_x, along_x = geometry[i, POSITION], geometry[i, ROTATION + 2]
        place_y, along_y = geometry[i, POSITION + 1], geometry[i, ROTATION + 5]
        place_z, along_z = geometry[i, POSITION + 2], geometry[i, ROTATION + 8]
        xx += load * geometry[i, ROTATION]
        zx += load * along_x
        xy += load * geometry[i, ROTATION + 3]
        zy += load * along_y
        xz += load * geometry[i, ROTATION + 6]
        zz += load * along_z
        touched_x = place_x + depth * along_x
        touched_y = place_y + depth * along_y
        touched_z = place_z + depth * along_z
        px += load * place_x
        one, other = load * touched_x, variance * place_x
        sx += one
        vx += other
        sxx += one * touched_x
        vxx += other * place_x
        sxy += one * touched_y
        vxy += other * place_y
        sxz += one * touched_z
        vxz += other * place_z
        py += load * place_y
        one, other = load * touched_y, variance * place_y
        sy += one
        vy += other
        syy += one * touched_y
        vyy += other * place_y
        syz += one * touched_z
        vyz += other * place_z
        pz += load * place_z
        one, other = load * touched_z, variance * place_z
        sz += one
        vz += other
        szz += one * touched_z
        vzz += other * place_z
    s[LOAD] += loads
    s[LOAD_VARIANCE] += variances
    s[SURFACE] += surface
    s[PEAK], s[PEAK_UNIT] = peak, peak_unit
    s[LOAD_P] += px
    s[LOAD_P + 1] += py
    s[LOAD_P + 2] += pz
    s[LOAD_S] += sx
    s[LOAD_S + 1] += sy
    s[LOAD_S + 2] += sz
    s[LOAD_SS] += sxx
    s[LOAD_SS + 1] += sxy
    s[LOAD_SS + 2] += sxz
    s[LOAD_SS + 3] += syy
    s[LOAD_SS + 4] += syz
    s[LOAD_SS + 5] += szz
    s[VAR_P] += vx
    s[VAR_P + 1] += vy
    s[VAR_P + 2] += vz
    s[VAR_PP] += vxx
    s[VAR_PP + 1] += vxy
    s[VAR_PP + 2] += vxz
    s[VAR_PP + 3] += vyy
    s[VAR_PP + 4] += vyz
    s[VAR_PP + 5] += vzz
    s[LOAD_Z] += zx
    s[LOAD_Z + 1] += zy
    s[LOAD_Z + 2] += zz
    s[LOAD_X] += xx
    s[LOAD_X + 1] += xy
    s[LOAD_X + 2] += xz


@register_jitable
def _add_wrenches(units, force, force_sigma, geometry, s):
    """Add the units' forces, their moments about the middle and covariances to the sums.

    A force along the axis (x, y, z) of a unit has a moment along (u, v, w), position x axis.
    """
    fx = fy = fz = fu = fv = fw = xx = xy = xz = xu = xv = xw = yy = yz = yu = yv = yw = 0.0
    zz = zu = zv = zw = uu = uv = uw = vv = vw = ww = 0.0
    for j in range(units.size):
        i = units[j]
        px, py, pz = geometry[i, POSITION], geometry[i, POSITION + 1], geometry[i, POSITION + 2]
        for axis in range(3):
            x = geometry[i, ROTATION + axis]
            y = geometry[i, ROTATION + 3 + axis]
            z = geometry[i, ROTATION + 6 + axis]
            u, v, w = py * z - pz * y, pz * x - px * z, px * y - py * x
            along = np.float64(force[axis, i])
            variance = np.float64(force_sigma[axis, i]) ** 2
            fx += along * x
            fy += along * y
            fz += along * z
            fu += along * u
            fv += along * v
            fw += along * w
            part = variance * x
            xx += part * x
            xy += part * y
            xz += part * z
            xu += part * u
            xv += part * v
            xw += part * w
            part = variance * y
            yy += part * y
            yz += part * z
            yu += part * u
            yv += part * v
            yw += part * w
            part = variance * z
            zz += part * z
            zu += part * u
            zv += part * v
            zw += part * w
            part = variance * u
            uu += part * u
            uv += part * v
            uw += part * w
            part = variance * v
            vv += part * v
            vw += part * w
            part = variance * w
            ww += part * w
    s[FORCE] += fx
    s[FORCE + 1] += fy
    s[FORCE + 2] += fz
    s[MOMENT] += fu
    s[MOMENT + 1] += fv
    s[MOMENT + 2] += fw
    s[COVARIANCE] += xx
    s[COVARIANCE + 1] += xy
    s[COVARIANCE + 2] += xz
    s[COVARIANCE + 3] += xu
    s[COVARIANCE + 4] += xv
    s[COVARIANCE + 5] += xw
    s[COVARIANCE + 6] += yy
    s[COVARIANCE + 7] += yz
    s[COVARIANCE + 8] += yu
    s[COVARIANCE + 9] += yv
    s[COVARIANCE + 10] += yw
    s[COVARIANCE + 11] += zz
    s[COVARIANCE + 12] += zu
    s[COVARIANCE + 13] += zv
    s[COVARIANCE + 14] += zw
    s[COVARIANCE + 15] += uu
    s[COVARIANCE + 16] += uv
    s[COVARIANCE + 17] += uw
    s[COVARIANCE + 18] += vv
    s[COVARIANCE + 19] += vw
    s[COVARIANCE + 20] += ww


@register_jitable
def _add_warmth(units, temperature, geometry, s):
    for j in range(units.size):
        i = units[j]
        warmth = np.float64(temperature[i])
        if not np.isfinite(warmth):
            continue
        place = geometry[i]
        area = place[AREA]
        s[WARM] += area
        s[WARM_T] += area * warmth
        if s[HOT_UNIT] < 0.0 or warmth > s[HOT]:
            s[HOT] = warmth
            s[HOT_UNIT] = i
        row = 0
        for a in range(3):
            s[WARM_P + a] += area * place[a]
            s[WARM_TP + a] += area * warmth * place[a]
            for b in range(a, 3):
                s[WARM_PP + row] += area * place[a] * place[b]
                row += 1


@register_jitable
def _add_units(units, force, force_sigma, displacement, temperature, geometry, have, s):
    """Add units to the sums."""
    s[UNITS] += units.size
    _add_loads(units, force, force_sigma, displacement, geometry, have, s)
    _add_wrenches(units, force, force_sigma, geometry, s)
    if have & WARMTH:
        _add_warmth(units, temperature, geometry, s)


@register_jitable
def _clear(s):
    s[:] = 0.0
    s[PEAK_UNIT] = -1.0
    s[HOT_UNIT] = -1.0


@register_jitable
def _add_sums(s, total):
    for row in range(SUMS):
        if row not in (PEAK, PEAK_UNIT, HOT, HOT_UNIT):
            total[row] += s[row]
    if s[PEAK] > total[PEAK]:
        total[PEAK] = s[PEAK]
        total[PEAK_UNIT] = s[PEAK_UNIT]
    if s[HOT_UNIT] >= 0.0 and (total[HOT_UNIT] < 0.0 or s[HOT] > total[HOT]):
        total[HOT] = s[HOT]
        total[HOT_UNIT] = s[HOT_UNIT]


@register_jitable
def _add_silence(count, kind, label, start, index, geometry, sums):
    """Area of silent units beside each contact, each unit once a contact."""
    for i in range(kind.size):
        if kind[i] != BRIDGE and kind[i] != SILENT:
            continue
        for at in range(start[i], start[i + 1]):
            k = label[index[at]]
            fresh = k >= 0
            for before in range(start[i], at):
                fresh &= label[index[before]] != k
            if fresh:
                sums[min(k, count), SILENT_AREA] += geometry[i, AREA]


@register_jitable
def _unpack(s, row, matrix):
    """Upper triangle from `row` on to a full symmetric matrix."""
    size = matrix.shape[0]
    for a in range(size):
        for b in range(a, size):
            matrix[a, b] = s[row]
            matrix[b, a] = s[row]
            row += 1


@register_jitable
def _start(m, v):
    """Turn m into the axes v; or v into the plain axes, where it holds none."""
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


@register_jitable
def _eigen(m, v):
    """Eigenvectors of the symmetric m into the columns of v, by Jacobi rotations; m is destroyed.

    The eigenvalues are left on the diagonal of m. Where v holds axes, those of the cycle before for
    instance, they are where the rotations begin.
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


@register_jitable
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@register_jitable
def _shift_covariance(covariance, shift, side, low):
    """Covariance of a wrench after its moment has been moved: M' = M + shift x F.

    The block of force and moment goes into `side`, that of the moment into `low`.
    """
    x, y, z = shift[0], shift[1], shift[2]
    for a in range(3):
        for b in range(3):
            side[a, b] = covariance[a, b + 3]
            low[a, b] = covariance[a + 3, b + 3]
    for a in range(3):
        p, q, r = covariance[a, 0], covariance[a, 1], covariance[a, 2]
        side[a, 0] += y * r - z * q
        side[a, 1] += z * p - x * r
        side[a, 2] += x * q - y * p
    for a in range(3):
        p, q, r = covariance[0, a + 3], covariance[1, a + 3], covariance[2, a + 3]
        low[a, 0] += y * r - z * q
        low[a, 1] += z * p - x * r
        low[a, 2] += x * q - y * p
    for b in range(3):
        p, q, r = side[0, b], side[1, b], side[2, b]
        low[0, b] += y * r - z * q
        low[1, b] += z * p - x * r
        low[2, b] += x * q - y * p


@register_jitable
def _orient(s, record, m, v, vectors):
    """Axes and normal: plane through the touched points, or the mean of the units' normals."""
    load = s[LOAD]
    size = (s[LOAD_SS] + s[LOAD_SS + 3] + s[LOAD_SS + 5]) / load
    row = 0
    for a in range(3):
        for b in range(a, 3):
            second = s[LOAD_SS + row] / load - s[LOAD_S + a] * s[LOAD_S + b] / (load * load)
            m[a, b] = second
            m[b, a] = second
            row += 1
    if m[0, 0] + m[1, 1] + m[2, 2] <= ONE_POINT * size:
        m[:] = 0.0
    v[:] = record["axes"]
    _eigen(m, v)
    large, small = 0, 0
    for a in range(1, 3):
        if m[a, a] > m[large, large]:
            large = a
        if m[a, a] <= m[small, small]:
            small = a
    if large == small:
        large, small = 0, 2
    middle = 3 - large - small
    first, second = max(m[large, large], 0.0), max(m[middle, middle], 0.0)
    condition = np.sqrt(second / first) if first > 0.0 else 0.0
    axes, normal = record["axes"], record["normal"]
    outward, major = vectors[0], vectors[1]
    length = 0.0
    for a in range(3):
        outward[a] = -s[LOAD_Z + a]
        length += outward[a] ** 2
    length = np.sqrt(length)
    along = 0.0
    for a in range(3):
        outward[a] /= length
        along += v[a, small] * outward[a]
    planar = s[UNITS] >= 3.0 and condition > ROUND
    for a in range(3):
        normal[a] = (v[a, small] if along >= 0.0 else -v[a, small]) if planar else outward[a]
    if not planar:
        record["flags"] |= NORMAL_ASSUMED
    # The major axis keeps its sense from cycle to cycle.
    same = 0.0
    across = 0.0
    for a in range(3):
        major[a] = v[a, large] if first > 0.0 else s[LOAD_X + a]
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
    _cross(normal, major, outward)
    for a in range(3):
        axes[a, 1] = outward[a]
    record["extent"][0] = np.sqrt(first)
    record["extent"][1] = np.sqrt(second)
    record["normal_condition"] = condition


@register_jitable
def _warm(s, record, m):
    """Mean, hottest unit, and slope of the temperature along the two axes of the contact."""
    gradient = record["temperature_gradient"]
    gradient[:] = np.nan
    record["hot_unit"] = int(s[HOT_UNIT])
    if s[WARM] <= 0.0:
        record["temperature"] = np.nan
        record["hot_temperature"] = np.nan
        return
    record["temperature"] = s[WARM_T] / s[WARM]
    record["hot_temperature"] = s[HOT]
    if s[UNITS] < 3.0:
        return
    axes = record["axes"]
    m[:] = 0.0
    rhs = m[2]
    row = 0
    for a in range(3):
        slope = s[WARM_TP + a] - s[WARM_T] * s[WARM_P + a] / s[WARM]
        for k in range(2):
            rhs[k] += axes[a, k] * slope
        for b in range(a, 3):
            spread = s[WARM_PP + row] - s[WARM_P + a] * s[WARM_P + b] / s[WARM]
            row += 1
            for k in range(2):
                for j in range(2):
                    both = axes[a, k] * axes[b, j]
                    if a != b:
                        both += axes[b, k] * axes[a, j]
                    m[k, j] += both * spread
    det = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    if det <= ROUND**4 * (m[0, 0] + m[1, 1]) ** 2:
        return
    first = (rhs[0] * m[1, 1] - rhs[1] * m[0, 1]) / det
    second = (rhs[1] * m[0, 0] - rhs[0] * m[1, 0]) / det
    for a in range(3):
        gradient[a] = first * axes[a, 0] + second * axes[a, 1]


@register_jitable
def _conclude(s, record, origin, c6, spare):
    """Everything that follows from the sums of one contact; `origin` is the array's middle."""
    m, v, about = spare[0], spare[1], spare[2, 2]
    load = s[LOAD]
    record["flags"] = 0
    record["load"] = load
    record["load_sigma"] = np.sqrt(s[LOAD_VARIANCE])
    record["area"] = s[SURFACE]
    record["mean_pressure"] = load / s[SURFACE]
    record["peak_pressure"] = s[PEAK]
    record["peak_unit"] = int(s[PEAK_UNIT])
    record["coverage"] = s[SURFACE] / (s[SURFACE] + s[SILENT_AREA])
    force = s[FORCE : FORCE + 3]
    _unpack(s, COVARIANCE, c6)
    wrench = record["wrench"]
    _cross(origin, force, wrench[3:])
    for a in range(3):
        wrench[a] = force[a]
        wrench[a + 3] += s[MOMENT + a]
    covariance = record["wrench_covariance"]
    _shift_covariance(c6, origin, m, v)
    for a in range(3):
        for b in range(3):
            covariance[a, b] = c6[a, b]
            covariance[a, b + 3] = m[a, b]
            covariance[b + 3, a] = m[a, b]
            covariance[a + 3, b + 3] = v[a, b]
    for a in range(6):
        record["wrench_sigma"][a] = np.sqrt(max(covariance[a, a], 0.0))
    _orient(s, record, m, v, spare[2])
    _warm(s, record, m)
    centre, moment, normal = record["centroid"], record["moment"], record["normal"]
    along = 0.0
    for a in range(3):
        along += force[a] * normal[a]
    across = 0.0
    for a in range(3):
        across += (force[a] - along * normal[a]) ** 2
    record["shear"] = np.sqrt(across)
    if s[UNITS] < 2.0:
        record["flags"] |= TORSION_BLIND
    if load < WEAK_SIGMAS * record["load_sigma"]:
        record["flags"] |= WEAK
        centre[:] = np.nan
        moment[:] = np.nan
        record["centroid_covariance"][:] = np.nan
        record["moment_covariance"][:] = np.nan
        record["torsion"] = np.nan
        record["torsion_sigma"] = np.nan
        record["margin"] = np.nan
        record["grip_force"] = np.nan
        return
    for a in range(3):
        about[a] = -s[LOAD_P + a] / load
        centre[a] = origin[a] - about[a]
    _cross(about, force, moment)
    for a in range(3):
        moment[a] += s[MOMENT + a]
    _shift_covariance(c6, about, m, record["moment_covariance"])
    torsion, variance = 0.0, 0.0
    row = 0
    for a in range(3):
        torsion += moment[a] * normal[a]
        for b in range(3):
            variance += normal[a] * record["moment_covariance"][a, b] * normal[b]
        for b in range(a, 3):
            spread = s[VAR_PP + row] + about[a] * s[VAR_P + b] + about[b] * s[VAR_P + a]
            spread = (spread + about[a] * about[b] * s[LOAD_VARIANCE]) / (load * load)
            if a == b:
                spread = max(spread, 0.0)
            record["centroid_covariance"][a, b] = spread
            record["centroid_covariance"][b, a] = spread
            row += 1
    record["torsion"] = torsion
    record["torsion_sigma"] = np.sqrt(max(variance, 0.0))


@register_jitable
def _forget(record):
    """A record may have been another contact's: of a new one, nothing is known of slip."""
    record["slip"] = 0
    record["slip_units"] = 0
    record["body_units"] = 0
    record["onset_ns"] = 0
    record["stick_ratio"] = np.nan
    record["pattern"] = np.nan
    record["motion"][:] = np.nan
    record["rotation"][:] = np.nan
    record["friction"] = np.nan
    record["friction_sigma"] = np.nan
    record["friction_lower"] = 0.0
    record["margin"] = np.nan
    record["grip_force"] = np.nan


@register_jitable
def _arm(members, first, last, force, geometry, origin, record):
    """Load-weighted mean distance from the centre, across the normal."""
    centre, normal = record["centroid"], record["normal"]
    moment, load = 0.0, 0.0
    for at in range(first, last):
        i = members[at]
        along, square = 0.0, 0.0
        for a in range(3):
            d = geometry[i, POSITION + a] + origin[a] - centre[a]
            along += d * normal[a]
            square += d * d
        load += force[2, i]
        moment += force[2, i] * np.sqrt(max(square - along * along, 0.0))
    # Of one unit it is 0, not what rounding makes of that: a torsion is divided by it.
    record["arm"] = moment / load if last - first > 1 else 0.0


@register_jitable
def _walk(record, path):
    """Take the centre as a waypoint if it has really moved."""
    centre, waypoint = record["centroid"], record["waypoint"]
    if record["event"] & BORN:
        record["waypoints"] = 0
        record["travel"] = 0.0
    if not np.isfinite(centre[0]):
        return
    if record["waypoints"] == 0:
        record["origin"][:] = centre
    else:
        square, variance = 0.0, 0.0
        for a in range(3):
            square += (centre[a] - waypoint[a]) ** 2
            variance += record["centroid_covariance"][a, a]
        if square <= max(STEP_M**2, STEP_SIGMAS**2 * variance):
            return
        record["travel"] += np.sqrt(square)
    waypoint[:] = centre
    path[record["waypoints"] % WAYPOINTS] = centre
    record["waypoints"] += 1


def describe_python(
    count, untracked_end, have, force, force_sigma, displacement, temperature,
    geometry, origin, graph, units, slots, contacts, path, sums, c6, spare,
):  # fmt: skip
    """Describe the contacts that `find_contacts` has found, and their total.

    Parameters
    ----------
    count : int
        Contacts; with 0 only the total is described.
    untracked_end : int
        Units in contact, those of contacts that are not described included.
    have : int
        DEPTH and WARMTH, as far as given.
    force, force_sigma : ndarray, shape (3, n)
        Newton, unit frame, and its one-sigma.
    displacement : ndarray, shape (3, n)
        Millimetre, unit frame; the last row is the pressed depth.
    temperature : ndarray, shape (n,)
        Degree Celsius.
    geometry : ndarray, shape (n, 16), float64
        See `GEOMETRY`.
    origin : ndarray, shape (3,), float64
        Metre, middle of the array in the skin frame.
    graph, units, slots : ndarray
        As in `find_contacts`.
    contacts : ndarray, shape (s + 1,), CONTACT
        The records; the last is the total.
    path : ndarray, shape (s, WAYPOINTS, 3), float64
        Last waypoints of each record, a ring.
    sums : ndarray, shape (s // 2 + 2, SUMS), float64
        Scratch, as are the two below.
    c6 : ndarray, shape (6, 6), float64
    spare : ndarray, shape (3, 3, 3), float64
    """
    n = force.shape[1]
    kind, label, members = units[KIND], units[LABEL], units[MEMBERS]
    total = sums[count + 1]
    _clear(total)
    end = 0
    for k in range(count + 1):
        _clear(sums[k])
    for k in range(count):
        record = contacts[slots[0, k]]
        end = max(end, record["end"])
        _add_units(
            members[record["begin"] : record["end"]],
            force, force_sigma, displacement, temperature, geometry, have, sums[k],
        )  # fmt: skip
    if untracked_end > end:
        _add_units(
            members[end:untracked_end],
            force, force_sigma, displacement, temperature, geometry, have, sums[count],
        )  # fmt: skip
    _add_silence(count, kind[:n], label, graph[: n + 1], graph[n + 1 :], geometry, sums)
    for k in range(count):
        record = contacts[slots[0, k]]
        if record["event"] & BORN:
            _forget(record)
        _conclude(sums[k], record, origin, c6, spare)
        _arm(members, record["begin"], record["end"], force, geometry, origin, record)
        _walk(record, path[slots[0, k]])
    for k in range(count + 1):
        _add_sums(sums[k], total)
    _conclude(total, contacts[contacts.size - 1], origin, c6, spare)


describe = njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp"}
)(describe_python)
