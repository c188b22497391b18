"""What the ambient loop tells of itself, saves, and forgets; two bodies, units of any attitude."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skin.decode.ambient import Ambient
from tests.naive.ambient import PRIOR_UT2, NaiveAmbient, state_of
from tests.skin.decode.test_ambient_naive import BODY, UNITS, any_reading, any_state, tumbled


def anyhow(seed=0):
    """An `Ambient` in any state."""
    skin = tumbled()
    ambient, naive = Ambient(skin, dtype="float64"), NaiveAmbient(skin, BODY)
    any_state(ambient, naive, np.random.default_rng(seed))
    return ambient, naive


def test_nothing_is_known_at_first_and_after_a_reset():
    ambient, _ = anyhow()
    ambient.reset()
    for one in (ambient, Ambient(tumbled())):
        state = state_of(one)
        for name, value in vars(state).items():
            if name == "covariance_ut2":
                np.testing.assert_array_equal(value, [PRIOR_UT2 * np.eye(3)] * 2)
            elif name == "kept_ut2":
                np.testing.assert_array_equal(value, [[PRIOR_UT2 * np.eye(3)] * 2] * 2)
            elif name == "bound_hz":
                np.testing.assert_allclose(value, 0.5)  # 1 Hz a minute, in 30 s
            elif name in ("rest_ut", "rest_film_c"):
                assert np.isnan(value).all()
            else:
                assert not value.any(), name
        assert not one.background.any()
        assert (one.residue_ut2 == PRIOR_UT2).all()
        assert not one.followed.any()


def test_each_chip_reads_the_field_of_its_body_through_its_map():
    ambient, naive = anyhow()
    field = ambient.field_ut
    for i, g in enumerate(BODY):
        seen = naive.turn[i].T @ field[:, g]
        expected = [*(naive.unmap[i] @ seen[:2]), seen[2]]
        np.testing.assert_allclose(ambient.field_at_chips_ut[:, i], expected)


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize(("given", "seconds"), [(None, 0.004), (0.05, 0.05)])
def test_a_cycle_lasts_a_period_if_nobody_says_otherwise(given, seconds):
    ambient, naive = anyhow()
    before = state_of(ambient)
    reading = any_reading(naive, before, np.random.default_rng(0))
    ambient.update(reading, given)
    expected = naive.step(before, reading, seconds)
    for name, value in vars(state_of(ambient)).items():
        np.testing.assert_allclose(
            value, getattr(expected, name), rtol=1e-7, atol=1e-7, err_msg=name
        )


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_clock_that_goes_back_stands_still():
    ambient, naive = anyhow()
    before = state_of(ambient)
    ambient.update(any_reading(naive, before, np.random.default_rng(0)), -3.0)
    found = state_of(ambient)
    usable = found.age_s > 0.0
    assert usable.any()
    np.testing.assert_array_equal(found.age_s[usable], before.age_s[usable])
    np.testing.assert_array_equal(found.zero, before.zero)


def test_temperatures_that_are_not_told_are_steady():
    ambient, _ = anyhow()
    ambient.reset()
    field, depth = np.zeros((3, UNITS)), np.zeros((3, UNITS))
    reading = SimpleNamespace(
        field_ut=field, displacement_mm=depth, temperature=None, status=np.zeros(UNITS, np.uint16)
    )
    for _ in range(3):
        ambient.update(reading)
    state = state_of(ambient)
    assert not state.gel_c.any()
    assert not state.film_c.any()
    assert (state.calm_s > 0.0).any()
