"""What neighbours at rest add along z, by magnet theory and by a tare, and what it says of films.

A tare reads Bz of an untouched unit less that of its own film (`axial_rest_ut`): what its
neighbours at rest add, and the ambient field. Theory knows the first as well as films are made as
drawn. All films of a skin are made alike, so what their fields at rest are off by also says what
they are off by as they move.
"""

from __future__ import annotations

import logging

import numpy as np

from skin.physics.film_table import load_film_table
from skin.physics.halbach import CHIP_AXES
from skin.physics.multipoles import ORDERS, STRENGTH, films_as_made, multipole_field
from skin.physics.stencil import (
    AS_MADE,
    Stencil,
    check_stencil,
    neighbours_at_rest,
    with_films_apart,
)
from skin.physics.stray import (
    DEPTH_MAX_MM,
    DISPLACEMENT_MAX_MM,
    NEAR_M,
    field_at_rest,
    films_seen,
    near,
    scan_poses,
)
from topology import Topology

__all__ = ["FilmsSeen", "axial_at_rest", "check_zeros", "rest_of"]

ALIKE_SIGMAS = 5.0
"""Sigmas by which a tare and theory may differ; a unit that reads farther off is not believed
[assumed: as what the constants of a unit may be off by]."""
AMBIENT_UT2 = 2500.0
"""Variance of a component of the ambient field of a tare, µT² [derived: the Earth's, 50 µT]."""
STEP_MM = 1e-3
"""Of differences: errors of truncation and rounding are both below 1e-4 of a slope."""
DISTANCES = 24
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


class FilmsSeen:
    """What the fields of films at rest say of the fields along z that they add as they move.

    The multipoles that all films share, with those of films as made as the prior, and the ambient
    field of the tare are estimated from `axial_rest_ut` of all units, by linear least squares. What
    a unit itself is off, errors of places and tilts, and films that differ in strength count as
    noise, independent from unit to unit.

    Parameters
    ----------
    topology : Topology
        Places as drawn.
    stencil : Stencil
        That of the drawing.
    """

    def __init__(self, topology: Topology, stencil: Stencil) -> None:
        self._stencil = stencil
        separated = with_films_apart(topology)
        shape, covariance = films_as_made()
        p, film = topology.parameters, load_film_table().film
        share = float(p["stray_sigma_relative"].mean()) / AS_MADE
        self._prior = share**2 * covariance
        lever = film.middle_mm + film.chip_mm
        place2 = p["placement_sigma_mm"] ** 2 + lever**2 * p["placement_sigma_rad"] ** 2
        strength2 = p["field_amplitude_sigma_relative"] ** 2 + STRENGTH**2
        n = topology.n
        self._rest, slopes, self._noise_ut2 = np.zeros((n, ORDERS)), np.zeros((n, 3)), np.zeros(n)
        for at, by, points, turn in films_seen(separated):
            poles = np.einsum("cm,kcm->mk", turn[2], multipole_field(points))
            field = poles @ shape
            slope = np.empty((3, at.size))
            for axis, step in enumerate(STEP_MM * np.eye(3)):
                moved = multipole_field(points + step[:, np.newaxis])
                moved_ut = np.einsum("cm,kcm,k->m", turn[2], moved, shape)
                slope[axis] = (moved_ut - field) / STEP_MM
            np.add.at(self._rest, at, poles)
            np.add.at(slopes, at, np.einsum("abm,bm->ma", separated.rotation[:, :, by], slope))
            noise = strength2[by] * field**2 + place2[by] * np.sum(slope**2, axis=0)
            self._noise_ut2 += np.bincount(at, noise, minlength=n)
        self._noise_ut2 += place2 * np.sum(slopes**2, axis=1)
        far_ut = field_at_rest(separated) - field_at_rest(separated, NEAR_M)  # of dipoles
        self._rest[:, 0] += far_ut[2] / shape[0]
        self._moving = _moving(separated)
        self._ambient = CHIP_AXES[2] * topology.rotation[:, 2].T

    def share2(self, topology: Topology) -> np.ndarray:
        """Mean square of what films add along z otherwise than as drawn, as they move, over that of
        films of which nothing was measured; shape (n,).

        Parameters
        ----------
        topology : Topology
            With what a tare has measured.
        """
        p, prior, rest_ut = topology.parameters, self._prior, self._stencil.rest_ut[2]
        seen = _believed(topology, rest_ut, self._stencil.rest_sigma_ut[2] ** 2)
        before = np.einsum("nk,kl,nl->n", self._moving, prior, self._moving)
        if not seen.any() or not (before > 0.0).any():
            return np.ones(topology.n)
        matrix = np.hstack([self._rest, self._ambient])[seen]
        weight = 1.0 / (p["axial_rest_sigma_ut"] ** 2 + self._noise_ut2)[seen]
        off_ut = (p["axial_rest_ut"] - rest_ut)[seen]
        covariance = AMBIENT_UT2 * np.eye(ORDERS + 3)
        covariance[:ORDERS, :ORDERS] = prior
        normal = (matrix.T * weight) @ matrix
        found = np.linalg.solve(np.eye(len(covariance)) + covariance @ normal, covariance)
        mean = (found @ (matrix.T * weight) @ off_ut)[:ORDERS]
        square = found[:ORDERS, :ORDERS] + np.outer(mean, mean)
        after = np.einsum("nk,kl,nl->n", self._moving, square, self._moving)
        return after / np.where(before > 0.0, before, 1.0)


def _moving(topology: Topology) -> np.ndarray:
    """Change along z, by multipole, that films within `NEAR_M` make at each chip in the mean over
    the range of a scan, side by side as on a flat skin, µT, shape (n, ORDERS)."""
    i, j = near(topology, NEAR_M)
    at, by = np.concatenate([i, j]), np.concatenate([j, i])
    if not at.size:
        return np.zeros((topology.n, ORDERS))
    d = 1e3 * np.linalg.norm(topology.position[:, at] - topology.position[:, by], axis=0)
    moved, share = scan_poses(DEPTH_MAX_MM, DISPLACEMENT_MAX_MM)
    distance = np.geomspace(d.min(), d.max() + STEP_MM, DISTANCES)
    still = np.zeros((3, DISTANCES, 1))
    still[0, :, 0], still[2] = distance, load_film_table().film.chip_mm
    change = multipole_field(still - moved.T[:, np.newaxis]) - multipole_field(still)
    table = change[:, 2] @ share * distance**4
    strength = topology.parameters["field_amplitude_ut"][by]
    out = np.zeros((topology.n, ORDERS))
    for k, row in enumerate(table):
        each = strength * np.interp(d, distance, row) / d**4
        out[:, k] = np.bincount(at, each, minlength=topology.n)
    return out


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
