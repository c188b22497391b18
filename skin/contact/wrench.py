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
def _covariance(triangle, shift, c):
    """Covariance of a wrench about a shifted point, M' = M + shift × F, into c, shape (6, 6), from
    its upper triangle."""
    row = 0
    for a in range(6):
        for b in range(a, 6):
            c[a, b] = c[b, a] = triangle[row]
            row += 1
    for b in range(6):
        x, y, z = beside(shift, c[:3, b])
        c[3, b] += x
        c[4, b] += y
        c[5, b] += z
    for a in range(6):
        x, y, z = beside(shift, c[a, :3])
        c[a, 3] += x
        c[a, 4] += y
        c[a, 5] += z
        for b in range(a):
            c[a, b] = c[b, a]


@jitable
def _add_unseen(v, first, square, t):
    """Add loads of unknown directions, of the variance v along each axis, by its moments: Σ v of
    the screws (e, p × e) of the axes e of the skin frame."""
    x, y, z = first[0], first[1], first[2]
    xx, xy, xz, yy, yz, zz = square[0], square[1], square[2], square[3], square[4], square[5]
    screws = (
        v, 0.0, 0.0, 0.0, z, -y, v, 0.0, -z, 0.0, x, v, y, -x, 0.0,
        yy + zz, -xy, -xz, xx + zz, -yz, xx + yy,
    )  # fmt: skip
    for row in range(21):
        t[row] += screws[row]


@jitable
def total_wrench(s, record, origin):
    """Wrench about the origin of the skin frame, its covariance and sigma; after `add_faces`.

    Parameters
    ----------
    s : SUMS
        The torque of the faces and unseen loads are added to its covariance.
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
    _add_unseen(s["unseen"], s["unseen_position"], s["unseen_square"], t)
    _covariance(t, origin, covariance)
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
    _covariance(s["wrench_covariance"], about, s["about"])
    for a in range(3):
        for b in range(3):
            covariance[a, b] = s["about"][a + 3, b + 3]
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
