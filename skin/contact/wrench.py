"""Wrench, centre of pressure and torsion of a contact, with their covariances."""

from __future__ import annotations

from typing import overload

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import TORSION_BLIND, WEAK
from skin.contact.shape import beside

__all__ = ["centre", "tangential_demand", "total_wrench", "wrench_in_frame"]

WEAK_SIGMAS = 5.0
"""Sigmas of its load below which a contact has no centre [assumed]."""


@jitable
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@jitable
def _shifted(t, shift):
    """Covariance of a wrench about a shifted point, M' = M + shift x F, of its upper triangle t:
    the rows of force with torque, and the upper triangle of the torque."""
    a, b, c = (t[3], t[4], t[5]), (t[8], t[9], t[10]), (t[12], t[13], t[14])
    x = _plus(a, beside(shift, (t[0], t[1], t[2])))
    y = _plus(b, beside(shift, (t[1], t[6], t[7])))
    z = _plus(c, beside(shift, (t[2], t[7], t[11])))
    # cov(M') = cov(M) + cov(M, F) by the shift + the shift by cov(F, M'), column by column
    first = _plus(beside(shift, (a[0], b[0], c[0])), (t[15], t[16], t[17]))
    second = _plus(beside(shift, (a[1], b[1], c[1])), (t[16], t[18], t[19]))
    third = _plus(beside(shift, (a[2], b[2], c[2])), (t[17], t[19], t[20]))
    p = beside(shift, (x[0], y[0], z[0]))
    q = beside(shift, (x[1], y[1], z[1]))
    r = beside(shift, (x[2], y[2], z[2]))
    torque = (
        first[0] + p[0], first[1] + q[0], first[2] + r[0],
        second[1] + q[1], second[2] + r[1], third[2] + r[2],
    )  # fmt: skip
    return (x, y, z), torque


@jitable
def _write_symmetric(values, block):
    """Write an upper triangle into a symmetric 3 by 3 block."""
    block[0, 0], block[1, 1], block[2, 2] = values[0], values[3], values[5]
    block[0, 1] = block[1, 0] = values[1]
    block[0, 2] = block[2, 0] = values[2]
    block[1, 2] = block[2, 1] = values[4]


@jitable
def total_wrench(s, record, origin):
    """Wrench about the origin of the skin frame, its covariance and sigma; after `add_faces`.

    Parameters
    ----------
    s : SUMS
        The torque of the faces is added to its covariance.
    record : CONTACT
    origin : ndarray, shape (3,)
        Metre, the middle of the array.
    """
    wrench, covariance, t = record["wrench"], record["wrench_covariance"], s["wrench_covariance"]
    shifted = beside(origin, s["wrench"])
    for a in range(3):
        wrench[a] = s["wrench"][a]
        wrench[a + 3] = shifted[a] + s["wrench"][a + 3]
    for row in range(6):
        t[15 + row] += s["face_torque"][row]
    mixed, torque = _shifted(t, origin)
    _write_symmetric((t[0], t[1], t[2], t[6], t[7], t[11]), covariance[:3, :3])
    _write_symmetric(torque, covariance[3:, 3:])
    for a in range(3):
        for b in range(3):
            covariance[a, b + 3] = covariance[b + 3, a] = mixed[a][b]
    for a in range(6):
        record["wrench_sigma"][a] = np.sqrt(max(covariance[a, a], 0.0))


@jitable
def _no_centre(record):
    record["flags"] |= WEAK
    record["centroid"][:] = np.nan
    record["middle"][:] = np.nan
    record["moment"][:] = np.nan
    record["centroid_covariance"][:] = np.nan
    record["moment_covariance"][:] = np.nan
    record["torsion"] = np.nan
    record["torsion_sigma"] = np.nan
    record["margin"] = np.nan
    record["grip_force"] = np.nan


@jitable
def _centre_covariance(s, about, load, record):
    """First order: of the noise of the loads and of unseen loads, Σ σ² (p - c) (p - c)' / load²,
    and of the places of load on the faces; `about` is -c."""
    covariance = record["centroid_covariance"]
    variance = s["load_variance"] + s["light_variance"] + s["unseen"]
    own, light, unseen = s["variance_position"], s["light_variance_position"], s["unseen_position"]
    row, inverse2 = 0, 1.0 / (load * load)
    for a in range(3):
        first = own[a] + light[a] + unseen[a]
        for b in range(a, 3):
            second = own[b] + light[b] + unseen[b]
            spread = s["variance_position_square"][row] + s["light_variance_square"][row]
            spread += s["unseen_square"][row] + about[a] * second + about[b] * first
            spread = (spread + about[a] * about[b] * variance) * inverse2
            if a == b:
                spread = max(spread, 0.0)
                s["step_variance"] += spread
            spread += s["face"][row] * inverse2
            covariance[a, b] = covariance[b, a] = spread
            row += 1


