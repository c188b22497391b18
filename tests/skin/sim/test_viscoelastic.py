"""Relaxation against closed forms, loops against their width, and both ways as inverses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp

from skin.sim.mechanics.viscoelastic import Hysteresis, Prony

SEEDS = st.integers(0, 2**32 - 1)
BOTH_WAYS = arrays(float, (30, 2), elements=st.floats(-7.0, 7.0))


def force_of(law: Prony | Hysteresis, elastic: np.ndarray, dt_s: float = 0.0) -> np.ndarray:
    """Go on by one step, to the force at a displacement whose elastic force is `elastic`: the way
    back of `elastic`, by the series itself."""
    change = elastic - law._elastic
    law._elastic[...] = elastic
    if isinstance(law, Prony):
        law._adapt(dt_s)
        law.terms[...] = law._kept * law.terms + law._gained * change
        return elastic + law.terms.sum(axis=0)
    law.stops[...] = np.clip(law.stops + change, law._low, law._high)
    return elastic + (law._weights * law.stops).sum(axis=0)


# -- Prony -----------------------------------------------------------------------------------------


@given(
    weights=st.lists(st.floats(0.01, 0.5), min_size=1, max_size=4),
    fastest=st.floats(0.01, 1.0),
    dt_s=st.floats(1e-4, 5.0),
)
def test_a_step_relaxes_as_the_series_says(
    weights: list[float], fastest: float, dt_s: float
) -> None:
    """1 + sum of w exp(-t / tau), whatever the time step."""
    times = fastest * 7.0 ** np.arange(len(weights))
    prony = Prony((1,), weights, times)
    held = np.array([3.0])
    assert force_of(prony, held, 0.0)[0] == pytest.approx(3.0 * (1.0 + sum(weights)))
    for k in range(1, 20):
        expected = 3.0 * (1.0 + weights @ np.exp(-k * dt_s / times))
        assert force_of(prony, held, dt_s)[0] == pytest.approx(expected, rel=1e-9)


@given(seed=SEEDS)
def test_forces_that_change_linearly_are_exact(seed: int) -> None:
    """The same as the differential equations, between corners of any way, in uneven steps."""
    rng = np.random.default_rng(seed)
    weights, times = rng.uniform(0.05, 0.5, 2), rng.uniform(0.1, 3.0, 2)
    corners, at = rng.uniform(0.0, 5.0, 6), np.cumsum(rng.uniform(0.05, 1.0, 6))
    prony = Prony((1,), weights, times)
    q, before, t = np.zeros(2), 0.0, 0.0
    for corner, now in zip(corners, at, strict=True):
        rate = (corner - before) / (now - t)
        q = solve_ivp(
            lambda _, y, rate=rate: weights * rate - y / times, (0.0, now - t), q,
            rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
        # in two pieces: where a line is cut does not matter
        force_of(prony, np.array([before + 0.3 * (corner - before)]), 0.3 * (now - t))
        got = force_of(prony, np.array([corner]), 0.7 * (now - t))
        assert got[0] == pytest.approx(corner + q.sum(), abs=1e-7)
        before, t = corner, now


@given(seed=SEEDS)
def test_the_force_of_the_displacement_under_a_force_is_that_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    there, back = Prony((3, 2)), Prony((3, 2))
    for _ in range(30):
        load, dt_s = rng.normal(size=(3, 2)), rng.choice([0.0, 0.004, 1.0])
        np.testing.assert_allclose(
            force_of(back, there.elastic(load, dt_s), dt_s), load, atol=1e-12
        )
    np.testing.assert_allclose(there.terms, back.terms, atol=1e-12)


# -- hysteresis ------------------------------------------------------------------------------------


@given(
    width=st.floats(0.01, 1.0), span=st.floats(0.5, 20.0), one_sided=st.booleans(),
)  # fmt: skip
def test_the_loop_is_as_wide_as_it_was_set(width: float, span: float, one_sided: bool) -> None:
    loop = Hysteresis((1,), width_n=width, span_n=span, one_sided=one_sided)
    ends = (0.0, span) if one_sided else (-0.5 * span, 0.5 * span)
    middle = 0.5 * sum(ends)
    force_of(loop, np.array([ends[1]]))
    force_of(loop, np.array([ends[0]]))
    up = force_of(loop, np.array([middle]))[0]
    force_of(loop, np.array([ends[1]]))
    down = force_of(loop, np.array([middle]))[0]
    assert up - down == pytest.approx(width, rel=1e-9)
    if not one_sided:
        assert up - middle == pytest.approx(middle - down, abs=1e-9)


@given(way=BOTH_WAYS, one_sided=st.booleans())
def test_the_force_of_the_elastic_force_under_a_force_is_that_force(
    way: np.ndarray, one_sided: bool
) -> None:
    there, back = (Hysteresis((2,), width_n=0.8, span_n=7.2, one_sided=one_sided) for _ in range(2))
    for load in way:
        np.testing.assert_allclose(force_of(back, there.elastic(load)), load, atol=1e-9)
    np.testing.assert_allclose(there.stops, back.stops, atol=1e-9)
