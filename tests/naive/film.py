"""The film's field as a sum of many small dipoles: slow, obvious, and no magpylib in it."""

import numpy as np


def film_dipoles(film):
    """Places (3, d) in mm and moments (3, d) in µT mm³ (times mu0 / 4 pi) of a film's grains.

    Grains lie on rings, each ring's in the middle of equal slices, over the true circle.
    """
    rings, around, layers = 60, 24, 6
    radius = film.radius_mm * (np.arange(rings) + 0.5) / rings
    slices = film.sectors * around
    angle = 2.0 * np.pi * (np.arange(slices) + 0.5) / slices - np.pi / film.sectors
    height = film.thickness_mm * ((np.arange(layers) + 0.5) / layers - 0.5)
    rho, phi, z = (grid.ravel() for grid in np.meshgrid(radius, angle, height, indexing="ij"))
    volume = rho * (film.radius_mm / rings) * (2.0 * np.pi / slices) * film.thickness_mm / layers
    axis = 2.0 * np.pi / film.sectors * np.round(phi * film.sectors / (2.0 * np.pi))
    phase = 2.0 * np.pi * rho * np.cos(phi - axis) / film.wavelength_mm
    polarisation = np.stack(
        [-np.sin(phase) * np.cos(axis), -np.sin(phase) * np.sin(axis), np.cos(phase)]
    )
    place = np.stack([rho * np.cos(phi), rho * np.sin(phi), z])
    return place, 1e6 * film.remanence_t * polarisation * volume / (4.0 * np.pi)


def dipole_sum_ut(film, points_mm):
    """Field at points (3, p), µT, film frame."""
    place, moment = film_dipoles(film)
    field = np.empty(points_mm.shape)
    for i, point in enumerate(points_mm.T):
        offset = point[:, np.newaxis] - place
        r2 = np.sum(offset**2, axis=0)
        along = 3.0 * np.sum(moment * offset, axis=0) / r2
        field[:, i] = np.sum((along * offset - moment) / r2**1.5, axis=1)
    return field
