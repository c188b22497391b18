"""Contacts of units, and their forces: springs with sticking tips, and a return map.

A unit is a spring from its face to a tip. Without contact it searches along its normal, into the
skin; where that line leaves a solid below the face, the tip sticks to the solid. From then on the
tip moves with it, by R across the unit's normal and by H into the skin, and the force is the
gradient of an elastic energy, so that a cycle of loading and unloading gains nothing::

    energy = U(H) + g(H) V(R)        force = (g V'(R) r, U'(H) + g' V(R))      in the unit frame

with U' and V' the unit's own elastic laws (`skin.physics.elastic`) and g their stiffening with
depth. The tip slides over the solid only where that force leaves the cone of friction about the
solid's normal (Coulomb's return map); otherwise it sticks exactly. Both bodies get the same force,
at the tip. This is the Winkler foundation of `skin.sim.mechanics.springs` for bodies that are
moved by forces.
"""

from __future__ import annotations

import math

from bus.compiled.jit import compiled, jitable
from skin.physics.force_law import at, energy, force, inverse, slope, stiffening
from skin.sim.mechanics.rays import MESH, crossing, hull_crossing
from skin.sim.mechanics.springs import yields
from skin.sim.mechanics.vectors import add, dot, turned, turned_back

__all__ = ["DEEPEST_M", "LOSS_S", "feel"]

DEEPEST_M = 3.5e-3
"""Depth at which the film would lie on its chip; a line that enters below is behind the skin."""

STEEPEST = 0.2
"""Cosine of the tilt beyond which a solid passes a unit without pressing it [assumed]."""

LEAST_STIFF = 0.1
"""Lower bound of the shear stiffness over that at the reference depth [assumed]."""

SLIDES = 4
"""Corrections of the path of a tip in one step for the curvature of the solid [numeric]."""

ON_CONE = 1e-9
"""Relative distance to the cone of friction that counts as on it [numeric]."""

LOSS_S = 2e-4
"""Viscosity over stiffness of the elastomer: a loss of 6 % at 50 Hz [assumed, a soft silicone]."""


@jitable
def _stiffened(springs, i, deep_mm):
    """Factor of the shear at a depth, and its slope."""
    gain = springs.gain_per_mm[i]
    stiff = stiffening(deep_mm, gain, springs.reference_mm[i])
    if stiff < LEAST_STIFF:
        stiff, gain = LEAST_STIFF, 0.0
    return stiff, gain


@jitable
def _borne(target, law, soft_mm_per_n):
    """Force and energy of a unit that yields by so much together with a compliance in series."""
    own = yields(target, law, soft_mm_per_n)
    push = force(own, law)
    return push, energy(own, law) + 0.5 * soft_mm_per_n * push * push


@jitable
def _elastic(springs, i, tip, soft_mm_per_n):
    """Force in newton, unit frame, and energy in N·mm, of a tip displaced by so many mm."""
    stiff, gain = _stiffened(springs, i, tip[2])
    travel = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    side_n, side = _borne(travel, at(springs.shear, i), soft_mm_per_n)
    push_n, push = _borne(tip[2], at(springs.normal, i), soft_mm_per_n)
    across = stiff * side_n / travel if travel > 0.0 else 0.0
    return (across * tip[0], across * tip[1], push_n + gain * side), push + stiff * side


@jitable
def _onto_cone(pull, normal, friction):
    """Components of a force along a normal and across it, and the force projected onto the cone of
    friction; its part along the unit's z stays. Unit frame."""
    along = dot(pull, normal)
    side = add(pull, normal, -along)
    size = math.sqrt(dot(side, side))
    if size <= friction * along:
        return along, size, pull
    direction = add(normal, side, friction / size)
    share = pull[2] / max(direction[2], STEEPEST)
    return along, size, (share * direction[0], share * direction[1], pull[2])


@jitable
def _slid(springs, i, pull, soft_mm_per_n, deep_mm):
    """Displacement of the tip, across the unit's normal, under a force within the cone of friction;
    mm."""
    stiff, _ = _stiffened(springs, i, deep_mm)
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1]) / stiff
    travel = inverse(size, at(springs.shear, i)) + soft_mm_per_n * size
    share = travel / (stiff * size) if size > 0.0 else 0.0
    return share * pull[0], share * pull[1]


