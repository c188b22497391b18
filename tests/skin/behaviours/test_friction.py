"""The posterior of friction, by a block between pads: Newton's law in steps of 0.1 ms."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from skin.behaviours.friction import LOWER, Friction, G

PERIOD_S, STEP_S = 0.004, 1e-4
NOISE = 0.1


def hung(static, kinetic, grips, rng=None, noise=NOISE):
    """Tangential load over weight of a block between pads, whose grip over its weight goes evenly
    from one value to the next, a cycle each; at the end of the cycles, and how far it went."""
    speed, way, shares = 0.0, 0.0, []
    for before, after in itertools.pairwise(grips):
        for grip in np.linspace(before, after, round(PERIOD_S / STEP_S), endpoint=False):
            slides = speed > 0.0 or static * grip < 1.0
            drag = kinetic * grip if slides else 1.0
            faster = speed + G * STEP_S * (1.0 - drag)
            if slides and faster <= 0.0:
                drag, faster = 1.0, 0.0
            speed = faster
            way += STEP_S * speed
        shares.append(drag)  # a unit is read at the end of a cycle
    shares = np.array(shares)
    return shares if rng is None else shares + rng.normal(0.0, noise, shares.size), way


def dip(low, high):
    """Grips of a dip from `high` to `low` and up again beyond it, by an actuator with a lag."""
    wanted = np.concatenate([[high] * 2, [low] * 6, [1.6 * high] * 14, [high] * 20])
    felt = [high]
    for each in wanted:
        felt.append(felt[-1] + 0.45 * (each - felt[-1]))
    return np.array(felt)


def watched(friction, static, kinetic, lows, rng, high=None):
    """What dips to these grips, in turn, make of a posterior; the slide of all."""
    gone = 0.0
    for low in lows:
        grips = dip(low, 1.6 * low if high is None else high)
        shares, way = hung(static, kinetic, grips, rng)
        gone += way
        friction.begin()
        for grip, share in zip(grips[1:], shares, strict=True):
            friction.watch(1.0, float(grip), float(share), NOISE)
        friction.take()
    return gone


def test_before_anything_is_known_the_lower_bound_is_the_given_one():
    for least in (0.15, 0.25, 0.4):
        assert Friction(least, PERIOD_S).quantile(LOWER) == pytest.approx(least, rel=0.05)


def test_both_coefficients_are_found_from_dips_that_slide():
    rng = np.random.default_rng(1)
    for static, share in ((0.4, 0.9), (0.6, 0.7), (0.9, 0.98)):
        friction = Friction(0.25, PERIOD_S)
        watched(friction, static, share * static, [1.3 / static] + 4 * [0.75 / static], rng)
        assert friction.quantile(LOWER) / 1.03 < static < friction.quantile(1.0 - LOWER)
        found = float(friction.weights @ friction.kinetic)
        assert found == pytest.approx(share * static, rel=0.12)


def test_the_lower_bound_is_wrong_as_seldom_as_it_says():
    rng, wrong, spread = np.random.default_rng(2), 0, []
    for _ in range(150):
        static, share = np.exp(rng.uniform(np.log(0.27), np.log(1.2))), rng.uniform(0.6, 1.0)
        friction = Friction(0.25, PERIOD_S)
        for _ in range(5):
            low = 1.0 / min(friction.quantile(0.5), 1.4 * friction.quantile(LOWER))
            watched(friction, static, share * static, [low], rng)
        wrong += friction.quantile(LOWER) > 1.02 * static
        spread.append(friction.quantile(0.5) / friction.quantile(LOWER))
    assert wrong <= 6  # 1.5 are expected of 150; 7 or more in 1 of 1000
    assert np.median(spread) < 1.4


def test_what_sticks_raises_the_bound_and_nothing_else_is_said_of_motion():
    friction, rng = Friction(0.25, PERIOD_S), np.random.default_rng(3)
    assert watched(friction, 1.2, 1.0, [3.0, 2.2, 1.6], rng) == 0.0
    assert friction.quantile(LOWER) > 0.9 / 1.6 * 0.8
    ratio = friction.kinetic / friction.static
    assert float(friction.weights @ ratio) == pytest.approx(0.775, abs=0.05)


def test_a_load_that_was_borne_is_a_bound():
    friction = Friction(0.25, PERIOD_S)
    friction.bound(0.6)
    assert 0.55 < friction.quantile(LOWER) < 0.6


def test_a_slide_that_an_alarm_reports_lowers_friction_and_one_alarm_is_not_believed_alone():
    friction = Friction(0.25, PERIOD_S)
    before = friction.quantile(0.5)
    friction.slid(0.4)
    assert friction.quantile(0.5) < before
    friction.bound(0.9)  # no slide at 0.4 then: kinetic friction is at least 0.55 of static
    assert friction.quantile(LOWER) > 0.8


def test_the_slide_that_a_dip_may_cost_is_at_least_that_of_the_block():
    friction = Friction(0.25, PERIOD_S)
    friction._log[:] = np.where(abs(friction.static - 0.6) < 0.02, 0.0, -50.0)
    friction._log[friction.kinetic < 0.75 * friction.static] = -50.0
    friction._learn(0.0)
    low = 1.25 / 0.6 * 0.7
    _, way = hung(0.6, 0.5, dip(low, 1.6 * low))
    assert friction.slide_m(np.array([low]), 0.024)[0] == pytest.approx(way, rel=0.6)
    assert friction.slide_m(np.array([1.2 / 0.6]), 0.024)[0] < 1e-9


def test_it_says_whether_something_slides_now():
    friction, rng = Friction(0.25, PERIOD_S), np.random.default_rng(4)
    watched(friction, 0.5, 0.4, [2.4, 1.8, 1.7], rng)
    friction.begin()
    grips = np.concatenate([[2.5], np.linspace(2.5, 1.4, 6), [1.4] * 4])
    shares, _ = hung(0.5, 0.4, grips, rng)
    for grip, share in zip(grips[1:], shares, strict=True):
        friction.watch(1.0, float(grip), float(share), NOISE)
    assert friction.slides > 0.95
    for _ in range(20):
        friction.watch(1.0, 5.0, 1.0, NOISE)
    assert friction.slides < 0.05
