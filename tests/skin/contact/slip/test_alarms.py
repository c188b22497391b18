"""Alarms: how often there is one without slip, and how soon there is one, at any rate of cycles."""

import numpy as np
import pytest
from scipy.stats import chi2

from skin.contact.record import SlipState
from skin.contact.slip import SlipSettings
from tests.fixtures.cases import long_after_first
from tests.skin.contact.slip.hold import Hold

PER_S = 1.0
"""Alarms without slip that are asked for."""


@long_after_first(
    ("rate_hz", "rows", "columns"),
    [(100.0, 1, 4), (100.0, 2, 3), (100.0, 3, 4), (250.0, 2, 3), (1000.0, 3, 4)],
)
def test_alarms_without_slip_are_rarer_than_was_asked_for(rate_hz, rows, columns):
    alarms, seconds = 0, 0.0
    for seed in range(4):
        hold = Hold(
            rows, columns, rate_hz=rate_hz, seed=seed,
            slip=SlipSettings(false_alarms_per_hour=3600.0 * PER_S),
        )  # fmt: skip
        gain_error, before = 0.012 * hold.rng.standard_normal(hold.n), SlipState.UNKNOWN
        for t in range(int(8.0 * rate_hz)):
            way_mm = 0.5 * min(1.0, 2.0 * t / rate_hz)
            noise = 0.03 * hold.rng.standard_normal((2, hold.n))
            noise[0] += gain_error * way_mm
            hold.step(hold.dome(), (way_mm, 0.0), noise=noise)
            now = hold.contact.slip
            alarms += now >= SlipState.INCIPIENT > before
            before = now
        seconds += 8.0
    # Garwood's interval, 99 %
    assert 0.5 * chi2.ppf(0.995, 2 * alarms + 2) / seconds < PER_S
    # it is no detector that never says a word
    assert alarms > 0


def latency_s(rate_hz, seed):
    """From the first unit that slips to the alarm; 4 mm/s, noise of the same density."""
    hold = Hold(4, 5, rate_hz=rate_hz, sigma_mm=0.03 * np.sqrt(rate_hz / 250.0), seed=seed)
    load, first_s = hold.dome(), None
    for t in range(int(rate_hz)):
        way_mm = 4.0 * max(0.0, t / rate_hz - 0.3)
        truth = hold.step(load, (way_mm, 0.0), 0.4)
        first_s = t / rate_hz if first_s is None and truth.slips.any() else first_s
        if hold.contact.slip >= SlipState.INCIPIENT:
            assert first_s is not None
            return t / rate_hz - first_s
    raise AssertionError("no alarm")


@long_after_first("rate_hz", [1000.0, 100.0])
def test_slip_is_seen_after_the_same_time_at_any_rate(rate_hz):
    at_250 = np.median([latency_s(250.0, seed) for seed in range(5)])
    took = np.median([latency_s(rate_hz, seed) for seed in range(5)])
    assert at_250 / 1.5 < took < 1.5 * at_250


@pytest.mark.parametrize("sigma_mm", [0.0, 1e-5, 1e-3])
def test_slip_of_units_with_hardly_any_noise_is_seen_before_all_slip(sigma_mm):
    hold, alarm = Hold(4, 5, sigma_mm=sigma_mm), False
    # a gate in sigmas needs one
    hold.force_sigma[:] = 0.01
    for t in range(300):
        truth = hold.step(hold.dome(), (10.0 * max(0.0, t / 250.0 - 0.3), 0.0), 0.4)
        alarm |= hold.contact.slip >= SlipState.INCIPIENT
        assert truth.slips.any() or not alarm
        if truth.slips.all():
            break
    assert truth.slips.all()
    assert alarm


@long_after_first("speed_mm_s", [2.0, 0.5])
def test_an_alarm_of_slip_that_goes_on_does_not_come_and_go(speed_mm_s):
    for seed in range(3):
        hold, states = Hold(5, 5, sigma_mm=0.03, seed=seed), []
        for t in range(int(250.0 * (0.5 + 2.0 / speed_mm_s))):
            way_mm = speed_mm_s * max(0.0, t / 250.0 - 0.3)
            hold.step(hold.dome(1.0), (way_mm, 0.0), 0.4)
            states.append(hold.contact.slip)
        alarms = np.array(states) >= SlipState.INCIPIENT
        assert alarms.any()
        assert np.diff(alarms.astype(int)).clip(max=0).sum() == 0


@pytest.mark.parametrize("gap_s", [0.5, 30.0, 3600.0])
def test_a_gap_in_the_cycles_of_what_is_held_is_no_slip(gap_s):
    for seed in range(2):
        hold = Hold(5, 5, sigma_mm=0.01, seed=seed)
        for t in range(600):
            hold.now_ns += round(1e9 * gap_s) if t == 400 else 0
            hold.step(hold.dome(), (0.6 * min(1.0, t / 200.0), 0.0))
            assert hold.contact.slip < SlipState.INCIPIENT


def test_a_face_that_slides_all_alike_is_seen_where_its_friction_is_told():
    hold, even = Hold(3, 3, slip=SlipSettings(friction=0.4)), np.full(9, 2.0)
    seen = []
    for t in range(300):
        truth = hold.step(even, (6.0 * max(0.0, t / 250.0 - 0.3), 0.0), 0.4)
        seen.append(hold.contact.slip)
        assert seen[-1] < SlipState.INCIPIENT or hold.contact.margin < 0.05
    assert truth.slips.all()
    assert max(seen) >= SlipState.INCIPIENT


@pytest.mark.parametrize("left", [0.5, 0.2, 0.0], ids=["half", "few", "no"])
@long_after_first("cycles", [5, 1, 20])
@long_after_first("seed", range(2))
def test_gross_slip_does_not_flicker_while_units_are_heard_in_part(left, cycles, seed):
    hold, told = Hold(4, 4, sigma_mm=0.03, seed=seed), []
    # of which a few are not like all
    friction = 0.4 * np.exp(0.2 * hold.rng.standard_normal(hold.n))
    for t in range(600):
        heard = np.ones(hold.n, bool)
        if t >= 200 and t // cycles % 4 == 0:
            heard = hold.rng.random(hold.n) < left
        hold.step(hold.dome(1.0), (8.0 * max(0.0, t / 250.0 - 0.3), 0.0), friction, valid=heard)
        told += [SlipState(contact.slip) for contact in hold.contacts if contact.id == 1]
    assert set(told[told.index(SlipState.GROSS) :]) == {SlipState.GROSS}
