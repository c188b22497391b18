"""The filter against batch least squares, and against noise that is made up."""

from enum import IntEnum

import numpy as np
import pytest

from skin.behaviours.kalman import Kalman, Noise, _follow


def test_a_ramp_is_that_of_least_squares():
    random = np.random.default_rng(1)
    period_s, count, sigma = 0.01, 300, 0.2
    times = period_s * np.arange(1, count + 1)
    values = 3.0 + 2.0 * times + random.normal(0.0, sigma, count)
    filter = Kalman(np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros((2, 2)), period_s)
    filter.begin(np.zeros(2), 1e8 * np.eye(2))
    for value in values:
        filter.update(0, value, sigma**2)
    design = np.stack([np.ones(count), times - times[-1]], axis=1)
    expected = np.linalg.lstsq(design, values, rcond=None)[0]
    np.testing.assert_allclose(filter.x, expected, rtol=1e-5)
    covariance = sigma**2 * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(filter.covariance, covariance, rtol=1e-4)


def test_a_silence_of_many_periods_is_as_that_many_of_one():
    one, many = (Kalman(np.array([[0.0, 1.0], [0.0, -0.5]]), np.eye(2), 0.02) for _ in range(2))
    for filter in (one, many):
        filter.begin(np.array([1.0, 2.0]), np.eye(2))
    for _ in range(50):
        one.update(0, np.nan, 1.0)
    many.update(0, np.nan, 1.0, 50)
    np.testing.assert_allclose(one.x, many.x)
    np.testing.assert_allclose(one.covariance, many.covariance)
    # of a walk: the variance is the time
    assert one.covariance[1, 1] == pytest.approx(np.exp(-1.0) + 1.0 - np.exp(-1.0), rel=1e-3)


def test_the_settled_sigma_is_where_it_settles():
    filter = Kalman(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, 0.01]), 0.01)
    filter.begin(np.zeros(2), np.eye(2))
    for _ in range(5000):
        filter.update(0, 0.0, 0.04)
    assert filter.sigma(1) == pytest.approx(filter.settled_sigma(1, 0, 0.04), rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_jump_is_told_and_noise_is_not(seed):
    random = np.random.default_rng(seed)
    filter = Kalman(np.zeros((1, 1)), np.zeros((1, 1)), 0.004)
    filter.begin(np.zeros(1), np.array([[0.01]]))
    told = 0
    for _ in range(5000):
        filter.update(0, random.normal(), 1.0)
        told += filter.changed
    assert told < 20  # a few cycles in a row at most, in 20 s
    filter.begin(np.zeros(1), np.array([[0.01]]))
    count = 0
    while not filter.changed:
        filter.update(0, 1.0 + random.normal(), 1.0)
        count += 1
        assert count < 100
    filter.inflate(0, 1.0)
    for _ in range(1000):
        filter.update(0, 1.0 + random.normal(), 1.0)
    assert filter.x[0] == pytest.approx(1.0, abs=0.15)


def test_a_jump_some_periods_ago_has_led_to_what_it_leads_to_since():
    flows = np.array([[0.0, 1.0], [0.0, 0.0]])
    filter = Kalman(flows, np.zeros((2, 2)), 0.01)
    filter.begin(np.zeros(2), np.zeros((2, 2)))
    filter.jump(1, 3.0, 50)
    # a ramp of 3 ± 0.0 units a second for half a second
    np.testing.assert_allclose(filter.covariance, 9.0 * np.array([[0.25, 0.5], [0.5, 1.0]]))


def test_a_long_mean_tells_a_change_that_a_short_one_does_not():
    told = []
    for innovation_s in ((0.12,), (0.12, 1.0)):
        random = np.random.default_rng(7)
        filter = Kalman(np.zeros((1, 1)), np.zeros((1, 1)), 0.004, innovation_s)
        filter.begin(np.zeros(1), np.array([[1e-6]]))
        for _ in range(750):
            filter.update(0, 0.4 + random.normal(), 1.0)
        told.append(abs(filter.disagreement))
        assert filter.lag == pytest.approx(0.4, abs=0.2) or len(innovation_s) == 1
    assert told[1] > 4.0 > told[0]


def test_a_state_that_is_another_and_one_of_another_unit():
    filter = Kalman(np.zeros((2, 2)), np.zeros((2, 2)), 0.01)
    filter.begin(np.array([5.0, 2.0]), np.array([[4.0, 1.0], [1.0, 9.0]]))
    filter.equate(0, 1, 10.0)
    np.testing.assert_allclose(filter.x, [12.0, 2.0])
    np.testing.assert_allclose(filter.covariance, np.full((2, 2), 9.0))
    filter.scale(0, 2.0)
    np.testing.assert_allclose(filter.x, [24.0, 2.0])
    np.testing.assert_allclose(filter.covariance, [[36.0, 18.0], [18.0, 9.0]])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_no_measurement(bad):
    filter = Kalman(np.zeros((1, 1)), np.zeros((1, 1)), 0.01)
    filter.begin(np.zeros(1), np.eye(1))
    filter.update(0, bad, 1.0)
    filter.update(0, 1.0, bad)
    assert filter.x[0] == 0.0
    assert not filter.changed
    noise = Noise(1.0, 0.01)
    for value in (1.0, bad, 1.0, 1.0):
        noise.update(value)
    assert np.isfinite(noise.variance)


def test_noise_is_learned_from_neighbours_and_jumps_are_left_out():
    random = np.random.default_rng(3)
    noise = Noise(1.0, 0.004)
    for k in range(5000):
        jumped = k % 100 == 0
        noise.update(100.0 * (k // 100) + random.normal(0.0, 0.1), not jumped)
    assert noise.variance == pytest.approx(0.01, rel=0.15)


class Row(IntEnum):
    """Some states, named."""

    ONE = 1


def test_named_states_are_no_signature_of_their_own():
    for row in (1, Row.ONE, np.int32(1)):
        one = Kalman(np.zeros((2, 2)), np.eye(2), 0.01)
        one.begin(np.zeros(2), np.eye(2))
        one.update(row, 1.0, 0.5)
        assert one.x[1] > 0.0
    assert len(getattr(_follow, "signatures", [()])) == 1
