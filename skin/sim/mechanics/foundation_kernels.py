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


def press_python(units, start, depth, own, body, coupled, tolerance, sweeps, load, own_mm):
    """`Foundation.press`, in place; the sweeps needed, or one more than `sweeps`.

    `units` that rest together stand together, a group from each of `start` (g + 1,) on; `coupled`
    holds one square for each group, one after the other, and nothing where all rest alone.
    """
    force = load[units]
    load[:] = 0.0
    own_mm[:] = 0.0
    needed, at = 1, 0
    for g in range(start.size - 1):
        first, count = start[g], start[g + 1] - start[g]
        size = count if coupled.size > 0 else 0
        square = coupled[at : at + size * size].reshape((size, size))
        at += size * size
        held = force[first : first + count]
        done, settled = 0, False
        while not settled and done <= sweeps:
            change = largest = 0.0
            for k in range(count):
                i = units[first + k]
                target, series = depth[i], body
                if size > 0:
                    row = square[k]
                    others = 0.0
                    for m in range(count):
                        others += row[m] * held[m]
                    target -= others - row[k] * held[k]
                    series += row[k]
                new = 0.0
                if target > 0.0:
                    new = _force(target, own[0, i] + series, own[1, i] + series, own[2, i])
                change = max(change, abs(new - held[k]))
                largest = max(largest, new)
                held[k] = new
            done += 1
            settled = size == 0 or change <= tolerance * largest
        needed = max(needed, done)
    for k in range(units.size):
        i = units[k]
        load[i] = force[k]
        own_mm[i] = _displacement(force[k], own[0, i], own[1, i], own[2, i])
    return needed


def drag_python(
    units, start, want, load, depth, static, kinetic, own, gain, reference, body, coupled,
    tolerance, sweeps, slipping, traction, own_mm, held, slip,
):  # fmt: skip
    """`Foundation.drag`, in place; the sweeps needed, or one more than `sweeps`.

    Groups as for `press`; their squares hold x of all units of a group, then y.
    """
    limit, stiff = np.empty(units.size), np.empty(units.size)
    before = traction[:, units]
    for k in range(units.size):
        i = units[k]
        limit[k] = load[i] * (kinetic[i] if slipping[i] else static[i])
        stiff[k] = 1.0 + gain[i] * (depth[i] - reference[i])
    traction[:] = 0.0
    own_mm[:] = 0.0
    held[:] = 0.0
    slip[:] = 0.0
    most, at = 0, 0
    for g in range(start.size - 1):
        first, count = start[g], start[g + 1] - start[g]
        size = 2 * count if coupled.size > 0 else 0
        square = coupled[at : at + size * size].reshape((size, size))
        at += size * size
        # forces of the group, x of all and then y
        force = np.zeros(2 * count)
        for k in range(count):
            if limit[first + k] > 0.0:
                force[k], force[count + k] = before[0, first + k], before[1, first + k]
        needed, settled = 0, False
        while not settled and needed <= sweeps:
            change = largest = 0.0
            for k in range(count):
                most_n, soft = limit[first + k], stiff[first + k]
                if not most_n > 0.0:
                    continue
                i = units[first + k]
                x, y, series = want[0, i], want[1, i], body
                if size > 0:
                    by_x = by_y = 0.0
                    for m in range(size):
                        by_x += square[k, m] * force[m]
                        by_y += square[count + k, m] * force[m]
                    # a square yields alike along x and y, and not across
                    series += square[k, k]
                    x -= by_x - square[k, k] * force[k]
                    y -= by_y - square[k, k] * force[count + k]
                length = np.sqrt(x * x + y * y)
                force_n = _force(
                    length, own[0, i] / soft + series, own[1, i] / soft + series, own[2, i] * soft
                )
                force_n = min(force_n, most_n)
                share = force_n / length if length > 0.0 else 0.0
                x, y = share * x, share * y
                largest = max(largest, force_n)
                change = max(change, abs(x - force[k]), abs(y - force[count + k]))
                force[k], force[count + k] = x, y
            needed += 1
            if size > 0 and change > tolerance * largest:
                continue
            # what cannot be held moves, and what moves is held by less: others may follow
            settled = True
            for k in range(count):
                i, most_n, soft = units[first + k], limit[first + k], stiff[first + k]
                x, y = force[k], force[count + k]
                force_n = np.sqrt(x * x + y * y)
                share = own[0, i] / soft
                if force_n > 0.0:
                    share = _displacement(
                        force_n, own[0, i] / soft, own[1, i] / soft, own[2, i] * soft
                    ) / force_n  # fmt: skip
                traction[0, i], traction[1, i] = x, y
                own_mm[0, i], own_mm[1, i] = share * x, share * y
                slip[0, i] = slip[1, i] = 0.0
                # short of the limit nothing slips: what is left there is the sweeps' own error
                if most_n > 0.0 and force_n < (1.0 - 1e-12) * most_n:
                    held[0, i], held[1, i] = want[0, i], want[1, i]
                    continue
                by_x = by_y = 0.0
                for m in range(size):
                    by_x += square[k, m] * force[m]
                    by_y += square[count + k, m] * force[m]
                held[0, i] = (share + body) * x + by_x
                held[1, i] = (share + body) * y + by_y
                if not most_n > 0.0:
                    continue
                slip[0, i], slip[1, i] = want[0, i] - held[0, i], want[1, i] - held[1, i]
                if not slipping[i] and np.hypot(slip[0, i], slip[1, i]) > SLIP_MM:
                    slipping[i] = True
                    if kinetic[i] < static[i]:
                        limit[first + k] = load[i] * kinetic[i]
                        settled = False
        most = max(most, needed if settled else sweeps + 1)
    for i in range(slipping.size):
        slipping[i] = np.hypot(slip[0, i], slip[1, i]) > SLIP_MM
    return most


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
