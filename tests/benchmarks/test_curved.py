"""Films on a curve: flat ones are decoded, bent ones read too much, the more the tighter."""

import numpy as np

from benchmarks.curved import _field
from skin.physics.film_table import load_film_table
from skin.physics.halbach import HalbachField
from tests.fixtures.decode import row_of


def test_the_flat_film_of_dipoles_is_that_of_the_simulator_s_table():
    film, depth = load_film_table().film, np.array([0.0, 1.0, 2.0])
    place = np.array([[0.5, 1.5, -2.0], [0.0, 1.0, 0.5]])
    table = HalbachField(row_of(1), reach_m=0.0)
    for k in range(3):
        told = table(place[:, k : k + 1], depth[k : k + 1], np.full(1, 25.0))[:, 0]
        found = _field(film, place[:, k : k + 1], depth[k : k + 1], np.inf)[0]
        scale = np.linalg.norm(told) / np.linalg.norm(found)
        np.testing.assert_allclose(scale * found, told, atol=0.005 * np.linalg.norm(told))


def test_a_bend_strengthens_the_field_across_more_than_along():
    film = load_film_table().film
    place, depth = np.array([[1.5, 0.0], [0.0, 1.5]]), np.zeros(2)
    flat, wide, bent = (_field(film, place, depth, radius) for radius in (np.inf, 1e6, 20.0))
    np.testing.assert_allclose(wide, flat, atol=1e-4 * np.abs(flat).max())
    angle = [np.arctan2(np.abs(f[[0, 1], [0, 1]]), f[:, 2]) for f in (flat, bent)]
    across, along = angle[1] / angle[0]
    assert across > along > 1.0
