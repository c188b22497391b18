"""What is not known of the fields that neighbours add: at rest, by theory and by a tare; moving.

A tare reads Bz of an untouched unit less that of its own film (`axial_rest_ut`): what its
neighbours at rest add, and the ambient field. Theory knows the first as well as films are made as
drawn.
"""

from __future__ import annotations

import logging

import numpy as np

from skin.physics.film_table import load_film_table
from skin.physics.halbach import CHIP_AXES
from skin.physics.stencil import (
    Stencil,
    check_stencil,
    neighbours_at_rest,
    neighbours_moving_ut2,
)
from topology import Topology

__all__ = ["axial_at_rest", "check_zeros", "rest_of", "share_shown", "stray_ut2"]

ALIKE_SIGMAS = 5.0
"""Sigmas by which a tare and theory may differ; a unit that reads farther off is not believed
[assumed: as what the constants of a unit may be off by]."""
AMBIENT_UT2 = 2500.0
"""Variance of a component of the ambient field of a tare, µT² [derived: the Earth's, 50 µT]."""
OWN_SHARE = 0.03
"""By which what neighbours at rest add differs from unit to unit: strengths and places
[assumed]."""
SHAPE2 = 0.1
"""Share of the variance that a tare leaves at least: the shape of films [assumed]."""
STEEPNESS = 18.0, 10.0
"""Share by which errors of places change what neighbours add, over those errors and the distance of
the nearest one: of units that are not tared, and that are [derived: films on a plane, by the slopes
of their stencil]."""
FAR = 3.0
"""Root of the mean square of the difference over the units of a patch, in sigmas of their zeros
(`field_sigma_ut`), from which it is named [derived: what differs by less is in sigma]."""

_log = logging.getLogger("skin")


