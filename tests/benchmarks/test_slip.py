"""The score of slip detectors says what it claims, and its trials are what they are called."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from benchmarks import slip, workers
from benchmarks.slip_intervals import per_minute, rate
from benchmarks.slip_play import lasting
from benchmarks.slip_rows import Counts
from benchmarks.slip_scenes import FAMILIES, FEW, FIRST, KINDS, ONSET, PITCH_M, play, skin_of, stage
from benchmarks.slip_scoring import FRICTION_S, outcome, score
from benchmarks.slip_seen import SIGHTS, Sight, see, unit_noise
from skin.physics.elastic import Elastic


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
    ("cycles", "caught", "premature", "latency_ms", "lead_ms"),
    [
        ((), 0.0, 0.0, None, 0.0),
        ((3, 4), 1.0, 0.0, 0.0, 200.0),
        ((2,), 1.0, 0.0, -100.0, 300.0),
        ((4,), 1.0, 0.0, 100.0, 100.0),
        ((5,), 0.0, 0.0, 200.0, 0.0),
        ((6,), 0.0, 0.0, 300.0, 0.0),
        ((1, 4), 0.0, 1.0, -200.0, 0.0),
        ((0, 4), 1.0, 1.0, 100.0, 100.0),
    ],
)
def test_one_slip_is_scored_by_its_first_alarm(cycles, caught, premature, latency_ms, lead_ms):
    figures = score([outcome(trial(SLIDES), alarm(*cycles))])
    assert figures["lead_ms_median"] == pytest.approx(lead_ms, abs=1e-6)
    assert figures["latency_ms_first_p90"] == (
        None if latency_ms is None else pytest.approx(latency_ms + 100.0, abs=1e-6)
    )
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
    assert figures["rates"]["caught_before_gross"] is None
    assert figures["rates"]["false_alarm_hold"]["trials"] == 4
    # two alarms in five times 0.65 s, each held until its end
    assert figures["rates"]["false_alarms_per_minute"]["rate"] == pytest.approx(2 / (3.25 / 60.0))


def test_a_slip_that_never_becomes_gross_is_neither_caught_nor_has_a_lead():
    figures = score([outcome(trial((0.0, 0.0, 0.05, 0.2, 0.5, 0.5, 0.5)), alarm(3))])
    assert figures["caught_before_gross"] is None
    assert figures["lead_ms_median"] is None
    assert figures["latency_ms_first_median"] == pytest.approx(100.0)


def holds(interval, truth):
    return interval["lower"] <= truth <= interval["upper"]


@pytest.mark.parametrize("share", [0.001, 0.03, 0.5])
def test_intervals_of_rates_hold_the_truth_in_95_of_100_cases(share):
    trials = 60
    held = [holds(rate(hits, trials), share) for hits in range(trials + 1)]
    assert stats.binom(trials, share).pmf(np.flatnonzero(held)).sum() >= 0.95
    mean = 60 * share
    held = [holds(per_minute(count, 60.0), mean) for count in range(200)]
    assert stats.poisson(mean).pmf(np.flatnonzero(held)).sum() >= 0.95


def test_intervals_are_those_of_the_tables():
    # Clopper and Pearson 1934; Garwood 1936
    assert [rate(5, 10)[end] for end in ("lower", "upper")] == pytest.approx([0.1871, 0.8129], 1e-3)
    assert rate(0, 10)["upper"] == pytest.approx(0.3085, 1e-3)
    assert rate(10, 10)["upper"] == 1.0
    found = per_minute(10, 120.0)
    assert [2.0 * found[end] for end in ("lower", "upper")] == pytest.approx([4.795, 18.39], 1e-3)
    assert rate(0, 0) is None
    assert per_minute(0, 0.0) is None


@pytest.mark.parametrize(
    ("kind", "few", "number", "known"),
    [
        ("slip", False, 0, ("cylinder", 1566758165, 211, 75.1183950414361, 31.132309768965822)),
        ("hold", False, 0, ("flat", 1404384863, 728, 7466.850389816151, 0.0)),
        ("modulation", False, 1, ("flat", 251824352, 602, 1609.666888961763, 0.05291102927809006)),
        ("slip", True, 0, ("flat", 1053774385, 609, 1468.0526721274532, 138.60535037933275)),
        ("hold", True, 0, ("cylinder", 500026316, 590, 824.9070911537199, 0.0)),
    ],
)
def test_the_base_draws_what_it_drew_before_there_were_families(kind, few, number, known):
    one = stage(5, kind, number, few=few)
    skin, seed, cycles, moved, share = known
    assert (one.plan.skin, one.plan.seed, len(one.time_s)) == (skin, seed, cycles)
    assert one.displacement_mm.sum() == pytest.approx(moved, rel=1e-6)
    assert one.share.sum() == pytest.approx(share, rel=1e-6)


def dragged_mm(one):
    """How far the farthest face is dragged where all of it slips, as it lies when it begins."""
    at = np.argmax(one.moving)
    skin, load = skin_of(one.plan.skin), one.force[at, 2]
    law = Elastic(skin)
    return float(law.displacement(one.plan.friction * load, law.depth(load)).max())


def test_light_grips_are_light_and_fast_and_slow_ones_what_they_say():
    light = [stage(3, "slip", i, family="light") for i in range(2)]
    assert all(0.09 < dragged_mm(one) < 0.42 for one in light)
    assert all(6 <= (one.force[-1, 2] > 0.0).sum() for one in light)
    base = [stage(3, "slip", i) for i in range(4)]
    assert np.median([dragged_mm(one) for one in base]) > 0.5
    fast = [stage(3, "slip", i, family="fast") for i in range(2)]
    assert all(10.0 <= one.plan.speed_mm_s <= 50.0 for one in fast)
    slow = stage(3, "slip", 0, family="slow")
    assert 0.05 <= slow.plan.speed_mm_s <= 0.5
    assert slow.share.max() >= ONSET


def test_a_soft_object_yields_by_a_millimetre_a_newton():
    soft, stiff = (stage(3, "hold", 1, family=name) for name in ("soft", "base"))
    assert soft.plan.body.compliance_mm_per_n == 1.0
    # the same face bears the same for a deeper body
    assert soft.plan.depth_mm > stiff.plan.depth_mm


def test_friction_is_spread_over_the_face_and_never_negative():
    spread = np.concatenate([
        np.log(one.plan.friction / one.plan.friction.mean())
        for one in (stage(3, "slip", i, family="spread") for i in range(6))
    ])  # fmt: skip
    assert np.isfinite(spread).all()
    assert 0.2 < spread.std() < 0.35
    one = next(one for one in (stage(3, "slip", i, family="spread") for i in range(9))
               if one.plan.skin == "flat")  # fmt: skip
    ratio = one.plan.kinetic / one.plan.friction
    assert np.ptp(ratio) < 1e-12
    assert 0.8 <= ratio[0] <= 1.0
    # neighbours are more alike than faces far from each other
    logs, place = np.log(one.plan.friction), skin_of("flat").position
    gap = np.linalg.norm(place[:, :, np.newaxis] - place[:, np.newaxis], axis=0)
    unlike = (logs[:, np.newaxis] - logs) ** 2
    near, far = (gap > 0) & (gap < 1.1 * PITCH_M), gap > 4.0 * PITCH_M
    assert unlike[near].mean() < unlike[far].mean()


@pytest.mark.parametrize("family", ["100 Hz", "1 kHz"])
def test_other_rates_play_the_same_motion_in_other_steps(family):
    one, base = stage(3, "slip", 0, family=family), stage(3, "slip", 0)
    assert np.diff(one.time_s) == pytest.approx(1.0 / FAMILIES[family].rate_hz)
    assert one.plan.depth_mm == base.plan.depth_mm
    began = [each.time_s[np.argmax(each.moving & (each.share >= ONSET))] for each in (one, base)]
    assert began[0] == pytest.approx(began[1], abs=0.02)


def test_a_rolling_body_drags_faces_less_than_it_goes():
    one = stage(3, "slip", 1, family="rolling")
    slides = replace(one.plan, roll_per_m=0.0)
    other = play(slides)
    first = [each.travel_mm[np.argmax(each.moving & (each.share >= ONSET))]
             for each in (one, other)]  # fmt: skip
    assert first[0] > 1.2 * first[1]


def test_a_shaking_body_shakes_the_faces_that_it_touches():
    one = stage(3, "hold", 0, family="shaking")
    still = one.time_s > one.time_s[-1] - 1.0
    loaded = one.force[-1, 2] > 0.5 * one.force[-1, 2].max()
    moved = one.displacement_mm[still][:, :2][..., loaded]
    size = np.hypot(*np.ptp(moved, axis=0))
    assert 0.2 * one.plan.shake_mm < size.max() < 2.5 * one.plan.shake_mm
    assert (one.share < FIRST).all()


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


@pytest.mark.parametrize(("kind", "few"), [*((kind, False) for kind in KINDS), ("slip", True)])
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


NOISES = {"white": Sight(), "over 20 ms": SIGHTS["noise over 20 ms"],
          "Student t(4)": SIGHTS["Student t(4)"]}  # fmt: skip


@pytest.mark.parametrize("name", NOISES)
def test_noises_have_the_variance_the_correlation_and_the_tails_that_they_say(name):
    noise = unit_noise(np.random.default_rng(4), (4000, 2, 50), 250.0, NOISES[name])
    assert noise.var() == pytest.approx(1.0, abs=0.03)
    assert noise[0].var() == pytest.approx(1.0, abs=0.5)
    lag = 5  # 20 ms
    kept = (noise[lag:] * noise[:-lag]).mean()
    assert kept == pytest.approx(np.exp(-1.0) if name == "over 20 ms" else 0.0, abs=0.03)
    # of the normal, from tables
    beyond = (np.abs(noise) > 4.0).mean()
    tails = {"Student t(4)": 2.0 * stats.t(4).sf(4.0 * np.sqrt(2.0))}
    assert beyond == pytest.approx(tails.get(name, 6.3e-5), rel=0.5)


def test_noise_that_sigma_does_not_tell_is_as_large_as_it_says():
    one = stage(3, "hold", 2)

    def scaled(sight):
        seen = see(one, residue=0.0, sight=sight)
        wrong = np.diff(seen.displacement_mm - one.displacement_mm, axis=0)
        return (wrong / seen.displacement_sigma_mm[1:] / np.sqrt(2.0)).std(axis=(0, 1))

    assert scaled(Sight()) == pytest.approx(1.0, abs=0.15)
    assert scaled(SIGHTS["noise x 2"]) == pytest.approx(2.0, abs=0.3)
    assert np.log(scaled(SIGHTS["unlike noise"])).std() == pytest.approx(0.4, abs=0.15)


def test_dead_units_are_silent_late_ones_say_what_they_said_and_drift_goes_on():
    one = stage(3, "hold", 2)
    plain, dead, late, drift = (
        see(one, sight=sight)
        for sight in (Sight(), SIGHTS["dead units"], SIGHTS["late units"], SIGHTS["drift"])
    )
    silent = np.isnan(dead.force).all(axis=(0, 1))
    assert 0.01 <= silent.mean() <= 0.11
    assert not np.isnan(dead.displacement_mm[..., ~silent]).any()
    said, before = late.displacement_mm[1:], plain.displacement_mm
    held = (said == before[:-1]).all(axis=(0, 1))
    np.testing.assert_array_equal(said[..., ~held], before[1:][..., ~held])
    assert 0.1 < held.mean() < 0.4
    gone = drift.displacement_mm - plain.displacement_mm
    speed = gone[-100:].mean(axis=0) / one.time_s[-100:].mean()
    assert speed.std() == pytest.approx(SIGHTS["drift"].drift_mm_s, rel=0.3)


def test_slow_noise_and_noise_that_grows_are_as_large_as_they_say():
    one = stage(3, "hold", 2)
    long = lasting(one, 10.0)
    assert long.time_s[-1] == pytest.approx(10.0)
    np.testing.assert_allclose(np.diff(long.time_s), 1.0 / one.plan.rate_hz)
    np.testing.assert_array_equal(long.displacement_mm[-1], one.displacement_mm[-1])
    np.testing.assert_array_equal(long.force[: len(one.force)], one.force)
    names = ("wander of 1 sigma", "noise that doubles", "fast drift along")
    plain, slow, grown, drift = (
        see(long, residue=0.0, sight=sight) for sight in (Sight(), *map(SIGHTS.get, names))
    )
    sigma = plain.displacement_sigma_mm[:, :2]
    wander = (slow.displacement_mm - plain.displacement_mm)[:, :2] / sigma
    assert wander.std() == pytest.approx(1.0, rel=0.2)
    assert np.diff(wander, axis=0).std() == pytest.approx(np.sqrt(2.0 * 0.004 / 2.0), rel=0.1)
    wrong = np.diff((grown.displacement_mm - long.displacement_mm)[:, :2], axis=0) / sigma[1:]
    still = ~long.moving[1:]
    assert wrong[~still].std() == pytest.approx(2.0 * wrong[still].std(), rel=0.1)
    gone = drift.displacement_mm - plain.displacement_mm
    assert gone[-1, :2].std() == pytest.approx(10.0 * 0.02, rel=0.3)
    assert np.abs(gone[:, 2]).max() < 1e-9


def test_draws_of_a_trial_are_independent():
    one = stage(3, "hold", 2)
    first, again, other = (see(one, draw=draw).displacement_mm for draw in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    wrong = [(each - one.displacement_mm)[:, 2].ravel() for each in (first, other)]
    assert abs(np.corrcoef(*wrong)[0, 1]) < 0.02


def test_the_benchmark_runs_and_shows(monkeypatch):
    every = dict.fromkeys(KINDS, 1)
    counts = Counts(base=dict.fromkeys(KINDS, 2), others=1, robust=every, few=1, chain=0)
    monkeypatch.setattr(slip, "WHOLE", counts)
    monkeypatch.setattr(workers, "processors", lambda: 1)
    # what lasts long is for others
    monkeypatch.setattr(
        "benchmarks.slip_rows.FAMILIES", {name: FAMILIES[name] for name in ("base", "light")}
    )
    figures = slip.run(quick=False)
    json.loads(json.dumps(figures), parse_constant=pytest.fail)
    assert {"displacement", "sine law", "friction ratio", "bound: displacement"} < set(
        figures["detectors"]
    )
    assert figures["slip_robust"].keys() == {"light", *SIGHTS}
    assert figures["slip_robust"]["light"]["bound"]["slips"] == 1
    assert figures["detectors"]["displacement"]["slips"] == 2
    assert figures["false_alarm_hold_rate"]["trials"] == 2
    rows = len(figures["detectors"]) + len(figures["slip_robust"]) + 1
    assert len(slip.table(figures).splitlines()) == rows + 5
