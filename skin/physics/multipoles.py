"""The field of a film outside the film, as a few multipoles on its axis.

A film looks the same from every side, so its field outside the sphere around it is a sum of axial
multipoles, ``Phi = sum over l of a_l P_l(cos theta) / r^(l + 1)``, of any material. At 12 mm
six of them describe the field of films of any radius, wavelength, thickness and remanence profile
within 0.1 % of the film's own (`tests/skin/physics/test_multipoles.py`). These few numbers, one set
for all films of a skin, are what a stencil from magnet theory can be wrong in.
"""

from __future__ import annotations

import functools
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.special import eval_legendre

from skin.physics.film_table import load_film_table

__all__ = ["ORDERS", "STRENGTH", "FilmDrawing", "films_as_made", "multipole_field"]

ORDERS = 8
"""Multipoles, from the dipole on: each is half to two thirds of the one before at 12 mm."""
SCALE_MM = 6.0
"""Length in which the multipoles are given: the film's radius, so that they are alike in size."""
NODES = 8
"""Of the quadratures over a film, a sector and the thickness: exact to 1e-6 here."""


@dataclass(frozen=True)
class FilmDrawing:
    """What a film is drawn by; its polarisation as of `skin.physics.film_table.Film`."""

    radius_mm: float
    thickness_mm: float
    wavelength_mm: float
    sectors: float
    falloff: float = 0.0
    """Share that the remanence loses from the middle to the rim, as the square of the radius."""


TOLERANCE = FilmDrawing(0.05, 0.2, 0.05, 0.25, 0.2)
"""One sigma, as a share; of the falloff as it is [assumed: a stamped film of a filled silicone,
magnetised sector by sector]."""
STRENGTH = 0.02
"""One sigma of a film's stray field over its own, from film to film [assumed]."""
BESIDE = 0.02
"""One sigma of every multipole by all else, as a share of the root mean square of all of them
[assumed]."""


def multipole_field(points_mm: np.ndarray) -> np.ndarray:
    """Field of each multipole.

    Parameters
    ----------
    points_mm : ndarray, shape (3, ...)
        From the middle of the film, film frame, outside the film.

    Returns
    -------
    ndarray, shape (ORDERS, 3, ...)
        µT for a multipole of 1 µT: what its field is of, `SCALE_MM` from the middle.
    """
    across2 = points_mm[0] ** 2 + points_mm[1] ** 2
    r = np.sqrt(across2 + points_mm[2] ** 2)
    u, sine2 = points_mm[2] / r, np.maximum(across2 / r**2, 1e-12)
    legendre = [eval_legendre(order, u) for order in range(ORDERS + 2)]
    out = np.empty((ORDERS, *points_mm.shape))
    for k in range(ORDERS):
        n = k + 2
        size = (SCALE_MM / r) ** (n + 1)
        slope = n * (legendre[n - 1] - u * legendre[n]) / sine2
        out[k, :2] = size * slope / r * points_mm[:2]
        out[k, 2] = n * size * legendre[n]
    return out


@functools.cache
def films_as_made() -> tuple[np.ndarray, np.ndarray]:
    """Multipoles of a film whose own crest M0(H = 2 mm) is 1 µT, and how they differ.

    Returns
    -------
    mean : ndarray, shape (ORDERS,)
        Of the film as drawn, whose table the stencils are made of.
    covariance : ndarray, shape (ORDERS, ORDERS)
        To first order in each of `TOLERANCE`, and `BESIDE`.
    """
    film = load_film_table().film
    drawn = FilmDrawing(film.radius_mm, film.thickness_mm, film.wavelength_mm, film.sectors)
    mean = _multipoles(drawn)
    covariance = BESIDE**2 * np.mean(mean**2) * np.eye(ORDERS)
    for name, share, value in zip(
        FilmDrawing.__dataclass_fields__, astuple(TOLERANCE), astuple(drawn), strict=True
    ):
        step = share * (value or 1.0)
        high, low = (replace(drawn, **{name: value + sign * step}) for sign in (1.0, -1.0))
        change = 0.5 * (_multipoles(high) - _multipoles(low))
        covariance += np.outer(change, change)
    mean.flags.writeable = covariance.flags.writeable = False
    return mean, covariance


def _multipoles(film: FilmDrawing) -> np.ndarray:
    """``a_l = integral of J . grad(r^l P_l) / 4 pi``, the own crest being 1 µT; shape (ORDERS,)."""
    up = load_film_table().film.chip_mm - 2.0
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    rho, z = 0.5 * film.radius_mm * (nodes + 1.0), 0.5 * film.thickness_mm * nodes
    aside = np.pi / film.sectors * nodes  # from the axis of a sector
    rho, aside, z = np.meshgrid(rho, aside, z, indexing="ij")
    volume = np.einsum("i,j,k->ijk", weights, weights, weights) * rho
    remanence = volume * (1.0 - film.falloff * (rho / film.radius_mm) ** 2)
    phase = 2.0 * np.pi * rho * np.cos(aside) / film.wavelength_mm
    # the mean around the axis, of a sector as of all
    along, inward = remanence * np.cos(phase), -remanence * np.sin(phase) * np.cos(aside)
    r = np.hypot(rho, z)
    u = z / r
    out = np.empty(ORDERS)
    for k in range(ORDERS):
        n = k + 1
        lower, here = eval_legendre(n - 1, u), eval_legendre(n, u)
        # d/dz and d/drho of r^n P_n(z / r)
        up_slope = n * r ** (n - 1) * lower
        out_slope = n * r ** (n - 1) * (here - u * lower) * r / rho
        out[k] = np.sum(along * up_slope + inward * out_slope) / SCALE_MM ** (n + 2)
    return out / _crest(film, up)


def _crest(film: FilmDrawing, up_mm: float) -> float:
    """Crest of the lateral field of a film of remanence 1 at a height, in the unit of the
    integrals."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * NODES)
    rho, ring = 0.5 * film.radius_mm * (nodes + 1.0), np.arange(8 * NODES) * np.pi / (4 * NODES)
    aside = np.pi / film.sectors * nodes
    phase = 2.0 * np.pi * np.outer(rho, np.cos(aside)) / film.wavelength_mm
    size = weights * rho * (1.0 - film.falloff * (rho / film.radius_mm) ** 2) / ring.size
    along = 0.5 * size * (np.cos(phase) @ weights)
    outward = -0.5 * size * ((np.sin(phase) * np.cos(aside)) @ weights)
    x = np.linspace(1.5, 3.5, 41)[:, np.newaxis, np.newaxis, np.newaxis]
    rho, ring, z = np.meshgrid(rho, ring, 0.5 * film.thickness_mm * nodes, indexing="ij")
    between = x - rho * np.cos(ring), -rho * np.sin(ring), up_mm - z
    r2 = sum(part**2 for part in between)
    moment_x = outward[:, np.newaxis, np.newaxis] * np.cos(ring) * weights
    moment_y = outward[:, np.newaxis, np.newaxis] * np.sin(ring) * weights
    moment_z = along[:, np.newaxis, np.newaxis] * weights
    along_r = moment_x * between[0] + moment_y * between[1] + moment_z * between[2]
    lateral = (3.0 * along_r * between[0] / r2 - moment_x) / r2**1.5
    return float(np.abs(lateral.sum(axis=(1, 2, 3))).max()) * 2.0
