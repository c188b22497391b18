"""The benchmarks of simulation measure what they say, at a small size."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import simulate


def test_simulating_gives_a_factor_for_each_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "SIZES", {64: 1})
    figures = simulate.run(quick=True)
    assert figures["real_time_factor_64"] > 0.0
    rows = figures["sizes"]["64"]
    assert set(rows) == {"none", "everything"}
    assert all(row["beyond_friction_n"] < 1e-9 for row in rows.values())
    assert len(simulate.table(figures).splitlines()) == 3
    json.dumps(figures)


def test_the_square_has_a_bus_for_each_64_units() -> None:
    skin = simulate.skin_of(1024)
    assert (skin.n, len(skin.buses)) == (1024, 16)
    # 32 x 32 places, 12 mm apart, about the origin
    places = np.unique(skin.position[0].round(6))
    assert np.diff(places) == pytest.approx(0.012)
    assert places.size == 32
    assert skin.position.mean(axis=1) == pytest.approx(0.0, abs=1e-9)
