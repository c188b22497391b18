"""Common errors of units: the unknown ambient field.

The tangential displacement follows the field at the chip. The error of the ambient field is one
vector for all units of a body, so that its parts in their forces add up linearly, not as squares:
with F = Σ F_i and F_i = F_i0 + J_i e, cov(F) = Σ cov(F_i0) + (Σ J_i) C (Σ J_i)'. The same holds
for the field in which Bz at rest was learnt: it is one vector as well, with the prior variance, of
which a unit feels the component along its axis. The decoder includes the variance of both in the
sigma of each unit, as that of a lateral axis of its field (`Ambient.residue_ut2`); `add_common`
subtracts it. For J_i, the field B of a film turns by k R from the chip's axis as the film is
displaced by R; hence, along the lateral field and across it, with c = cos(k R) and s = sin(k R)
from B,

    dR = R / S sinc(k R) (c dS - s dBz),  R / S times the lateral field across

and sinc(k R) is (2 + c) / 3 to within 3 % up to a right angle [derived: both are 1 - (k R)² / 6 +
O((k R)⁴)]. By the strength alone, R = asin(S / M0) / k, dR = R / S sinc(k R) dS / c.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled import aligned
from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import padded, row_length
from skin.physics.force_law import TERMS, scaled, secant, shear_law, stacked
from skin.physics.force_law import at as law_at
from skin.physics.halbach import CHIP_AXES
from topology import Topology

__all__ = ["LAW", "Common", "add_common", "common_field", "no_common", "spread_common"]

CREST = 0.1
"""Smallest cosine at which the strength of a field determines the displacement [assumed]."""

LAW = np.dtype(
    [
        ("body", np.int64),  # whose ambient field it is
        ("axes", np.float64, (3, 3)),  # columns: axes of its field in the frame of `covariance_ut2`
        ("film", np.float64, (2,)),  # mm, middle of the film off the chip's axis
        ("shear", np.float64, (len(TERMS), 1)),  # law of the tangential force
        ("gain", np.float64),  # 1/mm, by depth
        ("gain_offset", np.float64),
        ("wavenumber", np.float64),  # rad/mm if R is found by the field's strength; or 0 for all
    ],
    align=True,
)
"""How the tangential force of a unit follows its field."""


FELT_ROWS = 29


class Felt(NamedTuple):
    """What the units of one contact feel of their fields, in rows as those of `Touched`."""

    field: np.ndarray  # (3, length), µT, zero where it or the displacement is unknown
    moved: np.ndarray  # (2, length), mm
    film: np.ndarray  # (2, length), see `LAW`, as the next but one
    shear: np.ndarray  # (len(TERMS), length)
    stiffening: np.ndarray  # factor of the tangential force by depth
    residue: np.ndarray  # µT², see `Common`
    axes: np.ndarray  # (9, length), row by row
    body: np.ndarray
    per_ut: np.ndarray  # (6, length): tangential force per µT, a row of three for each axis


class Common(NamedTuple):
    """Errors common to the units of g bodies; without bodies there are none."""

    law: np.ndarray  # (n,), LAW
    field_ut: np.ndarray  # (3, n), see `Reading`
    displacement_mm: np.ndarray  # (3, n), see `Reading`
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    residue_ut2: np.ndarray  # (n,): variance of a lateral axis by both, as in the sigma of a unit
    rest_ut2: np.ndarray  # (1,), float64: of an axis of the field that Bz at rest was learnt in
    felt: np.ndarray  # (FELT_ROWS, length), float64: see `Felt`; scratch
    gain: np.ndarray  # (rows, 2 g, 6, 3), float64: wrench of a row of the sums per µT of the field
    # of each body, then of that which its Bz at rest was learnt in; scratch


def felt_rows(n: int) -> np.ndarray:
    """Scratch for contacts of up to n units."""
    return aligned.zeros((FELT_ROWS, row_length(n)))


def no_common(dtype: np.dtype | type) -> Common:
    """No common errors."""
    return Common(
        np.zeros(0, LAW), np.zeros((3, 0), dtype), np.zeros((3, 0), dtype), np.zeros((0, 3, 3)),
        np.zeros(0, dtype), np.zeros(1), np.zeros((0, 0)), np.zeros((0, 0, 6, 3)),
    )  # fmt: skip


def common_field(
    topology: Topology, body: np.ndarray, covariance_ut2: np.ndarray, residue_ut2: np.ndarray,
    field_ut: np.ndarray, displacement_mm: np.ndarray, *, rest_ut2: float, by_strength: bool,
) -> Common:  # fmt: skip
    """Common errors of units in one ambient field.

    Parameters
    ----------
    topology : Topology
    body : ndarray, shape (n,), int
        Body of each unit.
    covariance_ut2 : ndarray, shape (g, 3, 3), float64
        Of the field of each body, in the skin frame, with the body where the topology has it; read
        in each cycle.
    residue_ut2 : ndarray, shape (n,)
        Variance of a lateral axis of the field by the unknown ambient field; read in each cycle.
    field_ut, displacement_mm : ndarray, shape (3, n)
        See `Reading`; read in each cycle.
    rest_ut2 : float
        Variance of an axis of the field in which Bz at rest was learnt, µT².
    by_strength : bool
        Whether displacements are decoded from the strength of the field alone.
    """
    p, law = topology.parameters, np.zeros(topology.n, LAW)
    law["body"] = body
    law["axes"] = np.moveaxis(topology.rotation * CHIP_AXES[:, np.newaxis], 2, 0)
    law["film"] = np.stack([p["film_x_mm"], p["film_y_mm"]], axis=1)
    law["shear"][..., 0] = stacked(shear_law(p)).T
    law["gain"] = p["shear_gain_per_mm"]
    law["gain_offset"] = 1.0 - p["shear_gain_per_mm"] * p["field_reference_mm"]
    law["wavenumber"] = p["field_wavenumber_rad_per_mm"] if by_strength else 0.0
    return Common(
        law, field_ut, displacement_mm, covariance_ut2, residue_ut2,
        np.array([0.0 if by_strength else rest_ut2]), felt_rows(topology.n),
        np.zeros((0, 0, 6, 3)),
    )  # fmt: skip


@jitable(inline=True)
def _rows(b):
    """The rows of a block, shape (FELT_ROWS, length), by name."""
    return Felt(b[0:3], b[3:5], b[5:7], b[7:11], b[11], b[12], b[13:22], b[22], b[23:29])


@jitable(inline=True)
def _gather(units, common):
    """Gather the units into the rows; returns their first and their last body.

    Where field or displacement is unknown, the field is zero: such units feel nothing.
    """
    felt, laws = _rows(common.felt), common.law
    moved, field = common.displacement_mm, common.field_ut
    first, last = laws.size, 0
    for j in range(units.size):
        i = units[j]
        law = laws[i]
        x, y, depth = np.float64(moved[0, i]), np.float64(moved[1, i]), np.float64(moved[2, i])
        known = math.isfinite(x + y + depth + field[0, i] + field[1, i])
        x, y, depth = (x, y, depth) if known else (0.0, 0.0, 0.0)
        felt.moved[0, j], felt.moved[1, j] = x, y
        felt.stiffening[j] = law["gain"] * depth + law["gain_offset"]
        for a in range(2):
            felt.film[a, j] = law["film"][a]
            felt.field[a, j] = field[a, i] if known else 0.0
        felt.field[2, j] = field[2, i]
        for term in range(len(TERMS)):
            felt.shear[term, j] = law["shear"][term, 0]
        for a in range(3):
            for b in range(3):
                felt.axes[3 * a + b, j] = law["axes"][a, b]
        felt.residue[j] = common.residue_ut2[i]
        body = law["body"]
        felt.body[j] = body
        first, last = min(first, body), max(last, body)
    return first, last


@jitable(inline=True)
def _by_angle(length, felt):
    """dR along the lateral field S per S / R of it and of Bz, where R is found by the angle."""
    assume_noalias()
    field, along, upright = felt.field, felt.per_ut[0], felt.per_ut[1]
    for j in range(length):
        bx, by, bz = field[0, j], field[1, j], field[2, j]
        square = bx * bx + by * by
        inverse = 1.0 / math.sqrt(square + bz * bz) if square > 0.0 else 0.0
        c = bz * inverse
        narrow = (2.0 + c) * (1.0 / 3.0)
        along[j] = narrow * c
        upright[j] = -narrow * math.sqrt(square) * inverse


@jitable
def _by_strength(units, felt, laws):
    """The same where R is found by the strength S."""
    for j in range(units.size):
        x, y = felt.moved[0, j] + felt.film[0, j], felt.moved[1, j] + felt.film[1, j]
        c = max(math.cos(laws[units[j]]["wavenumber"] * math.sqrt(x * x + y * y)), CREST)
        felt.per_ut[0, j], felt.per_ut[1, j] = (2.0 + c) / (3.0 * c), 0.0


@jitable(inline=True)
def _per_field(length, felt):
    """Tangential forces per µT of the field, two rows of three; zeros where it is unknown."""
    assume_noalias()
    field, moved, film, out = felt.field, felt.moved, felt.film, felt.per_ut
    for j in range(length):
        x, y, bx, by = moved[0, j], moved[1, j], field[0, j], field[1, j]
        square = bx * bx + by * by
        inverse = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
        outer_x, outer_y = x + film[0, j], y + film[1, j]
        per_ut = math.sqrt(outer_x * outer_x + outer_y * outer_y) * inverse
        wx, wy = bx * inverse, by * inverse
        along, upright = per_ut * out[0, j], per_ut * out[1, j]
        square = x * x + y * y
        across, steeper = secant(square, scaled(law_at(felt.shear, j), felt.stiffening[j]))
        steeper = steeper / square if steeper != 0.0 else 0.0
        fxx, fxy, fyy = steeper * x * x + across, steeper * x * y, steeper * y * y + across
        # the displacement by the field, then the force by the displacement
        xx, xy = along * wx * wx + per_ut * wy * wy, (along - per_ut) * wx * wy
        yy = along * wy * wy + per_ut * wx * wx
        out[0, j], out[1, j] = fxx * xx + fxy * xy, fxx * xy + fxy * yy
        out[2, j] = upright * (fxx * wx + fxy * wy)
        out[3, j], out[4, j] = fxy * xx + fyy * xy, fxy * xy + fyy * yy
        out[5, j] = upright * (fxy * wx + fyy * wy)


@jitable(inline=True)
def _subtract(length, felt, touched):
    """Subtract the common part from the variances of the units' tangential forces."""
    assume_noalias()
    per_ut, residue, variance = felt.per_ut, felt.residue, touched.variance
    for j in range(length):
        first = residue[j] * (per_ut[0, j] * per_ut[0, j] + per_ut[1, j] * per_ut[1, j])
        second = residue[j] * (per_ut[3, j] * per_ut[3, j] + per_ut[4, j] * per_ut[4, j])
        variance[0, j] = max(variance[0, j] - first, 0.0)
        variance[1, j] = max(variance[1, j] - second, 0.0)


