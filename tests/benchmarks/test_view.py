"""The benchmark of the live view measures what it says, at a small size."""

from __future__ import annotations

import json

import pytest

from benchmarks import view

pytest.importorskip("viser", reason="viser is not installed")


@pytest.mark.long
def test_the_view_has_a_share_and_the_cycle_its_times_with_and_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(view, "SIZES", (64,))
    monkeypatch.setattr(view, "WARM", 20)
    figures = view.run(quick=True)
    row = figures["sizes"]["64"]
    assert figures["view_cpu_share"]["64"] == row["view_share"] + row["loop_share"] > 0.0
    assert 0.0 < row["loop_share"] < row["view_share"]
    assert row["with"]["cycles"] == row["without"]["cycles"] == 750
    assert 1.0 < row["snapshots_hz"] <= 31.0
    assert len(view.table(figures).splitlines()) == 2
    json.dumps(figures)
