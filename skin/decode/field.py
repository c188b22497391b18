"""The field at the Hall chip, and the tangential displacement R that follows.

The lateral field points the way of the tangential displacement: +x force, +x displacement, +Bx.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.functions import OCTAVES_MAX, asin, atan, exp2, sinc
from skin.decode.plan import Plan
from skin.decode.records import BX, BY, BZ, INVALID, LANES, MAGNETIC_ANOMALY, SATURATED, SILENT
from skin.decode.rows import read, write
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force

__all__ = ["FIELD_MIN", "GAIN_MIN", "Field", "Inverted", "anomaly_stage", "field_law", "inversion"]

GAIN_MIN = 0.1
"""Bound of the gain; only a temperature of a unit that is OUT_OF_RANGE reaches it."""
FIELD_MIN = 1e-6
"""µT: a lateral field below it has no direction, and is divided by this."""
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
    """R, mm, with its one-sigma; 1 / S and the variance of the field, 1/µT and µT²."""

    radius: float
    along: float
    each: float
    variance: float


def field_law(plan: Plan) -> Callable:
    """The field without the chip's offset, its drift and the background, mapped."""
    with_chip = plan.chip_compensation
    with_z = plan.angle or plan.consistency or "field" in plan.results

    @jitable
    def field(unit, counts, background, j, chip_above):
        """Lateral field and Bz of a unit, and the chip's gain, which is left in them."""
        real = type(chip_above)
        bx, by = real(read(counts, BX, j)), real(read(counts, BY, j))
        x = unit["x_bx"][j] * bx + unit["x_by"][j] * by + unit["x_offset"][j]
        y = unit["y_bx"][j] * bx + unit["y_by"][j] * by + unit["y_offset"][j]
        z = real(0.0)
        gain = real(1.0)
        if with_z:
            z = unit["z_bz"][j] * real(read(counts, BZ, j)) + unit["z_offset"][j]
        if with_chip:
            x += unit["x_drift"][j] * chip_above
            y += unit["y_drift"][j] * chip_above
            z += unit["z_drift"][j] * chip_above
            gain = max(gain + unit["chip_gain"][j] * chip_above, real(GAIN_MIN))
        if background is not None:
            bx = gain * read(background, 1, j)
            by = gain * read(background, 2, j)
            x -= unit["map_xx"][j] * bx + unit["map_xy"][j] * by
            y -= unit["map_yx"][j] * bx + unit["map_yy"][j] * by
            z -= gain * read(background, 3, j)
        return x, y, z, gain

    return field


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
    read = solid * inverse
    off, whole, weak = read - model, model * model * square, read * read
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


def strength_law(plan: Plan) -> Callable:
    """R by the strength of the lateral field, R = asin(S / M0) / k [paper, eq. 1]."""
    with_sigma = plan.sigma

    @jitable
    def by_strength(solid, variance, depth, depth_sigma, gain, weakest, unit, j):
        """R, its sigma, its flags, 1 / S, 1 / M0 and the variance of the field.

        The sigma is half of the interval of the arcsine, which has no slope at the crest.
        """
        real = type(solid)
        one = real(1.0)
        scale = unit["wavenumber_inverse"][j]
        each = one / (solid * gain)  # one division for both quotients
        inverse = solid * each * weakest
        ratio = min(solid * inverse, one)
        radius = scale * asin(ratio)
        noise2 = variance * (inverse * inverse)
        square = ratio * ratio
        near2 = noise2 + square * amplitude_variance(depth, unit["depth_sigma"][j], unit, j)
        below = one - ratio
        found = SATURATED if near2 >= below * below else 0
        sigma = real(0.0)
        if with_sigma:
            variance += film_variance(solid, radius, depth, unit, j)
            noise2 = variance * (inverse * inverse)
            s = np.sqrt(noise2 + square * amplitude_variance(depth, depth_sigma, unit, j))
            low = ratio - s
            lower = asin(min(abs(low), one))
            lower = lower if low > real(0.0) else -lower
            sigma = real(0.5) * scale * (asin(min(ratio + s, one)) - lower)
        return radius, sigma, found, each * gain, inverse, variance

    return by_strength


