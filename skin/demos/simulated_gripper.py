"""The simulated gripper: fingers with position servos, under force control."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from skin.grasp.world import World

__all__ = ["SimulatedGripper"]

SERVO_N_PER_M = 1000.0
"""Gain from the fingers' target to the grip [the gripper's actuators]."""

GAIN_PER_S = 15.0
"""Gain of the loop from force error to target: slower than the servo [assumed]. A late gripper has
1 / (e x its whole delay) at most, with which an integrator neither overshoots nor creeps."""

ANSWER_S = 0.012
"""Response time of the measured grip to the target [derived: 0.15 kg on its pad, and a cycle]."""

CLOSING_M_PER_S = 0.04
OPENING_M_PER_S = 0.05
TOUCH_N = 0.1
"""Load above which the target moves with the wanted force [assumed]."""


class SimulatedGripper:
    """An adapter (`skin.behaviours.gripper.Gripper`) of fingers of a `World`.

    A change of the wanted force moves the target at once, by the servo's stiffness; the remaining
    error, to what the servo should have answered by now, is integrated.

    Parameters
    ----------
    world : World
    fingers : iterable of str
        Joints that close as their target grows.
    delay_s : float
        Time after which the fingers get a target, in whole cycles.

    Attributes
    ----------
    target_m : float
        Of all fingers.
    """

    def __init__(
        self, world: World, fingers: Iterable[str] = ("left", "right"), delay_s: float = 0.0
    ) -> None:
        self.target_m = 0.0
        self._world, self._fingers = world, tuple(fingers)
        limits = [world.joints.limits(name) for name in self._fingers]
        self._least_m = max(lower for lower, _ in limits)
        self._most_m = min(upper for _, upper in limits)
        self._period_s = 1.0 / world.skin.topology.cycle_rate_hz
        self._wanted_n = self._expected_n = math.nan
        cycles = round(delay_s / self._period_s)
        self._late_m, self._late_n = deque([0.0] * cycles), deque([math.nan] * cycles)
        self._gain_per_s = min(GAIN_PER_S, 1.0 / (math.e * (delay_s + ANSWER_S)))

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """See `Gripper`."""
        if math.isnan(self._wanted_n):
            self._wanted_n, self._expected_n = wanted_n, 0.0
        step_n = wanted_n - self._wanted_n
        self._wanted_n = wanted_n
        self._late_n.append(wanted_n)
        due_n = self._late_n.popleft()
        if math.isnan(felt_n):
            self._move(step_n / SERVO_N_PER_M)
            return
        if felt_n < TOUCH_N:
            self._expected_n = felt_n
            self._move(math.copysign(CLOSING_M_PER_S * self._period_s, wanted_n - felt_n))
            return
        share = -math.expm1(-self._period_s / ANSWER_S)
        if not math.isnan(due_n):  # else no command has arrived yet
            self._expected_n += share * (due_n - self._expected_n)
        lacking_n = self._expected_n - felt_n
        most_m = CLOSING_M_PER_S * self._period_s
        slow_m = self._gain_per_s * self._period_s * lacking_n / SERVO_N_PER_M
        self._move(step_n / SERVO_N_PER_M + min(max(slow_m, -most_m), most_m))

    def release(self) -> None:
        """See `Gripper`."""
        self._wanted_n = math.nan
        self._move(-OPENING_M_PER_S * self._period_s)

    def _move(self, by_m: float) -> None:
        self.target_m = min(max(self.target_m + by_m, self._least_m), self._most_m)
        self._late_m.append(self.target_m)
        now_m = self._late_m.popleft()
        for name in self._fingers:
            self._world.joints[name] = now_m
