"""What the ambient loop tells of itself, saves, and forgets; two bodies, units of any attitude."""

from __future__ import annotations

import numpy as np

from skin.decode.ambient import Ambient
from tests.naive.ambient import PRIOR_UT2, NaiveAmbient, state_of
from tests.skin.decode.test_ambient_naive import BODY, any_state, tumbled


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
