"""How films differ from the drawing: errors of fabrication, unit by unit, from a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Fabrication"]


SECTOR_ANGLE_DEG, SECTOR_STRENGTH, CENTRE_MM, TILT_DEG = 2.0, 0.05, 0.1, 1.0
"""Bounds within which every error lies, evenly spread [assumed]: turn of each sector about the
film's middle, away from its place; share by which its remanence is off; offset of the film from the
chip's axis, along x and along y; tilt of the film about x and about y."""


@dataclass(frozen=True, eq=False)
class Fabrication:
    """The films of n units as they were made.

    Attributes
    ----------
    sector_angle_rad, sector_strength : ndarray, shape (n, sectors)
        Turn from its place, and factor of the remanence, of each sector.
    centre_mm : ndarray, shape (2, n)
        Middle of the unloaded film, unit frame.
    tilt_rad : ndarray, shape (2, n)
        Rotation vector of the unloaded film, unit frame.
    """

    sector_angle_rad: np.ndarray
    sector_strength: np.ndarray
    centre_mm: np.ndarray
    tilt_rad: np.ndarray

    @classmethod
    def perfect(cls, n: int, sectors: int = 16) -> Fabrication:
        """n films as drawn."""
        return cls(
            np.zeros((n, sectors)), np.ones((n, sectors)), np.zeros((2, n)), np.zeros((2, n))
        )

    @classmethod
    def draw(cls, n: int, seed: int, sectors: int = 16) -> Fabrication:
        """n films with errors; unit i is the same for every n > i.

        Examples
        --------
        >>> few, many = Fabrication.draw(2, seed=7), Fabrication.draw(9, seed=7)
        >>> bool((few.centre_mm == many.centre_mm[:, :2]).all())
        True
        """
        errors = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 2 * sectors + 4))
        angle, strength, centre, tilt = np.split(
            errors, [sectors, 2 * sectors, 2 * sectors + 2], axis=1
        )
        return cls(
            np.radians(SECTOR_ANGLE_DEG) * angle,
            1.0 + SECTOR_STRENGTH * strength,
            np.ascontiguousarray(CENTRE_MM * centre.T),
            np.ascontiguousarray(np.radians(TILT_DEG) * tilt.T),
        )

    def coefficients(self, orders: np.ndarray) -> np.ndarray:
        """Fourier coefficients of the sectors, shape (n, orders), complex; see `FilmTable`."""
        sectors = self.sector_angle_rad.shape[1]
        angle = 2.0 * np.pi / sectors * np.arange(sectors) + self.sector_angle_rad
        turned = np.exp(-1j * orders[:, np.newaxis] * angle[:, np.newaxis, :])
        return np.mean(self.sector_strength[:, np.newaxis, :] * turned, axis=-1)
