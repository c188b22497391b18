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
from skin.contact.shape import cross
from skin.physics.force_law import at as law_at
from skin.physics.force_law import scaled, secant, shear_law, stacked
from skin.physics.halbach import CHIP_AXES
from topology import Topology

__all__ = ["Common", "add_shared", "common_field", "spread_shared"]

CREST = 0.1
"""Smallest cosine at which the strength of a field determines the displacement [assumed]."""


class Common(NamedTuple):
    """Errors common to the units of g bodies; all but the laws are read in each cycle."""

    laws: dict[str, np.ndarray]  # of n units: how a tangential force follows its field, see `POSE`
    rest_ut2: float  # variance of an axis of the field that Bz at rest was learnt in
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    field_ut: np.ndarray  # (3, n), see `Reading`
    field_displacement_mm: np.ndarray  # (3, n), see `Reading`
    residue_ut2: np.ndarray  # (n,), variance of a lateral axis by both, as in the sigma of a unit


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
    covariance_ut2, residue_ut2, field_ut, displacement_mm, rest_ut2
        See `Common`; the covariances are in the skin frame, with the body where the topology has
        it.
    by_strength : bool
        Whether displacements are decoded from the strength of the field alone.
    """
    p = topology.parameters
    laws = {
        "body": body,
        "axes": np.moveaxis(topology.rotation * CHIP_AXES[:, np.newaxis], 2, 0),
        "film": np.stack([p["film_x_mm"], p["film_y_mm"]], axis=1),
        "shear": stacked(shear_law(p)).T[..., np.newaxis],
        "gain": p["shear_gain_per_mm"],
        "gain_offset": 1.0 - p["shear_gain_per_mm"] * p["field_reference_mm"],
        "wavenumber": p["field_wavenumber_rad_per_mm"] * by_strength,
    }
    rest_ut2 = 0.0 if by_strength else rest_ut2
    return Common(laws, rest_ut2, covariance_ut2, field_ut, displacement_mm, residue_ut2)


@jitable
def force_per_ut(u, pose):
    """Tangential force of a unit per µT of its field, two rows of three; zeros where the field or
    the displacement is unknown."""
    x, y, depth = u["field_displacement"][0], u["field_displacement"][1], u["field_displacement"][2]
    bx, by, bz = u["field"][0], u["field"][1], u["field"][2]
    lateral2 = bx * bx + by * by
    if not (math.isfinite(x + y + depth + bx + by) and lateral2 > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
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
def add_shared(u, pose, gain):
    """Add a unit to the wrenches per µT of each body; returns the part of the ambient field in the
    variances of its two tangential forces, N², and 0 of the normal one."""
    xx, xy, xz, yx, yy, yz = force_per_ut(u, pose)
    r, body = pose["rotation"], pose["body"]
    for b in range(3):
        ax, ay, az = pose["axes"][b, 0], pose["axes"][b, 1], pose["axes"][b, 2]
        for rest in range(2):
            x, y = az * xz, az * yz
            if not rest:
                x, y = x + ax * xx + ay * xy, y + ax * yx + ay * yy
            force = r[0, 0] * x + r[0, 1] * y, r[1, 0] * x + r[1, 1] * y, r[2, 0] * x + r[2, 1] * y
            torque = cross(pose["position"], force)
            for a in range(3):
                gain[body, rest, a, b] += force[a]
                gain[body, rest, a + 3, b] += torque[a]
    return u["residue"] * (xx * xx + xy * xy), u["residue"] * (yx * yx + yy * yy), 0.0


@jitable
def spread_shared(gain, rest_ut2, data, covariance):
    """Add the common errors of units to the covariance of their wrench: Σ G C G'."""
    for g in range(gain.shape[0]):
        field, rest, c = gain[g, 0], gain[g, 1], data.covariance_ut2[g]
        for a in range(6):
            for p in range(3):
                x = field[a, 0] * c[0, p] + field[a, 1] * c[1, p] + field[a, 2] * c[2, p]
                for b in range(6):
                    covariance[a, b] += x * field[b, p] + rest_ut2 * rest[a, p] * rest[b, p]
