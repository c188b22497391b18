"""Entry and exit of a line through a convex solid: every primitive of the engine, and hulls.

All in the frame of the geom. A line is a point and a direction of length 1; a crossing is the
distance along it in metre, and the outward normal at the exit. Sizes are those of MuJoCo: radius;
radius and half length along z; semi-axes; half edges.
"""

from __future__ import annotations

import math

from bus.compiled.jit import jitable

__all__ = [
    "BOX", "CAPSULE", "CYLINDER", "ELLIPSOID", "MESH", "PLANE", "SPHERE", "crossing",
    "hull_crossing",
]  # fmt: skip

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7
"""Kinds of geom, with the numbers of `mujoco.mjtGeom`."""

NOWHERE = (math.inf, -math.inf, 0.0, 0.0, 0.0)
"""Crossing of a line that misses: the entry is after the exit."""


@jitable
def crossing(kind, size, point, direction):
    """Entry, exit, and the outward normal at the exit, of a line and a primitive.

    Parameters
    ----------
    kind : int
    size : ndarray, shape (3,)
        Metre.
    point, direction : tuple of 3 float
        Metre, and a direction of length 1; frame of the geom.

    Returns
    -------
    tuple of 5 float
        Distances along the line, metre, and a normal; the entry is after the exit for a miss.
    """
    if kind == SPHERE:
        return _ball(point, direction, size[0], 0.0)
    if kind == CAPSULE:
        return _capsule(point, direction, size[0], size[1])
    if kind == CYLINDER:
        return _cylinder(point, direction, size[0], size[1])
    if kind == ELLIPSOID:
        return _ellipsoid(point, direction, size)
    if kind == BOX:
        return _box(point, direction, size)
    if kind == PLANE:
        return _plane(point, direction)
    return NOWHERE


@jitable
def _ball(point, direction, radius, shift):
    """A sphere whose centre is moved by `shift` along z."""
    x, y, z = point[0], point[1], point[2] - shift
    along = x * direction[0] + y * direction[1] + z * direction[2]
    square = along * along - (x * x + y * y + z * z - radius * radius)
    if not square > 0.0:
        return NOWHERE
    half = math.sqrt(square)
    out = half - along
    return (
        -half - along, out,
        (x + out * direction[0]) / radius, (y + out * direction[1]) / radius,
        (z + out * direction[2]) / radius,
    )  # fmt: skip


@jitable
def _slab(place, direction, half):
    """Entry and exit of one coordinate between -half and half."""
    if direction == 0.0:
        return (-math.inf, math.inf) if abs(place) < half else (math.inf, -math.inf)
    one, other = (-half - place) / direction, (half - place) / direction
    return min(one, other), max(one, other)


@jitable
def _tube(point, direction, radius):
    """Entry and exit of an endless cylinder about z."""
    a = direction[0] * direction[0] + direction[1] * direction[1]
    b = point[0] * direction[0] + point[1] * direction[1]
    c = point[0] * point[0] + point[1] * point[1] - radius * radius
    if a < 1e-24:  # along the axis, to rounding [numeric]
        return (-math.inf, math.inf) if c < 0.0 else (math.inf, -math.inf)
    square = b * b - a * c
    if not square > 0.0:
        return math.inf, -math.inf
    half = math.sqrt(square)
    return (-half - b) / a, (half - b) / a


@jitable
def _cylinder(point, direction, radius, half):
    side_in, side_out = _tube(point, direction, radius)
    cap_in, cap_out = _slab(point[2], direction[2], half)
    enters, out = max(side_in, cap_in), min(side_out, cap_out)
    if not enters < out:
        return NOWHERE
    if cap_out < side_out:
        return enters, out, 0.0, 0.0, math.copysign(1.0, direction[2])
    x, y = point[0] + out * direction[0], point[1] + out * direction[1]
    return enters, out, x / radius, y / radius, 0.0


@jitable
def _capsule(point, direction, radius, half):
    """The union of a cylinder's wall and two balls: the exit is the last of theirs."""
    low, high = _ball(point, direction, radius, -half), _ball(point, direction, radius, half)
    last = high if high[1] > low[1] else low
    enters, out = min(low[0], high[0]), last[1]
    side_in, side_out = _tube(point, direction, radius)
    cap_in, cap_out = _slab(point[2], direction[2], half)
    wall_in, wall_out = max(side_in, cap_in), min(side_out, cap_out)
    if wall_in < wall_out:
        enters = min(enters, wall_in)
        if wall_out > out:
            x, y = point[0] + wall_out * direction[0], point[1] + wall_out * direction[1]
            return enters, wall_out, x / radius, y / radius, 0.0
    return enters, out, last[2], last[3], last[4]


@jitable
def _ellipsoid(point, direction, size):
    """A sphere of radius 1 in coordinates divided by the semi-axes."""
    px, py, pz = point[0] / size[0], point[1] / size[1], point[2] / size[2]
    wx, wy, wz = direction[0] / size[0], direction[1] / size[1], direction[2] / size[2]
    a = wx * wx + wy * wy + wz * wz
    b = px * wx + py * wy + pz * wz
    square = b * b - a * (px * px + py * py + pz * pz - 1.0)
    if not square > 0.0:
        return NOWHERE
    half = math.sqrt(square)
    out = (half - b) / a
    x, y, z = (px + out * wx) / size[0], (py + out * wy) / size[1], (pz + out * wz) / size[2]
    length = math.sqrt(x * x + y * y + z * z)
    return (-half - b) / a, out, x / length, y / length, z / length


@jitable
def _box(point, direction, size):
    x_in, x_out = _slab(point[0], direction[0], size[0])
    y_in, y_out = _slab(point[1], direction[1], size[1])
    z_in, z_out = _slab(point[2], direction[2], size[2])
    enters, out = max(x_in, y_in, z_in), min(x_out, y_out, z_out)
    if not enters < out:
        return NOWHERE
    if out == z_out:
        return enters, out, 0.0, 0.0, math.copysign(1.0, direction[2])
    if out == y_out:
        return enters, out, 0.0, math.copysign(1.0, direction[1]), 0.0
    return enters, out, math.copysign(1.0, direction[0]), 0.0, 0.0


@jitable
def _plane(point, direction):
    """The half space below z = 0: left upwards only."""
    if not direction[2] > 0.0:
        return NOWHERE
    return -math.inf, -point[2] / direction[2], 0.0, 0.0, 1.0


@jitable
def hull_crossing(planes, faces, point, direction):
    """The same of a convex hull.

    Parameters
    ----------
    planes : ndarray, shape (p, 4)
        Outward normal n and offset d of each face: ``n @ x + d`` is 0 on it, and below 0 inside.
    faces : ndarray, shape (2,)
        First face of the hull, and the first behind it.
    point, direction : tuple of 3 float
    """
    enters, out, last = -math.inf, math.inf, -1
    for f in range(faces[0], faces[1]):
        x, y, z, d = planes[f, 0], planes[f, 1], planes[f, 2], planes[f, 3]
        along = x * direction[0] + y * direction[1] + z * direction[2]
        above = x * point[0] + y * point[1] + z * point[2] + d
        if along > 0.0 and -above / along < out:
            out, last = -above / along, f
        elif along < 0.0:
            enters = max(enters, -above / along)
        elif along == 0.0 and above > 0.0:
            return NOWHERE
    if last < 0 or not enters < out:
        return NOWHERE
    return enters, out, planes[last, 0], planes[last, 1], planes[last, 2]
