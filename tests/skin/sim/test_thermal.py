"""The thermal chain against the closed forms of lags in a row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skin.errors import OptionError
from skin.sim.thermal import (
    CONTACT_LAG_S,
    ELASTOMER_LAG_S,
    FREE_LAG_S,
    LAYERS,
    STEADY_SHARES,
    ThermalChain,
)
from topology import Topology, load


def strip(film_s: float = 7.0, chip_s: float = 190.0) -> Topology:
    """Ten units, half of them of slower film."""
    skin = load("strip")
    slower = np.where(np.arange(skin.n) < 5, 1.0, 1.5)
    lags = {"film_lag_s": film_s * slower, "hall_lag_s": np.full(skin.n, chip_s)}
    return replace(skin, parameters=skin.parameters | lags)


def touch(chain: ThermalChain, dt_s: float, steps: int = 1, source: float = 80.0) -> np.ndarray:
    everywhere = np.ones(chain.temperature.shape[1], bool)
    for _ in range(steps):
        chain.step(dt_s, everywhere, source, 20.0)
    return chain.temperature.copy()


def lags_in_a_row(time_s: float, lags_s: list[float]) -> float:
    """Answer to a unit step of first-order lags one behind the other, all different."""
    left = 0.0
    for i, lag in enumerate(lags_s):
        others = [lag / (lag - other) for j, other in enumerate(lags_s) if j != i]
        left += np.prod(others) * np.exp(-time_s / lag)
    return 1.0 - left


@given(time_s=st.floats(0.001, 500.0), film=st.floats(6.5, 12.0), chip=st.floats(150.0, 190.0))
def test_time_constants_are_those_that_were_set(time_s: float, film: float, chip: float) -> None:
    """Each layer a lag behind the one above; the chip's lags from the gel add up to its own."""
    chain = ThermalChain(strip(film, chip), ambient=20.0)
    found = (touch(chain, time_s) - 20.0) / 60.0
    for unit in (0, 9):
        film_s = film if unit < 5 else 1.5 * film
        row = [CONTACT_LAG_S, film_s, ELASTOMER_LAG_S, chip - film_s - ELASTOMER_LAG_S]
        for layer in range(4):
            expected = STEADY_SHARES[layer] * lags_in_a_row(time_s, row[: layer + 1])
            assert found[layer, unit] == pytest.approx(expected, abs=1e-8)


@given(time_s=st.floats(0.001, 500.0))
def test_direct_layers_are_one_lag_behind_the_gel(time_s: float) -> None:
    chain = ThermalChain(strip(), ambient=20.0, direct=True)
    found = (touch(chain, time_s)[:, 0] - 20.0) / 60.0
    assert found[0] == pytest.approx(lags_in_a_row(time_s, [4.0]), abs=1e-9)
    for layer, lag in ((1, 7.0), (2, ELASTOMER_LAG_S), (3, 190.0)):
        assert found[layer] == pytest.approx(lags_in_a_row(time_s, [4.0, lag]), abs=1e-9)


@given(dt_s=st.floats(0.001, 30.0), pieces=st.integers(2, 20), direct=st.booleans())
def test_how_time_is_cut_does_not_matter(dt_s: float, pieces: int, direct: bool) -> None:
    one, many = (ThermalChain(strip(), ambient=20.0, direct=direct) for _ in range(2))
    for source in (80.0, 40.0):
        whole = touch(one, dt_s, source=source)
        parts = touch(many, dt_s / pieces, pieces, source)
        np.testing.assert_allclose(parts, whole, atol=1e-9)


def test_a_chip_that_is_faster_than_what_is_before_it_is_refused() -> None:
    with pytest.raises(OptionError, match=r"^strip/.*: hall_lag_s: must be at least film_lag_s and "
                       r"60 s of the elastomer; got 65$"):  # fmt: skip
        ThermalChain(strip(chip_s=65.0), ambient=24.0)


def test_only_what_is_touched_warms_and_it_cools_in_the_room() -> None:
    chain = ThermalChain(strip(), ambient=20.0)
    contact = np.arange(10) == 2
    chain.step(8.0, contact, 80.0, 20.0)
    assert np.all(chain.temperature[:, ~contact] == pytest.approx(20.0, abs=1e-9))
    warm = chain.temperature[0, 2] - 20.0
    assert warm > 50.0
    chain.step(FREE_LAG_S, np.zeros(10, bool), 80.0, 20.0)
    assert chain.temperature[0, 2] - 20.0 == pytest.approx(warm * np.exp(-1.0))
    assert len(LAYERS) == len(chain.temperature)
