"""Errors that units have in common: the unknown ambient field.

The tangential displacement follows the field at the chip. The error of the ambient field is one
vector for all units of a body, so that its parts in their forces add up linearly, not as squares:
with F = Σ F_i and F_i = F_i0 + J_i e, cov(F) = Σ cov(F_i0) + (Σ J_i) C (Σ J_i)'. The same holds
for the field in which Bz at rest was learnt. The decoder includes the variance of both in the sigma
of each unit; `add_shared` subtracts it. J_i is derived in docs/explanation/derivations.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.model import POSE, ContactModel
from skin.physics.force_law import at as law_at
from skin.physics.force_law import scaled, secant, shear_law, stacked
from skin.physics.halbach import CHIP_AXES
from topology import Topology

__all__ = ["COMMON", "Common", "add_shared", "common_field", "set_common", "spread_shared"]

CREST = 0.1
"""Smallest cosine at which the strength of a field determines the displacement [assumed]."""
LAW = ("body", "axes", "film", "shear", "gain", "gain_offset", "wavenumber")
"""Fields of `POSE` that say how the tangential force of a unit follows its field."""
COMMON = ("field_ut", "field_displacement_mm", "residue_ut2")
"""Fields of `Common` that are readings of a cycle."""
_NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Common(NamedTuple):
    """Errors common to the units of g bodies."""

    law: np.ndarray  # (n,), POSE: the fields `LAW`
    field_ut: np.ndarray  # (3, n), see `Reading`
    field_displacement_mm: np.ndarray  # (3, n), see `Reading`
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    residue_ut2: np.ndarray  # (n,), variance of a lateral axis by both, as in the sigma of a unit
    rest_ut2: float  # of an axis of the field that Bz at rest was learnt in


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
    p, law = topology.parameters, np.zeros(topology.n, POSE)
    law["body"] = body
    law["axes"] = np.moveaxis(topology.rotation * CHIP_AXES[:, np.newaxis], 2, 0)
    law["film"] = np.stack([p["film_x_mm"], p["film_y_mm"]], axis=1)
    law["shear"][..., 0] = stacked(shear_law(p)).T
    law["gain"] = p["shear_gain_per_mm"]
    law["gain_offset"] = 1.0 - p["shear_gain_per_mm"] * p["field_reference_mm"]
    law["wavenumber"] = p["field_wavenumber_rad_per_mm"] if by_strength else 0.0
    return Common(law, field_ut, displacement_mm, covariance_ut2, residue_ut2,
                  0.0 if by_strength else rest_ut2)  # fmt: skip


def set_common(model: ContactModel, common: Common) -> None:
    """Write the constants of common errors into those of a stream."""
    for name in LAW:
        model.poses[name] = common.law[name]
    model.settings["rest_ut2"] = common.rest_ut2


@jitable
def _force_per_ut(u, pose):
    """Tangential force of a unit per µT of its field, two rows of three; zeros where the field or
    the displacement is unknown."""
    x, y, depth = u["field_displacement"][0], u["field_displacement"][1], u["field_displacement"][2]
    bx, by, bz = u["field"][0], u["field"][1], u["field"][2]
    lateral2 = bx * bx + by * by
    if not (math.isfinite(x + y + depth + bx + by) and lateral2 > 0.0):
        return _NOTHING
    lateral = math.sqrt(lateral2)
    wx, wy = bx / lateral, by / lateral
    outer_x, outer_y = x + pose["film"][0], y + pose["film"][1]
    outer = math.sqrt(outer_x * outer_x + outer_y * outer_y)
    if pose["wavenumber"] > 0.0:
        c = max(math.cos(pose["wavenumber"] * outer), CREST)
        along, upright = (2.0 + c) / (3.0 * c), 0.0
    else:
        whole = math.sqrt(lateral2 + bz * bz)
        c = bz / whole
        narrow = (2.0 + c) / 3.0
        along, upright = narrow * c, -narrow * lateral / whole
    per_ut = outer / lateral
    along, upright = per_ut * along, per_ut * upright
    square = x * x + y * y
    stiffening = pose["gain"] * depth + pose["gain_offset"]
    across, steeper = secant(square, scaled(law_at(pose["shear"], 0), stiffening))
    steeper = steeper / square if steeper != 0.0 else 0.0
    fxx, fxy, fyy = steeper * x * x + across, steeper * x * y, steeper * y * y + across
    # the displacement by the field, then the force by the displacement
    xx, xy = along * wx * wx + per_ut * wy * wy, (along - per_ut) * wx * wy
    yy = along * wy * wy + per_ut * wx * wx
    return (
        fxx * xx + fxy * xy, fxx * xy + fxy * yy, upright * (fxx * wx + fxy * wy),
        fxy * xx + fyy * xy, fxy * xy + fyy * yy, upright * (fxy * wx + fyy * wy),
    )  # fmt: skip


@jitable
def _add_screw(out, b, u, v, pose):
    """Add the wrench (F, p × F) of a force along the axes x and y of a unit to column b."""
    p, r = pose["position"], pose["rotation"]
    x = u * r[0, 0] + v * r[0, 1]
    y = u * r[1, 0] + v * r[1, 1]
    z = u * r[2, 0] + v * r[2, 1]
    out[0, b] += x
    out[1, b] += y
    out[2, b] += z
    out[3, b] += p[1] * z - p[2] * y
    out[4, b] += p[2] * x - p[0] * z
    out[5, b] += p[0] * y - p[1] * x


@jitable
def add_shared(k, u, pose, gain):
    """Add a unit to the gains of row k; returns the part of the ambient field in the variances of
    its two tangential forces, N²."""
    xx, xy, xz, yx, yy, yz = _force_per_ut(u, pose)
    bodies, body, axes = gain.shape[1] // 2, pose["body"], pose["axes"]
    field, rest = gain[k, body], gain[k, bodies + body]
    for b in range(3):
        ax, ay, az = axes[b, 0], axes[b, 1], axes[b, 2]
        _add_screw(rest, b, az * xz, az * yz, pose)
        _add_screw(field, b, ax * xx + ay * xy + az * xz, ax * yx + ay * yy + az * yz, pose)
    return u["residue"] * (xx * xx + xy * xy), u["residue"] * (yx * yx + yy * yy)


@jitable
def _spread(k, rest_ut2, data):
    """Add the common errors of the units of row k to the covariance of its wrench: Σ G C G'."""
    triangle, bodies = data.sums[k]["wrench_covariance"], data.covariance_ut2.shape[0]
    for g in range(bodies):
        gain, rest, c = data.gain[k, g], data.gain[k, g + bodies], data.covariance_ut2[g]
        row = 0
        for a in range(6):
            p, q, r = gain[a, 0], gain[a, 1], gain[a, 2]
            x = p * c[0, 0] + q * c[1, 0] + r * c[2, 0]
            y = p * c[0, 1] + q * c[1, 1] + r * c[2, 1]
            z = p * c[0, 2] + q * c[1, 2] + r * c[2, 2]
            u, v, w = rest_ut2 * rest[a, 0], rest_ut2 * rest[a, 1], rest_ut2 * rest[a, 2]
            for b in range(a, 6):
                triangle[row] += x * gain[b, 0] + y * gain[b, 1] + z * gain[b, 2]
                triangle[row] += u * rest[b, 0] + v * rest[b, 1] + w * rest[b, 2]
                row += 1


@jitable
def spread_shared(count, model, data):
    """Add common errors to the covariances of the first `count` rows, and to that of the total, the
    row after the next, with errors common to contacts."""
    gain, rest_ut2 = data.gain, model.settings[0]["rest_ut2"]
    for k in range(count + 1):
        for g in range(gain.shape[1]):
            for a in range(6):
                for b in range(3):
                    gain[count + 1, g, a, b] += gain[k, g, a, b]
    for k in range(count):
        _spread(k, rest_ut2, data)
    _spread(count + 1, rest_ut2, data)
