"""Tangential displacement and force, and what is not known of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.field import (
    FIELD_MIN,
    GAIN_MIN,
    amplitude_stage,
    anomaly_stage,
    field_law,
    inversion,
)
from skin.decode.functions import atan2, sin_cos
from skin.decode.normal import law_variance
from skin.decode.parts import Parts
from skin.decode.records import EXTRAPOLATED, KNOTS, SILENT
from skin.decode.span import lanes_of
from skin.decode.temperature import EXTRAPOLATION
from skin.physics.force_law import at, force, lines

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


def shear_variance_of(parts: Parts) -> Callable:
    """Variance of the tangential force along its direction."""
    push_of = force if parts.cubes else lines

    @jitable(inline=True)
    def shear_variance(shear, along, depth_sigma, unit, j):
        law = at(unit["shear_law"], j)
        half = push_of(shear.radius + along, law)
        half -= push_of(shear.radius - along, law)
        half *= type(along)(0.5) * shear.stiffening
        deeper = shear.law * unit["shear_gain"][j] * depth_sigma
        push = shear.law * shear.stiffening
        law2 = law_variance(push, unit["shear_variance"][j], unit["shear_floor"][j])
        return half * half + deeper * deeper + law2

    return shear_variance


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
    push_of = force if parts.cubes else lines

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
        law = push_of(radius, at(unit["shear_law"], j))
        depth = tile["displacement"][2, j]
        stiffening = unit["shear_gain"][j] * depth + unit["shear_gain_offset"][j]
        push = law * stiffening
        if with_force:
            tile["force"][0, j] = push * x
            tile["force"][1, j] = push * y
        if with_tangential:
            tile["tangential"][j] = push * share
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
    shear_variance = shear_variance_of(parts)

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
            push = shear.law * shear.stiffening
            depth_sigma = tile["displacement_sigma"][2, j]
            along2 = shear_variance(shear, along, depth_sigma, unit, j)
            across2 = push * push * turned2
            if with_tangential:
                tile["tangential_sigma"][j] = np.sqrt(along2)
            if with_force:
                tile["force_sigma"][0, j] = component(shear.x, along2, across2)
                tile["force_sigma"][1, j] = component(shear.y, along2, across2)

    return sigma


def field_stage(parts: Parts) -> Callable:
    """The stage that decodes the field and its strength, with the chip's gain left in them."""
    with_field, with_shear, with_z = parts.field, parts.shear, parts.angle or parts.consistency
    with_film, law = parts.film_compensation, field_law(parts)

    @jitable(inline=True)
    def field(unit, counts, background, span, tile):
        assume_noalias()
        first, start, size = lanes_of(span)
        real = tile["force"].dtype.type
        for lane in range(size):
            j = start + lane
            chip_above = tile["chip_above"][j]
            x, y, z, gain = law(unit, counts, background, span.cycle, first + j, chip_above, j)
            if with_field:
                each = real(1.0) / gain
                tile["field"][0, j] = x * each
                tile["field"][1, j] = y * each
                tile["field"][2, j] = z * each
            if with_shear:
                if with_film:
                    warmer = unit["film_drift"][j] * tile["film_above"][j]
                    gain *= max(real(1.0) + warmer, real(GAIN_MIN))
                tile["read"][0, j] = x
                tile["read"][1, j] = y
                if with_z:
                    tile["read"][2, j] = z
                tile["gain"][j] = gain
                tile["strength"][j] = np.sqrt(x * x + y * y)

    return field


def displacement_stage(parts: Parts) -> Callable:
    """The stage that decodes R and its direction."""
    with_sigma, with_check = parts.sigma, parts.consistency
    invert = inversion(parts)

    @jitable(inline=True)
    def displacement(unit, background, span, tile, flag):
        assume_noalias()
        first, start, size = lanes_of(span)
        for lane in range(size):
            j = start + lane
            variance = unit["field_variance"][j]
            if background is not None:
                variance += background[span.cycle, 4, first + j]
            radius, along, found, each, inverse, variance = invert(variance, tile, unit, j)
            found |= EXTRAPOLATED if radius > unit["displacement_max"][j] else 0
            flags = flag[j]
            flag[j] = flags if flags & SILENT else flags | found
            tile["radius"][j] = radius
            tile["direction"][0, j] = tile["read"][0, j] * each
            tile["direction"][1, j] = tile["read"][1, j] * each
            if with_check:
                tile["inverse"][j] = inverse
            if with_sigma:
                tile["each"][j] = each
                tile["along"][j] = along
                tile["variance"][j] = variance

    return displacement


def shear_stage(parts: Parts) -> Callable:
    """The stage that decodes the tangential force, and what is not known of all of these."""
    with_sigma = parts.sigma
    shear_from, sigma_from = shear_of(parts), sigma_of(parts)

    @jitable(inline=True)
    def shear(unit, span, tile):
        assume_noalias()
        _, start, size = lanes_of(span)
        real = tile["force"].dtype.type
        for lane in range(size):
            j = start + lane
            x, y = tile["direction"][0, j], tile["direction"][1, j]
            along = tile["along"][j] if with_sigma else real(0.0)
            strength = tile["strength"][j]
            found = shear_from(x, y, tile["radius"][j], along, strength, tile, unit, j)
            if with_sigma:
                sigma_from(found, tile["each"][j], tile["variance"][j], tile, unit, j)

    return shear


def tangential_stage(parts: Parts) -> Callable:
    """The stages that decode the field, the tangential displacement and the tangential force.

    Each is a loop of its own: a short loop keeps its constants in registers, and a processor that
    looks ahead works on more units at a time.
    """
    with_shear, with_check = parts.shear, parts.consistency
    with_amplitude = parts.consistency or not parts.angle
    field, amplitude = field_stage(parts), amplitude_stage(parts)
    displacement, check = displacement_stage(parts), anomaly_stage(parts)
    shear = shear_stage(parts)

    @jitable(inline=True)
    def tangential(unit, counts, background, span, tile, flag, state, advance):
        field(unit, counts, background, span, tile)
        if with_shear:
            if with_amplitude:
                amplitude(unit, span, tile)
            displacement(unit, background, span, tile, flag)
            if with_check:
                check(unit, span, tile, flag, state, advance)
            shear(unit, span, tile)

    return tangential
