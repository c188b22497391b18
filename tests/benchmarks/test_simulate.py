"""The benchmarks of simulation measure what they say, at a small size."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import nonideal, simulate
from skin.sim.scenes.script import NonIdeal


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


@pytest.mark.long
def test_non_idealities_are_compared_on_the_papers_experiment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = ("wire alone", "noise", "everything")
    monkeypatch.setattr(nonideal, "CASES", {name: nonideal.CASES[name] for name in names})
    figures = nonideal.run(quick=True)
    for estimator, worst in figures["hurts_most"].items():
        rows = {name: each[estimator] for name, each in figures["cases"].items()}
        errors = {name: row["force_mean_n"] for name, row in rows.items()}
        assert errors["wire alone"] < 0.01 < errors["noise"] < errors["everything"]
        assert worst == "noise"
        assert all(row["invalid_share"] < 0.05 for row in rows.values())
        assert all(row["temperature_mean_c"] < 0.8 for row in rows.values())
    assert len(nonideal.table(figures).splitlines()) == 1 + 5 * len(figures["hurts_most"])
    json.dumps(figures)


def test_every_non_ideality_has_a_case_of_its_own() -> None:
    alone = {name for name in nonideal.CASES if name in NonIdeal.__struct_fields__}
    # a tool is a thing in a scene, and this one has none
    assert alone == set(NonIdeal.__struct_fields__) - {"tools"}
