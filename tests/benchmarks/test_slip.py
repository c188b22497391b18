"""Slip against a physics that the detector does not know: coupled faces, Coulomb, relaxation."""

import numpy as np
import pytest

from benchmarks import slip, workers
from benchmarks.slip_play import FIRST, GROSS, ONSET, Plan, play
from benchmarks.slip_scenes import stage
from benchmarks.slip_scoring import WARNING_S, outcome, watch
from benchmarks.slip_seen import see
from skin.sim.mechanics.body import Body

pytestmark = pytest.mark.long


def plan(**changes):
    """A ball of half a metre on a flat skin; friction 0.5 at rest, 0.45 in motion."""
    values = {
        "kind": "slip", "skin": "flat", "body": Body.sphere(0.5),
        "lean": (np.eye(3), np.array([0.004, -0.003, 0.5])), "depth_mm": 1.2,
        "friction": np.full(64, 0.5), "kinetic": np.full(64, 0.45), "modulus_pa": 6e5,
        "press_s": 0.2, "speed_mm_s": 3.0, "heading_rad": 0.4, "turn_rad_per_mm": 0.0,
        "pivot_m": (0.0, 0.0), "seed": 5,
    }  # fmt: skip
    return Plan(**{**values, **changes})


WAYS = {
    "straight": {},
    "turning on the spot": {"slide": 0.0, "turn_rad_per_mm": 0.05},
    "both": {"turn_rad_per_mm": -0.03, "pivot_m": (0.01, 0.0)},
    "straight over a cylinder": {"skin": "cylinder", "body": Body.plate(0.2, 0.2),
                                 "lean": (np.eye(3), np.zeros(3)), "heading_rad": 1.57},
}  # fmt: skip


@pytest.fixture(scope="module", params=WAYS)
def slipping(request):
    return play(plan(**WAYS[request.param]))


def test_slip_is_seen_between_its_first_sign_and_gross_slip(slipping):
    alarm, friction = watch(slipping, see(slipping))
    found = outcome(slipping, alarm, friction)
    assert not found.early
    assert found.first_s <= found.alarm_s < max(found.gross_s, found.onset_s + WARNING_S)
    assert found.alarm_s < found.onset_s + 0.06
    assert abs(found.friction_error) < 0.1


@pytest.mark.parametrize("number", [100, 176])
def test_a_light_unit_that_slips_alone_is_not_taken_for_slip_of_its_neighbours(number):
    trial = stage(11, "slip", number)
    alarm, friction = watch(trial, see(trial))
    assert not outcome(trial, alarm, friction).false


def test_the_truth_slips_from_nothing_to_everything(slipping):
    share = slipping.share[slipping.moving]
    assert share[0] < FIRST
    assert np.argmax(share >= FIRST) <= np.argmax(share >= ONSET) < np.argmax(share >= GROSS)


@pytest.mark.parametrize("modulation", [0.0, 0.1, 0.3])
def test_a_grip_that_holds_is_quiet(modulation):
    trial = play(
        plan(kind="modulation", farthest_mm=0.03, modulation=modulation, modulation_hz=2.0)
    )
    assert trial.share.max() < FIRST
    load = trial.force[trial.moving, 2].sum(axis=1)
    assert np.ptp(load) / np.median(load) == pytest.approx(2.0 * modulation, abs=0.02)
    alarm, _ = watch(trial, see(trial))
    assert not alarm.any()


def test_trials_are_what_they_were_when_the_stored_figures_were_measured():
    known = {"slip": ("cylinder", 1566758165, 211, 75.1183950414361),
             "hold": ("flat", 1404384863, 728, 7466.850389816151)}  # fmt: skip
    for kind, (skin, seed, cycles, moved) in known.items():
        one = stage(5, kind, 0)
        assert (one.plan.skin, one.plan.seed, len(one.time_s)) == (skin, seed, cycles)
        assert one.displacement_mm.sum() == pytest.approx(moved, rel=1e-6)


def test_the_benchmark_runs_and_shows(monkeypatch):
    monkeypatch.setattr(workers, "processors", lambda: 1)
    figures = slip.run(quick=True)
    assert figures["slips"] == slip.BASE[True]["slip"]
    assert figures["slip_robust"].keys() == {*slip.FAMILIES, *slip.SIGHTS} - {"base"}
    assert len(slip.table(figures).splitlines()) == len(figures["slip_robust"]) + 4
