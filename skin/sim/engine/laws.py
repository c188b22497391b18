"""Laws of a unit's tip: elastic force and energy, the cone of friction, and what viscosity adds."""

from __future__ import annotations

import math

from bus.compiled.jit import jitable
from skin.physics.force_law import inverse_integral, slope, stiffening
from skin.sim.engine.vectors import add, dot
from skin.sim.mechanics.springs import displacement, force

__all__ = ["STEEPEST", "elastic", "lost", "onto_cone", "slid"]

STEEPEST = 0.2
"""Cosine of the tilt beyond which a solid passes by a unit instead of pressing it [assumed]."""

LEAST_STIFF = 0.1
"""Of shear over that at the reference depth, however shallow [assumed]."""


@jitable
def _laws(springs, i, deep_mm, soft_mm_per_n):
    """Stiffening with depth and its slope, compliances and knee of the shear there."""
    s, gain = springs.shear, springs.gain_per_mm[i]
    stiff = stiffening(deep_mm, gain, springs.reference_mm[i])
    if stiff < LEAST_STIFF:
        stiff, gain = LEAST_STIFF, 0.0
    below, beyond = s[0, i] + soft_mm_per_n, s[1, i] + soft_mm_per_n
    return stiff, gain, below / stiff, beyond / stiff, s[2, i] * stiff


@jitable
def elastic(springs, i, tip, soft_mm_per_n):
    """Force in newton, unit frame, and energy in N·mm, of a tip displaced by so many mm."""
    n = springs.normal
    below, beyond = n[0, i] + soft_mm_per_n, n[1, i] + soft_mm_per_n
    stiff, gain, soft, hard, knee = _laws(springs, i, tip[2], soft_mm_per_n)
    way = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    across = force(way, soft, hard, knee) / way if way > 0.0 else 0.0
    drag = inverse_integral(way, soft, knee, hard)
    normal_n = force(tip[2], below, beyond, n[2, i]) + gain / stiff * drag
    energy = inverse_integral(tip[2], below, n[2, i], beyond) + drag
    return (across * tip[0], across * tip[1], normal_n), energy


@jitable
def onto_cone(pull, normal, friction):
    """Components of a force along a normal and across it, and the force turned so that friction can
    bear it; its part along the unit's z stays. Unit frame."""
    along = dot(pull, normal)
    side = add(pull, normal, -along)
    size = math.sqrt(dot(side, side))
    if size <= friction * along:
        return along, size, pull
    way = add(normal, side, friction / size)
    share = pull[2] / max(way[2], STEEPEST)
    return along, size, (share * way[0], share * way[1], pull[2])


@jitable
def slid(springs, i, pull, soft_mm_per_n, deep_mm):
    """Where the tip is, across the unit's normal, under a force that friction bears; mm."""
    _, _, soft, hard, knee = _laws(springs, i, deep_mm, soft_mm_per_n)
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    way = displacement(size, soft, hard, knee)
    share = way / size if size > 0.0 else 0.0
    return share * pull[0], share * pull[1]


@jitable
def lost(springs, i, pull, tip, before, rate):
    """A force with what viscosity adds to it: stiffness times the rate of each displacement."""
    n = springs.normal
    steep = 1.0 / slope(pull[2], n[0, i], n[2, i], n[1, i])
    way = math.sqrt(tip[0] * tip[0] + tip[1] * tip[1])
    size = math.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    across = size / way if way > 1e-9 else 1.0 / springs.shear[0, i]
    return (pull[0] + rate * across * (tip[0] - before[0]),
            pull[1] + rate * across * (tip[1] - before[1]),
            pull[2] + rate * steep * (tip[2] - before[2]))  # fmt: skip
