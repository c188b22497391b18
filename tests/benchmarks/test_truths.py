"""What benchmarks take for the truth: the oracle, the plant and the half space, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.arrays import array_of, counts_of
from benchmarks.half_space import influence
from benchmarks.oracle import judge, walk
from benchmarks.recorded.eflesh import load
from benchmarks.recorded.noise import structure
from tests.fixtures.film import DRAWN, Film, field_of, grains, sum_of_dipoles
from tests.naive.mechanics import line_integral_rectangle


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
def test_oracles_of_40_and_19_digits_agree(estimator):
    skin = array_of(64, alike=False)
    counts, units = counts_of(skin), np.arange(0, 64, 7)
    exact = judge(skin, counts[:, units], units, estimator)
    np.testing.assert_allclose(walk(skin, counts[:, units], units, estimator), exact, atol=1e-13)


def test_the_oracle_gives_the_papers_forces():
    """540 Hz are 0.9 N, 1800 Hz 7.2 N."""
    skin = array_of(2, alike=True)
    counts = counts_of(skin)
    for unit, frequency_hz in enumerate((3960.0, 2700.0)):
        counts[1, unit] = np.rint((frequency_hz - skin.offset[1, 0]) / skin.scale[1, 0])
    force = judge(skin, counts, np.arange(2), "sine")[2].astype(float)
    np.testing.assert_allclose(force, [0.9, 7.2], atol=skin.scale[1, 0] / 200.0)


def test_a_dipole_has_its_field_on_the_axis_and_beside_it():
    moment = np.array([[0.0], [0.0], [2.0]])  # A m²
    points = np.array([[0.0, 30.0], [0.0, 0.0], [20.0, 0.0]])
    seen = sum_of_dipoles(points, np.zeros((3, 1)), moment)
    axis, aside = 1e6 * 1e-7 * 2.0 * 2.0 / 0.020**3, -1e6 * 1e-7 * 2.0 / 0.030**3
    assert seen == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.0], [axis, aside]]))


def test_a_film_without_wave_is_a_magnetised_disc():
    """On its axis, the difference of two solenoid terms: Br / 2 (cos of the near and far face)."""
    disc = Film(wavelength_mm=1e9)
    z = np.array([3.0, 5.0, 9.0])
    points = np.stack([0.0 * z, 0.0 * z, z])
    ends = [z + side * 0.5 * disc.thickness_mm for side in (1.0, -1.0)]
    far, near = (end / np.hypot(end, disc.radius_mm) for end in ends)
    expected = 1e6 * disc.remanence_t / 2.0 * (far - near)
    assert sum_of_dipoles(points, *grains(disc))[2] == pytest.approx(expected, rel=5e-3)


@pytest.mark.long
def test_the_table_of_a_film_is_the_sum_of_its_dipoles():
    rng = np.random.default_rng(4)
    angle = rng.uniform(-np.pi, np.pi, 60)
    for reach, heights in ((3.0, (1.6, 5.0)), (12.0, (4.0, 11.0)), (30.0, (13.0, 30.0))):
        radius, z = reach * np.sqrt(rng.random(60)), rng.uniform(*heights, 60)
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z])
        exact = sum_of_dipoles(points, *grains(DRAWN))
        # 12 mm of it are a harmonic of the sectors' number
        assert np.abs(field_of(DRAWN, points) - exact).max() < 3e-3 * np.abs(exact).max() + 1.0


@pytest.mark.parametrize("poisson", [0.0, 0.5])
def test_influence_is_the_sum_over_the_square(poisson):
    """Boussinesq's and Cerruti's point forces, summed over the face of the unit that presses."""
    position = np.array([[0.0, 0.007, 0.0], [0.0, 0.002, 0.012], [0.0] * 3])
    rotation = np.repeat(np.eye(3)[..., np.newaxis], 3, axis=2)
    side, modulus = 0.01, 1e6
    normal, shear = influence(
        position, rotation, np.full(3, side**2), modulus_pa=modulus, poisson=poisson
    )
    g = modulus / (2.0 * (1.0 + poisson))
    for i in range(3):
        for j in range(3):
            x, y = position[:2, i] - position[:2, j]
            whole, xx, yy, xy = line_integral_rectangle(x, y, 0.5 * side)
            got = normal[i, j], shear[i, j], shear[3 + i, 3 + j], shear[i, 3 + j]
            expected = (1 - poisson) * whole + poisson * np.array([whole, xx, yy, xy])
            expected[0] -= poisson * whole
            expected[3] = poisson * xy
            scale = 1e3 / (2.0 * np.pi * g * side**2)
            np.testing.assert_allclose(got, scale * expected, rtol=3e-3, atol=1e-9)


def test_the_stored_readings_are_those_of_the_source():
    found = load()
    assert found.held_ut.shape == (69, 300, 2, 5, 3)
    assert (int(found.pulled.sum()), int((~found.pulled).sum())) == (52, 17)
    assert structure(np.arange(300.0))[:3].tolist() == [1.0, 4.0, 9.0]
