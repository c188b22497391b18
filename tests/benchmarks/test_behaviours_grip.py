"""The benchmark of the grip: what runs come to, counted by hand."""

from __future__ import annotations

import pytest

from benchmarks import behaviours_grip

RUN = {
    "dropped": False, "slid_mm": 1.0, "margin_rest": 0.1, "margin_peak": 0.2, "margin_median": 0.15,
    "return_error": 0.02, "friction_believed": 0.5, "friction": 0.5, "work_us": 10.0, "work": 11.0,
    "kinetic_share": 0.95, "dead": 0, "reactions_s": [0.01, 0.03], "seed": 7000,
}  # fmt: skip


def test_figures_of_runs_are_those_counted_by_hand():
    lost = RUN | {"dropped": True, "seed": 7001, "dead": 2, "margin_median": 9.0, "reactions_s": []}
    late = RUN | {"return_error": -0.2, "seed": 7002, "margin_median": 0.25}
    found = behaviours_grip.figures([RUN, lost, late])
    assert found["dropped_rate"]["rate"] == pytest.approx(1 / 3)
    assert found["dropped_seeds"] == [7001]
    assert found["dropped_with_dead_units"]["rate"] == 1.0
    assert found["margin_median"] == pytest.approx(0.2)
    assert found["share_used_median"] == pytest.approx(1.0 / 1.2)
    assert found["returned_rate"]["rate"] == pytest.approx(0.5)
    assert found["reaction_ms_median"] == pytest.approx(20.0)
    assert "dropped" in behaviours_grip.table(found)


def test_a_part_without_slips_or_dead_units_has_no_such_figures():
    found = behaviours_grip.figures([RUN | {"reactions_s": []}])
    assert found["reaction_ms_median"] is None
    assert found["dropped_with_dead_units"] is None
    assert "none" in behaviours_grip.table(found)
