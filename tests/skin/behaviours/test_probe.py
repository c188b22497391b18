"""The probe on a block between two pads, whose gripper is late, slow, stuck or disturbed."""

from __future__ import annotations

from collections import deque

import numpy as np

from skin.behaviours.friction import LOWER, Friction, G
from skin.behaviours.probe import Outcome, Probe
from tests.fixtures.cases import long_after_first

PERIOD_S = 0.004
HUNG_N, SIGMA_N, START_N = 0.8, 0.04, 4.0


class Felt:
    """As much of a `Demand` as a probe looks at."""

    def __init__(self, pull_n):
        self.pull_n, self.borne_n, self.forecast_n, self.sigma_n = pull_n, HUNG_N, HUNG_N, SIGMA_N


class Played:
    """A probe and a block, until the first outcome."""

    def __init__(
        self, static=0.5, kinetic=0.42, delay=0, lag_s=0.01, seed=0, pull=lambda cycle: 0.0,
        stuck=False, least_n=0.4,
    ):  # fmt: skip
        rng, self.friction = np.random.default_rng(seed), Friction(0.25, PERIOD_S)
        self.probe = Probe(PERIOD_S, 0.05, least_n, 20.0)
        self.slid_m, self.outcome, self.commands = 0.0, None, []
        self.began = -1
        queue, grip_n, speed = deque([START_N] * (delay + 1)), START_N, 0.0
        for self.cycle in range(1500):
            weight_n = HUNG_N + pull(self.cycle)
            slides = speed > 0.0 or static * grip_n < weight_n
            drag_n = kinetic * grip_n if slides else weight_n
            faster = speed + G * PERIOD_S * (1.0 - drag_n / weight_n)
            if slides and faster <= 0.0:
                drag_n, faster = weight_n, 0.0
            speed = faster
            self.slid_m += PERIOD_S * speed
            self.speed = speed
            felt = Felt(drag_n + rng.normal(0.0, SIGMA_N))
            load_n = grip_n + rng.normal(0.0, 0.02)
            self.outcome = self.probe.update(load_n, felt, self.friction)
            rest_n = 1.05 * HUNG_N / self.friction.quantile(LOWER)
            command_n = self.probe.command_n if self.probe.dips else min(rest_n, START_N)
            self.commands.append(command_n)
            if self.probe.dips and self.began < 0:
                self.began = self.cycle
            if self.outcome is not None:
                return
            queue.append(START_N if stuck else command_n)
            grip_n += (1.0 - np.exp(-PERIOD_S / lag_s)) * (queue.popleft() - grip_n)
        raise AssertionError


@long_after_first(("static", "share"), [(0.35, 1.0), (0.5, 0.85), (0.8, 0.9)])
def test_friction_is_found_and_its_lower_bound_holds(static, share):
    spread = []
    for seed in range(12):
        played = Played(static, share * static, seed=seed)
        assert played.outcome is Outcome.DONE
        assert played.friction.quantile(LOWER) < 1.03 * static
        spread.append(static / played.friction.quantile(LOWER))
    assert np.median(spread) < 1.3


@long_after_first("delay", [0, 5, 15])
def test_a_late_gripper_does_not_lengthen_the_slide_and_its_delay_is_found(delay):
    found = [Played(delay=delay, seed=seed) for seed in range(12)]
    assert max(played.slid_m for played in found) < 6e-3
    assert np.quantile([played.slid_m for played in found], 0.9) < 3e-3
    assert all(played.speed == 0.0 for played in found)
    late = np.median([played.probe.response_s for played in found])
    assert delay * PERIOD_S <= late < delay * PERIOD_S + 0.03


def test_a_slow_gripper_is_asked_for_less_and_slides_no_further():
    found = [Played(lag_s=0.04, seed=seed) for seed in range(8)]
    assert max(played.slid_m for played in found) < 6e-3
    assert all(played.friction.quantile(LOWER) < 0.53 for played in found)


def test_what_slides_far_more_easily_once_it_moves_is_stopped():
    found = [Played(0.5, 0.29, seed=seed) for seed in range(12)]
    assert max(played.slid_m for played in found) < 8e-3
    assert all(played.speed == 0.0 for played in found)


def test_a_pull_during_a_dip_disturbs_it_and_is_not_learned_from():
    played = Played(pull=lambda cycle: 0.0 if cycle < 75 else min(0.01 * (cycle - 75), 0.5))
    assert played.outcome is Outcome.DISTURBED
    assert not played.probe.dips


def test_a_grip_that_does_not_follow_ends_the_probe():
    assert Played(stuck=True).outcome is Outcome.UNFOLLOWED


def test_it_asks_for_no_less_than_the_least_grip_and_waits_for_rest():
    played = Played(static=1.4, kinetic=1.4, least_n=1.5)
    assert played.outcome is Outcome.DONE
    assert min(played.commands) >= 0.75 * 1.5
    assert PERIOD_S * (played.began + 1) >= 0.28
