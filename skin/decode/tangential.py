"""Depth, displacement and force of units, and what is not known of them.

Depth and normal force come from the frequency of the oscillator under the gel capacitor, the
tangential displacement from the field, the tangential force from the displacement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.field import FIELD_MIN, Field, Inverted, field_at, invert
from skin.decode.functions import atan2, read, sin_cos
from skin.decode.temperature import EXTRAPOLATION
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force

from skin.decode.records import (  # isort: skip
    DISPLACEMENT, EXTRAPOLATED, FORCE, FREQUENCY, IDLE, KNOTS, LANES, RESULTS, SIGMA, SILENT,
    TANGENTIAL, TEMPERATURE, TEST_RATIO, THETA,
)  # fmt: skip

__all__ = ["decode_unloaded", "hide", "invert_units", "show_units"]

THETA_MOST_RAD = 1.8137993642342178
"""Sigma of a direction that is not known: even over the circle, pi / sqrt(3)."""


class Normal(NamedTuple):
    """Depth, mm, and normal force, N, with their one-sigma."""

    depth: float
    push: float
    depth_sigma: float
    push_sigma: float


class Shear(NamedTuple):
    """A unit's tangential displacement and force on their way.

    Attributes
    ----------
    x, y : float
        Direction.
    radius : float
        Displacement of the film's middle, mm.
    law, stiffening : float
        Force at the reference depth, N, and its factor at this depth.
    """

    x: float
    y: float
    radius: float
    law: float
    stiffening: float


@jitable
def law_variance(force, relative2, absolute2):
    """What a law is off by that is not the unit's: a share of the force, and as much for all loads;
    but never more than the force itself, for the law goes through zero as the unit does."""
    square = force * force
    return relative2 * square + min(absolute2, square)


@jitable
def normal_of(wants, unit, counts, background, j):
    """A unit's `Normal`."""
    real = unit["depth_scale"].dtype.type
    depth = unit["depth_scale"][j] * real(read(counts, FREQUENCY, j))
    depth += unit["depth_offset"][j]
    if background is not None:
        depth -= unit["depth_per_hz"][j] * read(background, 0, j)
    law = law_at(unit["normal_law"], j)
    push = force(depth, law)
    depth_sigma = push_sigma = real(0.0)
    if wants.sigma is not None:
        over = max(depth - unit["depth_high"][j], unit["depth_low"][j] - depth)
        beyond = real(EXTRAPOLATION) * max(over, real(0.0))
        depth_sigma = unit["depth_sigma"][j] + beyond
        # half of what the force changes over the interval of the frequency, and of the law
        sigma = unit["normal_sigma"][j] + beyond
        half = real(0.5) * (force(depth + sigma, law) - force(depth - sigma, law))
        law2 = law_variance(push, unit["normal_variance"][j], unit["normal_floor"][j])
        push_sigma = np.sqrt(half * half + law2)
    return Normal(depth, push, depth_sigma, push_sigma)


@jitable
def corrected(x, y, unit, j):
    """A direction by the unit's table, linear in theta between knots: a sum of ramps."""
    real = type(x)
    along = atan2(y, x) + real(np.pi)
    table = unit["theta_correction"]
    turn = table[0, j] + table[1, j] * along
    for knot in range(1, KNOTS):
        ramp = max(along - real(knot) * real(2.0 * np.pi / KNOTS), real(0.0))
        turn += table[1 + knot, j] * ramp
    sine, cosine = sin_cos(turn)
    return x * cosine - y * sine, x * sine + y * cosine


@jitable
def show_shear(wants, field, inverted, depth, unit, out, j):
    """Direction, displacement and force of a unit from its R: a `Shear`, which is shown."""
    real = type(depth)
    zero, one = real(0.0), real(1.0)
    x, y, outer = field.x * inverted.each, field.y * inverted.each, inverted.radius
    if wants.correction is not None:
        x, y = corrected(x, y, unit, j)
    radius, share = outer, one if field.strength > zero else zero
    if wants.centre is not None:
        dx = outer * x - unit["film_x"][j]
        dy = outer * y - unit["film_y"][j]
        radius, share = np.sqrt(dx * dx + dy * dy), one
        away = one / max(radius, real(FIELD_MIN))
        x = dx * away
        y = dy * away
    law = force(radius, law_at(unit["shear_law"], j))
    stiffening = unit["shear_gain"][j] * depth + unit["shear_gain_offset"][j]
    push = law * stiffening
    out[FORCE, j] = push * x
    out[FORCE + 1, j] = push * y
    out[TANGENTIAL, j] = push * share
    out[DISPLACEMENT, j] = radius * x
    out[DISPLACEMENT + 1, j] = radius * y
    if wants.theta is not None:
        out[THETA, j] = atan2(y, x)
    return Shear(x, y, radius, law, stiffening)


@jitable
def component(part, along2, across2):
    """Sigma of a component whose share of the direction is `part`; both are equal at R = 0."""
    return np.sqrt(across2 + part * part * (along2 - across2))


