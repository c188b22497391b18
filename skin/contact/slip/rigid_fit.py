"""The rigid motion of a body, fitted to the displacements of the units that stick to it."""

from __future__ import annotations

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import MOTIONS, PLANE, BodyFit, UnitFilter, UnitRows
from skin.contact.slip.parameters import PARAMETERS, SlipModel

__all__ = ["contact_frame", "design_motions", "fit_motion"]

RANK = 1e-9
"""Share of a pivot below which a motion cannot be told from those before it."""
FROZEN = 1e9
"""Factor on the prior of a motion that is not to be found."""


@jitable(inline=True)
def contact_frame(record, members, force, geometry, fit: BodyFit):
    """Axes, centre and mean normal of the contact; returns whether it is flat."""
    axes, mean = record["axes"], fit.mean_normal
    mean[:] = 0.0
    for at in range(record["begin"], record["end"]):
        i = members[at]
        load = np.float64(force[2, i])
        for a in range(3):
            mean[a] += load * geometry.pose[i]["rotation"][a, 2]
    square = 0.0
    for a in range(3):
        fit.axes[0, a], fit.axes[1, a], fit.axes[2, a] = axes[a, 0], axes[a, 1], axes[a, 2]
        fit.centre[a] = record["centroid"][a] - geometry.origin[a]
        square += mean[a] ** 2
    return np.sqrt(square) > (1.0 - PARAMETERS.flat) * record["load"]


@jitable(inline=True)
def design_motions(pose, fit: BodyFit, size, motions, row: UnitRows, j):
    """What each motion of the body does to one unit: derivations.md, equation 1."""
    scale = 1.0 / size
    position, rotation, axes, design = pose["position"], pose["rotation"], fit.axes, row.design
    qx = (position[0] - fit.centre[0]) * scale
    qy = (position[1] - fit.centre[1]) * scale
    qz = (position[2] - fit.centre[2]) * scale
    row.square_distance[j] = qx * qx + qy * qy + qz * qz
    for c in range(2):
        ax, ay, az = rotation[0, c], rotation[1, c], rotation[2, c]
        # Rotation about an axis e moves q by e x q; its share along a is e . (q x a).
        rx, ry, rz = qy * az - qz * ay, qz * ax - qx * az, qx * ay - qy * ax
        design[c, 0, j] = ax * axes[0, 0] + ay * axes[0, 1] + az * axes[0, 2]
        design[c, 1, j] = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
        design[c, 2, j] = rx * axes[2, 0] + ry * axes[2, 1] + rz * axes[2, 2]
        design[c, 3, j] = ax * qx + ay * qy + az * qz
        if motions > PLANE:
            design[c, 4, j] = ax * axes[2, 0] + ay * axes[2, 1] + az * axes[2, 2]
            design[c, 5, j] = rx * axes[0, 0] + ry * axes[0, 1] + rz * axes[0, 2]
            design[c, 6, j] = rx * axes[1, 0] + ry * axes[1, 1] + rz * axes[1, 2]


@jitable(inline=True)
def fit_motion(
    length, stuck, motions, model: SlipModel, unit: UnitFilter, row: UnitRows, fit: BodyFit
):
    """Weighted least squares of the body's motion: derivations.md, equations 2 to 4.

    Returns the one-sigma, mm, of how far it may have gone out of the contact's plane since the
    anchors have had time to follow.
    """
    peak = _weigh(length, model.floor_mm**2, unit, row)
    equations = fit.equations
    _normal_equations(length, motions, peak, unit, row, equations)
    if motions > 2:
        equations[3, 3] += 1.0 / PARAMETERS.swelling_mm**2
        if stuck < PARAMETERS.units_for_swelling:
            equations[3, 3] *= FROZEN
    if motions <= PLANE:
        _solve(equations, motions, fit.motion)
        return PARAMETERS.placement_mm
    # Out of the plane, few units cannot tell a motion from slip; how deep they are pressed can.
    deeper, total = 0.0, 0.0
    for j in range(length):
        deeper += row.weight[j] * row.deeper[j] ** 2
        total += row.weight[j]
    variance = PARAMETERS.out_of_plane_mm**2 + deeper / total
    _place(length, motions, peak, unit, row, fit)
    for a in range(PLANE, motions):
        equations[a, a] += 1.0 / variance
        equations[a, MOTIONS] += fit.placement[a - PLANE] / variance
    _solve(equations, motions, fit.motion)
    return np.sqrt(variance)


