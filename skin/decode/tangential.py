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
    Field,
    Inverted,
    anomaly_stage,
    field_law,
    inversion,
)
from skin.decode.functions import atan2, sin_cos
from skin.decode.normal import Normal, law_variance, normal_law
from skin.decode.plan import Plan
from skin.decode.records import EXTRAPOLATED, IDLE, KNOTS, LANES, SILENT
from skin.decode.rows import read, write
from skin.decode.temperature import EXTRAPOLATION
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, lines

__all__ = ["units_stage"]


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


def shear_variance_of(plan: Plan) -> Callable:
    """Variance of the tangential force along its direction."""
    push_of = force if plan.cubes else lines

    @jitable
    def shear_variance(shear, along, depth_sigma, unit, j):
        law = law_at(unit["shear_law"], j)
        half = push_of(shear.radius + along, law)
        half -= push_of(shear.radius - along, law)
        half *= type(along)(0.5) * shear.stiffening
        deeper = shear.law * unit["shear_gain"][j] * depth_sigma
        push = shear.law * shear.stiffening
        law2 = law_variance(push, unit["shear_variance"][j], unit["shear_floor"][j])
        return half * half + deeper * deeper + law2

    return shear_variance


@jitable
def component(part, along2, across2):
    """Sigma of a component whose share of the direction is `part`; both are equal at R = 0."""
    return np.sqrt(across2 + part * part * (along2 - across2))


@jitable
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


def shear_of(plan: Plan) -> Callable:
    """Direction, displacement and force of a unit from its R; what is wanted is shown."""
    with_correction, with_centre = plan.theta_correction, plan.film_centre
    with_force, with_tangential = "force" in plan.results, "tangential" in plan.results
    with_theta, with_displacement = "theta" in plan.results, "displacement" in plan.results
    push_row, tangential_row = plan.row("force"), plan.row("tangential")
    theta_row, row = plan.row("theta"), plan.row("displacement")
    push_of = force if plan.cubes else lines

    @jitable
    def shear(field, inverted, depth, unit, out, j):
        real = type(depth)
        zero, one = real(0.0), real(1.0)
        x, y, outer = field.x * inverted.each, field.y * inverted.each, inverted.radius
        if with_correction:
            x, y = correct(x, y, unit, j)
        radius, share = outer, one if field.strength > zero else zero
        if with_centre:
            dx = outer * x - unit["film_x"][j]
            dy = outer * y - unit["film_y"][j]
            radius, share = np.sqrt(dx * dx + dy * dy), one
            away = one / max(radius, real(FIELD_MIN))
            x = dx * away
            y = dy * away
        law = push_of(radius, law_at(unit["shear_law"], j))
        stiffening = unit["shear_gain"][j] * depth + unit["shear_gain_offset"][j]
        push = law * stiffening
        if with_force:
            write(out, push_row, j, push * x)
            write(out, push_row + 1, j, push * y)
        if with_tangential:
            write(out, tangential_row, j, push * share)
        if with_theta:
            write(out, theta_row, j, atan2(y, x))
        if with_displacement:
            write(out, row, j, radius * x)
            write(out, row + 1, j, radius * y)
        return Shear(x, y, radius, law, stiffening)

    return shear


def sigma_of(plan: Plan) -> Callable:
    """One-sigma of all that is tangential."""
    with_force, with_tangential = "force" in plan.results, "tangential" in plan.results
    with_theta, with_displacement = "theta" in plan.results, "displacement" in plan.results
    push_row, tangential_row = plan.row("force_sigma"), plan.row("tangential_sigma")
    theta_row, row = plan.row("theta_sigma"), plan.row("displacement_sigma")
    shear_variance = shear_variance_of(plan)

    @jitable
    def sigma(shear, inverted, depth_sigma, unit, out, j):
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
        if with_theta:
            most = real(1.8137993642342178)  # pi / sqrt(3)
            write(out, theta_row, j, min(np.sqrt(turned2), most))
        if with_displacement:
            write(out, row, j, component(shear.x, along2, across2))
            write(out, row + 1, j, component(shear.y, along2, across2))
        if with_force or with_tangential:
            push = shear.law * shear.stiffening
            along2 = shear_variance(shear, along, depth_sigma, unit, j)
            across2 = push * push * turned2
            if with_tangential:
                write(out, tangential_row, j, np.sqrt(along2))
            if with_force:
                write(out, push_row, j, component(shear.x, along2, across2))
                write(out, push_row + 1, j, component(shear.y, along2, across2))

    return sigma


