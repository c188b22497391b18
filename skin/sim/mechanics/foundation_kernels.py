"""Compiled code of foundations: springs with a knee, alone or on one half space, and friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, inverse, scaled, stiffening
from skin.sim.mechanics.springs import yields

__all__ = ["SLIP_MM", "Faces", "Touched", "drag", "press"]

SLIP_MM = 1e-6
"""Slip in one step below which a face counts as stuck, millimetre [assumed]."""

SHORT = 1.0 - 1e-12
"""Relative distance to its limit within which a face slips: the error of the sweeps."""


class Touched(NamedTuple):
    """Touched units, sorted by group.

    `units` : (m,), int64; `start` : (g + 1,), first of each group; `normal`, `shear` : flat,
    influences within each group, one square after the other, mm/N (x of all units of the group,
    then y); empty for independent units.
    """

    units: np.ndarray
    start: np.ndarray
    normal: np.ndarray
    shear: np.ndarray


class Faces(NamedTuple):
    """State of n faces that a body drags in one step.

    Attributes
    ----------
    want_mm : ndarray, shape (2, n)
        In: displacement of the surfaces without slip in this step.
    load, depth_mm : ndarray, shape (n,)
        In: normal forces in newton, and the units' own depths, as from `Foundation.press`.
    static, kinetic : ndarray, shape (n,)
        In: static and kinetic coefficients of friction.
    slipping : ndarray, shape (n,), bool
        In: whether the face was slipping; out: whether it is.
    traction : ndarray, shape (2, n)
        Newton; in: start of the sweeps; out: tangential forces.
    own_mm, held_mm, slip_mm : ndarray, shape (2, n)
        Out: the unit's own part of the displacement; the whole elastic displacement; the slip of
        the face in this step. 0 outside of the contact.
    """

    want_mm: np.ndarray
    load: np.ndarray
    depth_mm: np.ndarray
    static: np.ndarray
    kinetic: np.ndarray
    slipping: np.ndarray
    traction: np.ndarray
    own_mm: np.ndarray
    held_mm: np.ndarray
    slip_mm: np.ndarray


class _Group(NamedTuple):
    """Units of one half space: their limits of friction in newton, factors of their tangential
    stiffness, influences (2 m, 2 m), and forces, x of all and then y."""

    units: np.ndarray
    limit: np.ndarray
    stiff: np.ndarray
    square: np.ndarray
    force: np.ndarray


def press_python(springs, touched, depth, body, tolerance, sweeps, load, own_mm):
    """`Foundation.press`, in place; returns the number of sweeps, or `sweeps` + 1."""
    units, start, coupled, _ = touched
    own = springs.normal
    all_forces = load[units]
    load[:] = 0.0
    own_mm[:] = 0.0
    needed, at = 1, 0
    for g in range(start.size - 1):
        first, count = start[g], start[g + 1] - start[g]
        size = count if coupled.size > 0 else 0
        square = coupled[at : at + size * size].reshape((size, size))
        at += size * size
        held = all_forces[first : first + count]
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
                    law = law_at(own, i)
                    new = force(yields(target, law, series), law)
                change = max(change, abs(new - held[k]))
                largest = max(largest, new)
                held[k] = new
            done += 1
            settled = size == 0 or change <= tolerance * largest
        needed = max(needed, done)
    for k in range(units.size):
        i = units[k]
        load[i] = all_forces[k]
        own_mm[i] = inverse(all_forces[k], law_at(own, i))
    return needed


def drag_python(springs, touched, faces, body, tolerance, sweeps):
    """`Foundation.drag`, in place; returns the number of sweeps, or `sweeps` + 1."""
    units, start, _, coupled = touched
    limit, stiff = np.empty(units.size), np.empty(units.size)
    before = faces.traction[:, units]
    for k in range(units.size):
        i = units[k]
        limit[k] = faces.load[i] * (faces.kinetic[i] if faces.slipping[i] else faces.static[i])
        stiff[k] = stiffening(faces.depth_mm[i], springs.gain_per_mm[i], springs.reference_mm[i])
    for written in (faces.traction, faces.own_mm, faces.held_mm, faces.slip_mm):
        written[:] = 0.0
    most, at = 0, 0
    for g in range(start.size - 1):
        first, end = start[g], start[g + 1]
        count = end - first
        size = 2 * count if coupled.size > 0 else 0
        square = coupled[at : at + size * size].reshape((size, size))
        at += size * size
        forces = np.zeros(2 * count)
        for k in range(count):
            if limit[first + k] > 0.0:
                forces[k], forces[count + k] = before[0, first + k], before[1, first + k]
        group = _Group(units[first:end], limit[first:end], stiff[first:end], square, forces)
        needed, settled = 0, False
        while not settled and needed <= sweeps:
            change, largest = _sweep(springs.shear, faces.want_mm, group, body)
            needed += 1
            if size == 0 or change <= tolerance * largest:
                settled = _slip_faces(springs.shear, faces, group, body)
        most = max(most, needed if settled else sweeps + 1)
    for i in range(faces.slipping.size):
        faces.slipping[i] = np.hypot(faces.slip_mm[0, i], faces.slip_mm[1, i]) > SLIP_MM
    return most


@jitable
def _sweep(own, want, group, body):
    """One Gauss-Seidel sweep over the forces of a group; largest change, and largest force."""
    units, limit, stiff, square, forces = group
    count, size = units.size, square.shape[0]
    change = largest = 0.0
    for k in range(count):
        most_n, soft = limit[k], stiff[k]
        if not most_n > 0.0:
            continue
        i = units[k]
        x, y, series = want[0, i], want[1, i], body
        if size > 0:
            by_x = by_y = 0.0
            for m in range(size):
                by_x += square[k, m] * forces[m]
                by_y += square[count + k, m] * forces[m]
            # a square yields equally along x and y, without coupling
            series += square[k, k]
            x -= by_x - square[k, k] * forces[k]
            y -= by_y - square[k, k] * forces[count + k]
        length = np.sqrt(x * x + y * y)
        law = scaled(law_at(own, i), soft)
        force_n = min(force(yields(length, law, series), law), most_n)
        share = force_n / length if length > 0.0 else 0.0
        x, y = share * x, share * y
        largest = max(largest, force_n)
        change = max(change, abs(x - forces[k]), abs(y - forces[count + k]))
        forces[k], forces[count + k] = x, y
    return change, largest


@jitable
def _slip_faces(own, faces, group, body):
    """Coulomb's return map. False where a face has begun to slip: its force drops to kinetic
    friction, so that others may follow."""
    units, limit, stiff, square, forces = group
    count, size = units.size, square.shape[0]
    want, held, slip = faces.want_mm, faces.held_mm, faces.slip_mm
    settled = True
    for k in range(count):
        i, most_n, soft = units[k], limit[k], stiff[k]
        x, y = forces[k], forces[count + k]
        force_n = np.sqrt(x * x + y * y)
        share = 0.0
        if force_n > 0.0:
            share = inverse(force_n, scaled(law_at(own, i), soft)) / force_n
        faces.traction[0, i], faces.traction[1, i] = x, y
        faces.own_mm[0, i], faces.own_mm[1, i] = share * x, share * y
        slip[0, i] = slip[1, i] = 0.0
        if most_n > 0.0 and force_n < SHORT * most_n:
            held[0, i], held[1, i] = want[0, i], want[1, i]
            continue
        by_x = by_y = 0.0
        for m in range(size):
            by_x += square[k, m] * forces[m]
            by_y += square[count + k, m] * forces[m]
        held[0, i] = (share + body) * x + by_x
        held[1, i] = (share + body) * y + by_y
        if not most_n > 0.0:
            continue
        slip[0, i], slip[1, i] = want[0, i] - held[0, i], want[1, i] - held[1, i]
        if not faces.slipping[i] and np.hypot(slip[0, i], slip[1, i]) > SLIP_MM:
            faces.slipping[i] = True
            if faces.kinetic[i] < faces.static[i]:
                limit[k] = faces.load[i] * faces.kinetic[i]
                settled = False
    return settled


press = compiled(press_python, fastmath=("contract", "reassoc"))
drag = compiled(drag_python, fastmath=("contract", "reassoc"))
