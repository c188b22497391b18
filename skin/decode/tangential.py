"""Field, depth, displacement and force of units, and what is not known of them.

Depth and normal force come from the frequency of the oscillator under the gel capacitor, the
tangential displacement R from the field at the Hall chip, the tangential force from the
displacement. The lateral field points the way of the tangential displacement: +x force, +x
displacement, +Bx.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.functions import OCTAVES_MAX, asin, atan, atan2, exp2, read, sin_cos, sinc
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, slope

from skin.decode.records import (  # isort: skip
    BX, BY, BZ, DISPLACEMENT, EXTRAPOLATED, FIELD, FILM_ABOVE, FORCE, FORCE_PER_UT, FREQUENCY, IDLE,
    INVALID, KNOTS, LANES, MAGNETIC_ANOMALY, RESULTS, SATURATED, SIGMA, SILENT, TANGENTIAL,
    TEMPERATURE, TEST_RATIO, THETA,
)  # fmt: skip

__all__ = [
    "EXTRAPOLATION", "GAIN_MIN", "check_fields", "decode_unloaded", "hide", "invert_units",
    "show_units",
]  # fmt: skip

EXTRAPOLATION = 0.2
"""What lies beyond the calibrated range adds this share of it to its one-sigma [assumed]: straight,
for a law that goes on otherwise than it is taken to is wrong the same way in every reading."""
THETA_MOST_RAD = 1.8137993642342178
"""Sigma of a direction that is not known: even over the circle, pi / sqrt(3)."""
GAIN_MIN = 0.1
"""Bound of the gain; only a temperature of a unit that is OUT_OF_RANGE reaches it."""
FIELD_MIN = 1e-6
"""µT: a lateral field below it has no direction, and is divided by this."""
CREST = 0.1
"""Smallest cosine at which the strength of a field determines the displacement [assumed]."""
DEPTH_MIN, DEPTH_MAX = -0.5, 4.0
"""mm: bounds of H in R(psi, H), whose cubics in H mean nothing far beyond their fit."""


class Field(NamedTuple):
    """The field that a chip reads, µT, with its gain in it.

    Attributes
    ----------
    x, y, z : float
    gain : float
        Of chip and film.
    strength : float
        Of the lateral field.
    """

    x: float
    y: float
    z: float
    gain: float
    strength: float


class Inverted(NamedTuple):
    """R, mm, with its one-sigma; 1 / S and the variance of the field, 1/µT and µT²; and how R
    follows the field, mm: by its angle, dR / dpsi, with `sine` by its strength, S dR / dS."""

    radius: float
    along: float
    each: float
    variance: float
    turn: float


@jitable
def field_at(wants, unit, counts, background, j, tile):
    """A `Field` without the chip's offset, its drift and the background, mapped; without the gain
    it is shown, if it is wanted."""
    real = unit["x_bx"].dtype.type
    one, chip_above = real(1.0), tile["chip_above"][j]
    bx, by = real(read(counts, BX, j)), real(read(counts, BY, j))
    x = unit["x_bx"][j] * bx + unit["x_by"][j] * by + unit["x_offset"][j]
    y = unit["y_bx"][j] * bx + unit["y_by"][j] * by + unit["y_offset"][j]
    z = unit["z_bz"][j] * real(read(counts, BZ, j)) + unit["z_offset"][j]
    x += unit["x_drift"][j] * chip_above
    y += unit["y_drift"][j] * chip_above
    z += unit["z_drift"][j] * chip_above
    gain = max(one + unit["chip_gain"][j] * chip_above, real(GAIN_MIN))
    if background is not None:
        bx = gain * read(background, 1, j)
        by = gain * read(background, 2, j)
        x -= unit["map_xx"][j] * bx + unit["map_xy"][j] * by
        y -= unit["map_yx"][j] * bx + unit["map_yy"][j] * by
        z -= gain * read(background, 3, j)
    if wants.field is not None:
        out = tile["result"]
        each = one / gain
        out[FIELD, j] = x * each
        out[FIELD + 1, j] = y * each
        out[FIELD + 2, j] = z * each
    gain *= max(one + unit["film_drift"][j] * tile["film_above"][j], real(GAIN_MIN))
    return Field(x, y, z, gain, np.sqrt(x * x + y * y))


@jitable
def octaves(depth, unit, j):
    """log2(M0 / µT) at a depth, without the gains of film and chip."""
    real = type(depth)
    growth = unit["amplitude_octaves"]
    x = growth[2, j] * depth + growth[1, j]
    x = x * depth + growth[0, j]
    return min(max(x, real(-OCTAVES_MAX)), real(OCTAVES_MAX))


@jitable
def amplitude_variance(depth, sigma, unit, j):
    """Relative variance of M0 at a depth that has a sigma."""
    real = type(depth)
    growth = unit["amplitude_octaves"]
    slope = real(2.0) * growth[2, j] * depth + growth[1, j]
    change = real(0.6931471805599453) * slope * sigma
    return unit["amplitude_variance"][j] + change * change


@jitable
def anomaly(solid, z, radius, amplitude, inverse, missed, unit, j):
    """S against M0 sin(k R), R from the angle: the miss and what a reading may miss, both squared
    and relative, but times `whole`, the model and the field squared, so that one division does;
    `whole`; and by how much the miss over its allowance is above the mean, `missed`.

    At R = 0 this is Bz against the M0 that makes this R of this angle, so it is a check of the
    strength everywhere. Either M0 or its inverse is 1. Why each miss is divided by its own
    allowance before it is averaged: `docs/explanation/derivations.md`, "What a field may miss".
    """
    real = type(solid)
    u = unit["wavenumber"][j] * radius
    model, square = amplitude * (u * sinc(u)), solid * solid + z * z
    measured = solid * inverse
    off, whole, weak = measured - model, model * model * square, measured * measured
    miss2 = off * off * square
    single2 = unit["anomaly_share"][j] * whole + unit["anomaly_field"][j] * weak
    mean2 = unit["miss_share"][j] * whole + unit["miss_field"][j] * weak
    above = off * np.sqrt(square / mean2) - missed
    return miss2, single2, whole, above if miss2 <= single2 else real(0.0)


@jitable
def film_variance(solid, radius, depth, unit, j):
    """Variance of an axis of the field, for a film that is not as its model is."""
    real = type(radius)
    c, h2, r3 = unit["film_variance"], depth * depth, radius * radius * radius
    across = (c[5, j] * h2 + c[4, j]) * r3 + (c[3, j] * h2 + c[2, j])
    across = max(across * r3 + (c[1, j] * h2 + c[0, j]), real(0.0))
    per_mm = solid / max(radius, real(1e-30))
    return across * (per_mm * per_mm)


@jitable
def by_strength(wants, solid, variance, depth, depth_sigma, gain, unit, j):
    """R by the strength of the lateral field, R = asin(S / M0) / k [paper, eq. 1]: an `Inverted`,
    its flags, and 1 / M0 over the gain.

    The sigma is half of the interval of the arcsine, which has no slope at the crest.
    """
    real = type(solid)
    one = real(1.0)
    scale = unit["wavenumber_inverse"][j]
    each = one / (solid * gain)  # one division for both quotients
    inverse = solid * each * exp2(-octaves(depth, unit, j))
    ratio = min(solid * inverse, one)
    radius = scale * asin(ratio)
    noise2 = variance * (inverse * inverse)
    square = ratio * ratio
    near2 = noise2 + square * amplitude_variance(depth, unit["depth_sigma"][j], unit, j)
    below = one - ratio
    found = SATURATED if near2 >= below * below else 0
    sigma = turn = real(0.0)
    if wants.sigma is not None:
        steep = np.sqrt(max(one - square, real(CREST * CREST)))
        turn = scale * ratio / steep
        variance += film_variance(solid, radius, depth, unit, j)
        noise2 = variance * (inverse * inverse)
        s = np.sqrt(noise2 + square * amplitude_variance(depth, depth_sigma, unit, j))
        low = ratio - s
        lower = asin(min(abs(low), one))
        lower = lower if low > real(0.0) else -lower
        sigma = real(0.5) * scale * (asin(min(ratio + s, one)) - lower)
    return Inverted(radius, sigma, each * gain, variance, turn), found, inverse


@jitable
def _cubic(factor, i, h, j):
    """Factor of psi^(2 i + 1) in R(psi, H), a cubic in H, and its derivative by H."""
    real = type(h)
    c1, c2, c3 = factor[4 * i + 1, j], factor[4 * i + 2, j], factor[4 * i + 3, j]
    slope = (real(3.0) * c3 * h + real(2.0) * c2) * h + c1
    return ((c3 * h + c2) * h + c1) * h + factor[4 * i, j], slope


@jitable
def by_angle(wants, solid, z, variance, depth, depth_sigma, unit, j):
    """R by the angle psi = atan2(S, Bz) of the field: a polynomial of psi and H, fitted to the
    film's field. An `Inverted`, and its flags."""
    real = type(solid)
    upright = abs(z)
    big = max(solid, upright)
    quotient = real(1.0) / (solid * big)  # one division for both quotients
    psi = atan(min(solid, upright) * (solid * quotient))
    psi = real(1.5707963267948966) - psi if solid > upright else psi
    psi = real(3.141592653589793) - psi if z < real(0.0) else psi
    end = unit["angle_end"][j]
    found = SATURATED if psi > end else 0
    p = min(psi, end)
    p2 = p * p
    h = min(max(depth, real(DEPTH_MIN)), real(DEPTH_MAX))
    factor = unit["angle"]
    q0, d0 = _cubic(factor, 0, h, j)
    q1, d1 = _cubic(factor, 1, h, j)
    q2, d2 = _cubic(factor, 2, h, j)
    q3, d3 = _cubic(factor, 3, h, j)
    radius = p * (((q3 * p2 + q2) * p2 + q1) * p2 + q0)
    sigma = slope = real(0.0)
    if wants.sigma is not None:
        slope = ((real(7.0) * q3 * p2 + real(5.0) * q2) * p2 + real(3.0) * q1) * p2 + q0
        deeper = p * (((d3 * p2 + d2) * p2 + d1) * p2 + d0) * depth_sigma
        further = slope * (psi - p)
        variance += film_variance(solid, radius, depth, unit, j)
        inverse2 = real(1.0) / (solid * solid + z * z + variance)
        # what is not known of Bz turns a field that lies flat
        axial = unit["axial_variance"][j] * (solid * solid * inverse2)
        turned2 = (variance + axial) * inverse2
        sigma = np.sqrt(slope * slope * turned2 + deeper * deeper + further * further)
    return Inverted(radius, sigma, big * quotient, variance, slope), found


