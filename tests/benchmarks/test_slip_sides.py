"""What stands beside the slip detector is what it is called: bound, baselines, curve, chain."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import slip_curve, workers
from benchmarks.slip_baselines import BASELINES, Baseline, Felt, feel, light_units_cusum
from benchmarks.slip_calibration import Gripped, grip_figures, gripped, needed_n, reliability, told
from benchmarks.slip_chain import chain_of
from benchmarks.slip_matched import alarms, evidence, matched, stuck
from benchmarks.slip_scenes import FIRST, stage
from benchmarks.slip_scoring import FRICTION_S, outcome
from benchmarks.slip_search import RANGES, Case, cost, scored
from benchmarks.slip_seen import see
from benchmarks.slip_watch import Watched, listen
from skin.contact.slip import SlipSettings


@pytest.fixture(scope="module")
def slips():
    return stage(3, "slip", 1)


@pytest.fixture(scope="module")
def holds():
    return stage(3, "hold", 1)


# -- the bound ------------------------------------------------------------------------------------


@pytest.mark.parametrize("false_alarms", [0.2, 0.05])
def test_the_matched_filter_is_wrong_as_often_as_it_may(false_alarms):
    rng, trials, cycles = np.random.default_rng(5), 4000, 400
    # the lag grows in small steps, so that the level is hardly overshot
    lag = np.linspace(0.0, 0.6, cycles)[:, np.newaxis]
    wrong = sum(
        alarms(evidence(rng.standard_normal((cycles, 1)), 0.0, lag, 1.0), false_alarms)[-1]
        for _ in range(trials)
    )
    # Ville: no more; and close to it, since the evidence moves by little in a cycle
    spread = 3.0 * np.sqrt(false_alarms / trials)
    assert 0.6 * false_alarms < wrong / trials <= false_alarms + spread


def test_evidence_grows_by_half_the_square_of_the_lag_in_sigmas():
    rng, lag, sigma = np.random.default_rng(6), np.full((20_000, 3), 0.3), 2.0
    found = evidence(lag + sigma * rng.standard_normal(lag.shape), 0.0, lag, sigma)
    mean = 0.5 * lag.size * (0.3 / sigma) ** 2
    # a log likelihood ratio has twice its mean for variance
    assert found[-1] == pytest.approx(mean, abs=3.0 * np.sqrt(2.0 * mean))


def test_what_sticks_is_the_truth_until_it_slips_and_ahead_of_it_then(slips):
    held = stuck(slips)
    until = np.argmax(slips.moving)
    np.testing.assert_allclose(held[:until], slips.displacement_mm[:until], atol=1e-9)
    gone, true = (
        np.hypot(each[-1, 0], each[-1, 1]).max() for each in (held, slips.displacement_mm)
    )
    assert gone > true + 0.02


def test_the_bound_never_alarms_where_no_slip_is_there_and_always_later_if_the_noise_is_more(slips):
    seen = see(slips)
    alarm = matched(slips, seen)
    at = np.argmax(alarm)
    assert alarm[at:].all()
    assert slips.share[at] >= FIRST
    noisy = replace(seen, displacement_sigma_mm=10.0 * seen.displacement_sigma_mm)
    assert np.argmax(matched(slips, noisy)) > at


def test_the_bound_is_silent_while_nothing_slips(holds):
    assert not matched(holds, see(holds)).any()


# -- the baselines --------------------------------------------------------------------------------


def test_a_cusum_is_the_recursion_that_textbooks_have(slips):
    felt = feel(slips, see(slips))
    drift, limit = 1.0, 20.0
    found = light_units_cusum(felt, drift=drift, limit=limit, lowpass_hz=20.0)
    keep, lead, light = np.exp(-2.0 * np.pi * 20.0 / 250.0), np.zeros(3), np.zeros(3)
    lags, sizes = [], []
    for heavy_now, light_now in zip(felt.heavy, felt.light, strict=True):
        lead = keep * lead + (1.0 - keep) * heavy_now
        light = keep * light + (1.0 - keep) * light_now
        sizes.append(np.linalg.norm(lead))
        lags.append(sizes[-1] - light @ lead / max(sizes[-1], 1e-9))
    sigma = np.hypot(np.std(np.array(lags)[felt.rest]), 0.01 * np.array(sizes))
    level, expected = 0.0, []
    for moving, lag, of in zip(felt.moving, lags, sigma, strict=True):
        level = max(0.0, level + lag / of - drift) if moving else level
        expected.append(moving and level > limit)
    np.testing.assert_array_equal(found, expected)
    assert found.any()


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_are_silent_before_the_motion_and_searched_within_their_ranges(name, slips):
    felt = feel(slips, see(slips))
    assert not BASELINES[name](felt)[~slips.moving].any()
    settings = BASELINES[name].settings
    assert settings.keys() == RANGES[name].keys()
    for key, (least, most) in RANGES[name].items():
        assert least <= settings[key] <= most


def test_a_search_prefers_what_catches_more_and_then_what_is_quiet():
    time_s = np.arange(100) / 250.0
    zeros = np.zeros(100)

    def case(slips):
        felt = Felt(250.0, 0.5, time_s > 0.1, time_s <= 0.1, zeros, zeros, zeros, zeros)
        return Case(felt, time_s, slips, *((0.2, 0.3) if slips else (np.inf, np.inf)))

    cases = [case(True), case(False)]

    def alarms_from(slip_s):
        return Baseline(lambda felt: time_s >= slip_s, {})

    assert scored(alarms_from(0.25), cases)[:2] == (1.0, 1.0)
    assert scored(alarms_from(0.35), cases)[0] == scored(alarms_from(0.15), cases)[0] == 0.0
    never = Baseline(lambda felt: time_s < 0.0, {})
    assert cost(never, cases) < cost(alarms_from(0.25), cases)
    assert cost(alarms_from(0.21), cases[:1] * 2 + cases[1:]) < cost(
        alarms_from(0.29), cases[:1] * 2 + cases[1:]
    )


# -- what else the detector says ------------------------------------------------------------------


def said(trial, **values):
    """A detector that says these in every cycle."""
    cycles = len(trial.time_s)
    whole = {name: np.full(cycles, np.nan) for name in
             ("friction", "slip_probability", "grip_force", "grip_force_sigma")}  # fmt: skip
    whole |= {name: np.broadcast_to(value, cycles) for name, value in values.items()}
    return Watched(trial.share >= FIRST, **whole)


def test_a_probability_that_is_always_right_has_a_score_of_nothing(slips):
    true = (slips.share >= FIRST).astype(float)
    found = reliability([told(slips, said(slips, slip_probability=true))])
    assert found["brier"] == 0.0
    assert found["skill"] == 1.0
    assert [row["true"] for row in found["table"]] == [0.0, 1.0]
    wrong = reliability([told(slips, said(slips, slip_probability=1.0 - true))])
    assert wrong["brier"] == 1.0
    often = true.mean()
    dull = reliability([told(slips, said(slips, slip_probability=often))])
    assert dull["brier"] == pytest.approx(often * (1.0 - often))
    assert dull["skill"] == pytest.approx(0.0, abs=1e-12)


def test_what_says_no_probability_has_no_score(slips):
    assert reliability([told(slips, said(slips))]) is None


def test_the_load_that_would_have_held_is_that_of_a_body_that_slides():
    drawn = (stage(3, "slip", number) for number in range(20))
    trial = next(one for one in drawn if one.plan.skin == "flat" and not one.plan.turn_rad_per_mm)
    at = len(trial.time_s) - 1
    assert trial.share[at] > 0.95
    # while all faces slide straight on, the load there is is just what friction needs
    assert needed_n(trial, at) == pytest.approx(trial.force[at, 2].sum(), rel=0.05)
    before = np.argmax(trial.moving)
    assert needed_n(trial, before) < 0.5 * trial.force[before, 2].sum()


def test_grip_forces_are_scored_without_the_safety_that_was_asked_for(slips):
    watched = listen(slips, see(slips))
    one = outcome(slips, watched.alarm)
    since_s = slips.time_s - slips.plan.begins_s
    at = min(int(np.searchsorted(since_s, one.alarm_s + FRICTION_S)), since_s.size - 1)
    force = 1.1 * SlipSettings().safety * needed_n(slips, at)
    found = gripped(slips, said(slips, grip_force=force, grip_force_sigma=0.1 * force), one)
    assert found.relative == pytest.approx(0.1)
    assert found.sigmas == pytest.approx(0.1 / 0.11)
    figures = grip_figures([found, Gripped(np.nan, np.nan), Gripped(-0.3, -2.0)])
    assert figures["known"] == 2
    assert figures["error_median"] == pytest.approx(0.2)
    assert figures["coverage"]["rate"] == 0.5


# -- curve and chain ------------------------------------------------------------------------------


def test_a_curve_falls_from_false_alarms_to_none():
    settings = slip_curve.levels()
    trials = [("base", "slip", 0), *(("base", "hold", i) for i in range(40))]
    rows = slip_curve.curve(trials, settings, seed=3)
    alarms = [row["rates"]["false_alarms_per_minute"]["rate"] for row in rows]
    late = [np.inf if row["latency_ms_first_p90"] is None else row["latency_ms_first_p90"]
            for row in rows]  # fmt: skip
    strict, loose = (0, -1) if alarms[0] < alarms[-1] else (-1, 0)
    assert alarms[strict] == 0.0 < alarms[loose]
    # who is asked to be seldom wrong is later
    assert late[loose] < late[strict]


def test_a_curve_is_shown(monkeypatch):
    monkeypatch.setattr(slip_curve, "TRIALS", {"slip": 1, "hold": 1, "modulation": 0})
    monkeypatch.setattr(slip_curve, "FAMILIES", ("base",))
    monkeypatch.setattr(workers, "processors", lambda: 1)
    figures = slip_curve.run(quick=False)
    assert len(slip_curve.table(figures).splitlines()) == 1 + len(figures["levels"])


@pytest.mark.long
def test_the_chain_tells_what_moved_within_its_sigma():
    trial = stage(5, "hold", 0)
    seen = chain_of(trial.plan.skin, 2).decode(trial)
    touched = trial.force[-1, 2] > 0.3
    wrong = (seen.displacement_mm - trial.displacement_mm) / seen.displacement_sigma_mm
    assert 0.9 < wrong[:, :2][..., touched].std() < 1.2
    forces = (seen.force - trial.force)[..., touched]
    assert np.abs(forces.mean(axis=0)).max() < 0.1
