"""Time of cycles from stamps and numbers: jitter, gaps, clocks that are set, other rates."""

from __future__ import annotations

import numpy as np
import pytest

from skin.clock import Clock

PERIOD = 4_000_000


def times(clock, numbers, stamps):
    found = []
    for number, stamp in zip(numbers, stamps, strict=True):
        clock.tick(int(number), int(stamp))
        found.append(clock.now_ns)
    return np.array(found)


def test_steady_cycles_are_a_period_apart_to_the_nanosecond():
    now = times(Clock(PERIOD), range(500), 10**18 + PERIOD * np.arange(500))
    assert (now == PERIOD * np.arange(500)).all()


def test_jitter_of_stamps_counts_a_sixteenth():
    rng = np.random.default_rng(1)
    stamps = PERIOD * np.arange(2000) + rng.normal(0.0, 0.2 * PERIOD, 2000)
    now = times(Clock(PERIOD), range(2000), stamps)
    assert np.diff(now).std() < 0.2 * PERIOD / 10.0
    assert abs(now[-1] - PERIOD * 1999) < PERIOD


@pytest.mark.parametrize("rate", [0.5, 0.9, 1.03, 1.3, 3.1, 7.0])
@pytest.mark.parametrize("counted", [False, True])
def test_time_is_that_of_the_stamps_at_any_rate(rate, counted):
    """As a slow consumer makes it, or units that send at a rate of their own."""
    cycles = np.arange(1000)
    numbers = np.rint(rate * cycles) if counted else cycles
    clock = Clock(PERIOD)
    now = times(clock, numbers, rate * PERIOD * cycles)
    off = now - rate * PERIOD * cycles
    assert np.abs(off).max() < 35.0 * PERIOD
    assert np.abs(np.diff(now)[200:] / (rate * PERIOD) - 1.0).max() < (1.0 if counted else 0.01)
    assert np.diff(now)[200:].mean() == pytest.approx(rate * PERIOD, rel=2e-3)
    if rate > 1.5 and not counted:
        assert clock.overruns == pytest.approx((rate - 1.0) * 1000, rel=0.3)


@pytest.mark.parametrize("counted", [False, True])
def test_a_gap_is_as_long_as_it_was(counted):
    clock = Clock(PERIOD)
    times(clock, range(10), PERIOD * np.arange(10))
    clock.tick(9 + (250 if counted else 1), 259 * PERIOD)
    assert clock.elapsed_ns == 250 * PERIOD
    assert clock.overruns == 249
    clock.tick(9 + (251 if counted else 2), 260 * PERIOD)
    assert clock.elapsed_ns == PERIOD
    assert clock.overruns == 249


def test_clocks_that_are_set_do_not_turn_time_back_or_stop_it():
    stamps = PERIOD * np.arange(30)
    stamps[10:] -= 10**12
    stamps[20:] += 10**14
    now = times(Clock(PERIOD), range(30), stamps)
    assert (np.diff(now) == PERIOD).all()


def test_time_without_stamps_goes_by_numbers_which_may_repeat_or_step_back():
    clock = Clock(PERIOD)
    now = times(clock, [3, 4, 4, 9, 2, 3], [0] * 6)
    assert (np.diff(now) == PERIOD * np.array([1, 1, 5, 1, 1])).all()
    assert clock.overruns == 4
