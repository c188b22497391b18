"""All compiled code of the array features: unit forces in, wrench and centre of pressure out.

One file, because numba's cache does not see a change in another one. Sums run in float64 whatever
the type of the forces, so that their rounding stays far below the noise of any unit; moments are
taken about a point near the units and moved afterwards, so that a far origin costs no digits.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["CENTRE", "LOAD", "ROWS", "WRENCH", "total", "total_python"]

WRENCH, LOAD, CENTRE = 0, 6, 7
"""Rows of the result: force and moment, normal load, centre of pressure."""
ROWS = 10


def total_python(force, position, rotation, valid, gate, arm, centre, contact, out):
    """Sum the forces of the valid units whose normal load is above their gate.

    Parameters
    ----------
    force : ndarray, shape (3, n)
        Newton, unit frames.
    position : ndarray, shape (3, n), float64
        Metre, from the point about which moments are taken.
    rotation : ndarray, shape (3, 3, n), float64
        R_skin_unit.
    valid : ndarray, shape (n,), bool
    gate : ndarray, shape (n,), float64
        Newton; NaN forces never pass it.
    arm : ndarray, shape (3,), float64
        Metre, from the point for which the moment is wanted to the origin of `position`.
    centre : ndarray, shape (3,), float64
        Metre, the origin of `position` in the frame for which the centre of pressure is wanted.
    contact : ndarray, shape (n,), bool
        Written: units that were summed.
    out : ndarray, shape (10,), float64
        Written: force, moment, load, centre of pressure (NaN without load).
    """
    fx = fy = fz = mx = my = mz = load = px = py = pz = 0.0
    for i in range(force.shape[1]):
        a, b, c = np.float64(force[0, i]), np.float64(force[1, i]), np.float64(force[2, i])
        touched = valid[i] and c > gate[i]
        contact[i] = touched
        if touched:
            x = rotation[0, 0, i] * a + rotation[0, 1, i] * b + rotation[0, 2, i] * c
            y = rotation[1, 0, i] * a + rotation[1, 1, i] * b + rotation[1, 2, i] * c
            z = rotation[2, 0, i] * a + rotation[2, 1, i] * b + rotation[2, 2, i] * c
            u, v, w = position[0, i], position[1, i], position[2, i]
            fx += x
            fy += y
            fz += z
            mx += v * z - w * y
            my += w * x - u * z
            mz += u * y - v * x
            load += c
            px += c * u
            py += c * v
            pz += c * w
    out[0], out[1], out[2] = fx, fy, fz
    out[3] = mx + arm[1] * fz - arm[2] * fy
    out[4] = my + arm[2] * fx - arm[0] * fz
    out[5] = mz + arm[0] * fy - arm[1] * fx
    out[LOAD] = load
    loaded = load > 0.0
    out[7] = centre[0] + px / load if loaded else np.nan
    out[8] = centre[1] + py / load if loaded else np.nan
    out[9] = centre[2] + pz / load if loaded else np.nan


total = njit(total_python, error_model="numpy", nogil=True, cache=True, fastmath={"contract"})
