"""Compiled code of foundations: springs with a knee, alone or on one half space, and friction."""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = ["drag", "press", "under"]

SLIP_MM = 1e-6
"""A face that gives way less than this in one step counts as stuck."""

_FLAGS = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}


@register_jitable(**_FLAGS)
def _force(target, below, beyond, knee):
    """Force under which two compliances, one below the knee and one beyond, yield by `target`."""
    at_knee = below * knee
    return target / below if target <= at_knee else knee + (target - at_knee) / beyond


@register_jitable(**_FLAGS)
def _displacement(force, below, beyond, knee):
    """The inverse of `_force`."""
    return below * min(force, knee) + beyond * max(force - knee, 0.0)


def press_python(units, depth, own, body, coupled, tolerance, sweeps, load, own_mm):
    """`Foundation.press`, in place; the sweeps needed, or one more than `sweeps`."""
    count = units.size
    together = coupled.shape[1] > 0
    force = load[units]
    load[:] = 0.0
    own_mm[:] = 0.0
    needed = sweeps + 1
    for sweep in range(sweeps):
        change = largest = 0.0
        for k in range(count):
            i = units[k]
            target, series = depth[i], body
            if together:
                row = coupled[k]
                others = 0.0
                for m in range(count):
                    others += row[m] * force[m]
                target -= others - row[k] * force[k]
                series += row[k]
            new = 0.0
            if target > 0.0:
                new = _force(target, own[0, i] + series, own[1, i] + series, own[2, i])
            change = max(change, abs(new - force[k]))
            largest = max(largest, new)
            force[k] = new
        if not together or change <= tolerance * largest:
            needed = sweep + 1
            break
    for k in range(count):
        i = units[k]
        load[i] = force[k]
        own_mm[i] = _displacement(force[k], own[0, i], own[1, i], own[2, i])
    return needed


def drag_python(
    units, want, load, depth, static, kinetic, own, gain, reference, body, coupled,
    tolerance, sweeps, slipping, traction, own_mm, held, slip,
):  # fmt: skip
    """`Foundation.drag`, in place; the sweeps needed, or one more than `sweeps`."""
    count = units.size
    together = coupled.shape[1] > 0
    # forces on the touched units, x of all and then y, and what holds them
    force, limit, stiff = np.zeros(2 * count), np.empty(count), np.empty(count)
    for k in range(count):
        i = units[k]
        limit[k] = load[i] * (kinetic[i] if slipping[i] else static[i])
        stiff[k] = 1.0 + gain[i] * (depth[i] - reference[i])
        if limit[k] > 0.0:
            force[k], force[count + k] = traction[0, i], traction[1, i]
    traction[:] = 0.0
    own_mm[:] = 0.0
    held[:] = 0.0
    slip[:] = 0.0
    needed = 0
    settled = False
    while not settled and needed <= sweeps:
        change = largest = 0.0
        for k in range(count):
            if not limit[k] > 0.0:
                continue
            i = units[k]
            x, y, series = want[0, i], want[1, i], body
            if together:
                by_x = by_y = 0.0
                for m in range(2 * count):
                    by_x += coupled[k, m] * force[m]
                    by_y += coupled[count + k, m] * force[m]
                # a square yields alike along x and y, and not across
                series += coupled[k, k]
                x -= by_x - coupled[k, k] * force[k]
                y -= by_y - coupled[k, k] * force[count + k]
            length = np.sqrt(x * x + y * y)
            size = _force(
                length, own[0, i] / stiff[k] + series, own[1, i] / stiff[k] + series,
                own[2, i] * stiff[k],
            )  # fmt: skip
            size = min(size, limit[k])
            share = size / length if length > 0.0 else 0.0
            x, y = share * x, share * y
            largest = max(largest, size)
            change = max(change, abs(x - force[k]), abs(y - force[count + k]))
            force[k], force[count + k] = x, y
        needed += 1
        if together and change > tolerance * largest:
            continue
        # what cannot be held moves, and what moves is held by less: others may follow
        settled = True
        for k in range(count):
            i = units[k]
            x, y = force[k], force[count + k]
            size = np.sqrt(x * x + y * y)
            share = own[0, i] / stiff[k]
            if size > 0.0:
                share = _displacement(
                    size, own[0, i] / stiff[k], own[1, i] / stiff[k], own[2, i] * stiff[k]
                ) / size  # fmt: skip
            traction[0, i], traction[1, i] = x, y
            own_mm[0, i], own_mm[1, i] = share * x, share * y
            by_x = by_y = 0.0
            if together:
                for m in range(2 * count):
                    by_x += coupled[k, m] * force[m]
                    by_y += coupled[count + k, m] * force[m]
            held[0, i] = (share + body) * x + by_x
            held[1, i] = (share + body) * y + by_y
            # short of the limit nothing slips: what is left there is the sweeps' own error
            slip[0, i] = slip[1, i] = 0.0
            if limit[k] > 0.0 and size >= (1.0 - 1e-12) * limit[k]:
                slip[0, i], slip[1, i] = want[0, i] - held[0, i], want[1, i] - held[1, i]
                if not slipping[i] and np.hypot(slip[0, i], slip[1, i]) > SLIP_MM:
                    slipping[i] = True
                    if kinetic[i] < static[i]:
                        limit[k] = load[i] * kinetic[i]
                        settled = False
    for i in range(slipping.size):
        slipping[i] = np.hypot(slip[0, i], slip[1, i]) > SLIP_MM
    return needed if settled else sweeps + 1


def under_python(force, normal, shear, gain, reference, depth_mm, displacement_mm):
    """`Springs.under`, in place."""
    for i in range(depth_mm.size):
        x, y, z = force[0, i], force[1, i], max(force[2, i], 0.0)
        depth = _displacement(z, normal[0, i], normal[1, i], normal[2, i])
        size = np.sqrt(x * x + y * y)
        share = 0.0
        if size > 0.0:
            stiff = 1.0 + gain[i] * (depth - reference[i])
            way = _displacement(size, shear[0, i] / stiff, shear[1, i] / stiff, shear[2, i] * stiff)
            share = way / size
        depth_mm[i] = depth
        displacement_mm[0, i], displacement_mm[1, i] = share * x, share * y


press = njit(press_python, nogil=True, cache=True, **_FLAGS)
drag = njit(drag_python, nogil=True, cache=True, **_FLAGS)
under = njit(under_python, nogil=True, cache=True, **_FLAGS)
