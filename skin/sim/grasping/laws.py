"""Laws of a unit's tip: elastic force and energy, the cone of friction, and viscosity."""

from __future__ import annotations

import math

from bus.compiled.jit import jitable
from skin.physics.force_law import at, energy, force, inverse, slope, stiffening
from skin.sim.mechanics.springs import yields
from skin.sim.mechanics.vectors import add, dot

__all__ = ["STEEPEST", "elastic", "lost", "onto_cone", "slid"]

STEEPEST = 0.2
"""Cosine of the tilt beyond which a solid passes a unit without pressing it [assumed]."""

LEAST_STIFF = 0.1
"""Lower bound of the shear stiffness over that at the reference depth [assumed]."""


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
def elastic(springs, i, tip, soft_mm_per_n):
    """Force in newton, unit frame, and energy in N·mm, of a tip displaced by so many mm."""
    stiff, gain = _stiffened(springs, i, tip[2])
    travel = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    side_n, side = _borne(travel, at(springs.shear, i), soft_mm_per_n)
    push_n, push = _borne(tip[2], at(springs.normal, i), soft_mm_per_n)
    across = stiff * side_n / travel if travel > 0.0 else 0.0
    return (across * tip[0], across * tip[1], push_n + gain * side), push + stiff * side


@jitable
def onto_cone(pull, normal, friction):
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
def slid(springs, i, pull, soft_mm_per_n, deep_mm):
    """Displacement of the tip, across the unit's normal, under a force within the cone of friction;
    mm."""
    stiff, _ = _stiffened(springs, i, deep_mm)
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1]) / stiff
    travel = inverse(size, at(springs.shear, i)) + soft_mm_per_n * size
    share = travel / (stiff * size) if size > 0.0 else 0.0
    return share * pull[0], share * pull[1]


@jitable
def lost(springs, i, pull, tip, before, rate):
    """A force plus viscosity: stiffness times the rate of each displacement."""
    normal, shear = at(springs.normal, i), at(springs.shear, i)
    steep = slope(inverse(pull[2], normal), normal)
    travel = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    across = size / travel if travel > 1e-9 else slope(0.0, shear)
    return (pull[0] + rate * across * (tip[0] - before[0]),
            pull[1] + rate * across * (tip[1] - before[1]),
            pull[2] + rate * steep * (tip[2] - before[2]))  # fmt: skip
