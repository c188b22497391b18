"""The body's motion: what cannot be told, and a body that rolls."""

import numpy as np
import pytest

from skin.contact.slip.lags import _solve
from tests.skin.contact.slip.bench import flat_skin


def solve(rows, right):
    """By the kernel, which is given the lower triangle alone."""
    motions = rows.shape[1]
    equations = np.full((6, 7), np.nan)
    equations[:motions, :motions] = np.tril(rows.T @ rows)
    equations[:motions, 6] = rows.T @ right
    x = np.full(6, np.nan)
    _solve(equations, motions, x)
    return x[:motions], equations


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
@pytest.mark.parametrize("motions", [1, 2, 3, 6])
def test_normal_equations_are_solved_as_least_squares(motions, scale):
    rng = np.random.default_rng(motions)
    rows, right = scale * rng.standard_normal((9, motions)), rng.standard_normal(9)
    expected, *_ = np.linalg.lstsq(rows, right, rcond=None)
    x, equations = solve(rows, right)
    np.testing.assert_allclose(x, expected, rtol=1e-8)
    factor = np.linalg.cholesky(rows.T @ rows)
    lower = np.tril_indices(motions)
    np.testing.assert_allclose(equations[lower], factor[lower], rtol=1e-8)


@pytest.mark.parametrize("blind", range(5))
def test_a_motion_that_cannot_be_told_from_others_is_none(blind):
    rng = np.random.default_rng(blind)
    rows, right = rng.standard_normal((9, 5)), rng.standard_normal(9)
    rows[:, blind] = rows[:, :blind] @ rng.uniform(0.5, 2.0, blind)
    rest = np.delete(rows, blind, axis=1)
    expected = np.insert(np.linalg.lstsq(rest, right, rcond=None)[0], blind, 0.0)
    x, equations = solve(rows, right)
    np.testing.assert_allclose(x, expected, rtol=1e-6)
    assert not equations[blind:5, blind].any()


def test_units_in_a_row_and_all_at_one_place(bench_of):
    rng = np.random.default_rng(52)
    _, frames = flat_skin(4, rng)
    along = np.array([[1.0], [0.5], [0.2]])
    for spread in (0.01, 0.0):
        bench = bench_of((spread * along * np.arange(4), frames), rng)
        for t in range(25):
            bench.read(np.array([1.0, 0.4, 1.2, 0.9]), bench.drag((0.04 * t, 0.0)), 0.4)
            (record,) = bench.judge([{"id": 4, "members": [2, 0, 3, 1]}], 0.02)
        assert np.linalg.norm(record["motion"]) > 0.5
        assert np.any(record["rotation"]) == (spread > 0.0)
