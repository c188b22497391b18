"""Units that were calibrated flat and glued on a cylinder: what their bent films do to readings.

A film is a sum of dipoles here, along an arc of the mount's radius and the film's height above it;
grains turn with the arc, and the chip stays where it is. The flat film is calibrated by
`skin.calibrate.film`; the bent one is decoded by that calibration, and by the same with the gain of
a re-fit. Elastomer and capacitor are not bent: only what is magnetic is told.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.calibrate.bench.laws import displaced
from skin.calibrate.bench.spread import rms
from skin.calibrate.film import fit_film
from skin.physics.film_table import Film, load_film_table
from skin.physics.halbach import CHIP_AXES

RADII_MM = (10.0, 15.0, 20.0, 30.0, 50.0, 100.0)
HEIGHT_MM = 5.0
"""Of the film above the mount: the elastomer's layer [paper]."""
DEPTHS_MM = np.linspace(0.0, 2.0, 5)
REACH_MM = np.linspace(0.25, 2.75, 6)
SHEAR_N_PER_MM = 0.5


def run(quick: bool) -> dict[str, Any]:
    """Bend, decode and compare; see `table` for what the figures are."""
    film = load_film_table().film
    around = np.linspace(-np.pi, np.pi, 8 if quick else 16, endpoint=False)
    poses = np.meshgrid(DEPTHS_MM, REACH_MM, around, indexing="ij")
    depth, reach, direction = (each.ravel() for each in poses)
    place = reach * np.stack([np.cos(direction), np.sin(direction)])
    flat = _field(film, place, depth, np.inf)
    known = fit_film(flat, depth, reach, direction, sigma_ut=1.0, reading_ut=1.0).fit
    return {"poses": depth.size, "radii": {
        f"{radius:g}": _told(film, known, place, depth, radius) for radius in RADII_MM
    }}  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    heads = ("radius, mm", "error, µm", "gain across", "gain along", "after one gain, µm",
             "after two, µm", "force below 2 mm, mN")  # fmt: skip
    keys = ("rms_um", "gain_across", "gain_along", "left_one_um", "left_um", "force_mn")
    rows = ["".join(f"{head:>22}" for head in heads)]
    for radius, told in figures["radii"].items():
        rows.append(f"{radius:>22}" + "".join(f"{told[key]:>22.4g}" for key in keys))
    rows.append(
        f"{figures['poses']} poses to H = 2 mm, R = 2.75 mm, no noise; gains of the decoded "
        "displacement across and along the cylinder's axis"
    )
    return "\n".join(rows)


def _told(
    film: Film, known: Any, place: np.ndarray, depth: np.ndarray, radius_mm: float
) -> dict[str, float]:
    found = np.stack(displaced(known, _field(film, place, depth, radius_mm), depth))
    error = found - place
    gains = (found * place).sum(axis=1) / (place**2).sum(axis=1)
    left = found / gains[:, np.newaxis] - place
    near = np.hypot(*place) < 2.0
    return {
        "rms_um": 1e3 * rms(error),
        "gain_across": float(gains[0]),
        "gain_along": float(gains[1]),
        "left_one_um": 1e3 * rms(found / gains.mean() - place),
        "left_um": 1e3 * rms(left),
        "force_mn": 1e3 * SHEAR_N_PER_MM * rms(error[:, near]),
    }


def _field(film: Film, place: np.ndarray, depth: np.ndarray, radius_mm: float) -> np.ndarray:
    """Field at the chip for each pose, shape (t, 3), µT, axes of the chip."""
    grains, moment = _grains(film, radius_mm + HEIGHT_MM)
    chips = np.stack([-place[0], -place[1], film.chip_mm - depth])
    field = np.empty(chips.shape)
    for i, chip in enumerate(chips.T):
        offset = chip[:, np.newaxis] - grains
        square = (offset**2).sum(axis=0)
        along = 3.0 * (moment * offset).sum(axis=0) / square
        field[:, i] = ((along * offset - moment) / square**1.5).sum(axis=1)
    return (CHIP_AXES[:, np.newaxis] * field).T


def _grains(film: Film, arc_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Places, mm, and moments, µT mm³ over 4 pi, of a film bent about an axis along y."""
    rings, slices, layers = 40, 16 * film.sectors, 4
    radius = film.radius_mm * (np.arange(rings) + 0.5) / rings
    angle = 2.0 * np.pi * (np.arange(slices) + 0.5) / slices - np.pi / film.sectors
    height = film.thickness_mm * ((np.arange(layers) + 0.5) / layers - 0.5)
    rho, phi, z = (v.ravel() for v in np.meshgrid(radius, angle, height, indexing="ij"))
    volume = rho * film.radius_mm / rings * 2.0 * np.pi / slices * film.thickness_mm / layers
    axis = 2.0 * np.pi / film.sectors * np.round(phi * film.sectors / (2.0 * np.pi))
    phase = 2.0 * np.pi * rho * np.cos(phi - axis) / film.wavelength_mm
    x, y = rho * np.cos(phi), rho * np.sin(phi)
    pole = np.stack([-np.sin(phase) * np.cos(axis), -np.sin(phase) * np.sin(axis), np.cos(phase)])
    if np.isfinite(arc_mm):
        # z points to the chip, as the rim of a film on a convex mount does
        turn, out = x / arc_mm, arc_mm - z
        x, z = out * np.sin(turn), arc_mm - out * np.cos(turn)
        pole = np.stack([pole[0] * np.cos(turn) - pole[2] * np.sin(turn), pole[1],
                         pole[0] * np.sin(turn) + pole[2] * np.cos(turn)])  # fmt: skip
    return np.stack([x, y, z]), 1e6 * film.remanence_t * pole * volume / (4.0 * np.pi)
