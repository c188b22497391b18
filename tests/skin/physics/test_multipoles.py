"""Multipoles of films: against sums of dipoles, which know nothing of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.physics.film_table import load_film_table
from skin.physics.multipoles import ORDERS, films_as_made, multipole_field
from skin.physics.stray import scan_poses
from tests.fixtures.film import grains, sum_of_dipoles

FILMS = {
    "as drawn": {},
    "small": {"radius_mm": 5.2, "wavelength_mm": 9.8},
    "thick, of eight sectors": {"thickness_mm": 0.9, "sectors": 8},
}


def crest_ut(film):
    away = np.linspace(1.5, 3.5, 21)
    up = np.full(21, load_film_table().film.chip_mm - 2.0)
    return np.abs(sum_of_dipoles(np.stack([away, 0.0 * away, up]), *grains(film))[0]).max()


def around(pitch_mm, count=12):
    moved = scan_poses(2.0, 2.5)[0][:: 366 // count]
    return np.array([[pitch_mm], [0.0], [load_film_table().film.chip_mm]]) - moved.T


@pytest.mark.parametrize("name", FILMS)
def test_a_few_multipoles_tell_the_field_of_any_film_at_its_neighbours(name):
    film = dataclasses.replace(load_film_table().film, **FILMS[name])
    points = np.concatenate([around(12.0), around(17.0)], axis=1)
    field = sum_of_dipoles(points, *grains(film)) / crest_ut(film) * 11073.0
    basis = multipole_field(points)[:6].reshape(6, -1).T
    found = basis @ np.linalg.lstsq(basis, field.ravel(), rcond=None)[0]
    assert np.sqrt(np.mean((found - field.ravel()) ** 2)) < 1e-3 * np.abs(field).max()


def test_the_mean_of_films_as_made_is_the_film_as_drawn():
    mean, covariance = films_as_made()
    film, points = load_film_table().film, around(12.0)
    field = sum_of_dipoles(points, *grains(film)) / crest_ut(film)
    found = np.einsum("k,kap->ap", mean, multipole_field(points))
    # eight orders at 9.5 mm: what is left out is a series in 0.6
    assert np.abs(found - field).max() < 0.6**ORDERS * 2.5 * np.abs(field).max()
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert covariance.shape == (ORDERS, ORDERS)


def test_stray_sigma_of_a_unit_model_is_that_of_films_as_made():
    """The derivation of its default: a quarter, at rest and moved, from 12 to 17 mm."""
    from topology.model import UnitModel

    mean, covariance = films_as_made()
    moved, share = scan_poses(2.0, 2.5)
    for pitch in (12.0, 15.0, 17.0):
        up = load_film_table().film.chip_mm
        each = multipole_field(np.array([[pitch], [0.0], [up]]) - moved.T)
        for field, weight in ((each[..., :1], np.ones(1)), (each - each[..., :1], share)):
            size = np.einsum("k,kap->ap", mean, field) ** 2 @ weight
            spread = np.einsum("kap,kl,lap->ap", field, covariance, field) @ weight
            found = np.sqrt(spread.sum() / size.sum())
            assert found == pytest.approx(UnitModel().stray_sigma_relative, abs=0.03)


def test_the_field_of_a_multipole_has_no_divergence_and_no_curl():
    at, step = np.array([[9.0], [4.0], [3.0]]), 1e-4
    slope = np.stack([
        (multipole_field(at + step * axis[:, None]) - multipole_field(at - step * axis[:, None]))
        [..., 0] / (2.0 * step)
        for axis in np.eye(3)
    ], axis=-1)  # fmt: skip
    size = np.abs(slope).max(axis=(1, 2))
    assert (np.abs(np.trace(slope, axis1=1, axis2=2)) < 1e-6 * size).all()
    assert (np.abs(slope - slope.transpose(0, 2, 1)).max(axis=(1, 2)) < 1e-6 * size).all()
