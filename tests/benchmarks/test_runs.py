"""Each benchmark that ends within seconds runs, and shows what it finds."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import contact, decode, fig3, recorded, scale, skip, timing
from benchmarks.scale_units import PLAYED


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """As little as there can be of each."""
    monkeypatch.setattr(timing, "ROUNDS", 2)
    monkeypatch.setattr(decode, "SIZES", (48, 64))
    monkeypatch.setattr(decode, "CALIBRATED", 96)
    monkeypatch.setattr(contact, "SIZES", (64,))
    monkeypatch.setattr(contact, "LAPS", (1, 1))
    monkeypatch.setattr(contact, "TRIALS", (2, 2))
    monkeypatch.setattr(skip, "SIZES", (64,))
    monkeypatch.setattr(skip, "WARM", 1)


@pytest.mark.long
@pytest.mark.parametrize("benchmark", [decode, fig3, contact, skip, recorded])
def test_a_benchmark_runs_and_shows(benchmark):
    figures = json.loads(json.dumps(benchmark.run(True)))
    assert benchmark.table(figures)
    if benchmark is decode:
        single, double = (
            figures["sizes"]["48"][f"{dtype} sine"] for dtype in ("float32", "float64")
        )
        assert single["error_n"] < 2e-5
        assert double["error_n"] < 1e-9


def test_periods_that_units_spoilt_are_not_judged_and_others_are_late_or_lost():
    """Ten cycles that are played in time and seen after 3 ms, but for some."""
    period_ns, frames = 4_000_000, 13
    played = np.zeros(12, PLAYED)
    played["sync_ns"] = 1 + period_ns * np.arange(12)
    played["left_ns"] = played["sync_ns"] + 2_500_000
    played["late_ns"][5] = 1_000_000  # by the units: their cycle and the next are not judged
    seen = np.zeros(10, scale.SEEN)
    seen["cycle"] = np.arange(2, 12)
    seen["at_ns"] = played["sync_ns"][2:] + 3_000_000
    seen["shown"], seen["complete"] = frames, 1
    seen["at_ns"][0] += 2_000_000
    seen["shown"][1] -= 2
    found = scale.judge(seen, played, frames, period_ns, 170_000)
    assert np.flatnonzero(~found.judged).tolist() == [3, 4]
    assert np.flatnonzero(found.late).tolist() == [0]
    assert found.lost.tolist() == [0, 2, *[0] * 8]
