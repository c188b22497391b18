"""Common errors of units: the unknown ambient field.

The tangential displacement follows the field at the chip. The error of the ambient field is one
vector for all units of a body, so that its parts in their forces add up linearly, not as squares:
with F = Σ F_i and F_i = F_i0 + J_i e, cov(F) = Σ cov(F_i0) + (Σ J_i) C (Σ J_i)'. The same holds
for the field in which Bz at rest was learnt: it is one vector as well, with the prior variance, of
which a unit feels the component along its axis. The decoder includes the variance of both in the
sigma of each unit, as that of a lateral axis of its field (`Ambient.residue_ut2`); `add_wrenches`
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

from bus.compiled.jit import jitable
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
        ("wavenumber", np.float64),  # rad/mm where R is found by the field's strength, else 0
    ],
    align=True,
)
"""How the tangential force of a unit follows its field."""


class Common(NamedTuple):
    """Errors common to the units of g bodies; without bodies there are none."""

    law: np.ndarray  # (n,), LAW
    field_ut: np.ndarray  # (3, n), see `Reading`
    displacement_mm: np.ndarray  # (3, n), see `Reading`
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    residue_ut2: np.ndarray  # (n,): variance of a lateral axis by both, as in the sigma of a unit
    rest_ut2: np.ndarray  # (1,), float64: of an axis of the field that Bz at rest was learnt in
    shared_n2: np.ndarray  # (2, n), float64: variance of the tangential forces of units in contact
    # by both; scratch
    gain: np.ndarray  # (rows, 2 g, 6, 3), float64: wrench of a row of the sums per µT of the field
    # of each body, then of that which its Bz at rest was learnt in; scratch


def no_common(dtype: np.dtype | type) -> Common:
    """No common errors."""
    return Common(
        np.zeros(0, LAW), np.zeros((3, 0), dtype), np.zeros((3, 0), dtype), np.zeros((0, 3, 3)),
        np.zeros(0, dtype), np.zeros(1), np.zeros((2, 0)), np.zeros((0, 0, 6, 3)),
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
        np.array([0.0 if by_strength else rest_ut2]), np.zeros((2, topology.n)),
        np.zeros((0, 0, 6, 3)),
    )  # fmt: skip


@jitable
def _per_field(i, common):
    """Tangential force of a unit per µT of its field, two rows of three; zeros if unknown."""
    law = common.law[i]
    x, y = np.float64(common.displacement_mm[0, i]), np.float64(common.displacement_mm[1, i])
    depth = np.float64(common.displacement_mm[2, i])
    bx, by = np.float64(common.field_ut[0, i]), np.float64(common.field_ut[1, i])
    bz = np.float64(common.field_ut[2, i])
    strength = math.sqrt(bx * bx + by * by)
    if not (strength > 0.0 and math.isfinite(x + y + depth)):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    outer_x, outer_y = x + law["film"][0], y + law["film"][1]
    outer = math.sqrt(outer_x * outer_x + outer_y * outer_y)
    inverse = 1.0 / strength
    per_ut, wx, wy = outer * inverse, bx * inverse, by * inverse
    if law["wavenumber"] > 0.0:
        c = max(math.cos(law["wavenumber"] * outer), CREST)
        along, upright = per_ut * (2.0 + c) / (3.0 * c), 0.0
    else:
        inverse = 1.0 / math.sqrt(strength * strength + bz * bz)
        c = bz * inverse
        narrow = per_ut * (2.0 + c) * (1.0 / 3.0)
        along, upright = narrow * c, -narrow * strength * inverse
    stiffening = law["gain"] * depth + law["gain_offset"]
    square = x * x + y * y
    across, steeper = secant(square, scaled(law_at(law["shear"], 0), stiffening))
    fxx = fxy = fyy = 0.0
    if steeper != 0.0:
        steeper /= square
        fxx, fxy, fyy = steeper * x * x, steeper * x * y, steeper * y * y
    fxx += across
    fyy += across
    # the displacement by the field, then the force by the displacement
    xx, xy = along * wx * wx + per_ut * wy * wy, (along - per_ut) * wx * wy
    yy = along * wy * wy + per_ut * wx * wx
    return (
        fxx * xx + fxy * xy, fxx * xy + fxy * yy, upright * (fxx * wx + fxy * wy),
        fxy * xx + fyy * xy, fxy * xy + fyy * yy, upright * (fxy * wx + fyy * wy),
    )  # fmt: skip


@jitable(inline=True)
def _add_wrench(gain, b, p, x, y, z):
    """Add the wrench of a force (x, y, z) at p to column b."""
    gain[0, b] += x
    gain[1, b] += y
    gain[2, b] += z
    gain[3, b] += p[1] * z - p[2] * y
    gain[4, b] += p[2] * x - p[0] * z
    gain[5, b] += p[0] * y - p[1] * x


@jitable
def add_common(k, units, common, poses):
    """Add the units to the gain of row k, and store their common part of their own variances."""
    bodies = common.covariance_ut2.shape[0]
    for at in range(units.size):
        i = units[at]
        j00, j01, j02, j10, j11, j12 = _per_field(i, common)
        axes, g = common.law[i]["axes"], common.law[i]["body"]
        gain, rest_gain = common.gain[k, g], common.gain[k, g + bodies]
        p, r = poses[i]["position"], poses[i]["rotation"]
        ax, ay, az, bx, by, bz = r[0, 0], r[1, 0], r[2, 0], r[0, 1], r[1, 1], r[2, 1]
        ux, uy, uz = ax * j02 + bx * j12, ay * j02 + by * j12, az * j02 + bz * j12
        for b in range(3):
            z = axes[b, 2]
            x, y, z = ux * z, uy * z, uz * z
            _add_wrench(rest_gain, b, p, x, y, z)
            first = j00 * axes[b, 0] + j01 * axes[b, 1]
            second = j10 * axes[b, 0] + j11 * axes[b, 1]
            x += ax * first + bx * second
            y += ay * first + by * second
            z += az * first + bz * second
            _add_wrench(gain, b, p, x, y, z)
        residue = np.float64(common.residue_ut2[i])
        common.shared_n2[0, i] = residue * (j00 * j00 + j01 * j01)
        common.shared_n2[1, i] = residue * (j10 * j10 + j11 * j11)


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
