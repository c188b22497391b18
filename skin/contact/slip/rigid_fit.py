"""The rigid motion of a body, fitted to the displacements of the units that stick to it."""

from __future__ import annotations

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import MOTIONS, PLANE, BodyFit, UnitFilter, UnitRows
from skin.contact.slip.parameters import SlipModel

__all__ = ["contact_frame", "design_motions", "fit_motion", "move_units"]

RANK = 1e-9
"""[numeric] Fraction of a pivot below which a motion depends on those before it."""
FLAT = 1e-3
"""[numeric] One minus the length of the mean normal below which a contact is flat."""
RIDGE = 1e-6
"""[numeric] Regularisation of motions out of the plane, relative to the diagonal."""


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
        fit.centre[a] = record["middle"][a] - geometry.origin[a]
        square += mean[a] ** 2
    return np.sqrt(square) > (1.0 - FLAT) * record["load"]


@jitable(inline=True)
def design_motions(pose, fit: BodyFit, size, motions, row: UnitRows, j):
    """Displacement of one unit by each motion of the body: derivations.md, equation 1."""
    scale = 1.0 / size
    position, rotation, axes, design = pose["position"], pose["rotation"], fit.axes, row.design
    qx = (position[0] - fit.centre[0]) * scale
    qy = (position[1] - fit.centre[1]) * scale
    qz = (position[2] - fit.centre[2]) * scale
    row.square_distance[j] = qx * qx + qy * qy + qz * qz
    for c in range(2):
        ax, ay, az = rotation[0, c], rotation[1, c], rotation[2, c]
        # Rotation about an axis e moves q by e x q; its component along a is e . (q x a).
        rx, ry, rz = qy * az - qz * ay, qz * ax - qx * az, qx * ay - qy * ax
        design[c][0, j] = ax * axes[0, 0] + ay * axes[0, 1] + az * axes[0, 2]
        design[c][1, j] = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
        design[c][2, j] = rx * axes[2, 0] + ry * axes[2, 1] + rz * axes[2, 2]
        if motions > PLANE:
            design[c][3, j] = ax * axes[2, 0] + ay * axes[2, 1] + az * axes[2, 2]
            design[c][4, j] = rx * axes[0, 0] + ry * axes[0, 1] + rz * axes[0, 2]
            design[c][5, j] = rx * axes[1, 0] + ry * axes[1, 1] + rz * axes[1, 2]


@jitable(inline=True)
def fit_motion(length, motions, model: SlipModel, unit: UnitFilter, row: UnitRows, fit: BodyFit):
    """Weighted least squares of the body's motion: derivations.md, equations 2 to 4.

    Returns the one-sigma, mm, of the motion out of the contact's plane that the anchors may have
    followed.
    """
    assume_noalias()
    floor, equations = model.floor_mm**2, fit.equations
    for j in range(length):
        row.weight[j] = row.held[j] / (row.noise[j] + unit.anchor_variance[j] + floor)
    _normal_equations(length, motions, unit, row, equations)
    variance = 0.0
    if motions > PLANE:
        # Out of the plane, few units cannot distinguish motion from slip; their depths can.
        deeper, total = 0.0, 0.0
        for j in range(length):
            deeper += row.weight[j] * row.deeper[j] ** 2
            total += row.weight[j]
        variance = floor + deeper / total
        _place(length, motions, row, unit, fit)
        for a in range(PLANE, motions):
            equations[a, a] += 1.0 / variance
            equations[a, MOTIONS] += fit.placement[a - PLANE] / variance
    _solve(equations, motions, fit.motion)
    _body_variance(length, motions, equations, row)
    return np.sqrt(variance)


@jitable(inline=True)
def move_units(length, motions, row: UnitRows, motion):
    """Displacement of each unit by the motion of the body, and its part out of the plane."""
    assume_noalias()
    for c in range(2):
        now, out, design = row.now[c], row.moved_out[c], row.design[c]
        out[:length] = 0.0
        for a in range(PLANE, motions):
            for j in range(length):
                out[j] += design[a, j] * motion[a]
        for j in range(length):
            now[j] = out[j]
        for a in range(min(motions, PLANE)):
            for j in range(length):
                now[j] += design[a, j] * motion[a]


@jitable(inline=True)
def _body_variance(length, motions, factor, row: UnitRows):
    """Variance of the predicted displacement of each unit, mean of both components, by the Cholesky
    factor of the normal equations."""
    assume_noalias()
    for c in range(2):
        design = row.design[c]
        for a in range(motions):
            scale = 1.0 / factor[a, a] if factor[a, a] > 0.0 else 0.0
            solved = row.nuisance[a]
            for j in range(length):
                solved[j] = design[a, j]
            for b in range(a):
                share, before = factor[a, b], row.nuisance[b]
                for j in range(length):
                    solved[j] -= share * before[j]
            for j in range(length):
                solved[j] *= scale
                row.body_variance[j] += 0.5 * solved[j] * solved[j]


@jitable(inline=True)
def _normal_equations(length, motions, unit: UnitFilter, row: UnitRows, equations):
    """Normal equations of the displacements since anchoring, without learned gains."""
    assume_noalias()
    design, weight = row.design, row.weight
    for a in range(motions):
        xa, ya = design[0][a], design[1][a]
        total = 0.0
        for j in range(length):
            gain_error = unit.gain_error[j]
            along_x = row.displacement[0, j] - unit.anchor[0, j]
            along_x -= gain_error * (unit.moved[0, j] - unit.followed[0, j])
            along_y = row.displacement[1, j] - unit.anchor[1, j]
            along_y -= gain_error * (unit.moved[1, j] - unit.followed[1, j])
            total += weight[j] * (xa[j] * along_x + ya[j] * along_y)
        equations[a, MOTIONS] = total
        for b in range(a + 1):
            total = _dot(weight, xa, design[0][b], length)
            total += _dot(weight, ya, design[1][b], length)
            equations[a, b] = total


@jitable(inline=True)
def _place(length, motions, row: UnitRows, unit: UnitFilter, fit: BodyFit):
    """Pose of the body out of the plane by the anchors (equation 4).

    A late unit was anchored further along the plane than the others, so only motions out of it are
    compared.
    """
    design, placement = row.design, fit.placement_equations
    for a in range(PLANE, motions):
        at = a - PLANE
        for b in range(at + 1):
            placement[at, b] = fit.equations[a, PLANE + b]
        placement[at, at] *= 1.0 + RIDGE
        placement[at, MOTIONS] = _dot(row.weight, design[0][a], unit.followed_out[0], length)
        placement[at, MOTIONS] += _dot(row.weight, design[1][a], unit.followed_out[1], length)
    _solve(placement, motions - PLANE, fit.placement)


@jitable(inline=True)
def _dot(a, b, c, length):
    total = 0.0
    for j in range(length):
        total += a[j] * b[j] * c[j]
    return total


@jitable(inline=True)
def _solve(equations, motions, x):
    """Cholesky solution of ``equations[:, :motions] x = equations[:, MOTIONS]``, given the lower
    triangle; dependent motions are 0."""
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
