"""Simulated units against the paper's figures and against formulae written out a second time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skin.physics.elastic import Elastic
from skin.sim.field import SineField
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, MODELS, Topology, load

PALM, STRIP = load("palm"), load("strip")
GEL, FREQUENCY, BX, BY, BZ, HALL_TEMPERATURE = range(len(CHANNELS))


def random_truth(n: int, seed: int) -> Truth:
    """Units pressed up to 3 mm, sheared up to 2.5 mm along each axis, 15 to 90 °C."""
    random = np.random.default_rng(seed)
    truth = Truth.at_rest(n, 25.0)
    truth.depth_mm[:] = random.uniform(0.0, 3.0, n)
    truth.displacement_mm[:] = random.uniform(-2.5, 2.5, (2, n))
    truth.temperature[:] = random.uniform(15.0, 90.0, n)
    truth.film_temperature[:] = random.uniform(15.0, 90.0, n)
    truth.hall_temperature[:] = random.uniform(15.0, 85.0, n)
    return truth


# -- timer -----------------------------------------------------------------------------------------


def frequency_at(depth_mm: float) -> np.ndarray:
    pressed = np.full(64, depth_mm), np.zeros((2, 64)), np.full(64, 25.0)
    return UnitSimulator(PALM, noise=False).quantities(*pressed)[FREQUENCY]


def test_frequency_falls_900_hz_per_mm_from_4500() -> None:
    for depth_mm in np.linspace(0.0, 4.9, 50):
        np.testing.assert_allclose(frequency_at(depth_mm), 4500 - 900 * depth_mm, rtol=1e-12)


def test_frequency_stays_positive_when_the_discs_meet() -> None:
    assert np.all(frequency_at(50.0) > 0.0)
    assert np.all(frequency_at(50.0) < 10.0)


# -- field -----------------------------------------------------------------------------------------


def test_field_meets_the_figures_of_the_paper() -> None:
    """10531 µT at 2 mm, 1 N; 377 µT/N beyond, up to 2.5 mm; at 2 mm depth and 25 °C."""
    field, elastic = SineField(PALM), Elastic(PALM)
    depth, warm = np.full(64, 2.0), np.full(64, 25.0)

    def at(displacement: float) -> tuple[float, float]:
        moved = np.zeros((2, 64))
        moved[0] = displacement
        force = elastic.tangential(np.full(64, displacement), depth)
        return float(field(moved, depth, warm)[0, 0]), float(force[0])

    (b2, f2), (b25, f25) = at(2.0), at(2.5)
    assert b2 == pytest.approx(10531.0, abs=1.0)
    assert f2 == pytest.approx(1.0, abs=1e-3)
    assert (b25 - b2) / (f25 - f2) == pytest.approx(377.0, abs=1.0)


@given(angle=st.floats(-np.pi, np.pi), displacement=st.floats(0.0, 2.5), depth=st.floats(0.0, 3.0))
def test_field_lies_along_the_displacement(angle: float, displacement: float, depth: float) -> None:
    moved = np.tile(displacement * np.array([[np.cos(angle)], [np.sin(angle)]]), 64)
    bx, by, bz = SineField(PALM)(moved, np.full(64, depth), np.full(64, 25.0))[:, 0]
    m0 = 11073.0 * np.exp(0.72 * (depth - 2.0))
    assert np.hypot(bx, by) == pytest.approx(m0 * np.sin(np.pi / 5 * displacement), abs=1e-7)
    assert bx * np.sin(angle) == pytest.approx(by * np.cos(angle), abs=1e-7)
    psi = np.arctan2(np.hypot(bx, by), bz)
    table = np.reshape(MODELS["f3t-paper"].field_angle_mm, (4, 4))
    found = psi ** np.arange(1, 8, 2) @ table @ depth ** np.arange(4)
    assert found == pytest.approx(displacement, abs=1e-12)


# -- the whole unit --------------------------------------------------------------------------------


def test_gel_current_rises_twelvefold_whatever_the_force() -> None:
    unit = UnitSimulator(PALM, noise=False)
    truth = random_truth(64, seed=1)
    cold, warm = (
        unit.quantities(truth.depth_mm, truth.displacement_mm, np.full(64, t))[GEL]
        for t in (20.0, 80.0)
    )
    np.testing.assert_allclose(cold, 10.0, rtol=1e-12)
    np.testing.assert_allclose(warm, 120.0, rtol=1e-12)


@pytest.mark.parametrize("topology", [PALM, STRIP], ids=["fd64", "classic"])
@given(seed=st.integers(0, 1000))
def test_quantisation_is_within_half_a_count(topology: Topology, seed: int) -> None:
    unit = UnitSimulator(topology, noise=False)
    truth = random_truth(topology.n, seed)
    counts = unit.counts(truth)
    exact = unit.quantities(
        truth.depth_mm, truth.displacement_mm, truth.temperature,
        truth.film_temperature, truth.hall_temperature,
    )  # fmt: skip
    off = np.abs(topology.scale * counts + topology.offset - exact)
    assert np.all((off <= 0.5000001 * topology.scale)[topology.wired])
    assert np.all(counts[~topology.wired] == 0)


def test_counts_stay_at_the_rails_of_the_wire() -> None:
    for topology, widest in [(PALM, (32767, 32767)), (STRIP, (4095, 16383))]:
        unit = UnitSimulator(topology, noise=False)
        values = np.full((len(CHANNELS), topology.n), 1e9)
        high, low = unit.quantise(values), unit.quantise(-values)
        assert tuple(high[[GEL, FREQUENCY], 0]) == widest
        assert low[GEL, 0] == (-32768 if topology is PALM else 0)
        assert high[BX, 0] == (32767 if topology is PALM else 1023)
        assert low[BX, 0] == (-32768 if topology is PALM else -1024)


def test_noise_is_as_large_as_the_model_says() -> None:
    unit = UnitSimulator(PALM, seed=7)
    exact = unit.quantities(np.full(64, 2.0), np.zeros((2, 64)), np.full(64, 30.0))
    noise = unit.disturb(np.tile(exact, (500, 1, 1))) - exact
    samples = 500 * 64
    for channel, sigma in [
        (GEL, 0.002 * exact[GEL, 0]), (FREQUENCY, 6.0), (BX, 105.0), (BY, 105.0), (BZ, 105.0),
    ]:  # fmt: skip
        assert noise[:, channel].std() == pytest.approx(sigma, rel=5.0 / np.sqrt(2 * samples))
        assert abs(noise[:, channel].mean()) < 5.0 * sigma / np.sqrt(samples)
    assert np.all(noise[:, HALL_TEMPERATURE] == 0.0)
