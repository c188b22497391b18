"""The score of slip detectors says what it claims, and its trials are what they are called."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import slip
from benchmarks.slip_scenes import FEW, FIRST, KINDS, ONSET, stage
from benchmarks.slip_scoring import FRICTION_S, outcome, score
from benchmarks.slip_seen import see


def trial(shares, kind="slip"):
    """A truth: shares from 100 ms before the motion begins, a cycle every 100 ms, 2 mm/s."""
    share = np.array(shares, float)
    time_s = 0.1 * np.arange(share.size) + 0.05
    plan = SimpleNamespace(
        kind=kind, begins_s=0.1, kinetic=np.array([0.4, 0.6]), speed_mm_s=2.0
    )  # fmt: skip
    return SimpleNamespace(
        plan=plan, time_s=time_s, share=share, moving=time_s > plan.begins_s, units=9
    )  # fmt: skip


SLIDES = (0.0, 0.0, 0.05, 0.2, 0.5, 1.0, 1.0)


def alarm(*cycles):
    found = np.zeros(len(SLIDES), bool)
    found[list(cycles)] = True
    return found


@pytest.mark.parametrize(
    ("cycles", "caught", "premature", "latency_ms"),
    [
        ((), 0.0, 0.0, None),
        ((3, 4), 1.0, 0.0, 0.0),
        ((2,), 1.0, 0.0, -100.0),
        ((4,), 1.0, 0.0, 100.0),
        ((5,), 0.0, 0.0, 200.0),
        ((1, 4), 0.0, 1.0, -200.0),
        ((0, 4), 1.0, 1.0, 100.0),
    ],
)
def test_one_slip_is_scored_by_its_first_alarm(cycles, caught, premature, latency_ms):
    figures = score([outcome(trial(SLIDES), alarm(*cycles))])
    assert figures["caught_before_gross"] == figures["caught_with_warning"] == caught
    assert figures["premature"] == premature
    assert figures["latency_ms_median"] == (
        None if latency_ms is None else pytest.approx(latency_ms, abs=1e-6)
    )
    if latency_ms is not None:
        assert figures["way_um_p90"] == pytest.approx(2.0 * latency_ms, abs=1e-6)
    assert figures["false_alarm_hold"] is None


def test_an_alarm_that_never_goes_off_again_counts_once_and_before_the_motion():
    found = outcome(trial(SLIDES), alarm(*range(7)))
    assert found.early
    assert np.isnan(found.alarm_s)


def test_an_alarm_where_nothing_slips_is_false():
    quiet = (0.0, 0.0, 0.01, 0.01, 0.0, 0.0, 0.0)
    holds = [outcome(trial(quiet, "hold"), alarm(*cycles)) for cycles in ((), (4,), (0,), ())]
    grips = [outcome(trial(quiet, "modulation"), alarm())]
    figures = score(holds + grips)
    assert figures["false_alarm_hold"] == 0.5
    assert figures["false_alarm_modulation"] == 0.0
    assert figures["caught_before_gross"] is None


def test_the_friction_estimate_is_read_a_while_after_the_alarm():
    cycles = round(FRICTION_S / 0.1)
    friction = np.full(len(SLIDES), np.nan)
    friction[2 + cycles] = 0.45
    found = outcome(trial(SLIDES), alarm(2, 3), friction)
    assert found.friction_error == pytest.approx(-0.1)
    unknown = outcome(trial(SLIDES), alarm(3), friction)
    figures = score([found, unknown])
    assert figures["friction_error_median"] == pytest.approx(0.1)
    assert figures["friction_known"] == 0.5


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("few", [False, True])
def test_trials_are_what_they_are_called_and_always_the_same(kind, few):
    one, again = (stage(3, kind, 1, few=few) for _ in range(2))
    np.testing.assert_array_equal(one.displacement_mm, again.displacement_mm)
    most = one.share[one.moving].max()
    assert (most >= ONSET) if kind == "slip" else (most < FIRST)
    bears = int((one.force[np.argmax(one.moving), 2] > 0.05).sum())
    # give or take one: here the elastomer has begun to creep
    assert bears <= FEW[1] + 1 if few else bears >= FEW[1]
    # Coulomb: no face bears more than friction at rest
    shear, load = np.hypot(one.force[:, 0], one.force[:, 1]), one.force[:, 2]
    assert (shear <= one.plan.friction * load * (1.0 + 1e-5) + 1e-6).all()


@pytest.mark.parametrize("estimator", ["field-angle", "sine"])
def test_what_units_see_is_wrong_by_its_sigma(estimator):
    one = stage(3, "hold", 2)
    seen = see(one, estimator, residue=0.0)
    wrong = seen.displacement_mm - one.displacement_mm
    # what is left of gains and directions is the same from cycle to cycle
    wrong = np.diff(wrong, axis=0) / seen.displacement_sigma_mm[1:] / np.sqrt(2.0)
    np.testing.assert_allclose(wrong.std(axis=(0, 2)), 1.0, atol=0.02)
    np.testing.assert_allclose(wrong.mean(axis=(0, 2)), 0.0, atol=0.02)


def test_the_benchmark_runs_and_shows(monkeypatch):
    for name, count in (("TRIALS", 2), ("FEW_TRIALS", 1), ("CHAIN_TRIALS", 1), ("WORKERS", 1)):
        monkeypatch.setattr(slip, name, count)
    figures = slip.run(quick=False)
    json.loads(json.dumps(figures), parse_constant=pytest.fail)
    assert {"displacement", "sine law", "chain", "friction ratio"} < set(figures["detectors"])
    assert figures["detectors"]["displacement"]["slips"] == 2
    assert len(slip.table(figures).splitlines()) == len(figures["detectors"]) + 3