@jitable
def invert(wants, field, normal, variance, unit, j):
    """An `Inverted`, flags, and the gain of chip and film; with `sine` 1 / M0 over it."""
    solid = max(field.strength, type(variance)(FIELD_MIN))
    if wants.angle is not None:
        found, flags = by_angle(
            wants, solid, field.z, variance, normal.depth, normal.depth_sigma, unit, j
        )
        return found, flags, field.gain
    return by_strength(
        wants, solid, variance, normal.depth, normal.depth_sigma, field.gain, unit, j
    )


@jitable
def inflate_sigma(beyond2, tile, unit, j):
    """Widen the sigmas of a unit whose relative miss is `beyond2` more, squared, than allowed.

    Field and depth disagree, and either may be what is wrong [derived]: the field by this share
    of its size, on an axis that is not known, which makes an error of R of that times R / S (R
    grows with the angle no faster than R / sin psi); or the depth, by this share over the
    growth of M0 per mm.
    """
    real = type(beyond2)
    solid = max(tile["strength"][j], real(FIELD_MIN))
    z = tile["z"][j]
    field2 = beyond2 * (solid * solid + z * z)
    aside, limit = tile["radius"][j] / solid, unit["displacement_max"][j]
    along = tile["along"][j]
    tile["along"][j] = np.sqrt(along * along + min(field2 * (aside * aside), limit * limit))
    tile["variance"][j] += field2
    depth, sigma = tile["depth"][j], tile["depth_sigma"][j]
    growth = unit["amplitude_octaves"]
    slope = real(0.6931471805599453) * (real(2.0) * growth[2, j] * depth + growth[1, j])
    deeper2 = beyond2 / max(slope * slope, real(1e-6))
    tile["depth_sigma"][j] = np.sqrt(sigma * sigma + deeper2)
    deeper, law = np.sqrt(deeper2), law_at(unit["normal_law"], j)
    half = (force(depth + deeper, law) - force(depth - deeper, law)) * real(0.5)
    known = tile["push_sigma"][j]
    tile["push_sigma"][j] = np.sqrt(known * known + half * half)


