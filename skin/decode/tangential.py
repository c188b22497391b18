"""Tangential displacement and force, and what is not known of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.field import FIELD_MIN, GAIN_MIN, field_law, inversion
from skin.decode.functions import atan2, sin_cos
from skin.decode.normal import bent
from skin.decode.parts import Parts
from skin.decode.records import EXTRAPOLATED, INVALID, KNOTS, SILENT
from skin.decode.span import lanes_of
from skin.decode.temperature import EXTRAPOLATION

__all__ = ["tangential_stage"]


class Shear(NamedTuple):
    """A unit's tangential displacement and force on their way.

    Attributes
    ----------
    x, y : float
        Direction.
    radius, outer : float
        Displacement of the film's middle and of the film on the chip's axis, mm.
    along : float
        One-sigma along the direction, mm.
    law, stiffening : float
        Force at the reference depth, N, and its factor at this depth.
    """

    x: float
    y: float
    radius: float
    outer: float
    along: float
    law: float
    stiffening: float


@jitable(inline=True)
def shear_variance(shear, along, depth_sigma, unit, j):
    """Variance of the tangential force along its direction."""
    soft, knee, stiffer = unit["shear_soft"][j], unit["shear_break"][j], unit["shear_stiffer"][j]
    half = bent(shear.radius + along, soft, knee, stiffer)
    half -= bent(shear.radius - along, soft, knee, stiffer)
    half *= type(along)(0.5) * shear.stiffening
    deeper = shear.law * unit["shear_gain"][j] * depth_sigma
    force = shear.law * shear.stiffening
    return half * half + deeper * deeper + unit["shear_variance"][j] * (force * force)


@jitable(inline=True)
def component(part, along2, across2):
    """Sigma of a component whose share of the direction is `part`; both are equal at R = 0."""
    return np.sqrt(across2 + part * part * (along2 - across2))


@jitable(inline=True)
def correct(x, y, unit, j):
    """Correct a direction by the unit's table, linear in theta between knots: a sum of ramps."""
    real = type(x)
    along = atan2(y, x) + real(np.pi)
    table = unit["theta_correction"]
    turn = table[0, j] + table[1, j] * along
    for knot in range(1, KNOTS):
        ramp = max(along - real(knot) * real(2.0 * np.pi / KNOTS), real(0.0))
        turn += table[1 + knot, j] * ramp
    sine, cosine = sin_cos(turn)
    return x * cosine - y * sine, x * sine + y * cosine


def shear_of(parts: Parts) -> Callable:
    """Direction, displacement and force of a unit from its R; what is wanted, into the tile."""
    with_correction, with_centre = parts.theta_correction, parts.film_centre
    with_force, with_tangential = parts.force, parts.tangential
    with_theta, with_displacement = parts.theta, parts.displacement

    @jitable(inline=True)
    def shear(x, y, outer, along, strength, tile, unit, j):
        real = type(x)
        zero, one = real(0.0), real(1.0)
        if with_correction:
            x, y = correct(x, y, unit, j)
        radius, share = outer, one if strength > zero else zero
        if with_centre:
            dx = outer * x - unit["film_x"][j]
            dy = outer * y - unit["film_y"][j]
            radius, share = np.sqrt(dx * dx + dy * dy), one
            away = one / max(radius, real(FIELD_MIN))
            x = dx * away
            y = dy * away
        soft, knee = unit["shear_soft"][j], unit["shear_break"][j]
        law = bent(radius, soft, knee, unit["shear_stiffer"][j])
        depth = tile["displacement"][2, j]
        stiffening = unit["shear_gain"][j] * depth + unit["shear_gain_offset"][j]
        force = law * stiffening
        if with_force:
            tile["force"][0, j] = force * x
            tile["force"][1, j] = force * y
        if with_tangential:
            tile["tangential"][j] = force * share
        if with_theta:
            tile["theta"][j] = atan2(y, x)
        if with_displacement:
            tile["displacement"][0, j] = radius * x
            tile["displacement"][1, j] = radius * y
        return Shear(x, y, radius, outer, along, law, stiffening)

    return shear


