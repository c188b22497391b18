"""The simulated gripper: fingers with position servos, under force control."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from skin.behaviours.grip import GripControl, GripParameters
from skin.sim import GraspObject, grasp

__all__ = ["SimulatedGripper", "held"]

SERVO_N_PER_M = 1000.0
"""Gain from the fingers' target to the grip [the gripper's actuators]."""
GAIN_PER_S = 15.0
"""Gain of the loop from force error to target: slower than the servo [assumed]. A late gripper has
1 / (e x its whole delay) at most, with which an integrator neither overshoots nor creeps."""
ANSWER_S = 0.012
"""Response time of the measured grip to the target [derived: 0.15 kg on its pad, and a cycle]."""
CLOSING_M_PER_S, OPENING_M_PER_S = 0.04, 0.05
TOUCH_N = 0.1
"""Load above which the target moves with the wanted force [assumed]."""
OPEN_M = 0.045
"""Distance from the middle to a pad of the open gripper."""


class SimulatedGripper:
    """An adapter (`skin.behaviours.grip.Gripper`) of the two fingers of a world.

    A change of the wanted force moves the target at once, by the servo's stiffness; the remaining
    error, to what the servo should have answered by now, is integrated. The fingers get a target
    `delay_s` later, in whole cycles.
    """

    def __init__(self, world: Any, target_m: float = 0.0, delay_s: float = 0.0) -> None:
        self.target_m, self._world = target_m, world
        self._least_m, self._most_m = world.joints.limits("left")
        self._period_s = 1.0 / world.skin.topology.cycle_rate_hz
        self._wanted_n = self._expected_n = math.nan
        cycles = round(delay_s / self._period_s)
        self._late_m, self._late_n = deque([target_m] * cycles), deque([math.nan] * cycles)
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
        most_m = CLOSING_M_PER_S * self._period_s
        if felt_n < TOUCH_N:
            self._expected_n = felt_n
            self._move(math.copysign(most_m, wanted_n - felt_n))
            return
        if not math.isnan(due_n):  # else no command has arrived yet
            share = -math.expm1(-self._period_s / ANSWER_S)
            self._expected_n += share * (due_n - self._expected_n)
        slow_m = self._gain_per_s * self._period_s * (self._expected_n - felt_n) / SERVO_N_PER_M
        self._move(step_n / SERVO_N_PER_M + min(max(slow_m, -most_m), most_m))

    def release(self) -> None:
        """See `Gripper`."""
        self._wanted_n = math.nan
        self._move(-OPENING_M_PER_S * self._period_s)

    def _move(self, by_m: float) -> None:
        self.target_m = min(max(self.target_m + by_m, self._least_m), self._most_m)
        self._late_m.append(self.target_m)
        now_m = self._late_m.popleft()
        self._world.joints["left"] = self._world.joints["right"] = now_m


LIFT_M, LIFT_M_PER_S, CLOSE_S, SETTLE_S = 0.02, 0.15, 0.4, 0.4
HOLDS = 1.6
"""Grip over that which weight and strongest pull need: people, not slips, are shown [assumed]."""


@contextmanager
def held(
    thing: GraspObject, *, strongest_n: float = 0.0, seed: int = 0, **options: Any
) -> Iterator[tuple[Any, GripControl, Iterator[Any]]]:
    """A world in which an object was grasped and lifted, the control whose `release` opens the
    gripper, and the states from the time when it hangs still.

    It is gripped for the largest pull by people, `strongest_n`, in advance.
    """
    load_n = 0.5 * (9.81 * thing.mass_kg + strongest_n)
    grip_n = HOLDS * load_n / thing.friction + 1.0
    with grasp("gripper", objects=[thing], seed=seed, **options) as world:
        gripper = SimulatedGripper(world, OPEN_M - thing.size_m[0])
        firm = GripParameters(probe=False, first_grip_n=grip_n, least_grip_n=grip_n,
                              most_grip_n=max(20.0, grip_n), release_n_per_s=50.0)  # fmt: skip
        control = GripControl(world.skin.topology, gripper, firm)
        states = _controlled(world, control)
        for _ in states:
            height_m = LIFT_M_PER_S * (world.time_s - CLOSE_S)
            world.joints["lift"] = float(np.clip(height_m, 0.0, LIFT_M))
            if world.time_s >= CLOSE_S + LIFT_M / LIFT_M_PER_S + SETTLE_S:
                break
        yield world, control, states


def _controlled(world: Any, control: GripControl) -> Iterator[Any]:
    for state in world:
        control.update(state)
        yield state
