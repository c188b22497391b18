"""The benchmark of cross-talk runs, and its errors fall as its plans promise."""

from __future__ import annotations

import json

import pytest

from benchmarks import crosstalk


@pytest.mark.long
def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(crosstalk, "PLANS", ((2, 0.018, 0.0), (4, 0.039, crosstalk.ACCURATE_UT)))
    monkeypatch.setattr(crosstalk, "PITCHES_MM", (12.0,))
    monkeypatch.setattr(crosstalk, "grid", lambda side, pitch: GRID(min(side, 6), pitch))
    figures = crosstalk.run(quick=True)
    coarse, fine = json.loads(json.dumps(figures))["plans"]
    assert coarse["terms"] == 8 * 9
    for row in (coarse, fine):
        raw, one, two = row["field-angle_um"]
        assert raw > 3.0 * one > 3.0 * two
        assert 0.7 < row["missed_ut"] / row["residue_ut"] < 1.3
        assert min(row["ns_per_unit"], row["idle_ns_per_unit"]) > 0.0
    live, accurate = figures["pitches"]["12"].values()
    assert live["field-angle_um"][1] < 15.0
    assert accurate["field-angle_um"][2] < 4.0
    assert fine["field-angle_um"] == accurate["field-angle_um"]
    text = crosstalk.table(figures)
    assert "12 mm, live" in text
    assert len(text.splitlines()) == 2 + len(figures["plans"]) + 3


GRID = crosstalk.grid
