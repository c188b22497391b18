"""The rigid motion of a body, fitted to the displacements of the units that stick to it."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.slip.state import MOTIONS, PLANE

__all__ = ["contact_frame", "design_motions", "fit_motion"]

RANK = 1e-9
"""[numeric] Fraction of a pivot below which a motion depends on those before it."""
FLAT = 1e-3
"""[numeric] One minus the length of the mean normal below which a contact is flat."""
RIDGE = 1e-6
"""[numeric] Regularisation of motions out of the plane, relative to the diagonal."""


@jitable
def contact_frame(record, members, model, data):
    """Axes and centre of the contact; returns whether it is flat."""
    fit, square = data.all[0], 0.0
    for a in range(3):
        mean = 0.0
        for i in members:
            mean += data.units[i]["force"][2] * model.poses[i]["rotation"][a, 2]
        square += mean**2
        for axis in range(3):
            fit["axes"][axis, a] = record["axes"][a, axis]
        fit["centre"][a] = record["middle"][a] - model.settings[0]["origin"][a]
    return np.sqrt(square) > (1.0 - FLAT) * record["load"]


@jitable
def design_motions(pose, fit, size, motions, s):
    """Displacement of one unit by each motion of the body: derivations.md, equation 1."""
    scale, axes, design = 1.0 / size, fit["axes"], s["design"]
    position, rotation, centre = pose["position"], pose["rotation"], fit["centre"]
    qx = (position[0] - centre[0]) * scale
    qy = (position[1] - centre[1]) * scale
    qz = (position[2] - centre[2]) * scale
    s["square_distance"] = qx * qx + qy * qy + qz * qz
    for c in range(2):
        ax, ay, az = rotation[0, c], rotation[1, c], rotation[2, c]
        # Rotation about an axis e moves q by e x q; its component along a is e . (q x a).
        rx, ry, rz = qy * az - qz * ay, qz * ax - qx * az, qx * ay - qy * ax
        design[c, 0] = ax * axes[0, 0] + ay * axes[0, 1] + az * axes[0, 2]
        design[c, 1] = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
        design[c, 2] = rx * axes[2, 0] + ry * axes[2, 1] + rz * axes[2, 2]
        if motions > PLANE:
            design[c, 3] = ax * axes[2, 0] + ay * axes[2, 1] + az * axes[2, 2]
            design[c, 4] = rx * axes[0, 0] + ry * axes[0, 1] + rz * axes[0, 2]
            design[c, 5] = rx * axes[1, 0] + ry * axes[1, 1] + rz * axes[1, 2]


@jitable
def fit_motion(members, motions, stuck, floor_mm, data):
    """Weighted least squares of the body's motion, none without sticking units, and how it moves
    each unit: derivations.md, equations 2 to 4.

    Each unit gets the variance of its predicted displacement, mean of both components, by the
    factor of the normal equations. Returns the one-sigma, mm, of the motion out of the contact's
    plane that the anchors may have missed.
    """
    fit, floor, variance = data.all[0], floor_mm**2, 1.0
    equations, motion = fit["equations"], fit["motion"]
    _normal_equations(members, motions, floor, equations, data)
    for a in range(MOTIONS):
        motion[a] = 0.0
    if motions > PLANE and stuck > 0:
        # Out of the plane, few units cannot distinguish motion from slip; their depths can.
        deeper, total = 0.0, 0.0
        for i in members:
            deeper += data.slips[i]["weight"] * data.slips[i]["deeper"] ** 2
            total += data.slips[i]["weight"]
        variance = floor + deeper / total
        # Pose of the body out of the plane by the anchors (equation 4). A late unit was anchored
        # further along the plane than the others, so only motions out of it are compared.
        placement, further = fit["placement_equations"], motions - PLANE
        for a in range(further):
            placement[a, MOTIONS] = 0.0
            for b in range(a + 1):
                placement[a, b] = equations[a + PLANE, b + PLANE]
            placement[a, a] *= 1.0 + RIDGE
            for i in members:
                s = data.slips[i]
                for c in range(2):
                    share = s["weight"] * s["design"][c, a + PLANE]
                    placement[a, MOTIONS] += share * s["followed_out"][c]
        _solve(placement, further, fit["placement"])
        for a in range(further):
            equations[a + PLANE, a + PLANE] += 1.0 / variance
            equations[a + PLANE, MOTIONS] += fit["placement"][a] / variance
    if stuck > 0:
        _solve(equations, motions, motion)
    for i in members:
        s, solved = data.slips[i], data.slips[i]["nuisance"]  # not in use yet
        for c in range(2):
            out, now = 0.0, 0.0
            for a in range(PLANE, motions):
                out += s["design"][c, a] * motion[a]
            for a in range(min(motions, PLANE)):
                now += s["design"][c, a] * motion[a]
            s["moved_out"][c], s["now"][c] = out, out + now
            for a in range(motions):
                rest = s["design"][c, a]
                for b in range(a):
                    rest -= equations[a, b] * solved[b]
                solved[a] = rest / equations[a, a] if equations[a, a] > 0.0 else 0.0
                s["body_variance"] += 0.5 * solved[a] * solved[a]
    return np.sqrt(variance)


@jitable
def _normal_equations(members, motions, floor, equations, data):
    """Normal equations of the displacements since anchoring, without learned gains."""
    equations[:] = 0.0
    for i in members:
        s, here = data.slips[i], data.units[i]["displacement"]
        s["weight"] = s["held"] / (s["noise"] + s["anchor_variance"] + floor)
        for c in range(2):
            along = here[c] - s["anchor"][c] - s["gain_error"] * (s["moved"][c] - s["followed"][c])
            for a in range(motions):
                share = s["weight"] * s["design"][c, a]
                equations[a, MOTIONS] += share * along
                for b in range(a + 1):
                    equations[a, b] += share * s["design"][c, b]


@jitable
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