@jitable
def _lost(springs, i, pull, tip, before, rate):
    """A force plus viscosity: stiffness times the rate of each displacement."""
    normal, shear = at(springs.normal, i), at(springs.shear, i)
    steep = slope(inverse(pull[2], normal), normal)
    travel = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    across = size / travel if travel > 1e-9 else slope(0.0, shear)
    return (pull[0] + rate * across * (tip[0] - before[0]),
            pull[1] + rate * across * (tip[1] - before[1]),
            pull[2] + rate * steep * (tip[2] - before[2]))  # fmt: skip


@jitable
def _deepest(bodies, surfaces, weight, face, direction):
    """The geom that presses a unit deepest, its depth, and its normal; -1 for none."""
    best, depth, normal = -1, 0.0, (0.0, 0.0, 0.0)
    for g in range(surfaces.kind.size):
        if weight[g] == 0.0:
            continue
        p = bodies.geom_position[g]
        off = (face[0] - p[0], face[1] - p[1], face[2] - p[2])
        away = surfaces.radius[g] + DEEPEST_M
        if dot(off, off) > away * away:
            continue
        point = turned_back(bodies.geom_rotation, g, off)
        along = turned_back(bodies.geom_rotation, g, direction)
        if surfaces.kind[g] == MESH:
            enters, out, x, y, z = hull_crossing(surfaces.planes, surfaces.faces[g], point, along)
        else:
            enters, out, x, y, z = crossing(surfaces.kind[g], surfaces.size[g], point, along)
        if enters > DEEPEST_M:
            continue
        if out > depth and x * along[0] + y * along[1] + z * along[2] > STEEPEST:
            best, depth, normal = g, out, turned(bodies.geom_rotation, g, (x, y, z))
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
def _mine(mounted, link_rotation, i, v):
    """A world vector in the unit's frame."""
    x = turned_back(link_rotation, mounted.body[i], v)
    r = mounted.rotation
    return (r[0, 0, i] * x[0] + r[1, 0, i] * x[1] + r[2, 0, i] * x[2],
            r[0, 1, i] * x[0] + r[1, 1, i] * x[1] + r[2, 1, i] * x[2],
            r[0, 2, i] * x[0] + r[1, 2, i] * x[1] + r[2, 2, i] * x[2])  # fmt: skip


