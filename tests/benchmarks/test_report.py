"""The report: one table of all benchmarks, which the page and the README show as it was found."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from benchmarks import __main__ as command
from benchmarks import report
from benchmarks.figures import FIGURES, SENTENCES, TIMED, TITLES, Figure
from benchmarks.intervals import per_minute, rate


def test_page_and_readme_show_what_was_stored():
    stored = json.loads(report.STORE.read_text(encoding="utf-8"))
    assert report.PAGE.read_text(encoding="utf-8") == report.page(stored)
    readme = report.README.read_text(encoding="utf-8")
    assert readme == report.with_short(readme, stored)
    page = report.PAGE.read_text(encoding="utf-8")
    assert "**missed**" in page or all(row["held"] is not False for row in stored.values())


def test_every_stored_figure_is_of_a_benchmark():
    """One whose subject has changed is not stored until it is measured again."""
    known = command.names()
    assert {figure.benchmark for figure in FIGURES} <= set(known)
    assert set(TIMED) <= set(known)
    stored = json.loads(report.STORE.read_text(encoding="utf-8"))
    keys = [report._key(figure) for figure in FIGURES]
    assert list(stored) == [key for key in keys if key in stored]
    assert len(stored) > 50
    assert {key for sentence in SENTENCES for key in sentence.keys} <= set(keys)
    assert set(TITLES) == {figure.benchmark for figure in FIGURES}
    assert {figure.kind for figure in FIGURES} == {"", "share", "count"}


def test_a_share_stays_one_in_its_interval():
    stored = json.loads(report.STORE.read_text(encoding="utf-8"))
    shares = [figure for figure in FIGURES if figure.kind == "share" or figure.trials]
    assert len(shares) > 15
    for figure in shares:
        if (row := stored.get(report._key(figure))) is None:
            continue
        ends = [row["value"], *(end for end in (row["low"], row["high"]) if end is not None)]
        assert all(0.0 <= end <= 1.0 for end in ends), figure


def test_shares_vary_on_their_log_odds_and_counts_have_their_ends():
    rng = np.random.default_rng(4)
    runs = 1.0 / (1.0 + np.exp(-rng.normal(1.0, 1.5, (4000, 4))))
    ends = np.array([report.prediction(list(row[:3]), "share") for row in runs])
    inside = np.mean((ends[:, 0] <= runs[:, 3]) & (runs[:, 3] <= ends[:, 1]))
    assert inside == pytest.approx(0.95, abs=0.015)
    assert report.prediction([3.0, 40.0, 7.0], "count") == (3.0, 40.0)


@pytest.mark.parametrize(
    ("target", "value", "expected"),
    [("<= 1.5", 1.6, False), ("<= 1.5", 1.5, True), (">= 20", 19.0, False), ("= 0", 0.0, True),
     ("= 0", 1.0, False), ("", 3.0, None), ("<= 1", None, None)],
)  # fmt: skip
def test_a_target_is_held_by_the_value(target, value, expected):
    """Not by how wide its spread is."""
    assert report.held(Figure("decode", "x", "", "", target), value, 0.1, 99.0) is expected


@pytest.mark.parametrize("share", [0.001, 0.03, 0.5])
def test_intervals_of_rates_hold_the_truth_in_95_of_100_cases(share):
    def holds(interval, truth):
        return interval["lower"] <= truth <= interval["upper"]

    trials = 60
    held = [holds(rate(hits, trials), share) for hits in range(trials + 1)]
    assert stats.binom(trials, share).pmf(np.flatnonzero(held)).sum() >= 0.95
    held = [holds(per_minute(count, 60.0), 60.0 * share) for count in range(200)]
    assert stats.poisson(60.0 * share).pmf(np.flatnonzero(held)).sum() >= 0.95


def test_intervals_are_those_of_the_tables():
    # Clopper and Pearson 1934; Garwood 1936
    assert [rate(5, 10)[end] for end in ("lower", "upper")] == pytest.approx([0.1871, 0.8129], 1e-3)
    assert rate(10, 10)["upper"] == 1.0
    found = per_minute(10, 120.0)
    assert [2.0 * found[end] for end in ("lower", "upper")] == pytest.approx([4.795, 18.39], 1e-3)
    assert rate(0, 0) is None
    assert per_minute(0, 0.0) is None
