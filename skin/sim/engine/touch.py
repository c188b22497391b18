"""What touches which unit, and with what force: springs along rays, and Coulomb's return map.

Each unit looks along its normal into the skin. Where that line leaves a solid, at a depth H below
the unit's face, the elastomer is pressed by H. The force is the gradient of an elastic energy
``U(H) + g(H) V(R)``, so that pushing and releasing gains nothing::

    N = (U'(H) + g'(H) V(R)) / cos(tilt)      along the solid's normal, at the point of contact
    T = g(H) V'(R)                            along the displacement R, across that normal

with U' and V' the unit's own elastic laws (`skin.physics.elastic`), g their stiffening with depth.
R is what the solid has dragged the point of contact since it stuck, and shrinks until
``|T| <= friction * N`` (return map): a face that sticks does so exactly. Both bodies are given the
same force at the same point. Without curvature or tilt that is the Winkler foundation of
`skin.sim.mechanics.foundation`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.sim.engine.mesh import Meshes, mesh_crossing
from skin.sim.engine.rays import MESH, crossing
from skin.sim.mechanics.springs import Springs, displacement, force

__all__ = ["DEEPEST_M", "LOSS_S", "Bodies", "Mounted", "Surfaces", "Touch", "feel"]

DEEPEST_M = 3.5e-3
"""Where the film would lie on its chip; what a line enters below that is behind the skin."""

STEEPEST = 0.2
"""Cosine of the tilt beyond which a solid passes by a unit instead of pressing it [assumed]."""

LOSS_S = 2e-4
"""Viscosity over stiffness of the elastomer: a loss of 6 % at 50 Hz [assumed, a soft silicone]."""


class Mounted(NamedTuple):
    """Where n units hang on b bodies, and how they yield.

    Attributes
    ----------
    body : ndarray, shape (n,), int32
    place : ndarray, shape (3, n)
        Metre, frame of the body.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the frame of the body.
    weight : ndarray, shape (n, g)
        What a unit does to a geom: 0 nothing, 1 all, 0.5 where the geom carries skin itself, which
        yields as much and does the other half.
    springs : Springs
    """

    body: np.ndarray
    place: np.ndarray
    rotation: np.ndarray
    weight: np.ndarray
    springs: Springs


class Surfaces(NamedTuple):
    """The g geoms of a model as a skin feels them.

    Attributes
    ----------
    kind : ndarray, shape (g,), int32
        As in `skin.sim.engine.rays`.
    body : ndarray, shape (g,), int32
    size : ndarray, shape (g, 3)
        Metre.
    radius : ndarray, shape (g,)
        Of a ball around it, metre; infinite for a plane.
    static, kinetic : ndarray, shape (g,)
        Coefficients of friction, at rest and in motion.
    compliance : ndarray, shape (g,)
        mm/N, to the force of one unit.
    mesh : ndarray, shape (g,), int32
    meshes : Meshes
    """

    kind: np.ndarray
    body: np.ndarray
    size: np.ndarray
    radius: np.ndarray
    static: np.ndarray
    kinetic: np.ndarray
    compliance: np.ndarray
    mesh: np.ndarray
    meshes: Meshes


class Bodies(NamedTuple):
    """Views of the engine's own arrays: poses of b bodies and g geoms, and wrenches on bodies.

    Attributes
    ----------
    position, middle : ndarray, shape (b, 3)
        Origins and centres of mass, metre.
    rotation : ndarray, shape (b, 9)
    geom_position, geom_rotation : ndarray, shape (g, 3) and (g, 9)
    wrench : ndarray, shape (b, 6)
        Added to: newton, and newton metre about the centre of mass.
    """

    position: np.ndarray
    middle: np.ndarray
    rotation: np.ndarray
    geom_position: np.ndarray
    geom_rotation: np.ndarray
    wrench: np.ndarray


class Touch(NamedTuple):
    """What touches each of n units, and what is remembered of it while it does.

    Attributes
    ----------
    body : ndarray, shape (n,), int32
        -1 where nothing touches.
    depth_m : ndarray, shape (n,)
    anchor_m, drag_mm : ndarray, shape (3, n)
        Point of contact, and elastic displacement; frame of the body that touches.
    slipping : ndarray, shape (n,), bool
    force : ndarray, shape (3, n)
        Newton, unit frame.
    normal_n, limit_n : ndarray, shape (n,)
        Along the solid's normal, and what friction holds of it.
    drag_n : ndarray, shape (n,)
        What friction bears.
    energy_j : ndarray, shape (n,)
        Stored.
    """

    body: np.ndarray
    depth_m: np.ndarray
    anchor_m: np.ndarray
    drag_mm: np.ndarray
    slipping: np.ndarray
    force: np.ndarray
    normal_n: np.ndarray
    limit_n: np.ndarray
    drag_n: np.ndarray
    energy_j: np.ndarray

    @classmethod
    def nothing(cls, n: int) -> Touch:
        """Of n units, none."""
        return cls(
            np.full(n, -1, np.int32), np.zeros(n), np.zeros((3, n)), np.zeros((3, n)),
            np.zeros(n, bool), np.zeros((3, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
        )  # fmt: skip


@jitable
def _turned(rotation, row, v):
    """R v, of a rotation that is a row of nine."""
    r = rotation[row]
    return (r[0] * v[0] + r[1] * v[1] + r[2] * v[2], r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
            r[6] * v[0] + r[7] * v[1] + r[8] * v[2])  # fmt: skip


@jitable
def _turned_back(rotation, row, v):
    """R^T v."""
    r = rotation[row]
    return (r[0] * v[0] + r[3] * v[1] + r[6] * v[2], r[1] * v[0] + r[4] * v[1] + r[7] * v[2],
            r[2] * v[0] + r[5] * v[1] + r[8] * v[2])  # fmt: skip


@jitable
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jitable
def _add(a, b, share):
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@jitable
def _deepest(bodies, surfaces, weight, face, way):
    """Of all geoms the one that presses a unit deepest, how deep, and its normal; -1 for none."""
    best, depth, normal = -1, 0.0, (0.0, 0.0, 0.0)
    for g in range(surfaces.kind.size):
        if weight[g] == 0.0:
            continue
        p = bodies.geom_position[g]
        off = (face[0] - p[0], face[1] - p[1], face[2] - p[2])
        away = surfaces.radius[g] + DEEPEST_M
        if _dot(off, off) > away * away:
            continue
        point = _turned_back(bodies.geom_rotation, g, off)
        along = _turned_back(bodies.geom_rotation, g, way)
        if surfaces.kind[g] == MESH:
            out, x, y, z = mesh_crossing(
                surfaces.meshes, surfaces.mesh[g], point, along, DEEPEST_M
            )
        else:
            enters, out, x, y, z = crossing(surfaces.kind[g], surfaces.size[g], point, along)
            if enters > DEEPEST_M:
                continue
        if out > depth and x * along[0] + y * along[1] + z * along[2] > STEEPEST:
            best, depth, normal = g, out, _turned(bodies.geom_rotation, g, (x, y, z))
    return best, depth, normal


@jitable
def _dragged(bodies, touch, i, b, face, way, normal):
    """How far a solid has dragged a unit since it stuck, and in this step: mm, across the normal,
    world frame. Turning the memory into the new plane keeps its length, and so its energy."""
    before = _turned(
        bodies.rotation, b, (touch.drag_mm[0, i], touch.drag_mm[1, i], touch.drag_mm[2, i])
    )
    spot = _add(face, way, touch.depth_m[i])
    p = bodies.position[b]
    now = _turned_back(bodies.rotation, b, (spot[0] - p[0], spot[1] - p[1], spot[2] - p[2]))
    step = _turned(
        bodies.rotation, b,
        (1e3 * (touch.anchor_m[0, i] - now[0]), 1e3 * (touch.anchor_m[1, i] - now[1]),
         1e3 * (touch.anchor_m[2, i] - now[2])),
    )  # fmt: skip
    length = math.sqrt(_dot(before, before))
    before = _add(before, normal, -_dot(before, normal))
    flat = math.sqrt(_dot(before, before))
    if flat > 0.0:
        before = _add((0.0, 0.0, 0.0), before, length / flat)
    step = _add(step, normal, -_dot(step, normal))
    return _add(before, step, 1.0), step


@jitable
def _stored(target, below, beyond, knee):
    """Energy of a spring with a knee that yields by `target` mm, N·mm."""
    at_knee = below * knee
    if target <= at_knee:
        return 0.5 * target * target / below
    past = target - at_knee
    return 0.5 * at_knee * knee + knee * past + 0.5 * past * past / beyond


@jitable
def _held(law, limits, drag, step, dt_s):
    """Coulomb's return map: the drag that friction leaves, the force, and whether the face slips.

    Parameters
    ----------
    law : tuple of 3 float
        Compliance below and beyond the knee, mm/N, and the knee, N.
    limits : tuple of 3 float
        Newton: now, at rest, in motion.
    drag, step : tuple of 3 float
        mm: since it stuck, and of that in this step.
    dt_s : float
    """
    length = math.sqrt(_dot(drag, drag))
    drag_n = force(length, law[0], law[1], law[2])
    if drag_n > limits[0]:
        share = displacement(limits[2], law[0], law[1], law[2]) / length
        drag = _add((0.0, 0.0, 0.0), drag, share)
        return drag, _add((0.0, 0.0, 0.0), drag, limits[2] / max(length * share, 1e-30)), True
    stiffness = drag_n / length if length > 1e-9 else 1.0 / law[0]
    pull = _add((0.0, 0.0, 0.0), drag, stiffness)
    if dt_s > 0.0:
        pull = _add(pull, step, stiffness * LOSS_S / dt_s)
    size = math.sqrt(_dot(pull, pull))
    if size > limits[1]:
        pull = _add((0.0, 0.0, 0.0), pull, limits[1] / size)
    return drag, pull, False


@jitable
def _push(bodies, body, spot, push, share):
    """Add a force at a point to the wrench on a body."""
    m = bodies.middle[body]
    x, y, z = spot[0] - m[0], spot[1] - m[1], spot[2] - m[2]
    wrench = bodies.wrench[body]
    wrench[0] += share * push[0]
    wrench[1] += share * push[1]
    wrench[2] += share * push[2]
    wrench[3] += share * (y * push[2] - z * push[1])
    wrench[4] += share * (z * push[0] - x * push[2])
    wrench[5] += share * (x * push[1] - y * push[0])


@jitable
def _free(touch, i):
    touch.body[i] = -1
    touch.slipping[i] = False
    touch.depth_m[i] = touch.normal_n[i] = touch.limit_n[i] = touch.drag_n[i] = 0.0
    touch.energy_j[i] = 0.0
    for a in range(3):
        touch.force[a, i] = touch.drag_mm[a, i] = touch.anchor_m[a, i] = 0.0


@jitable
def _normal_force(springs, i, body_mm_per_n, deep_mm, drag_mm, cosine):
    """Force along the solid's normal without loss, the law of the drag at this depth, and the
    energy stored in N·mm."""
    n, s = springs.normal, springs.shear
    stiff = 1.0 + springs.gain_per_mm[i] * (deep_mm - springs.reference_mm[i])
    gain = springs.gain_per_mm[i]
    if stiff < 0.1:
        stiff, gain = 0.1, 0.0
    below, beyond = n[0, i] + body_mm_per_n, n[1, i] + body_mm_per_n
    soft, hard = s[0, i] + body_mm_per_n, s[1, i] + body_mm_per_n
    stored = _stored(drag_mm, soft, hard, s[2, i])
    normal_n = force(deep_mm, below, beyond, n[2, i]) + gain * stored
    law = (soft / stiff, hard / stiff, s[2, i] * stiff)
    energy = _stored(deep_mm, below, beyond, n[2, i])
    slope = 1.0 / below if deep_mm <= below * n[2, i] else 1.0 / beyond
    return normal_n / cosine, slope / cosine, law, energy


def feel_python(bodies, mounted, surfaces, touch, elapsed_s):
    """Find what presses each unit, and add the wrenches to both bodies.

    Parameters
    ----------
    bodies : Bodies
        Its `wrench` is added to.
    mounted : Mounted
    surfaces : Surfaces
    touch : Touch
        As of `elapsed_s` ago; gone on.
    elapsed_s : ndarray, shape (1,)
        Second; 0 for the same instant, which knows no velocities.
    """
    dt_s = elapsed_s[0]
    springs = mounted.springs
    for i in range(mounted.body.size):
        link = mounted.body[i]
        p = bodies.position[link]
        face = _add(
            (p[0], p[1], p[2]),
            _turned(
                bodies.rotation, link,
                (mounted.place[0, i], mounted.place[1, i], mounted.place[2, i]),
            ), 1.0,
        )  # fmt: skip
        r = mounted.rotation
        way = _turned(bodies.rotation, link, (r[0, 2, i], r[1, 2, i], r[2, 2, i]))
        g, depth, normal = _deepest(bodies, surfaces, mounted.weight[i], face, way)
        if g < 0:
            _free(touch, i)
            continue
        b, weight = surfaces.body[g], mounted.weight[i, g]
        depth *= weight
        spot = _add(face, way, depth)
        drag = step = (0.0, 0.0, 0.0)
        pressing_mm = 0.0
        if touch.body[i] == b:
            drag, step = _dragged(bodies, touch, i, b, face, way, normal)
            pressing_mm = 1e3 * (depth - touch.depth_m[i])
        else:
            touch.slipping[i] = False
        cosine, size = _dot(normal, way), math.sqrt(_dot(drag, drag))
        normal_n, stiffness, law, energy = _normal_force(
            springs, i, surfaces.compliance[g], 1e3 * depth, size, cosine
        )
        if dt_s > 0.0:
            normal_n = max(normal_n + LOSS_S / dt_s * stiffness * pressing_mm, 0.0)
        rest_n, moving_n = surfaces.static[g] * normal_n, surfaces.kinetic[g] * normal_n
        now_n = moving_n if touch.slipping[i] else rest_n
        drag, pull, slips = _held(law, (now_n, rest_n, moving_n), drag, step, dt_s)
        push = _add(pull, normal, normal_n)
        _push(bodies, link, spot, push, weight)
        _push(bodies, b, spot, push, -weight)
        touch.body[i], touch.depth_m[i], touch.slipping[i] = b, depth, slips
        touch.normal_n[i], touch.limit_n[i] = normal_n, moving_n if slips else rest_n
        touch.drag_n[i] = math.sqrt(_dot(pull, pull))
        left = math.sqrt(_dot(drag, drag))
        touch.energy_j[i] = 1e-3 * weight * (energy + _stored(left, law[0], law[1], law[2]))
        q = bodies.position[b]
        at = _turned_back(bodies.rotation, b, (spot[0] - q[0], spot[1] - q[1], spot[2] - q[2]))
        kept = _turned_back(bodies.rotation, b, drag)
        mine = _turned_back(bodies.rotation, link, push)
        for a in range(3):
            touch.anchor_m[a, i], touch.drag_mm[a, i] = at[a], kept[a]
            touch.force[a, i] = r[0, a, i] * mine[0] + r[1, a, i] * mine[1] + r[2, a, i] * mine[2]


feel = compiled(feel_python, allocates=False, fastmath=("contract",))
