"""Statistics that come batch by batch are those of numpy over all of it."""

from __future__ import annotations

import numpy as np

from skin.io.export import statistics
from skin.io.export.statistics import Statistics, aggregate


def told_of(values, sizes):
    found = Statistics()
    for batch in np.split(values, np.cumsum(sizes)[:-1]):
        found.add(batch)
    return found.result()


def test_batches_are_as_one():
    values = np.random.default_rng(1).normal(3.0, [1.0, 5.0], (700, 4, 2))
    told = told_of(values, [64, 1, 600, 35])
    rows = values.reshape(-1, 2)
    np.testing.assert_allclose(told["mean"], rows.mean(axis=0))
    np.testing.assert_allclose(told["std"], rows.std(axis=0))
    np.testing.assert_array_equal(told["min"], rows.min(axis=0))
    np.testing.assert_array_equal(told["max"], rows.max(axis=0))
    np.testing.assert_allclose(told["q10"], np.quantile(rows, 0.1, axis=0))
    assert told["count"].tolist() == [700]


def test_what_is_not_finite_does_not_count():
    values = np.array([[1.0, np.nan], [np.nan, np.nan], [3.0, np.nan]])
    told = told_of(values, [1, 2])
    assert told["mean"].tolist() == [2.0, 0.0]
    assert (told["min"].tolist(), told["q50"].tolist()) == ([1.0, 0.0], [2.0, 0.0])
    assert told["count"].tolist() == [3]


def test_quantiles_of_a_long_run_are_taken_from_all_of_it(monkeypatch):
    monkeypatch.setattr(statistics, "KEPT", 100)
    values = np.linspace(0.0, 1.0, 5000)[:, np.newaxis]
    told = told_of(values, [7] * 714 + [2])
    np.testing.assert_allclose([told["q10"][0], told["q99"][0]], [0.1, 0.99], atol=0.03)


def test_episodes_together_are_as_one():
    values = np.random.default_rng(2).normal(0.0, 1.0, (90, 3)) + np.arange(90)[:, np.newaxis]
    parts = [told_of(part, [len(part)]) for part in np.split(values, [20, 50])]
    told = aggregate(parts)
    np.testing.assert_allclose(told["mean"], values.mean(axis=0))
    np.testing.assert_allclose(told["std"], values.std(axis=0))
    np.testing.assert_array_equal(told["max"], values.max(axis=0))
    assert told["count"].tolist() == [90]
