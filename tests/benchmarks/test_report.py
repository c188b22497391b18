"""The report: one table of all benchmarks, which the page and the README show as it was found."""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

from benchmarks import __main__ as command
from benchmarks import quiet, report
from benchmarks.figures import FIGURES, SENTENCES, TIMED, TITLES, Figure, Sentence
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


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A report of two benchmarks, one of which tells of the machine."""
    figures = (
        Figure("decode", "ratio", "one over the other", "", "<= 1.5"),
        Figure("slip", "rows/0/caught", "slips told", "", ">= 0.95", "rows/0/slips"),
    )
    sentences = (
        Sentence("Ours takes {:.2f} of it.", ("decode: ratio",)),
        Sentence("{:.0%} are caught.", ("slip: rows/0/caught",)),
        Sentence("{:.0f} is of another report.", ("view: x",)),
    )
    monkeypatch.setattr(report, "FIGURES", figures)
    monkeypatch.setattr(report, "SENTENCES", sentences)
    for name in ("STORE", "PAGE", "README"):
        monkeypatch.setattr(report, name, tmp_path / name)
    (tmp_path / "README").write_text(f"above\n{report.BEGIN}before\n{report.END}below\n")
    asked = []

    def once(name, quick):
        asked.append((name, quick))
        found = {"decode": {"ratio": 1.4 + 0.1 * len(asked)},
                 "slip": {"rows": [{"caught": 0.94, "slips": 200}]}}  # fmt: skip
        return found[name] | {"machine": {"processor": "P", "cores": 2, "date": "2026-01-01"}}

    monkeypatch.setattr(report, "_once", once)
    monkeypatch.setattr(quiet, "wait", lambda: 0.0)
    monkeypatch.setattr(quiet, "Others", lambda: Idle(0.0))
    return asked, tmp_path


class Idle(NamedTuple):
    """Stands for `quiet.Others`."""

    used: float | None

    def cores(self):
        return self.used


def test_a_run_while_others_use_the_machine_is_repeated(small, monkeypatch):
    asked, _ = small
    used = iter([0.7, 0.0, 0.05, None])
    monkeypatch.setattr(quiet, "Others", lambda: Idle(next(used)))
    row = report.run(quick=True)["figures"]["decode: ratio"]
    assert [name for name, _ in asked] == ["decode", "decode", "slip", "decode", "decode"]
    assert row["value"] == pytest.approx(1.8)
    assert row["runs"] == 3


def test_what_tells_of_the_machine_runs_several_times(small):
    asked, folder = small
    figures = report.run(quick=True)
    assert asked == [("decode", True), ("slip", True), ("decode", True), ("decode", True)]
    row = figures["figures"]["decode: ratio"]
    assert row["value"] == pytest.approx(1.7)
    assert row["low"] < 1.5
    assert row["high"] > 1.8
    assert row["runs"] == 3
    assert figures["missed"] == ["decode: ratio"]
    assert "| one over the other | 1.7 | " in (folder / "PAGE").read_text()
    text = (folder / "README").read_text()
    assert text.startswith("above\n")
    assert text.endswith("below\n")
    assert "before" not in text
    assert "- Ours takes 1.70 of it. ¹" in text
    assert "- 94 % are caught. ¹" in text
    page = (folder / "PAGE").read_text()
    assert "| ≤ 1.5 | **missed**, not decided |" in page
    assert "| ≥ 0.95 | held |" in page
    assert "another report" not in text
    assert "held" in report.table(figures)


def test_a_rate_has_its_interval_and_holds_a_target_within(small):
    row = report.run(quick=False)["figures"]["slip: rows/0/caught"]
    assert (row["low"], row["high"]) == pytest.approx((0.8983, 0.9654), abs=1e-3)
    assert row["held"] is True


def test_only_some_are_renewed(small):
    asked, folder = small
    report.run(quick=False)
    before = json.loads((folder / "STORE").read_text())
    asked.clear()
    (folder / "STORE").write_text(json.dumps(before | {"slip: rows/0/caught": {"quick": True}}))
    after = report.run(quick=True, only=["slip"])["figures"]
    assert asked == [("slip", True)]
    assert after["decode: ratio"] == before["decode: ratio"]
    assert after["slip: rows/0/caught"]["value"] == 0.94
    with pytest.raises(SystemExit, match="only: must be of decode, slip; got grip"):
        report.run(quick=True, only=["grip"])


def test_a_quick_run_does_not_overwrite_what_a_whole_one_found(small):
    whole = report.run(quick=False)["figures"]
    assert report.run(quick=True)["figures"] == whole
    assert "¹" not in (small[1] / "README").read_text()


def test_an_interval_that_the_benchmark_tells_is_that_of_the_rate():
    figure = Figure("accuracy", "share", "", "", ">= 0.66", interval="half")
    for share, expected in ((0.65, True), (0.62, False)):
        row = report.described(figure, [{"share": share, "half": 0.02}], quick=False)
        assert (row["low"], row["high"]) == pytest.approx((share - 0.02, share + 0.02))
        assert row["held"] is expected


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
