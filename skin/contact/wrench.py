"""Wrench, centre of pressure and torsion of a contact, with their covariances."""

from __future__ import annotations

from typing import overload

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import TORSION_BLIND, WEAK
from skin.contact.shape import cross

__all__ = ["add_missed", "centre", "total_wrench", "wrench_in_frame"]

WEAK_SIGMAS = 5.0
"""Sigmas of its load below which a contact has no centre [assumed]."""


@jitable
def _unpack(triangle, matrix):
    """Upper triangle to a full symmetric matrix."""
    row = 0
    size = matrix.shape[0]
    for a in range(size):
        for b in range(a, size):
            matrix[a, b] = triangle[row]
            matrix[b, a] = triangle[row]
            row += 1


@jitable
def _shift_covariance(covariance, shift, side, low):
    """Covariance of a wrench about a shifted point: M' = M + shift x F.

    The block of force and torque goes into `side`, that of the torque into `low`.
    """
    x, y, z = shift[0], shift[1], shift[2]
    for a in range(3):
        for b in range(3):
            side[a, b] = covariance[a, b + 3]
            low[a, b] = covariance[a + 3, b + 3]
    for a in range(3):
        p, q, r = covariance[a, 0], covariance[a, 1], covariance[a, 2]
        side[a, 0] += y * r - z * q
        side[a, 1] += z * p - x * r
        side[a, 2] += x * q - y * p
    for a in range(3):
        p, q, r = covariance[0, a + 3], covariance[1, a + 3], covariance[2, a + 3]
        low[a, 0] += y * r - z * q
        low[a, 1] += z * p - x * r
        low[a, 2] += x * q - y * p
    for b in range(3):
        p, q, r = side[0, b], side[1, b], side[2, b]
        low[0, b] += y * r - z * q
        low[1, b] += z * p - x * r
        low[2, b] += x * q - y * p


@jitable
def add_missed(s, six):
    """Add the neighbours' loads below the gate, which are in no wrench, to the covariance of a
    contact: the square of the most likely value.

    That is the sum of their readings, or 0 where noise makes it negative; it acts at these units,
    along the force of the contact, since the same body presses both [assumed].

    Parameters
    ----------
    s : SUMS
    six : ndarray, shape (6,)
        Scratch.
    """
    light, place, load = s["light"], s["light_position"], s["load"]
    if not (light > 0.0 and load > 0.0):
        return
    s["missed"] += light * light
    x, y, z = s["wrench"][0] / load, s["wrench"][1] / load, s["wrench"][2] / load
    six[0], six[1], six[2] = light * x, light * y, light * z
    six[3] = place[1] * z - place[2] * y
    six[4] = place[2] * x - place[0] * z
    six[5] = place[0] * y - place[1] * x
    row = 0
    for a in range(6):
        for b in range(a, 6):
            s["wrench_covariance"][row] += six[a] * six[b]
            row += 1


@jitable
def total_wrench(s, record, origin, scratch):
    """Wrench about the origin of the skin frame, its covariance and sigma.

    Parameters
    ----------
    s : SUMS
    record : CONTACT
    origin : ndarray, shape (3,)
        Metre, the middle of the array.
    scratch : Scratch
        `covariance` is about the middle of the array afterwards.
    """
    about_middle, side, low = scratch.covariance, scratch.first, scratch.second
    wrench, covariance = record["wrench"], record["wrench_covariance"]
    cross(origin, s["wrench"][:3], wrench[3:])
    for a in range(3):
        wrench[a] = s["wrench"][a]
        wrench[a + 3] += s["wrench"][a + 3]
    _unpack(s["wrench_covariance"], about_middle)
    _shift_covariance(about_middle, origin, side, low)
    for a in range(3):
        for b in range(3):
            covariance[a, b] = about_middle[a, b]
            covariance[a, b + 3] = side[a, b]
            covariance[b + 3, a] = side[a, b]
            covariance[a + 3, b + 3] = low[a, b]
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
def _centre_covariance(s, about, load, record, scratch):
    """First order: of the noise of the loads and of unseen loads, Σ σ² (p - c) (p - c)' / load²,
    and of the places of load on the faces."""
    covariance, face = record["centroid_covariance"], s["face"]
    variance = s["load_variance"] + s["light_variance"] + s["unseen"]
    position, square = scratch.vectors[0], scratch.six
    for a in range(3):
        position[a] = (
            s["variance_position"][a] + s["light_variance_position"][a] + s["unseen_position"][a]
        )
    for row in range(6):
        square[row] = s["variance_position_square"][row] + s["light_variance_square"][row]
        square[row] += s["unseen_square"][row]
    row, inverse2 = 0, 1.0 / (load * load)
    for a in range(3):
        for b in range(a, 3):
            spread = square[row] + about[a] * position[b] + about[b] * position[a]
            spread = (spread + about[a] * about[b] * variance) * inverse2
            if a == b:
                spread = max(spread, 0.0)
                s["step_variance"] += spread
            spread += face[row] * inverse2
            covariance[a, b] = spread
            covariance[b, a] = spread
            row += 1


@jitable
def _counting_light(s, record, origin, about, scratch):
    """Centre of pressure with the neighbours' loads below the gate: c + Σ l (p - c) / load, over
    the load of all of them, or of the contact alone where noise makes the sum smaller."""
    load = max(s["load"], s["load"] + s["light"])
    for a in range(3):
        about[a] -= (s["light_position"][a] + s["light"] * about[a]) / load
        record["centroid"][a] = origin[a] - about[a]
    _centre_covariance(s, about, load, record, scratch)


@jitable
def centre(s, record, origin, scratch):
    """Centre of pressure, torque about that of the units, shear and torsion; after `total_wrench`
    and `orient`."""
    about, load, force = scratch.vectors[2], s["load"], s["wrench"][:3]
    moment, normal = record["moment"], record["normal"]
    along = 0.0
    for a in range(3):
        along += force[a] * normal[a]
    across = 0.0
    for a in range(3):
        across += (force[a] - along * normal[a]) ** 2
    record["shear"] = np.sqrt(across)
    if s["units"] < 2.0:
        record["flags"] |= TORSION_BLIND
    if load * load < WEAK_SIGMAS**2 * s["load_variance"]:
        _no_centre(record)
        return
    for a in range(3):
        about[a] = -s["load_position"][a] / load
        record["middle"][a] = origin[a] - about[a]
    cross(about, force, moment)
    for a in range(3):
        moment[a] += s["wrench"][a + 3]
    covariance = record["moment_covariance"]
    _shift_covariance(scratch.covariance, about, scratch.first, covariance)
    torsion, variance = 0.0, 0.0
    for a in range(3):
        torsion += moment[a] * normal[a]
        for b in range(3):
            variance += normal[a] * covariance[a, b] * normal[b]
    record["torsion"] = torsion
    record["torsion_sigma"] = np.sqrt(max(variance, 0.0))
    _counting_light(s, record, origin, about, scratch)


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