@jitable(inline=True)
def _weigh(length, floor, unit: UnitFilter, row: UnitRows):
    """Weights of the units in the fit (equation 2); returns the greatest load that sticks."""
    assume_noalias()
    for j in range(length):
        robust = min(1.0, PARAMETERS.huber_sigmas / max(unit.score[j], 1e-9))
        robust *= 1.0 - (1.0 - PARAMETERS.clipped_weight) * unit.clipped[j]
        spread = row.noise[j] + PARAMETERS.anchor_correlation * unit.anchor_variance[j] + floor
        row.weight[j] = row.held[j] * robust * row.load[j] / spread
    # The loads only rank the units; the priors want weights like those of lone units.
    peak = 0.0
    for j in range(length):
        peak = max(peak, row.held[j] * row.load[j])
    return peak


@jitable(inline=True)
def _normal_equations(length, motions, peak, unit: UnitFilter, row: UnitRows, equations):
    """Normal equations of the displacements since anchoring, without learned gains."""
    assume_noalias()
    design, weight = row.design, row.weight
    for a in range(motions):
        xa, ya = design[0, a], design[1, a]
        total = 0.0
        for j in range(length):
            gain_error = max(unit.gain_error[j], 0.0)
            along_x = row.displacement[0, j] - unit.anchor[0, j]
            along_x -= gain_error * (unit.moved[0, j] - unit.followed[0, j])
            along_y = row.displacement[1, j] - unit.anchor[1, j]
            along_y -= gain_error * (unit.moved[1, j] - unit.followed[1, j])
            total += weight[j] * (xa[j] * along_x + ya[j] * along_y)
        equations[a, MOTIONS] = total / peak
        for b in range(a + 1):
            total = _dot(weight, xa, design[0, b], length)
            total += _dot(weight, ya, design[1, b], length)
            equations[a, b] = total / peak


@jitable(inline=True)
def _place(length, motions, peak, unit: UnitFilter, row: UnitRows, fit: BodyFit):
    """Where the anchors place the body out of the plane (equation 4).

    A unit that came late was anchored further along the plane than the others, so only motions out
    of it are compared.
    """
    design, placement = row.design, fit.placement_equations
    for a in range(PLANE, motions):
        at = a - PLANE
        for b in range(at + 1):
            placement[at, b] = fit.equations[a, PLANE + b]
        placement[at, at] += 1.0 / PARAMETERS.placement_mm**2
        placement[at, MOTIONS] = _dot(row.weight, design[0, a], unit.followed_out[0], length)
        placement[at, MOTIONS] += _dot(row.weight, design[1, a], unit.followed_out[1], length)
        placement[at, MOTIONS] /= peak
    _solve(placement, motions - PLANE, fit.placement)


@jitable(inline=True)
def _dot(a, b, c, length):
    total = 0.0
    for j in range(length):
        total += a[j] * b[j] * c[j]
    return total


@jitable(inline=True)
def _solve(equations, motions, x):
    """Cholesky's solution of ``equations[:, :motions] x = equations[:, MOTIONS]``, of which the
    lower triangle is given; motions that cannot be told are 0."""
    for j in range(motions):
        before = equations[j, j]
        for k in range(j):
            equations[j, j] -= equations[j, k] ** 2
        if equations[j, j] <= RANK * before or before <= 0.0:
            equations[j, j] = 0.0
            for i in range(j + 1, motions):
                equations[i, j] = 0.0
            continue
        equations[j, j] = np.sqrt(equations[j, j])
        for i in range(j + 1, motions):
            for k in range(j):
                equations[i, j] -= equations[i, k] * equations[j, k]
            equations[i, j] /= equations[j, j]
    for j in range(motions):
        x[j] = equations[j, MOTIONS]
        for k in range(j):
            x[j] -= equations[j, k] * x[k]
        x[j] = x[j] / equations[j, j] if equations[j, j] > 0.0 else 0.0
    for j in range(motions - 1, -1, -1):
        for k in range(j + 1, motions):
            x[j] -= equations[k, j] * x[k]
        x[j] = x[j] / equations[j, j] if equations[j, j] > 0.0 else 0.0