def sigma_of(parts: Parts) -> Callable:
    """One-sigma of all that is tangential."""
    with_force, with_tangential = parts.force, parts.tangential
    with_theta, with_displacement = parts.theta, parts.displacement

    @jitable(inline=True)
    def sigma(shear, each, variance, tile, unit, j):
        """`each` is 1 / S, `variance` that of the field."""
        real = type(each)
        limit = unit["displacement_max"][j]
        over = max(shear.outer - shear.along - limit, real(0.0))
        along = shear.along + real(EXTRAPOLATION) * over
        along2 = along * along
        # across the direction, R sigma / S, which has a limit at R = 0
        aside = each * shear.outer
        across2 = min(variance * (aside * aside), limit * limit)
        rate = real(1.0) / max(shear.radius, real(1e-12))
        turned2 = across2 * (rate * rate)
        if with_theta:
            most = real(1.8137993642342178)  # pi / sqrt(3)
            tile["theta_sigma"][j] = min(np.sqrt(turned2), most)
        if with_displacement:
            tile["displacement_sigma"][0, j] = component(shear.x, along2, across2)
            tile["displacement_sigma"][1, j] = component(shear.y, along2, across2)
        if with_force or with_tangential:
            force = shear.law * shear.stiffening
            depth_sigma = tile["displacement_sigma"][2, j]
            along2 = shear_variance(shear, along, depth_sigma, unit, j)
            across2 = force * force * turned2
            if with_tangential:
                tile["tangential_sigma"][j] = np.sqrt(along2)
            if with_force:
                tile["force_sigma"][0, j] = component(shear.x, along2, across2)
                tile["force_sigma"][1, j] = component(shear.y, along2, across2)

    return sigma


def tangential_stage(parts: Parts) -> Callable:
    """The stage that decodes the field, the tangential displacement and the tangential force."""
    with_field, with_shear, with_sigma = parts.field, parts.shear, parts.sigma
    with_film, with_check = parts.film_compensation, parts.consistency
    field, invert = field_law(parts), inversion(parts)
    shear_from, sigma = shear_of(parts), sigma_of(parts)

    @jitable(inline=True)
    def tangential(unit, counts, background, span, tile, flag, state, advance):
        assume_noalias()
        first, start, size = lanes_of(span)
        real = tile["force"].dtype.type
        for lane in range(size):
            j = start + lane
            i = first + j
            chip_above = tile["chip_above"][j]
            x, y, z, gain = field(unit, counts, background, span.cycle, i, chip_above, j)
            if with_field:
                each = real(1.0) / gain
                tile["field"][0, j] = x * each
                tile["field"][1, j] = y * each
                tile["field"][2, j] = z * each
            if with_shear:
                variance = unit["field_variance"][j]
                if background is not None:
                    variance += background[span.cycle, 4, i]
                if with_film:
                    warmer = unit["film_drift"][j] * tile["film_above"][j]
                    gain *= max(real(1.0) + warmer, real(GAIN_MIN))
                strength = np.sqrt(x * x + y * y)
                solid = max(strength, real(FIELD_MIN))
                missed = state["missed"][j] if with_check else real(0.0)
                radius, along, found, each, variance, mean = invert(
                    solid, z, variance, gain, missed, tile, unit, j
                )
                found |= EXTRAPOLATED if radius > unit["displacement_max"][j] else 0
                flags = flag[j]
                if with_check:
                    state["missed"][j] = mean if advance & (flags & INVALID == 0) else missed
                flag[j] = flags if flags & SILENT else flags | found
                shear = shear_from(x * each, y * each, radius, along, strength, tile, unit, j)
                if with_sigma:
                    sigma(shear, each, variance, tile, unit, j)

    return tangential