@jitable
def check_fields(wants, unit, size, tile, flag, state, advance):
    """Hold fields against the film's: test ratios, wider sigmas, and flags.

    One reading that is beyond is doubted, the second in a row is a MAGNETIC_ANOMALY, as is a mean
    that is beyond.
    """
    assume_noalias()
    size, out = min(size, LANES), tile["result"]
    real = unit["x_bx"].dtype.type
    nothing, one, two, three = real(0.0), real(1.0), real(2.0), real(3.0)
    doubted = np.int16(0)
    for j in range(size):
        z, radius, gain = tile["z"][j], tile["radius"][j], tile["gain"][j]
        solid, missed = max(tile["strength"][j], real(FIELD_MIN)), state["missed"][j]
        if wants.angle is not None:
            amplitude = gain * exp2(octaves(tile["depth"][j], unit, j))
            miss2, single2, whole, above = anomaly(
                solid, z, radius, amplitude, one, missed, unit, j
            )
        else:
            depth = tile["depth"][j]
            other, _ = by_angle(wants, solid, z, one, depth, one, unit, j)
            miss2, single2, whole, above = anomaly(
                solid, z, other.radius, one, gain, missed, unit, j
            )
        flags, odd, step = flag[j], state["odd"][j], unit["miss_step"][j]
        counts, mean = flags & INVALID == 0, missed + step * above
        last = (odd == one) | (odd == three)
        before = last if advance else odd >= two
        now = not miss2 <= single2
        lies = (now & before) | (not mean * mean <= one)
        # sums, for a store in some lanes alone costs more than all else here
        state["missed"][j] = missed + (step if advance & counts else nothing) * above
        seen = (one if now else nothing) + (two if before else nothing)
        state["odd"][j] = odd + (seen - odd if counts else nothing)
        found = MAGNETIC_ANOMALY if lies else 0
        flag[j] = flags if flags & SILENT else flags | found
        if wants.sigma is not None:
            tile["beyond"][j] = max((miss2 - single2) / whole, nothing)
            doubted = np.int16(doubted | (MAGNETIC_ANOMALY if now else 0))
        ratio = np.sqrt(max(miss2 / single2, mean * mean))
        out[TEST_RATIO, j] = real(np.nan) if flags & SILENT else ratio
    if wants.sigma is not None and doubted != 0:
        for j in range(size):
            inflate_sigma(tile["beyond"][j], tile, unit, j)


