"""The field of a film as a sum of dipoles, tabled in cylinder coordinates.

Nothing here comes from the simulator or the decoder. A film is a disc of sectors, each magnetised
along its axis as a Halbach array, ``(-sin kr, cos kr)`` with ``k = 2 pi / wavelength``, whose
strong side looks along +z. The sum over grains of a disc of many sectors has no angle in it but for
the harmonic of the sectors' number: the tables hold its mean over one sector.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import RectBivariateSpline

__all__ = ["DRAWN", "FILMS", "STRONG", "WEAK", "Film", "field_of", "grains", "sum_of_dipoles"]

MU0_OVER_4PI = 1e-7
UT = 1e6
RINGS, SLICES, LAYERS = 16, 96, 3
CHUNK = 256


@dataclass(frozen=True)
class Film:
    """One way to make films. Lengths in millimetre; `gap_mm` from its near face to the chip.

    Attributes
    ----------
    remanence_t : float
        Tesla; units differ from it, each by a factor of its own.
    """

    radius_mm: float = 6.0
    thickness_mm: float = 0.5
    wavelength_mm: float = 10.6
    sectors: int = 16
    remanence_t: float = 0.2118
    gap_mm: float = 4.2

    @property
    def up_mm(self) -> float:
        """From the middle of the film to the chip, at rest."""
        return self.gap_mm + 0.5 * self.thickness_mm


DRAWN = Film()
STRONG = Film(radius_mm=6.2, wavelength_mm=10.4, sectors=24)
WEAK = Film(radius_mm=5.7, wavelength_mm=11.0, gap_mm=4.4)
"""Films that no theory of the decoder knows: their stray field at a neighbour 12 mm away is 1.27
and 0.76 times that of the film as drawn, their own being the same [derived: this sum]."""
FILMS = {"drawn": DRAWN, "strong": STRONG, "weak": WEAK}


def grains(film: Film) -> tuple[np.ndarray, np.ndarray]:
    """Places, mm, and moments, A m², of the dipoles; shape (3, d) each."""
    r = film.radius_mm * (np.arange(RINGS) + 0.5) / RINGS
    phi = 2.0 * np.pi * (np.arange(SLICES) + 0.5) / SLICES
    z = film.thickness_mm * ((np.arange(LAYERS) + 0.5) / LAYERS - 0.5)
    r, phi, z = (each.ravel() for each in np.meshgrid(r, phi, z, indexing="ij"))
    width = 2.0 * np.pi / film.sectors
    axis = width * (np.floor(phi / width) + 0.5)
    phase = 2.0 * np.pi / film.wavelength_mm * r * np.cos(phi - axis)
    volume_mm3 = r * film.radius_mm / RINGS * 2.0 * np.pi / SLICES * film.thickness_mm / LAYERS
    moment = film.remanence_t / (4e-7 * np.pi) * 1e-9 * volume_mm3
    way = np.stack([-np.sin(phase) * np.cos(axis), -np.sin(phase) * np.sin(axis), np.cos(phase)])
    return np.stack([r * np.cos(phi), r * np.sin(phi), z]), moment * way


def sum_of_dipoles(points_mm: np.ndarray, place_mm: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Field of dipoles, µT, at points, shape (3, p): mu0 / 4 pi (3 (m r) r / r^5 - m / r^3)."""
    out = np.empty(points_mm.shape)
    for start in range(0, points_mm.shape[1], CHUNK):
        part = slice(start, start + CHUNK)
        x, y, z = (1e-3 * (points_mm[a, part, np.newaxis] - place_mm[a]) for a in range(3))
        square = x * x + y * y + z * z
        third = 1.0 / (square * np.sqrt(square))
        along = 3.0 * (moment[0] * x + moment[1] * y + moment[2] * z) / square
        for a, way in enumerate((x, y, z)):
            out[a, part] = np.sum((along * way - moment[a]) * third, axis=1)
    return UT * MU0_OVER_4PI * out


class _Tables:
    """Radial and axial field by distance from the axis and height, in three regions."""

    REGIONS = (
        (np.linspace(0.0, 12.0, 61), np.linspace(1.0, 12.0, 56)),
        (np.linspace(0.0, 60.0, 61), np.linspace(11.0, 60.0, 50)),
        (np.linspace(7.5, 60.0, 106), np.linspace(-60.0, 12.5, 117)),
    )

    def __init__(self, film: Film) -> None:
        place, moment = grains(film)
        self._splines = []
        # an axis and the border of a sector: their mean has no first harmonic of the sectors
        angles = (0.0, np.pi / film.sectors)
        for r, z in self.REGIONS:
            at_r, at_z = (each.ravel() for each in np.meshgrid(r, z, indexing="ij"))
            radial, axial = 0.0, 0.0
            for angle in angles:
                c, s = np.cos(angle), np.sin(angle)
                seen = sum_of_dipoles(np.stack([c * at_r, s * at_r, at_z]), place, moment)
                radial = radial + (c * seen[0] + s * seen[1]) / len(angles)
                axial = axial + seen[2] / len(angles)
            shape = r.size, z.size
            self._splines.append([RectBivariateSpline(r, z, each.reshape(shape))
                                  for each in (radial, axial)])  # fmt: skip

    def __call__(self, points_mm: np.ndarray) -> np.ndarray:
        x, y, z = points_mm
        r = np.hypot(x, y)
        which = np.where(z > 12.0, 1, np.where((r < 12.0) & (z >= 1.0), 0, 2))
        if np.any((which == 2) & (r < 7.5)) or r.max(initial=0.0) > 60.0:
            raise ValueError("a chip must be before the film or beside it, within 60 mm")
        radial, axial = np.empty(r.shape), np.empty(r.shape)
        for region, (of_radial, of_axial) in enumerate(self._splines):
            at = which == region
            radial[at] = of_radial.ev(r[at], z[at])
            axial[at] = of_axial.ev(r[at], z[at])
        share = np.divide(radial, r, out=np.zeros(r.shape), where=r > 1e-9)
        return np.stack([share * x, share * y, axial])


@cache
def _tables(film: Film) -> _Tables:
    return _Tables(film)


def field_of(film: Film, points_mm: np.ndarray) -> np.ndarray:
    """Field of a film at points of its frame, µT, shape (3, p)."""
    return _tables(film)(points_mm)