@jitable
def centre(s, record, origin):
    """Centre of pressure, torque about that of the units, shear and torsion; after `total_wrench`
    and `orient`.

    The centre of pressure counts the neighbours' loads below the gate: c + Σ l (p - c) / load, over
    the load of all of them, or of the contact alone where noise makes the sum smaller.
    """
    load, force, normal = s["load"], s["wrench"], record["normal"]
    along = force[0] * normal[0] + force[1] * normal[1] + force[2] * normal[2]
    across = 0.0
    for a in range(3):
        across += (force[a] - along * normal[a]) ** 2
    record["shear"] = np.sqrt(across)
    if s["units"] < 2.0:
        record["flags"] |= TORSION_BLIND
    if load * load < WEAK_SIGMAS**2 * s["load_variance"]:
        _no_centre(record)
        return
    place, light = s["load_position"], s["light_position"]
    about = -place[0] / load, -place[1] / load, -place[2] / load
    shifted = beside(about, force)
    moment, covariance = record["moment"], record["moment_covariance"]
    _, torque = _shifted(s["wrench_covariance"], about)
    _write_symmetric(torque, covariance)
    torsion, variance = 0.0, 0.0
    for a in range(3):
        moment[a] = shifted[a] + force[a + 3]
        record["middle"][a] = origin[a] - about[a]
        torsion += moment[a] * normal[a]
        for b in range(3):
            variance += normal[a] * covariance[a, b] * normal[b]
    record["torsion"], record["torsion_sigma"] = torsion, np.sqrt(max(variance, 0.0))
    load = max(load, load + s["light"])
    about = (
        about[0] - (light[0] + s["light"] * about[0]) / load,
        about[1] - (light[1] + s["light"] * about[1]) / load,
        about[2] - (light[2] + s["light"] * about[2]) / load,
    )
    for a in range(3):
        record["centroid"][a] = origin[a] - about[a]
    _centre_covariance(s, about, load, record)


@jitable
def tangential_demand(shear, torsion, arm):
    """Friction force that holds shear and torsion together, newton.

    The limit surface is an ellipsoid: ``(shear / friction load)² + (torsion / friction load arm)²
    = 1`` (Howe and Cutkosky 1996).

    Parameters
    ----------
    shear : float
        Newton, along the contact.
    torsion : float
        N·m about its normal.
    arm : float
        Metre; load-weighted mean distance from the centre of pressure. 0 for a point, which bears
        no measurable torsion.

    Returns
    -------
    float
    """
    square = shear**2
    if arm > 0.0:
        square += (torsion / arm) ** 2
    return np.sqrt(square)


@overload
def wrench_in_frame(
    wrench: np.ndarray, rotation: np.ndarray, origin: np.ndarray, covariance: None = None
) -> np.ndarray: ...
@overload
def wrench_in_frame(
    wrench: np.ndarray, rotation: np.ndarray, origin: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]: ...
def wrench_in_frame(
    wrench: np.ndarray,
    rotation: np.ndarray,
    origin: np.ndarray,
    covariance: np.ndarray | None = None,
) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """A wrench about the origin of the skin frame, in another frame.

    Parameters
    ----------
    wrench : ndarray, shape (6,)
        Force in newton and torque in newton metre.
    rotation : ndarray, shape (3, 3)
        Columns are the axes of the frame, in the skin frame.
    origin : ndarray, shape (3,)
        Metre, origin of the frame, in the skin frame, about which the torque is given.
    covariance : ndarray, shape (6, 6), optional

    Returns
    -------
    ndarray, shape (6,), or that and its covariance, shape (6, 6)

    Examples
    --------
    >>> wrench_in_frame(np.array([0, 0, 2.0, 0, -0.2, 0]), np.eye(3), [0.1, 0, 0]).tolist()
    [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
    """
    x, y, z = origin
    turn = np.transpose(rotation)
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = turn
    adjoint[3:, :3] = -turn @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moved = adjoint @ wrench
    return moved if covariance is None else (moved, adjoint @ covariance @ adjoint.T)
