"""Handover: detects when a hand has taken the held object.

While giving, hypotheses are weighed by Bayes' rule over the support: the fraction of the weight
that a person bears. A *taking hand* bears most of it, and continues to. A *light* touch (a brush, a
trying hand, a moving arm) bears little. A *bump* may bear any part, but briefly. A *fault* (a
magnet, a wrong unit) is on one pad alone. The age of a support counts from where it was last better
explained by a light touch, or was far below its peak: a bump is near its peak for less than half of
its duration, a taking hand stays there.

Support is the missing weight, not its change: a person who leans on the object, or pulls it down,
makes it heavier, and when they let go nothing is borne. The weight is that of the load at rest,
with or without such a person, whichever is less, and no more than was given to `Handover.give`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from enum import StrEnum
from itertools import takewhile

import numpy as np
from scipy.special import log_ndtr

from skin.behaviours import KEPT, Decision
from skin.behaviours.disturbance import Disturbance, beta_log
from skin.behaviours.pads import unit_vector
from skin.errors import check_number
from skin.state import State
from topology import Topology

__all__ = ["Handover", "Phase"]

TAKE = (0.8, 1.2, 0.25)
"""Support under a taking hand: uniform from the first to the second, and beyond by the third, a
sigma [assumed: people bear what they take, some pull a little more]."""
LIGHT = (0.1, 0.15)
"""Mean and sigma of the support under a light touch [assumed]."""
BUMP_S = (0.08, 0.6)
"""Median duration of a bump, and sigma of its logarithm [assumed: 25 to 270 ms]."""
EASE_S = 0.3
"""Time after which a peak of the support is forgotten, so that a hand that eases is a hand
[assumed]."""
WIDEST = 5.0
"""Support under a bump or a fault is uniform from minus this to this [assumed]."""
AGREE = (6.0, 6.0)
"""Beta distribution of the first of two pads' fraction of the change, under a hand [assumed: a hand
grips up to half a pad off the middle]."""
PRIORS = {"hand": 0.2, "light": 0.4, "bump": 0.398, "fault": 0.002}
"""Among events of a handover [assumed]."""
SMOOTH_S = 0.015
"""Time constant of the support [assumed]."""
NEAR = 0.75
"""Fraction of its peak above which a support is near it [assumed]."""
BUMP_NEAR = 1.0 - 2.0 * math.asin(NEAR) / math.pi
"""Fraction of its duration for which half a sine is near its peak [derived]."""
CONFIDENCE = 0.995
"""Probability of a hand at which it is taken: a wrong release is two hundred times as bad as a
delay [assumed]."""
LEAST_N = 0.35
"""Smallest weight that can be handed over [assumed: five sigma of two pads]."""


class Phase(StrEnum):
    """Phases of a handover."""

    IDLE = "idle"
    GIVING = "giving"
    """Held, until a person takes it."""
    TAKEN = "taken"
    """A hand bears it: open the gripper."""


class Handover:
    """Gives the held object.

    Any force that bears the weight for as long as a hand does counts as a hand: half a sine of more
    than 0.25 s upward, or an object that oscillates by its weight at less than 2 Hz.

    Parameters
    ----------
    topology : Topology
    pads : iterable of str, optional
        Patches of the gripper; all if not given.
    up : tuple of 3 float
        Against gravity, skin frame.

    Attributes
    ----------
    phase : Phase
    probabilities : dict of str to float
        Of hand, light, bump and fault, as of the last cycle with an event.
    support : float
        Fraction of the weight that a person bears; negative where they load it, NaN where the
        weight is unknown.
    disturbance : Disturbance
    decisions : deque of Decision
        Oldest first.

    Raises
    ------
    OptionError
        The direction has no length, or a patch does not exist.

    Examples
    --------
    ::

        handover.give()
        for state in skin:
            if handover.update(state) is Phase.TAKEN:
                gripper.release()
    """

    def __init__(
        self,
        topology: Topology,
        pads: Iterable[str] | None = None,
        *,
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
    ) -> None:
        self._up = unit_vector("handover: up", up)
        self.disturbance = Disturbance(topology, pads)
        self.decisions: deque[Decision] = deque(maxlen=KEPT)
        self.phase = Phase.IDLE
        self.probabilities: dict[str, float] = {}
        self._period_s = 1.0 / topology.cycle_rate_hz
        self._gain = self._period_s / (SMOOTH_S + self._period_s)
        self._recent: deque[float] = deque(maxlen=round(EASE_S / self._period_s) + 1)
        self._clear()

    def give(self, weight_n: float | None = None) -> None:
        """Give the held object from now on; hold it still for a moment.

        Parameters
        ----------
        weight_n : float, optional
            Of the object, newton, if known. Otherwise it is measured now: a person who leans on it
            with twice its weight in this moment, and lets go later, is taken for a hand.

        Raises
        ------
        OptionError
            The weight is invalid.
        """
        if weight_n is not None:
            check_number("handover: weight_n", weight_n, LEAST_N, 1e3)
        self._enter(Phase.GIVING, "asked to")
        self.disturbance.settle()
        self._clear()
        self._most_n = math.inf if weight_n is None else float(weight_n)

    def update(self, state: State) -> Phase:
        """Process a cycle; returns the phase."""
        if self.disturbance.update(state) and self.phase == Phase.GIVING:
            self._give()
        return self.phase

    @property
    def weight_n(self) -> float:
        """Load of the pads at rest, without a person's."""
        rest = self.disturbance.rest
        return min(-float(rest.own[:3] @ self._up), -float(rest.load[:3] @ self._up), self._most_n)

    def _clear(self) -> None:
        pads = len(self.disturbance.pads.names)
        self._most_n = math.inf
        self.support = math.nan
        self._rest, self._lift = np.zeros(pads), np.zeros(pads)
        self._recent.clear()

    def _enter(self, phase: Phase, why: str) -> None:
        self.phase = phase
        self.decisions.append(Decision(self.disturbance.time_s, phase.value, why))

    def _give(self) -> None:
        """Weigh the hypotheses, and report when the object is taken."""
        seen = self.disturbance
        now = -self._up @ seen.pad_force_n
        if not seen.active:
            self._rest = self._rest + min(seen.rest.doubt, 1.0) * (now - self._rest)
        weight_n = self.weight_n
        if not seen.rest.settled or weight_n < LEAST_N:
            self.support = math.nan
            return
        more_n = (weight_n - self._rest.sum()) / now.size
        self._lift = self._lift + self._gain * (self._rest + more_n - now - self._lift)
        self.support = float(self._lift.sum()) / weight_n
        if not seen.active:
            self._recent.clear()
            return
        hand, light = _even_log(self.support, *TAKE), _even_log(self.support, -math.inf, *LIGHT)
        age_s = self._aged_s(hand > light, seen.sigma_n() / weight_n)
        even, agree = -math.log(2.0 * WIDEST), self._agree()
        longer = math.log(max(age_s / BUMP_NEAR, 1e-3) / BUMP_S[0]) / BUMP_S[1]
        bump = even + agree + float(log_ndtr(-longer))
        logs = {"hand": hand + agree, "light": light + agree, "bump": bump, "fault": even}
        odds = {name: PRIORS[name] * math.exp(value) for name, value in logs.items()}
        total = sum(odds.values())
        self.probabilities = {name: value / total for name, value in odds.items()}
        if self.probabilities["hand"] >= CONFIDENCE:
            belief = f"{self.probabilities['hand']:.3f} certain: "
            belief += f"{self.support:.0%} of {weight_n:.2f} N"
            self._enter(Phase.TAKEN, f"{belief} borne for {age_s:.3f} s")

    def _aged_s(self, is_hand: bool, sigma: float) -> float:
        """How long the support has been that of a hand, and near its peak."""
        if not is_hand:
            self._recent.clear()
        self._recent.append(self.support)
        least = NEAR * max(self._recent) - sigma
        near = takewhile(lambda support: support >= least, reversed(self._recent))
        return self._period_s * len(list(near)) if is_hand else 0.0

    def _agree(self) -> float:
        """Log-likelihood that two pads share a lift."""
        total = float(self._lift.sum())
        if self._lift.size != 2 or total <= 0.0:
            return 0.0
        return float(beta_log(float(self._lift[0]) / total, *AGREE))


def _even_log(value: float, low: float, high: float, sigma: float) -> float:
    """Logarithm of a density that is uniform between two bounds, with normal tails; a lower bound
    of minus infinity has no weight of its own."""
    away = value - min(max(value, low), high)
    width = math.sqrt(2.0 * math.pi) * sigma + (high - low if math.isfinite(low) else 0.0)
    return -0.5 * (away / sigma) ** 2 - math.log(width)
