"""The films of the benchmark are what they are called, and no part of the product."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy_skin import square
from benchmarks.films_truth import STRAY_SHARE, DipoleField, FilmShape, dipole_sum_python
from skin.physics.halbach import HalbachField

DRAWN = FilmShape(6.0, 0.5, 10.6, 16, 0.0)


def test_the_drawn_film_is_that_of_the_simulator_by_another_way():
    skin = square(2, 0.012)
    rng = np.random.default_rng(0)
    displacement, depth = rng.uniform(-1.5, 1.5, (5, 2, 4)), rng.uniform(0.0, 2.0, (5, 4))
    room = np.full(depth.shape, 30.0)
    sums = DipoleField(skin, DRAWN, alone=False)(displacement, depth, room)
    table = HalbachField(skin, reach_m=1.0)(displacement, depth, room)
    assert np.abs(sums - table).max() < 0.01 * np.abs(table).max()


def test_films_are_drawn_with_the_stray_fields_that_are_stated():
    rng = np.random.default_rng(1)
    shares = [FilmShape.draw(rng).stray_share for _ in range(12)]
    assert STRAY_SHARE[0] <= min(shares) < 0.9
    assert 1.0 < max(shares) <= STRAY_SHARE[1]
    assert DRAWN.stray_share == pytest.approx(1.0, abs=1e-3)


def test_a_sum_of_one_dipole_is_the_field_of_a_dipole():
    points, moment = np.array([[0.0, 2.0], [0.0, 0.0], [2.0, 0.0]]), np.array([[0.0], [0.0], [1.0]])
    out = np.empty((3, 2))
    dipole_sum_python(points, np.zeros((3, 1)), moment, out)
    assert out[2] == pytest.approx([2.0 / 8.0, -1.0 / 8.0])
