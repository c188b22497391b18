"""The film's field from magnet theory alone, and its table: ``python -m tests.naive.magnets``.

Every strip of every sector is a uniformly polarised prism, whose field magpylib knows in closed
form; the simulator interpolates the table that this file makes of it and that ships with it.
"""

from __future__ import annotations

import functools
from dataclasses import asdict, astuple, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import magpylib
import numpy as np

from skin.physics.film_table import ARRAYS, AXES, TABLE_PATH, Axis, Film, FilmTable
from topology.files import whole_file

__all__ = ["build_table", "calibrated", "film_field_ut", "save"]

AMPLITUDE_UT = 11073.0
"""M0 at H = 2 mm, which fixes the remanence [derived]."""

REFERENCE_MM = 2.0

RHO = Axis(0.0, 0.15, 52)
Z = Axis(0.55, 0.15, 49)
NEAR_ORDERS = (*range(11), 16, 32)
"""What errors of sectors cause, and the pattern of the 16 sectors themselves."""

INVERSE_R = Axis(0.01, 0.0042, 30)
THETA = Axis(0.0, np.pi / 90.0, 91)
FAR_ORDERS = (0, 1, 2, 3, 16)

NEAR_AZIMUTHS, FAR_AZIMUTHS = 96, 48
"""Around the circle: the highest order's first alias is twice as high, and far weaker."""


def film_field_ut(
    film: Film,
    points_mm: np.ndarray,
    *,
    sector_angle_rad: np.ndarray | float = 0.0,
    sector_strength: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Field of a whole film, µT, film frame, shape (3, p).

    Parameters
    ----------
    film : Film
    points_mm : ndarray, shape (3, p)
        Film frame, outside the film.
    sector_angle_rad, sector_strength : ndarray, shape (sectors,)
        How far each sector is turned about the film's middle from its place, and the factor of its
        remanence.
    """
    place = 2.0 * np.pi / film.sectors * np.arange(film.sectors)
    field = np.zeros(points_mm.shape)
    for angle, strength in np.broadcast(place + sector_angle_rad, sector_strength):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        field += strength * (turn @ sector_field_ut(film, turn.T @ points_mm))
    return field


def sector_field_ut(film: Film, points_mm: np.ndarray) -> np.ndarray:
    """Field of the sector that points along x, µT, shape (3, p); see `film_field_ut`."""
    prisms = list(_strips(film))
    field = magpylib.getB(prisms, points_mm.T, sumup=True, in_out="outside")
    return 1e6 * field.reshape(-1, 3).T


@functools.cache
def _strips(film: Film) -> tuple[Any, ...]:
    """A sector's strips, which lie across its axis, as bodies of magpylib, in mm and T.

    The sector is a triangle with the apex in the film's middle; its height makes it as large as
    its slice of the circle.
    """
    slope = np.tan(np.pi / film.sectors)
    height = film.radius_mm * np.sqrt(np.pi / (film.sectors * slope))
    half = 0.5 * film.thickness_mm
    prisms = []
    for inner, outer in pairwise(np.linspace(0.0, height, film.strips + 1)):
        outline = {(x, side * slope * x) for x in (inner, outer) for side in (-1.0, 1.0)}
        corners = [(x, y, z) for x, y in sorted(outline) for z in (-half, half)]
        phase = np.pi * (inner + outer) / film.wavelength_mm
        polarization = film.remanence_t * np.array([-np.sin(phase), 0.0, np.cos(phase)])
        body = magpylib.magnet.TriangularMesh.from_ConvexHull(
            points=corners, polarization=polarization
        )
        prisms.append(body)
    return tuple(prisms)


def calibrated(film: Film) -> Film:
    """The film with the remanence that makes its lateral field crest at `AMPLITUDE_UT`."""
    lateral = np.linspace(2.0, 3.0, 201)
    height = np.full_like(lateral, film.chip_mm - REFERENCE_MM)
    points = np.stack([lateral, np.zeros_like(lateral), height])
    crest = film_field_ut(replace(film, remanence_t=1.0), points)[0].max()
    return replace(film, remanence_t=AMPLITUDE_UT / crest)


def build_table(film: Film) -> FilmTable:
    """Tabulate the field of a film."""
    near_grid = np.meshgrid(RHO.nodes, Z.nodes, _half_circle(NEAR_AZIMUTHS), indexing="ij")
    far_grid = np.meshgrid(INVERSE_R.nodes, THETA.nodes, _half_circle(FAR_AZIMUTHS), indexing="ij")

    def fields(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        points = np.stack([x, y, z]).reshape(3, -1)
        return sector_field_ut(film, points).reshape(3, *x.shape)

    rho, z, phi = near_grid
    c, s = np.cos(phi), np.sin(phi)
    bx, by, bz = fields(rho * c, rho * s, z)
    near = _harmonics(film, (bx * c + by * s, bz, by * c - bx * s), NEAR_ORDERS)

    inverse_r, theta, phi = far_grid
    r, ct, st, c, s = 1.0 / inverse_r, np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    bx, by, bz = r**3 * fields(r * st * c, r * st * s, r * ct)
    outward = bx * c + by * s
    far = _harmonics(
        film, (outward * st + bz * ct, outward * ct - bz * st, by * c - bx * s), FAR_ORDERS
    )
    return FilmTable(
        film=film, rho=RHO, z=Z, near_orders=np.array(NEAR_ORDERS), near=near,
        inverse_r=INVERSE_R, theta=THETA, far_orders=np.array(FAR_ORDERS), far=far,
    )  # fmt: skip


def _half_circle(azimuths: int) -> np.ndarray:
    return 2.0 * np.pi / azimuths * np.arange(azimuths // 2 + 1)


def _harmonics(
    film: Film, components: tuple[np.ndarray, ...], orders: tuple[int, ...]
) -> np.ndarray:
    """Fourier series in the azimuth, shape (a, b, 3, orders), of all sectors in phase.

    A sector is its own mirror image, so that half a circle, the last axis of each component, is
    the whole: the first two components are even in the azimuth, the third is odd.
    """
    first, second, third = components
    even = [np.concatenate([f, f[..., -2:0:-1]], axis=-1) for f in (first, second)]
    odd = np.concatenate([third, -third[..., -2:0:-1]], axis=-1)
    scale = np.where(np.array(orders) == 0, 1.0, 2.0) * film.sectors / odd.shape[-1]
    cosines = [np.fft.rfft(f, axis=-1).real[..., orders] for f in even]
    sines = -np.fft.rfft(odd, axis=-1).imag[..., orders]
    return np.ascontiguousarray(scale * np.stack([*cosines, sines], axis=-2), np.float32)


def save(table: FilmTable, path: Path, **origin: Any) -> None:
    """Write a table to `path`, whole or not at all, with the `origin` of its numbers."""
    axes = {f"axis_{name}": np.array(astuple(getattr(table, name))) for name in AXES}
    film = {f"film_{name}": value for name, value in asdict(table.film).items()}
    arrays = {name: getattr(table, name) for name in ARRAYS}
    with whole_file(path) as out:
        np.savez_compressed(out, **origin, **arrays, **axes, **film)


if __name__ == "__main__":
    source = f"magpylib {magpylib.__version__}"
    save(build_table(calibrated(Film())), TABLE_PATH, amplitude_ut=AMPLITUDE_UT, source=source)
