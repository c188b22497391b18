"""Ambient field and tools against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skin.errors import SkinError
from skin.physics.halbach import CHIP_AXES, HalbachField
from skin.physics.surroundings import Surroundings, Tool, dipole_field_ut
from tests.fixtures.film import grains, sum_of_dipoles
from topology import load

TIP = load("fingertip")
AWAY = (0.004, -0.002, 0.02)


def readings(surroundings: Surroundings | None, seed: int = 0) -> np.ndarray:
    """Readings of a fingertip in some state, shape (3, n)."""
    random = np.random.default_rng(seed)
    field = HalbachField(TIP, surroundings=surroundings)
    displacement = random.uniform(-1.0, 1.0, (2, TIP.n))
    return field(displacement, random.uniform(0.0, 1.5, TIP.n), np.full(TIP.n, 25.0))


def chips_mm() -> np.ndarray:
    """Hall elements in the skin frame, written out again: 5.7 mm under the sensing face."""
    return 1e3 * TIP.position + 5.7 * TIP.rotation[:, 2]


def read_by_chips(field_ut: np.ndarray) -> np.ndarray:
    """Components (3, n) of the skin frame as the chips read them."""
    return CHIP_AXES[:, np.newaxis] * np.einsum("abn,an->bn", TIP.rotation, field_ut)


@given(seed=st.integers(0, 10_000))
def test_every_chip_reads_the_whole_ambient_field(seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    earth = readings(Surroundings(attitude=turn)) - readings(None)
    np.testing.assert_allclose(np.linalg.norm(earth, axis=0), np.hypot(20.0, 44.0), rtol=1e-9)
    in_skin = np.repeat((turn.T @ [20.0, 0.0, -44.0])[:, np.newaxis], TIP.n, axis=1)
    np.testing.assert_allclose(earth, read_by_chips(in_skin), atol=1e-8)


@given(mu=st.floats(1.0, 1e5), radius=st.floats(0.001, 0.02), seed=st.integers(0, 10_000))
def test_at_a_spheres_surface_the_field_refracts(mu, radius, seed):
    """Normal B and tangential H go through: inside, B is 3 mu/(mu + 2) times the field applied."""
    random = np.random.default_rng(seed)
    applied = random.uniform(-100.0, 100.0, 3)
    normal = random.normal(size=3)
    normal /= np.linalg.norm(normal)
    moment = Tool((0.0, 0.0, 0.0), radius_m=radius, permeability=mu).moment(applied)
    outside = applied + dipole_field_ut(moment, 1e3 * radius * normal[:, np.newaxis])[:, 0]
    inside = 3.0 * mu / (mu + 2.0) * applied
    np.testing.assert_allclose(outside @ normal, inside @ normal, atol=1e-6)
    np.testing.assert_allclose(np.cross(normal, outside), np.cross(normal, inside / mu), atol=1e-6)


def test_a_magnetised_tool_is_felt_as_its_dipole():
    tool = Tool(AWAY, permeability=1.0, remanent_am2=(0.01, -0.02, 0.03))
    felt = readings(Surroundings(tools=(tool,))) - readings(Surroundings())
    offset = chips_mm() - 1e3 * np.array(AWAY)[:, np.newaxis]
    r = np.linalg.norm(offset, axis=0)
    moment = 1e8 * np.array([[0.01], [-0.02], [0.03]])
    dipole = 3.0 * offset * np.sum(moment * offset, axis=0) / r**5 - moment / r**3
    np.testing.assert_allclose(felt, read_by_chips(dipole), rtol=1e-9, atol=1e-9)


def test_iron_answers_the_films_and_the_ambient_field():
    ambient = np.array([15.0, -25.0, 40.0])
    tool = Tool(AWAY, radius_m=0.006, permeability=500.0)
    n = TIP.n
    rest = np.zeros((2, n)), np.zeros(n), np.full(n, 25.0)
    with_tool = HalbachField(TIP, surroundings=Surroundings(ambient, tools=(tool,)))
    without = HalbachField(TIP, surroundings=Surroundings(ambient))
    felt = with_tool(*rest) - without(*rest)

    film = with_tool.film
    local = ambient.copy()
    for i in range(n):
        middle = 1e3 * TIP.position[:, i] + film.middle_mm * TIP.rotation[:, 2, i]
        point = TIP.rotation[:, :, i].T @ (1e3 * np.array(AWAY) - middle)
        local += TIP.rotation[:, :, i] @ sum_of_dipoles(point[:, np.newaxis], *grains(film))[:, 0]
    assert np.linalg.norm(local - ambient) > 5.0
    moment = 6.0**3 * 499.0 / 502.0 * local
    offset = chips_mm() - 1e3 * np.array(AWAY)[:, np.newaxis]
    expected = read_by_chips(dipole_field_ut(moment, offset))
    assert np.abs(felt - expected).max() < 0.02 * np.abs(expected).max()


def test_a_tool_in_the_skin_is_an_error():
    inside = tuple(TIP.position[:, 0] + 0.0057 * TIP.rotation[:, 2, 0])
    with pytest.raises(
        SkinError,
        match=r"tool: must be outside of all units, its middle 7\.6 mm .*; got a sphere of 0\.005",
    ):
        readings(Surroundings(tools=(Tool(inside),)))