def axial_at_rest(
    topology: Topology, rest_ut: np.ndarray, variance_ut2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What neighbours at rest add along z, and its variance: the mean of theory and tare, each
    weighted by its variance.

    Parameters
    ----------
    topology : Topology
    rest_ut, variance_ut2 : ndarray, shape (n,)
        By theory, or by the stencil of a decoder.

    Returns
    -------
    rest_ut, variance_ut2 : ndarray, shape (n,)
    """
    p = topology.parameters
    measured2 = p["axial_rest_sigma_ut"] ** 2
    total2 = variance_ut2 + measured2
    share = np.where(_believed(topology, rest_ut, variance_ut2), variance_ut2, 0.0)
    share = share / np.where(total2 > 0.0, total2, 1.0)
    return rest_ut + share * (p["axial_rest_ut"] - rest_ut), variance_ut2 * (1.0 - share)


def _believed(topology: Topology, rest_ut: np.ndarray, variance_ut2: np.ndarray) -> np.ndarray:
    """Units whose Bz at rest a tare has measured, and which are no liars, shape (n,), bool."""
    p = topology.parameters
    measured2 = p["axial_rest_sigma_ut"] ** 2
    most2 = ALIKE_SIGMAS**2 * (variance_ut2 + measured2)
    return (measured2 > 0.0) & ((p["axial_rest_ut"] - rest_ut) ** 2 <= most2)


def stray_ut2(topology: Topology, stencil: Stencil) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the field by films that are not made, and units that are not placed, as the
    stencil has them: of x or y and of z, µT².

    All films of a skin are made alike, so that what they add as they move is off by one and the
    same share, `stray_sigma_relative`; errors of places and tilts move it by a share that falls
    with the distance, laterally. Of films that were measured neither is in here. At rest they are
    off by `Stencil.rest_sigma_ut`, of which a tare takes the lateral part off.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil

    Returns
    -------
    lateral_ut2 : ndarray, shape (2, n)
        Of units that are not tared, and of units that are.
    axial_ut2 : ndarray, shape (n,)
    """
    p, film, rest = topology.parameters, load_film_table().film, stencil.rest_sigma_ut**2
    lateral_ut2 = np.stack([0.5 * (rest[0] + rest[1]), np.zeros(stencil.n)])
    if not stencil.drawn:
        return lateral_ut2, np.zeros(stencil.n)
    moved_ut2, moved_axial_ut2 = neighbours_moving_ut2(topology, (1.0, 1.0))
    nearest_mm = np.full(stencil.n, np.inf)
    np.minimum.at(nearest_mm, stencil.unit, 1e3 * stencil.apart_m)
    lever = film.middle_mm + film.chip_mm
    off_mm = np.hypot(p["placement_sigma_mm"], lever * p["placement_sigma_rad"])
    for row, steepness in enumerate(STEEPNESS):
        share2 = p["stray_sigma_relative"] ** 2 + (steepness * off_mm / nearest_mm) ** 2
        lateral_ut2[row] += share2 * moved_ut2
    lateral_ut2[0] += p["placement_sigma_rad"] ** 2 * stencil.rest_ut[2] ** 2
    return lateral_ut2, p["stray_sigma_relative"] ** 2 * moved_axial_ut2


def share_shown(topology: Topology, stencil: Stencil) -> float:
    """Mean square of the share by which films add otherwise than as drawn, once a tare has read
    them at rest, over that before.

    That share, which all films of a skin have, and the ambient field of the tare are estimated from
    `axial_rest_ut` of all units, by linear least squares. It says less of films as they move, for
    their shape may differ too.

    Parameters
    ----------
    topology : Topology
        With what a tare has measured.
    stencil : Stencil
        That of the drawing.
    """
    p, rest_ut = topology.parameters, stencil.rest_ut[2]
    variance_ut2 = stencil.rest_sigma_ut[2] ** 2
    seen = _believed(topology, rest_ut, variance_ut2)
    if not stencil.drawn or not seen.any() or not variance_ut2.any():
        return 1.0
    prior = np.mean(variance_ut2) / np.mean(rest_ut**2)
    matrix = np.column_stack([rest_ut, CHIP_AXES[2] * topology.rotation[:, 2].T])[seen]
    noise_ut2 = p["axial_rest_sigma_ut"] ** 2 + (OWN_SHARE * rest_ut) ** 2
    weighted = matrix.T / noise_ut2[seen]
    known = np.diag(1.0 / np.array([prior, AMBIENT_UT2, AMBIENT_UT2, AMBIENT_UT2]))
    covariance = np.linalg.inv(known + weighted @ matrix)
    share = (covariance @ (weighted @ (p["axial_rest_ut"] - rest_ut)[seen]))[0]
    return float(np.clip((share**2 + covariance[0, 0]) / prior, SHAPE2, 1.0))


def rest_of(topology: Topology, stencil: Stencil | None) -> tuple[np.ndarray, np.ndarray]:
    """What is taken off for neighbours at rest.

    Returns
    -------
    rest_ut : ndarray, shape (3, n)
        µT, axes of the chips.
    beyond_ut : ndarray, shape (2, n)
        Of x and y, what a learned stencil has beyond magnet theory.

    Raises
    ------
    SkinError
        The stencil is none of these units.
    """
    if stencil is None:
        rest_ut, is_theory = neighbours_at_rest(topology), True
    else:
        check_stencil(topology, stencil)
        rest_ut, is_theory = stencil.rest_ut, stencil.drawn
    if is_theory:
        return rest_ut, np.zeros((2, topology.n))
    return rest_ut, rest_ut[:2] - neighbours_at_rest(topology)[:2]


def check_zeros(topology: Topology, beyond_ut: np.ndarray) -> None:
    """Warn of patches whose zeros leave out the field of another stencil, by the logger "skin".

    Parameters
    ----------
    topology : Topology
    beyond_ut : ndarray, shape (2, n)
        As of `rest_of`.
    """
    p = topology.parameters
    off_ut = beyond_ut - np.stack([p["tare_rest_x_ut"], p["tare_rest_y_ut"]])
    taken = topology.tared & topology.feels
    for number, patch in enumerate(topology.patch_names):
        units = taken & (topology.patch == number)
        if not units.any():
            continue
        sigma_ut = np.maximum(p["field_sigma_ut"][units], 1e-6)
        if np.sqrt(np.mean((off_ut[:, units] / sigma_ut) ** 2)) > FAR:
            learned = (p["tare_rest_x_ut"][units] != 0.0) | (p["tare_rest_y_ut"][units] != 0.0)
            zeros = "a learned stencil" if learned.any() else "magnet theory"
            _log.warning(
                "%s: patch %r: must be decoded with the stencil of its zeros, which leave out "
                "resting neighbours by %s; got another, %.0f µT off: its units read as sheared "
                "(stencil = that of its zeros, or tare it with this one)",
                topology.name, patch, zeros, np.sqrt(np.mean(off_ut[:, units] ** 2)),
            )  # fmt: skip
