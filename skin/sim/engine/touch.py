"""What touches which unit, and with what force: springs with tips that stick, and a return map.

A unit is a spring from its face to a tip. While nothing touches it looks along its normal, into the
skin; where that line leaves a solid below the face, the tip is there, and sticks to the solid. From
then on the tip is carried along, by R across the unit's normal and by H into the skin, and the force
is the gradient of an elastic energy, so that pushing and releasing gains nothing::

    energy = U(H) + g(H) V(R)        force = (g V'(R) r, U'(H) + g' V(R))      in the unit frame

with U' and V' the unit's own elastic laws (`skin.physics.elastic`) and g their stiffening with
depth. The tip slides over the solid, and only then, where that force leaves the cone of friction
about the solid's normal (Coulomb's return map): what sticks does so exactly. Both bodies are given
the same force, at the tip. That is the Winkler foundation of `skin.sim.mechanics.foundation` for
bodies that are moved by forces.
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

LEAST_STIFF = 0.1
"""Of shear over that at the reference depth, however shallow [assumed]."""

SLIDES = 4
"""How often the way of a tip in one step is corrected for the curvature of the solid [numeric]."""

ON_CONE = 1e-9
"""How far beyond the cone of friction a force is on it, relative [numeric]."""

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
    body, geom : ndarray, shape (n,), int32
        -1 where nothing touches.
    anchor_m, normal : ndarray, shape (3, n)
        Tip, and the solid's outward normal there; frame of the body that touches.
    tip_mm : ndarray, shape (3, n)
        Tip from where it is unloaded, unit frame.
    slipping : ndarray, shape (n,), bool
    force : ndarray, shape (3, n)
        Newton, unit frame.
    normal_n, drag_n, limit_n : ndarray, shape (n,)
        Along the solid's normal, across it, and what friction holds across it.
    energy_j : ndarray, shape (n,)
        Stored.
    """

    body: np.ndarray
    geom: np.ndarray
    anchor_m: np.ndarray
    normal: np.ndarray
    tip_mm: np.ndarray
    slipping: np.ndarray
    force: np.ndarray
    normal_n: np.ndarray
    drag_n: np.ndarray
    limit_n: np.ndarray
    energy_j: np.ndarray

    @classmethod
    def nothing(cls, n: int) -> Touch:
        """Of n units, none."""
        return cls(
            np.full(n, -1, np.int32), np.full(n, -1, np.int32), np.zeros((3, n)),
            np.zeros((3, n)), np.zeros((3, n)), np.zeros(n, bool), np.zeros((3, n)), np.zeros(n),
            np.zeros(n), np.zeros(n), np.zeros(n),
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
    touch.body[i] = touch.geom[i] = -1
    touch.slipping[i] = False
    touch.normal_n[i] = touch.limit_n[i] = touch.drag_n[i] = touch.energy_j[i] = 0.0
    for a in range(3):
        touch.force[a, i] = touch.tip_mm[a, i] = 0.0


@jitable
def _stored(target, below, beyond, knee):
    """Energy of a spring with a knee that yields by `target` mm, N·mm."""
    at_knee = below * knee
    if target <= at_knee:
        return 0.5 * target * target / below
    past = target - at_knee
    return 0.5 * at_knee * knee + knee * past + 0.5 * past * past / beyond


@jitable
def _laws(springs, i, deep_mm, soft_mm_per_n):
    """Stiffening with depth and its slope, compliances and knee of the shear there."""
    s, gain = springs.shear, springs.gain_per_mm[i]
    stiff = 1.0 + gain * (deep_mm - springs.reference_mm[i])
    if stiff < LEAST_STIFF:
        stiff, gain = LEAST_STIFF, 0.0
    below, beyond = s[0, i] + soft_mm_per_n, s[1, i] + soft_mm_per_n
    return stiff, gain, below / stiff, beyond / stiff, s[2, i] * stiff


@jitable
def _elastic(springs, i, tip, soft_mm_per_n):
    """Force in newton, unit frame, and energy in N·mm, of a tip displaced by so many mm."""
    n = springs.normal
    below, beyond = n[0, i] + soft_mm_per_n, n[1, i] + soft_mm_per_n
    stiff, gain, soft, hard, knee = _laws(springs, i, tip[2], soft_mm_per_n)
    way = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    across = force(way, soft, hard, knee) / way if way > 0.0 else 0.0
    drag = _stored(way, soft, hard, knee)
    normal_n = force(tip[2], below, beyond, n[2, i]) + gain / stiff * drag
    energy = _stored(tip[2], below, beyond, n[2, i]) + drag
    return (across * tip[0], across * tip[1], normal_n), energy


@jitable
def _onto_cone(pull, normal, friction):
    """Components of a force along a normal and across it, and the force turned so that friction can
    bear it; its part along the unit's z stays. Unit frame."""
    along = _dot(pull, normal)
    side = _add(pull, normal, -along)
    size = math.sqrt(_dot(side, side))
    if size <= friction * along:
        return along, size, pull
    way = _add(normal, side, friction / size)
    share = pull[2] / max(way[2], STEEPEST)
    return along, size, (share * way[0], share * way[1], pull[2])


@jitable
def _slid(springs, i, pull, soft_mm_per_n, deep_mm):
    """Where the tip is, across the unit's normal, under a force that friction bears; mm."""
    _, _, soft, hard, knee = _laws(springs, i, deep_mm, soft_mm_per_n)
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    way = displacement(size, soft, hard, knee)
    share = way / size if size > 0.0 else 0.0
    return share * pull[0], share * pull[1]


@jitable
def _lost(springs, i, pull, tip, before, rate):
    """A force with what viscosity adds to it: stiffness times the rate of each displacement."""
    n = springs.normal
    slope = 1.0 / (n[0, i] if pull[2] <= n[2, i] else n[1, i])
    way = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    across = size / way if way > 1e-9 else 1.0 / springs.shear[0, i]
    return (pull[0] + rate * across * (tip[0] - before[0]),
            pull[1] + rate * across * (tip[1] - before[1]),
            pull[2] + rate * slope * (tip[2] - before[2]))  # fmt: skip


@jitable
def _mine(mounted, link_rotation, i, v):
    """A vector of the world in the unit's frame."""
    x = _turned_back(link_rotation, mounted.body[i], v)
    r = mounted.rotation
    return (r[0, 0, i] * x[0] + r[1, 0, i] * x[1] + r[2, 0, i] * x[2],
            r[0, 1, i] * x[0] + r[1, 1, i] * x[1] + r[2, 1, i] * x[2],
            r[0, 2, i] * x[0] + r[1, 2, i] * x[1] + r[2, 2, i] * x[2])  # fmt: skip


@jitable
def _theirs(mounted, link_rotation, i, v):
    """A vector of the unit's frame in the world."""
    r = mounted.rotation
    return _turned(
        link_rotation, mounted.body[i],
        (r[0, 0, i] * v[0] + r[0, 1, i] * v[1] + r[0, 2, i] * v[2],
         r[1, 0, i] * v[0] + r[1, 1, i] * v[1] + r[1, 2, i] * v[2],
         r[2, 0, i] * v[0] + r[2, 1, i] * v[1] + r[2, 2, i] * v[2]),
    )  # fmt: skip


@jitable
def _face(bodies, mounted, i):
    """Middle of a unit's face, metre, world."""
    link = mounted.body[i]
    p, at = bodies.position[link], mounted.place
    turned = _turned(bodies.rotation, link, (at[0, i], at[1, i], at[2, i]))
    return p[0] + turned[0], p[1] + turned[1], p[2] + turned[2]


@jitable
def _stick(bodies, surfaces, touch, i, spot, found):
    """Remember where a tip, at a spot of the world, sticks, and to what."""
    geom, _, normal = found
    b = surfaces.body[geom]
    p = bodies.position[b]
    at = _turned_back(bodies.rotation, b, (spot[0] - p[0], spot[1] - p[1], spot[2] - p[2]))
    out = _turned_back(bodies.rotation, b, normal)
    touch.body[i], touch.geom[i] = b, geom
    for a in range(3):
        touch.anchor_m[a, i], touch.normal[a, i] = at[a], out[a]


@jitable
def _tip(bodies, mounted, touch, i, face, weight):
    """Where a tip that sticks is: world, and from the unloaded one, mm, unit frame; and the normal
    in the unit frame."""
    b = touch.body[i]
    p, at, out = bodies.position[b], touch.anchor_m, touch.normal
    turned = _turned(bodies.rotation, b, (at[0, i], at[1, i], at[2, i]))
    spot = (p[0] + turned[0], p[1] + turned[1], p[2] + turned[2])
    off = _mine(mounted, bodies.rotation, i, _add(spot, face, -1.0))
    scale = 1e3 * weight
    normal = _turned(bodies.rotation, b, (out[0, i], out[1, i], out[2, i]))
    tip = (scale * off[0], scale * off[1], scale * off[2])
    return spot, tip, _mine(mounted, bodies.rotation, i, normal)


@jitable
def _slide(bodies, mounted, surfaces, touch, i, pull):
    """Let the tip go on until friction bears the force, and find the solid's surface there; False
    where there is none any more."""
    geom = touch.geom[i]
    weight, soft = mounted.weight[i, geom], surfaces.compliance[geom]
    face = _face(bodies, mounted, i)
    x, y = _slid(mounted.springs, i, pull, soft, touch.tip_mm[2, i])
    share = 1e-3 / weight
    aside = _theirs(mounted, bodies.rotation, i, (share * x, share * y, 0.0))
    way = _theirs(mounted, bodies.rotation, i, (0.0, 0.0, 1.0))
    start = _add(face, aside, 1.0)
    found = _deepest(bodies, surfaces, mounted.weight[i], start, way)
    if found[0] < 0:
        return False
    _stick(bodies, surfaces, touch, i, _add(start, way, found[1]), found)
    return True


@jitable
def _touched(bodies, mounted, surfaces, touch, i):
    """Whether anything presses a unit, from now on or still."""
    face = _face(bodies, mounted, i)
    if touch.body[i] >= 0:
        weight = mounted.weight[i, touch.geom[i]]
        if weight > 0.0 and _tip(bodies, mounted, touch, i, face, weight)[1][2] > 0.0:
            return True
    _free(touch, i)
    way = _theirs(mounted, bodies.rotation, i, (0.0, 0.0, 1.0))
    found = _deepest(bodies, surfaces, mounted.weight[i], face, way)
    if found[0] < 0:
        return False
    _stick(bodies, surfaces, touch, i, _add(face, way, found[1]), found)
    touch.tip_mm[2, i] = 1e3 * mounted.weight[i, found[0]] * found[1]
    return True


@jitable
def _bear(bodies, mounted, surfaces, touch, i, rate):
    """The force on a unit that is touched, given to both bodies; False where it lets go."""
    springs, was_slipping = mounted.springs, touch.slipping[i]
    before = touch.tip_mm[0, i], touch.tip_mm[1, i], touch.tip_mm[2, i]
    face = _face(bodies, mounted, i)
    for trial in range(SLIDES):
        geom = touch.geom[i]
        weight, soft = mounted.weight[i, geom], surfaces.compliance[geom]
        spot, tip, normal = _tip(bodies, mounted, touch, i, face, weight)
        if tip[2] <= 0.0:
            return False
        pull, energy = _elastic(springs, i, tip, soft)
        moving = was_slipping or trial > 0
        friction = surfaces.kinetic[geom] if moving else surfaces.static[geom]
        along, across, held = _onto_cone(pull, normal, friction)
        slips = across > friction * along * (1.0 + ON_CONE)
        if not slips or trial == SLIDES - 1:
            break
        if not was_slipping:
            friction = surfaces.kinetic[geom]
            held = _onto_cone(pull, normal, friction)[2]
        if not _slide(bodies, mounted, surfaces, touch, i, held):
            return False
    touch.slipping[i] = trial > 0
    if rate > 0.0 and trial == 0:
        pull = _lost(springs, i, pull, tip, before, rate)
    friction = surfaces.kinetic[geom] if trial > 0 else surfaces.static[geom]
    if pull[2] <= 0.0 or _dot(pull, normal) <= 0.0:
        pull = (0.0, 0.0, 0.0)
    pull = _onto_cone(pull, normal, friction)[2]
    touch.normal_n[i], touch.drag_n[i], _ = _onto_cone(pull, normal, friction)
    touch.limit_n[i], touch.energy_j[i] = friction * touch.normal_n[i], 1e-3 * energy
    for a in range(3):
        touch.force[a, i], touch.tip_mm[a, i] = pull[a], tip[a]
    push = _theirs(mounted, bodies.rotation, i, pull)
    _push(bodies, mounted.body[i], spot, push, weight)
    _push(bodies, touch.body[i], spot, push, -weight)
    return True


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
    rate = LOSS_S / elapsed_s[0] if elapsed_s[0] > 0.0 else 0.0
    for i in range(mounted.body.size):
        if _touched(bodies, mounted, surfaces, touch, i) and not _bear(
            bodies, mounted, surfaces, touch, i, rate
        ):
            _free(touch, i)


feel = compiled(feel_python, allocates=False, fastmath=("contract",))