@jitable
def show_sigma(shear, inverted, depth_sigma, unit, out, j):
    """One-sigma of all that is tangential."""
    real = type(depth_sigma)
    limit = unit["displacement_max"][j]
    over = max(inverted.radius - inverted.along - limit, real(0.0))
    along = inverted.along + real(EXTRAPOLATION) * over
    along2 = along * along
    # across the direction, R sigma / S, which has a limit at R = 0
    aside = inverted.each * inverted.radius
    across2 = min(inverted.variance * (aside * aside), limit * limit)
    rate = real(1.0) / max(shear.radius, real(1e-12))
    turned2 = across2 * (rate * rate)
    out[SIGMA + THETA, j] = min(np.sqrt(turned2), real(THETA_MOST_RAD))
    out[SIGMA + DISPLACEMENT, j] = component(shear.x, along2, across2)
    out[SIGMA + DISPLACEMENT + 1, j] = component(shear.y, along2, across2)
    law, push = law_at(unit["shear_law"], j), shear.law * shear.stiffening
    half = force(shear.radius + along, law) - force(shear.radius - along, law)
    half *= real(0.5) * shear.stiffening
    deeper = shear.law * unit["shear_gain"][j] * depth_sigma
    law2 = law_variance(push, unit["shear_variance"][j], unit["shear_floor"][j])
    along2 = half * half + deeper * deeper + law2
    across2 = push * push * turned2
    out[SIGMA + TANGENTIAL, j] = np.sqrt(along2)
    out[SIGMA + FORCE, j] = component(shear.x, along2, across2)
    out[SIGMA + FORCE + 1, j] = component(shear.y, along2, across2)


@jitable
def show_normal(wants, normal, out, j):
    """Normal force and depth."""
    out[FORCE + 2, j] = normal.push
    out[DISPLACEMENT + 2, j] = normal.depth
    if wants.sigma is not None:
        out[SIGMA + FORCE + 2, j] = normal.push_sigma
        out[SIGMA + DISPLACEMENT + 2, j] = normal.depth_sigma


@jitable
def show(wants, field, inverted, normal, unit, out, j):
    """All that is known of a unit but its temperature and field."""
    shear = show_shear(wants, field, inverted, normal.depth, unit, out, j)
    if wants.sigma is not None:
        show_sigma(shear, inverted, normal.depth_sigma, unit, out, j)
    show_normal(wants, normal, out, j)


@jitable
def keep(tile, j, field, inverted, normal, gain):
    """Write a unit down for the stages that follow."""
    tile["x"][j], tile["y"][j], tile["z"][j] = field.x, field.y, field.z
    tile["strength"][j], tile["gain"][j] = field.strength, gain
    tile["radius"][j], tile["along"][j] = inverted.radius, inverted.along
    tile["each"][j], tile["variance"][j] = inverted.each, inverted.variance
    tile["depth"][j], tile["push"][j] = normal.depth, normal.push
    tile["depth_sigma"][j], tile["push_sigma"][j] = normal.depth_sigma, normal.push_sigma


@jitable
def invert_units(wants, unit, counts, background, size, tile, flag):
    """Fields, depths and R of the units of a block; shown here where no check follows."""
    assume_noalias()
    for j in range(min(size, LANES)):
        field = field_at(wants, unit, counts, background, j, tile)
        if wants.shear is not None:
            flags, normal = flag[j], normal_of(wants, unit, counts, background, j)
            variance = unit["field_variance"][j]
            if background is not None:
                variance += read(background, 4, j)
            inverted, found, gain = invert(wants, field, normal, variance, unit, j)
            found |= EXTRAPOLATED if inverted.radius > unit["displacement_max"][j] else 0
            flag[j] = flags if flags & SILENT else flags | found
            if wants.check is not None:
                keep(tile, j, field, inverted, normal, gain)
            else:
                show(wants, field, inverted, normal, unit, tile["result"], j)


@jitable
def show_units(wants, unit, size, tile):
    """Show the units of a block after their fields have been checked."""
    assume_noalias()
    for j in range(min(size, LANES)):
        strength = tile["strength"][j]
        field = Field(tile["x"][j], tile["y"][j], tile["z"][j], strength, strength)
        inverted = Inverted(
            tile["radius"][j], tile["along"][j], tile["each"][j], tile["variance"][j]
        )
        normal = Normal(
            tile["depth"][j], tile["push"][j], tile["depth_sigma"][j], tile["push_sigma"][j]
        )
        show(wants, field, inverted, normal, unit, tile["result"], j)


@jitable
def decode_unloaded(wants, unit, counts, background, size, tile, flag):
    """What shows of a block's units without load: IDLE, and nothing that is tangential."""
    assume_noalias()
    out = tile["result"]
    nothing = out.dtype.type(np.nan)
    for row in range(FORCE, TEST_RATIO + 1):
        if row != SIGMA + TEMPERATURE:
            for j in range(LANES):
                out[row, j] = nothing
    for j in range(min(size, LANES)):
        flags = flag[j]
        flag[j] = flags if flags & SILENT else flags | IDLE
        if wants.shear is not None:
            show_normal(wants, normal_of(wants, unit, counts, background, j), out, j)


@jitable
def hide(flag, unknown, tile):
    """Show nothing of units that are `unknown`."""
    assume_noalias()
    out = tile["result"]
    for j in range(LANES):
        if flag[j] & unknown != 0:
            for row in range(RESULTS):
                out[row, j] = np.nan
