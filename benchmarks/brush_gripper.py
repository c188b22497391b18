"""A gripper that is late, slow and sticky, driven by commanded or by felt force."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

__all__ = ["LateGripper", "Servo"]

CLOSING_MM_PER_S = 40.0
TOUCH_N = 0.1
"""Felt load above which a gripper driven by felt force trusts it [assumed]."""
GAIN_PER_S, PHASE = 15.0, 0.35
"""Gain of a loop on felt force; never more than so much over its dead time [derived: a phase margin
of 70 degrees]."""


class Servo(NamedTuple):
    """How a gripper follows its commands.

    Attributes
    ----------
    delay_s : float
        From a command to the begin of its effect.
    lag_s : float
        Time constant after that.
    stiction_n : float
        Change of force below which nothing moves.
    rate_n_per_s : float
        Fastest change of force.
    felt : bool
        Whether the loop is closed on the force that the pads feel; otherwise the gripper has a
        force sensor of its own.
    """

    delay_s: float = 0.0
    lag_s: float = 0.01
    stiction_n: float = 0.05
    rate_n_per_s: float = 100.0
    felt: bool = False


class LateGripper:
    """A `skin.behaviours.grip.Gripper`, and its force on each pad.

    Parameters
    ----------
    servo : Servo
    period_s : float
    away_mm : float
        Of each pad from what is between them, at first.

    Attributes
    ----------
    force_n : float
        On each pad, now.
    wanted_n : float
        Last command; NaN where it was to open.
    """

    def __init__(self, servo: Servo, period_s: float, away_mm: float) -> None:
        self.servo, self.force_n, self.wanted_n = servo, 0.0, math.nan
        self._period_s, self._away_mm = period_s, away_mm
        self._queue = deque([math.nan] * round(servo.delay_s / period_s))
        self._set_n = self._behind_n = 0.0
        self._moves = False
        self._gain = min(GAIN_PER_S, PHASE / (servo.delay_s + servo.lag_s + period_s))

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """See `Gripper`."""
        before, self.wanted_n = self.wanted_n, wanted_n
        if not self.servo.felt or math.isnan(felt_n) or felt_n < TOUCH_N:
            self._set_n = wanted_n
            return
        if not math.isnan(before):
            self._set_n += wanted_n - before
        self._set_n += self._gain * self._period_s * (wanted_n - felt_n)
        self._set_n = max(self._set_n, 0.0)

    def release(self) -> None:
        """See `Gripper`."""
        self.wanted_n = math.nan

    def step(self) -> float:
        """Let a cycle pass; force on each pad at its end."""
        self._queue.append(math.nan if math.isnan(self.wanted_n) else self._set_n)
        now = self._queue.popleft()
        if self._away_mm > 0.0:
            if not math.isnan(now):
                self._away_mm -= CLOSING_MM_PER_S * self._period_s
            return 0.0
        target = 0.0 if math.isnan(now) else now
        servo = self.servo
        share = 1.0 if servo.lag_s <= 0.0 else -math.expm1(-self._period_s / servo.lag_s)
        self._behind_n += share * (target - self._behind_n)
        off = self._behind_n - self.force_n
        if abs(off) > servo.stiction_n:
            self._moves = True
        if self._moves:
            most = servo.rate_n_per_s * self._period_s
            step = min(max(off, -most), most)
            self.force_n += step
            self._moves = step != off or abs(off) > 0.1 * servo.stiction_n
        return self.force_n