# -- displacement and force ----------------------------------------------------------------------


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
    outer_x, outer_y : float
        Direction off the chip's axis, where R is measured from.
    radius : float
        Displacement of the film's middle, mm.
    law, stiffening : float
        Force at the reference depth, N, and its factor at this depth.
    """

    x: float
    y: float
    outer_x: float
    outer_y: float
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
    outer_x, outer_y = x, y
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
    return Shear(x, y, outer_x, outer_y, radius, law, stiffening)


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
def show_force_per_ut(wants, shear, inverted, unit, out, j):
    """Tangential force per µT of each axis of the field: two rows of three.

    R follows the field along its lateral part and Bz, across it stays R / S; the force follows the
    displacement by its slope along it and F / R across. 0 where the field has no direction.
    """
    real = type(shear.radius)
    bx, by, bz = out[FIELD, j], out[FIELD + 1, j], out[FIELD + 2, j]
    lateral2 = bx * bx + by * by
    each = real(1.0) / max(np.sqrt(lateral2), real(FIELD_MIN))
    each = each if lateral2 > real(0.0) else real(0.0)
    wx, wy = bx * each, by * each
    along, upright = inverted.turn * each, real(0.0)
    if wants.angle is not None:
        whole2 = max(lateral2 + bz * bz, real(FIELD_MIN * FIELD_MIN))
        along, upright = inverted.turn * bz / whole2, -inverted.turn * lateral2 * each / whole2
    aside = inverted.radius * each
    # the force along and across the displacement of the film's middle, by each part of R
    steep = shear.stiffening * slope(shear.radius, law_at(unit["shear_law"], j))
    secant = shear.stiffening * shear.law / max(shear.radius, real(1e-12))
    ux, uy, vx, vy = shear.outer_x, shear.outer_y, shear.x, shear.y
    cosine, sine = ux * vx + uy * vy, ux * vy - uy * vx
    ax, ay = steep * cosine * vx + secant * sine * vy, steep * cosine * vy - secant * sine * vx
    tx, ty = steep * sine * vx - secant * cosine * vy, steep * sine * vy + secant * cosine * vx
    out[FORCE_PER_UT, j] = ax * along * wx - tx * aside * wy
    out[FORCE_PER_UT + 1, j] = ax * along * wy + tx * aside * wx
    out[FORCE_PER_UT + 2, j] = ax * upright
    out[FORCE_PER_UT + 3, j] = ay * along * wx - ty * aside * wy
    out[FORCE_PER_UT + 4, j] = ay * along * wy + ty * aside * wx
    out[FORCE_PER_UT + 5, j] = ay * upright


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
        if wants.field is not None:
            show_force_per_ut(wants, shear, inverted, unit, out, j)
    show_normal(wants, normal, out, j)


@jitable
def keep(wants, tile, j, field, inverted, normal, gain):
    """Write down what the check of a unit's field reads, and what is shown after it."""
    tile["z"][j], tile["strength"][j], tile["gain"][j] = field.z, field.strength, gain
    tile["radius"][j], tile["depth"][j] = inverted.radius, normal.depth
    if wants.sigma is not None:
        tile["x"][j], tile["y"][j] = field.x, field.y
        tile["along"][j], tile["each"][j] = inverted.along, inverted.each
        tile["variance"][j], tile["turn"][j] = inverted.variance, inverted.turn
        tile["push"][j], tile["push_sigma"][j] = normal.push, normal.push_sigma
        tile["depth_sigma"][j] = normal.depth_sigma


@jitable
def invert_units(wants, unit, counts, background, size, tile, flag):
    """Fields, depths and R of the units of a block; shown here unless a check may widen sigmas."""
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
                keep(wants, tile, j, field, inverted, normal, gain)
            if wants.check is None or wants.sigma is None:
                show(wants, field, inverted, normal, unit, tile["result"], j)


@jitable
def show_units(wants, unit, size, tile):
    """Show the units of a block whose sigmas the check of their fields may have widened."""
    assume_noalias()
    for j in range(min(size, LANES)):
        strength = tile["strength"][j]
        field = Field(tile["x"][j], tile["y"][j], tile["z"][j], strength, strength)
        inverted = Inverted(
            tile["radius"][j],
            tile["along"][j],
            tile["each"][j],
            tile["variance"][j],
            tile["turn"][j],
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
    for row in range(FORCE, FILM_ABOVE):
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