@jitable(inline=True)
def _gain(length, b, body, felt, touched):
    """Wrench Σ (F, p × F) of the units of a body per µT of an axis of its field, then of the field
    in which their Bz at rest was learnt."""
    assume_noalias()
    p, ex, ey, per_ut = touched.position, touched.x, touched.y, felt.per_ut
    along = felt.axes[3 * b : 3 * b + 3]
    f0 = f1 = f2 = f3 = f4 = f5 = 0.0
    r0 = r1 = r2 = r3 = r4 = r5 = 0.0
    for j in range(length):
        px, py, pz = p[0, j], p[1, j], p[2, j]
        own = 1.0 if felt.body[j] == body else 0.0
        ax, ay, az = own * along[0, j], own * along[1, j], own * along[2, j]
        u, v = az * per_ut[2, j], az * per_ut[5, j]
        x = u * ex[0, j] + v * ey[0, j]
        y = u * ex[1, j] + v * ey[1, j]
        z = u * ex[2, j] + v * ey[2, j]
        r0, r1, r2 = r0 + x, r1 + y, r2 + z
        r3, r4, r5 = r3 + (py * z - pz * y), r4 + (pz * x - px * z), r5 + (px * y - py * x)
        u = ax * per_ut[0, j] + ay * per_ut[1, j]
        v = ax * per_ut[3, j] + ay * per_ut[4, j]
        x += u * ex[0, j] + v * ey[0, j]
        y += u * ex[1, j] + v * ey[1, j]
        z += u * ex[2, j] + v * ey[2, j]
        f0, f1, f2 = f0 + x, f1 + y, f2 + z
        f3, f4, f5 = f3 + (py * z - pz * y), f4 + (pz * x - px * z), f5 + (px * y - py * x)
    return (f0, f1, f2, f3, f4, f5), (r0, r1, r2, r3, r4, r5)


