"""What a bench commands and reads: the recordings that calibration fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Recordings", "Scan", "strokes"]


@dataclass(frozen=True, eq=False)
class Scan:
    """What a bench commanded and read, t poses of n units.

    A recording of a real bench is the same arrays; the fits take any of them, a unit at a time:
    ``scan.field_ut[..., i]``.

    Attributes
    ----------
    depth_mm : ndarray, shape (t, n)
        Commanded depth H.
    displacement_mm : ndarray, shape (t, n)
        Commanded tangential displacement R >= 0.
    direction_rad : ndarray, shape (t, n)
        Its direction, unit frame.
    film_temperature, chip_temperature, gel_temperature : ndarray, shape (t, n)
        Degree Celsius.
    frequency_hz : ndarray, shape (t, n)
    field_ut : ndarray, shape (t, 3, n)
        As the chips report it.
    force_n : ndarray, shape (t, 2, n)
        Of the bench's reference cell: tangential along the direction, and normal.
    counts : ndarray, shape (t, c, n), int16
        The last reading of each pose, as on the wire.
    """

    depth_mm: np.ndarray
    displacement_mm: np.ndarray
    direction_rad: np.ndarray
    gel_temperature: np.ndarray
    film_temperature: np.ndarray
    chip_temperature: np.ndarray
    frequency_hz: np.ndarray
    field_ut: np.ndarray
    force_n: np.ndarray
    counts: np.ndarray


@dataclass(frozen=True, eq=False)
class Recordings:
    """What a bench records of the units of a skin, each unit alone; arrays as of `Scan`.

    Attributes
    ----------
    bare : Scan
        Chips before they have a film, heated.
    heated : Scan
        Films on, held in a few poses of different fields while film and chip are heated in turn;
        the gel is as warm as the film.
    pressed : Scan
        Straight down, from 0.
    sheared : Scan
        Strokes over depth, length and direction, each begun from rest.
    warmed : Scan
        Untouched, heated in small steps.
    readings : int
        Readings of which each sample is the mean.
    force_sigma_n : float
        Of the reference cell, one reading.
    """

    bare: Scan
    heated: Scan
    pressed: Scan
    sheared: Scan
    warmed: Scan
    readings: int
    force_sigma_n: float


def strokes(
    depths_mm: np.ndarray, displacements_mm: np.ndarray, directions_rad: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every depth with every displacement and direction: three arrays of shape (t,)."""
    depth, displacement, direction = np.meshgrid(
        depths_mm, displacements_mm, directions_rad, indexing="ij"
    )
    return depth.ravel(), displacement.ravel(), direction.ravel()
