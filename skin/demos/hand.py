"""Hand: grips in proportion to the load, and moves up, down and aside, on the simulated gripper.

A plain controller without learning; friction is assumed to be small.
"""

from __future__ import annotations

import math

from skin.behaviours.pads import PadLoads
from skin.grasp.world import World

__all__ = ["Hand"]

FRICTION = 0.4
"""Lower bound of friction [assumed]; grips hold a weight of twice that times the grip."""

MARGIN = 0.4
"""Factor of the grip above that demand [assumed]."""

TOUCH_N, FIRST_N, MOST_N = 0.3, 4.0, 14.0
"""Load of a pad in contact; grip before anything hangs; largest grip [assumed]."""

CLOSING_M_PER_S, OPENING_M_PER_S = 0.04, 0.05
GAIN_PER_S, SERVO_N_PER_M = 25.0, 1000.0
"""Gains of the loop from grip to target, and of the gripper's actuators [the model's]."""

MEAN_S, EASING_S = 0.1, 3.0
"""Time constants of the load that the grip follows, rising and falling [assumed]."""


class Hand:
    """A gripper with a lift and a lateral slide.

    Parameters
    ----------
    world : World

    Attributes
    ----------
    wanted_n, load_n, shear_n : float
        Per pad: requested grip, measured grip and tangential load.
    held : bool
        Whether both pads have been in contact, since they were opened.
    moving : bool
        Whether it has not yet reached its goal.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._period_s = 1.0 / world.skin.topology.cycle_rate_hz
        self._target_m = 0.0
        self._weight_n = 0.0
        self._goals = {"lift": 0.0, "aside": 0.0}
        self._at = {"lift": 0.0, "aside": 0.0}
        self.wanted_n, self.load_n, self.shear_n = FIRST_N, 0.0, 0.0
        self.held, self._open = False, True

    @property
    def moving(self) -> bool:
        """Whether it has not yet reached its goal."""
        return any(abs(self._at[name] - goal) > 1e-9 for name, goal in self._goals.items())

    def close(self) -> None:
        """Close until both pads are in contact, and hold."""
        self._open = False

    def open(self) -> None:
        """Open slowly."""
        self._open, self.held = True, False

    def go(self, speed_m_per_s: float, **goals: float) -> None:
        """Set goals of `lift` and `aside`, metre."""
        self._speed_m = speed_m_per_s * self._period_s
        self._goals.update(goals)

    def shake(self, lift_m: float) -> None:
        """Set the lift at once."""
        self._at["lift"] = self._goals["lift"] = lift_m

    @property
    def lift_m(self) -> float:
        """Set point of the lift."""
        return self._at["lift"]

    @property
    def aside_m(self) -> float:
        """Set point of the lateral slide."""
        return self._at["aside"]

    def update(self, loads: PadLoads) -> None:
        """Set the targets of the joints for the next cycle."""
        self._grip(loads)
        joints = self._world.joints
        lower, upper = joints.limits("left")
        self._target_m = min(max(self._target_m, lower), upper)
        joints["left"] = joints["right"] = self._target_m
        for name, goal in self._goals.items():
            off = goal - self._at[name]
            if off:
                self._at[name] += math.copysign(min(abs(off), self._speed_m), off)
            joints[name] = self._at[name]

    def _grip(self, loads: PadLoads) -> None:
        pads = loads.load_n.tolist()
        shear = loads.shear_n
        if not any(map(math.isnan, pads)):
            self.load_n = sum(pads) / len(pads)
            self.shear_n = sum(
                math.hypot(*shear[:, pad].tolist()) for pad in range(len(pads))
            ) / len(pads)
            load = loads.force_n[2]
            hangs = max(-0.5 * float(load[0] + load[1]), 0.0)
            wait_s = MEAN_S if hangs > self._weight_n else EASING_S
            self._weight_n += (hangs - self._weight_n) * self._period_s / wait_s
            felt = True
        else:
            felt = False  # never below the last grip without a measurement
        if self._open:
            self._target_m -= OPENING_M_PER_S * self._period_s
            self._weight_n = 0.0
            return
        if not self.held:
            self.held = felt and min(pads) > TOUCH_N
            self._target_m += CLOSING_M_PER_S * self._period_s
            return
        needed = (1.0 + MARGIN) * self._weight_n / FRICTION
        self.wanted_n = min(max(needed, FIRST_N), MOST_N)
        if felt:
            lacking_n = self.wanted_n - self.load_n
            self._target_m += GAIN_PER_S * self._period_s * lacking_n / SERVO_N_PER_M