@jitable
def _theirs(mounted, link_rotation, i, v):
    """A vector of the unit's frame in the world."""
    r = mounted.rotation
    return turned(
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
    arm = turned(bodies.rotation, link, (at[0, i], at[1, i], at[2, i]))
    return p[0] + arm[0], p[1] + arm[1], p[2] + arm[2]


@jitable
def _stick(bodies, surfaces, touch, i, spot, found):
    """Store where a tip sticks, and to what."""
    geom, _, normal = found
    b = surfaces.body[geom]
    p = bodies.position[b]
    at = turned_back(bodies.rotation, b, (spot[0] - p[0], spot[1] - p[1], spot[2] - p[2]))
    out = turned_back(bodies.rotation, b, normal)
    touch.body[i], touch.geom[i] = b, geom
    for a in range(3):
        touch.anchor_m[a, i], touch.normal[a, i] = at[a], out[a]


@jitable
def _tip(bodies, mounted, touch, i, face, weight):
    """Place of a sticking tip: world, and from the unloaded one, mm, unit frame; and the normal in
    the unit frame."""
    b = touch.body[i]
    p, at, out = bodies.position[b], touch.anchor_m, touch.normal
    arm = turned(bodies.rotation, b, (at[0, i], at[1, i], at[2, i]))
    spot = (p[0] + arm[0], p[1] + arm[1], p[2] + arm[2])
    off = _mine(mounted, bodies.rotation, i, add(spot, face, -1.0))
    scale = 1e3 * weight
    normal = turned(bodies.rotation, b, (out[0, i], out[1, i], out[2, i]))
    tip = (scale * off[0], scale * off[1], scale * off[2])
    return spot, tip, _mine(mounted, bodies.rotation, i, normal)


@jitable
def _slide(bodies, mounted, surfaces, touch, i, pull):
    """Slide the tip until friction bears the force, and find the solid's surface there; False if
    there is none."""
    geom = touch.geom[i]
    weight, soft = mounted.weight[i, geom], surfaces.compliance[geom]
    face = _face(bodies, mounted, i)
    x, y = _slid(mounted.springs, i, pull, soft, touch.tip_mm[2, i])
    share = 1e-3 / weight
    aside = _theirs(mounted, bodies.rotation, i, (share * x, share * y, 0.0))
    direction = _theirs(mounted, bodies.rotation, i, (0.0, 0.0, 1.0))
    start = add(face, aside, 1.0)
    found = _deepest(bodies, surfaces, mounted.weight[i], start, direction)
    if found[0] < 0:
        return False
    _stick(bodies, surfaces, touch, i, add(start, direction, found[1]), found)
    return True


@jitable
def _touched(bodies, mounted, surfaces, touch, i):
    """Whether a unit is in contact, new or continued."""
    face = _face(bodies, mounted, i)
    if touch.body[i] >= 0:
        weight = mounted.weight[i, touch.geom[i]]
        if weight > 0.0 and _tip(bodies, mounted, touch, i, face, weight)[1][2] > 0.0:
            return True
    _free(touch, i)
    direction = _theirs(mounted, bodies.rotation, i, (0.0, 0.0, 1.0))
    found = _deepest(bodies, surfaces, mounted.weight[i], face, direction)
    if found[0] < 0:
        return False
    _stick(bodies, surfaces, touch, i, add(face, direction, found[1]), found)
    touch.tip_mm[2, i] = 1e3 * mounted.weight[i, found[0]] * found[1]
    return True


@jitable
def _bear(bodies, mounted, surfaces, touch, i, rate):
    """The force on a unit in contact, applied to both bodies; False where it is released."""
    springs, was_slipping = mounted.springs, touch.slipping[i]
    before = touch.tip_mm[0, i], touch.tip_mm[1, i], touch.tip_mm[2, i]
    face = _face(bodies, mounted, i)
    trial = 0
    while True:
        geom = touch.geom[i]
        weight, soft = mounted.weight[i, geom], surfaces.compliance[geom]
        spot, tip, normal = _tip(bodies, mounted, touch, i, face, weight)
        if tip[2] <= 0.0:
            return False
        pull, stored = _elastic(springs, i, tip, soft)
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
        trial += 1
    touch.slipping[i] = trial > 0
    if rate > 0.0 and trial == 0:
        pull = _lost(springs, i, pull, tip, before, rate)
    friction = surfaces.kinetic[geom] if trial > 0 else surfaces.static[geom]
    if pull[2] <= 0.0 or dot(pull, normal) <= 0.0:
        pull = (0.0, 0.0, 0.0)
    pull = _onto_cone(pull, normal, friction)[2]
    touch.normal_n[i], touch.drag_n[i], _ = _onto_cone(pull, normal, friction)
    touch.limit_n[i], touch.energy_j[i] = friction * touch.normal_n[i], 1e-3 * stored
    for a in range(3):
        touch.force[a, i], touch.tip_mm[a, i] = pull[a], tip[a]
    push = _theirs(mounted, bodies.rotation, i, pull)
    _push(bodies, mounted.body[i], spot, push, weight)
    _push(bodies, touch.body[i], spot, push, -weight)
    return True


def feel_python(bodies, mounted, surfaces, touch, elapsed_s):
    """Find the contacts of all units, and add the wrenches to both bodies.

    Parameters
    ----------
    bodies : Bodies
        Its `wrench` is added to.
    mounted : Mounted
    surfaces : Surfaces
    touch : Touch
        State `elapsed_s` ago; updated.
    elapsed_s : ndarray, shape (1,)
        Second; 0 for the same instant, without velocities.
    """
    rate = LOSS_S / elapsed_s[0] if elapsed_s[0] > 0.0 else 0.0
    for i in range(mounted.body.size):
        if _touched(bodies, mounted, surfaces, touch, i) and not _bear(
            bodies, mounted, surfaces, touch, i, rate
        ):
            _free(touch, i)


feel = compiled(feel_python, fastmath=("contract",))