def field_of(plan: Plan) -> Callable:
    """The field and its strength, which is shown if it is wanted."""
    with_field, with_film, with_chip = (
        "field" in plan.results, plan.film_compensation, plan.chip_compensation
    )  # fmt: skip
    row, law = plan.row("field"), field_law(plan)

    @jitable
    def field_at(unit, counts, background, j, above, out):
        real = unit["x_bx"].dtype.type
        chip_above = above["chip_above"][j] if with_chip else real(0.0)
        x, y, z, gain = law(unit, counts, background, j, chip_above)
        if with_field:
            each = real(1.0) / gain
            write(out, row, j, x * each)
            write(out, row + 1, j, y * each)
            write(out, row + 2, j, z * each)
        if with_film:
            warmer = unit["film_drift"][j] * above["film_above"][j]
            gain *= max(real(1.0) + warmer, real(GAIN_MIN))
        return Field(x, y, z, gain, np.sqrt(x * x + y * y))

    return field_at


def keep_of(plan: Plan) -> tuple[Callable, Callable]:
    """What writes a unit down between two stages, and what reads it."""
    with_sigma = plan.sigma

    @jitable
    def keep(tile, j, field, inverted, normal, gain):
        tile["strength"][j] = field.strength
        tile["z"][j] = field.z
        tile["radius"][j] = inverted.radius
        tile["gain"][j] = gain
        tile["depth"][j] = normal.depth
        if with_sigma:
            tile["x"][j] = field.x
            tile["y"][j] = field.y
            tile["along"][j] = inverted.along
            tile["each"][j] = inverted.each
            tile["variance"][j] = inverted.variance
            tile["push"][j] = normal.push
            tile["depth_sigma"][j] = normal.depth_sigma
            tile["push_sigma"][j] = normal.push_sigma

    @jitable
    def kept(tile, j):
        strength = tile["strength"][j]
        field = Field(tile["x"][j], tile["y"][j], tile["z"][j], strength, strength)
        inverted = Inverted(
            tile["radius"][j], tile["along"][j], tile["each"][j], tile["variance"][j]
        )
        normal = Normal(
            tile["depth"][j], tile["push"][j], tile["depth_sigma"][j], tile["push_sigma"][j]
        )
        return field, inverted, normal

    return keep, kept


def show_of(plan: Plan, loaded: bool) -> Callable:
    """Forces, displacements and their one-sigma of a unit that is `loaded`, or what shows without
    load."""
    with_force, with_displacement = "force" in plan.results, "displacement" in plan.results
    with_sigma = plan.sigma
    push_row, push_sigma_row = plan.row("force") + 2, plan.row("force_sigma") + 2
    depth_row, depth_sigma_row = plan.row("displacement") + 2, plan.row("displacement_sigma") + 2
    shear_from, sigma_from = shear_of(plan), sigma_of(plan)

    @jitable
    def show(field, inverted, normal, unit, out, j):
        if loaded:
            shear = shear_from(field, inverted, normal.depth, unit, out, j)
            if with_sigma:
                sigma_from(shear, inverted, normal.depth_sigma, unit, out, j)
        if with_force:
            write(out, push_row, j, normal.push)
            if with_sigma:
                write(out, push_sigma_row, j, normal.push_sigma)
        if with_displacement:
            write(out, depth_row, j, normal.depth)
            if with_sigma:
                write(out, depth_sigma_row, j, normal.depth_sigma)

    return show


def units_stage(plan: Plan, loaded: bool) -> Callable:
    """The stage that decodes units but for their temperatures: those that are `loaded`, or what
    shows without load."""
    with_shear, with_check = plan.shear, loaded and plan.consistency
    with_field = loaded and (plan.shear or "field" in plan.results)
    shows_later = with_check and plan.sigma
    normal_of, field_at, invert = normal_law(plan), field_of(plan), inversion(plan)
    (keep, kept), show, check = keep_of(plan), show_of(plan, loaded), anomaly_stage(plan)

    @jitable
    def invert_units(unit, counts, background, size, tile, flag, out):
        assume_noalias()
        for j in range(min(size, LANES)):
            flags = flag[j]
            if with_field:
                field = field_at(unit, counts, background, j, tile, out)
            if with_shear:
                normal = normal_of(unit, counts, background, j)
                if with_field:
                    variance = unit["field_variance"][j]
                    if background is not None:
                        variance += read(background, 4, j)
                    inverted, found, gain = invert(field, normal, variance, unit, j)
                    found |= EXTRAPOLATED if inverted.radius > unit["displacement_max"][j] else 0
                    flag[j] = flags if flags & SILENT else flags | found
                    if with_check:
                        keep(tile, j, field, inverted, normal, gain)
                    if not shows_later:
                        show(field, inverted, normal, unit, out, j)
                else:
                    show(None, None, normal, unit, out, j)
            if not loaded:
                flag[j] = flags if flags & SILENT else flags | IDLE

    @jitable
    def show_units(unit, size, tile, out):
        assume_noalias()
        for j in range(min(size, LANES)):
            field, inverted, normal = kept(tile, j)
            show(field, inverted, normal, unit, out, j)

    @jitable
    def units(unit, counts, background, size, tile, flag, state, out, advance):
        invert_units(unit, counts, background, size, tile, flag, out)
        if with_check:
            check(unit, size, tile, flag, state, out, advance)
            if shows_later:
                show_units(unit, size, tile, out)

    return units