@jitable(inline=True)
def add_common(k, units, length, common, touched):
    """Add the units to the gain of row k, and leave the independent part of their variances.

    Parameters
    ----------
    k : int
    units : ndarray, int32
    length : int
        Padded.
    common : Common
    touched : Touched
        Of the units; `variance` is written.
    """
    felt, bodies = _rows(common.felt), common.covariance_ut2.shape[0]
    first, last = _gather(units, common)
    padded(units.size, common.felt)
    if common.law[0]["wavenumber"] > 0.0:
        _by_strength(units, felt, common.law)
    else:
        _by_angle(length, felt)
    _per_field(length, felt)
    _subtract(length, felt, touched)
    for g in range(first, last + 1):
        for b in range(3):
            field, rest = _gain(length, b, g, felt, touched)
            for a in range(6):
                common.gain[k, g, a, b] += field[a]
                common.gain[k, g + bodies, a, b] += rest[a]


@jitable
def _spread(k, data):
    """Add the common errors of the units of row k to the covariance of its wrench: Σ G C G'."""
    common, triangle = data.common, data.sums.rows[k]["wrench_covariance"]
    bodies, rest_ut2 = common.covariance_ut2.shape[0], common.rest_ut2[0]
    for g in range(bodies):
        gain, rest_gain, c = common.gain[k, g], common.gain[k, g + bodies], common.covariance_ut2[g]
        row = 0
        for a in range(6):
            p, q, r = gain[a, 0], gain[a, 1], gain[a, 2]
            x = p * c[0, 0] + q * c[1, 0] + r * c[2, 0]
            y = p * c[0, 1] + q * c[1, 1] + r * c[2, 1]
            z = p * c[0, 2] + q * c[1, 2] + r * c[2, 2]
            p, q, r = (
                rest_ut2 * rest_gain[a, 0],
                rest_ut2 * rest_gain[a, 1],
                rest_ut2 * rest_gain[a, 2],
            )
            for b in range(a, 6):
                field = x * gain[b, 0] + y * gain[b, 1] + z * gain[b, 2]
                rest = p * rest_gain[b, 0] + q * rest_gain[b, 1] + r * rest_gain[b, 2]
                triangle[row] += field + rest
                row += 1


@jitable
def spread_common(count, data):
    """Add common errors to the covariances of the first `count` rows, and to that of the total, the
    row after the next, with errors common to contacts."""
    gain = data.common.gain
    for g in range(gain.shape[1]):
        for k in range(count + 1):
            for a in range(6):
                for b in range(3):
                    gain[count + 1, g, a, b] += gain[k, g, a, b]
    for k in range(count):
        _spread(k, data)
    _spread(count + 1, data)