@jitable
def _cubic(factor, i, h, j):
    """Factor of psi^(2 i + 1) in R(psi, H), a cubic in H, and its derivative by H."""
    real = type(h)
    c1, c2, c3 = factor[4 * i + 1, j], factor[4 * i + 2, j], factor[4 * i + 3, j]
    slope = (real(3.0) * c3 * h + real(2.0) * c2) * h + c1
    return ((c3 * h + c2) * h + c1) * h + factor[4 * i, j], slope


def angle_law(plan: Plan) -> Callable:
    """R by the angle psi of the field: a polynomial of psi and H, fitted to the film's field."""
    with_sigma = plan.sigma

    @jitable
    def by_angle(solid, z, variance, depth, depth_sigma, unit, j):
        """R(psi, H), psi = atan2(S, Bz), its sigma, its flags, 1 / S and the variance of the
        field."""
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
        sigma = real(0.0)
        if with_sigma:
            slope = ((real(7.0) * q3 * p2 + real(5.0) * q2) * p2 + real(3.0) * q1) * p2 + q0
            deeper = p * (((d3 * p2 + d2) * p2 + d1) * p2 + d0) * depth_sigma
            further = slope * (psi - p)
            variance += film_variance(solid, radius, depth, unit, j)
            inverse2 = real(1.0) / (solid * solid + z * z + variance)
            # what is not known of Bz turns a field that lies flat
            axial = unit["axial_variance"][j] * (solid * solid * inverse2)
            turned2 = (variance + axial) * inverse2
            sigma = np.sqrt(slope * slope * turned2 + deeper * deeper + further * further)
        return radius, sigma, found, big * quotient, variance

    return by_angle


def inversion(plan: Plan) -> Callable:
    """R by angle or by strength."""
    with_angle = plan.angle
    by_angle, by_strength = angle_law(plan), strength_law(plan)

    @jitable
    def invert(field, normal, variance, unit, j):
        """An `Inverted`, flags, and the gain of chip and film; with `sine` 1 / M0 over it."""
        depth, gain = normal.depth, field.gain
        solid = max(field.strength, type(depth)(FIELD_MIN))
        if with_angle:
            radius, along, found, each, variance = by_angle(
                solid, field.z, variance, depth, normal.depth_sigma, unit, j
            )
        else:
            weakest = exp2(-octaves(depth, unit, j))
            radius, along, found, each, gain, variance = by_strength(
                solid, variance, depth, normal.depth_sigma, gain, weakest, unit, j
            )
        return Inverted(radius, along, each, variance), found, gain

    return invert


@jitable
def doubt(beyond2, tile, unit, j):
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


def anomaly_stage(plan: Plan) -> Callable:
    """The stage that holds fields against the film's: test ratios, doubt, and flags.

    One reading that is beyond is doubted, the second in a row is a MAGNETIC_ANOMALY, as is a mean
    that is beyond.
    """
    with_angle, with_ratio, by_angle = plan.angle, "test_ratio" in plan.results, angle_law(plan)
    with_sigma, row = plan.sigma, plan.row("test_ratio")

    @jitable
    def check(unit, size, tile, flag, state, out, advance):
        assume_noalias()
        size = min(size, LANES)
        real = unit["x_bx"].dtype.type
        nothing, one, two, three = real(0.0), real(1.0), real(2.0), real(3.0)
        doubted = np.int16(0)
        for j in range(size):
            z, radius, gain = tile["z"][j], tile["radius"][j], tile["gain"][j]
            solid, missed = max(tile["strength"][j], real(FIELD_MIN)), state["missed"][j]
            if with_angle:
                amplitude = gain * exp2(octaves(tile["depth"][j], unit, j))
                miss2, single2, whole, above = anomaly(
                    solid, z, radius, amplitude, one, missed, unit, j
                )
            else:
                depth = tile["depth"][j]
                other, _, _, _, _ = by_angle(solid, z, one, depth, one, unit, j)  # R alone
                miss2, single2, whole, above = anomaly(solid, z, other, one, gain, missed, unit, j)
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
            if with_sigma:
                tile["beyond"][j] = max((miss2 - single2) / whole, nothing)
                doubted = np.int16(doubted | (MAGNETIC_ANOMALY if now else 0))
            if with_ratio:
                ratio = np.sqrt(max(miss2 / single2, mean * mean))
                write(out, row, j, real(np.nan) if flags & SILENT else ratio)
        if with_sigma and doubted != 0:
            for j in range(size):
                doubt(tile["beyond"][j], tile, unit, j)

    return check
