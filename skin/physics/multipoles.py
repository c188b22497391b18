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
NODES = 16
"""Of the quadratures over a film, a sector and the thickness: exact to 1e-6 here."""
RING = np.arange(64) * np.pi / 32
"""Azimuths of the dipoles of a ring."""


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
    rho, z, outward, up = rings = _rings(film)
    r = np.hypot(rho, z)
    u = z / r
    out = np.empty(ORDERS)
    for k in range(ORDERS):
        n = k + 1
        lower, here = eval_legendre(n - 1, u), eval_legendre(n, u)
        # d/dz and d/drho of r^n P_n(z / r)
        up_slope = n * r ** (n - 1) * lower
        out_slope = n * r ** (n - 1) * (here - u * lower) * r / rho
        out[k] = np.sum(up * up_slope + outward * out_slope) / SCALE_MM ** (n + 2)
    return out / _crest(*rings)


def _rings(film: FilmDrawing) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rings of dipoles, which stand for a film of remanence 1 smeared around its axis: radius and
    height, mm, and moment outward and up; shape (rings,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    rho, z = 0.5 * film.radius_mm * (nodes + 1.0), 0.5 * film.thickness_mm * nodes
    aside = np.pi / film.sectors * nodes  # from the axis of a sector
    phase = 2.0 * np.pi * np.outer(rho, np.cos(aside)) / film.wavelength_mm
    size = weights * rho * (1.0 - film.falloff * (rho / film.radius_mm) ** 2)
    outward = -size * ((np.sin(phase) * np.cos(aside)) @ weights)
    up = size * (np.cos(phase) @ weights)
    rho, z = np.meshgrid(rho, z, indexing="ij")
    return rho.ravel(), z.ravel(), np.outer(outward, weights).ravel(), np.outer(up, weights).ravel()


def _crest(rho: np.ndarray, z: np.ndarray, outward: np.ndarray, up: np.ndarray) -> float:
    """Largest lateral field of rings at the chip of a film 2 mm deep, in the unit of their
    moments."""
    c, s = np.cos(RING)[:, np.newaxis], np.sin(RING)[:, np.newaxis]
    x = np.linspace(1.5, 3.5, 41)[:, np.newaxis, np.newaxis]
    across, height = x - rho * c, load_film_table().film.chip_mm - 2.0 - z
    r2 = across**2 + (rho * s) ** 2 + height**2
    along_r = outward * c * across - outward * s * rho * s + up * height
    lateral = (3.0 * along_r * across / r2 - outward * c) / r2**1.5
    return float(np.abs(lateral.sum(axis=(1, 2))).max()) / RING.size
