"""Handover: detects when a hand has taken the held object, and when it has given one.

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
from dataclasses import dataclass, field
from enum import StrEnum

from skin.behaviours.decision import Decisions
from skin.behaviours.densities import beta_log, log_normal_longer_log, normal_log
from skin.behaviours.disturbance import Disturbance
from skin.behaviours.disturbance_parameters import DisturbanceParameters
from skin.behaviours.numbers import check_direction, check_tuple
from skin.errors import OptionError, check_kind, check_number, shown
from skin.state import State
from topology import Topology

__all__ = ["Handover", "HandoverParameters", "Phase"]


NEAR = 0.75
"""Fraction of its peak above which a support is near it [assumed]."""

BUMP_NEAR = 1.0 - 2.0 * math.asin(NEAR) / math.pi
"""Fraction of its duration for which half a sine is near its peak [derived]."""

STILL = 4.5
"""Sigmas of a force that show a motion [derived: noise alone in three components reaches it once
per half a minute of tests]."""


class Phase(StrEnum):
    """Phases of a handover."""

    IDLE = "idle"
    GIVING = "giving"
    """Held, until a person takes it."""
    TAKEN = "taken"
    """A hand bears it: open the gripper."""
    AWAITING = "awaiting"
    """Open, until an object is put between the pads."""
    OFFERED = "offered"
    """An object touches the pads: close the gripper."""
    RECEIVED = "received"
    """The object hangs on the pads, and is not moved."""


@dataclass(frozen=True, kw_only=True)
class HandoverParameters:
    """Properties of hands, bumps and touches.

    Attributes
    ----------
    take : (float, float, float)
        Support under a taking hand: uniform from the first to the second, and beyond by the third,
        a sigma [assumed: people bear what they take, some pull a little more].
    light : (float, float)
        Mean and sigma of the support under a light touch [assumed].
    bump_s : (float, float)
        Median duration of a bump, and sigma of its logarithm [assumed: 25 to 270 ms].
    ease_s : float
        Decay time of the peak of the support, so that a hand that eases is a hand [assumed].
    widest : float
        Support under a bump or a fault is uniform from minus this to this [assumed].
    agree : (float, float)
        Beta distribution of the first of two pads' fraction of the change, under a hand [assumed: a
        hand grips up to half a pad off the middle].
    priors : (float, float, float, float)
        Of hand, light touch, bump and fault among events of a handover; they sum to 1 [assumed].
    least_confidence : float
        Probability at which it is taken [assumed: a wrong release is two hundred times as bad as a
        delay].
    smooth_s : float
        Time constant of the support [assumed].
    least_n : float
        Smallest weight that can be handed over [derived: five sigma of two pads].
    still_s : float
        Duration without motion after which an object is received [assumed].
    up : tuple of 3 float
        Against gravity, skin frame.
    disturbance : DisturbanceParameters
    """

    take: tuple[float, float, float] = (0.8, 1.2, 0.25)
    light: tuple[float, float] = (0.1, 0.15)
    bump_s: tuple[float, float] = (0.08, 0.6)
    ease_s: float = 0.3
    widest: float = 5.0
    agree: tuple[float, float] = (6.0, 6.0)
    priors: tuple[float, float, float, float] = (0.2, 0.4, 0.398, 0.002)
    least_confidence: float = 0.995
    smooth_s: float = 0.015
    least_n: float = 0.35
    still_s: float = 0.4
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    disturbance: DisturbanceParameters = field(default_factory=DisturbanceParameters)

    def __post_init__(self) -> None:
        check_number("handover: least_confidence", self.least_confidence, 0.5, 1.0)
        for name in ("widest", "smooth_s", "least_n", "still_s"):
            check_number(f"handover: {name}", getattr(self, name), 1e-6, 1e3)
        check_number("handover: ease_s", self.ease_s, 1e-3, 10.0)
        share, sigma, positive = (-100.0, 100.0), (1e-3, 100.0), (1e-3, 1e3)
        check_tuple("handover: take", self.take, share, share, sigma)
        if self.take[1] < self.take[0]:
            raise OptionError(f"handover: take: must rise; got {shown(self.take)}")
        check_tuple("handover: light", self.light, share, sigma)
        check_tuple("handover: bump_s", self.bump_s, positive, sigma)
        check_tuple("handover: agree", self.agree, positive, positive)
        check_tuple("handover: priors", self.priors, *[(0.0, 1.0)] * 4)
        if abs(sum(self.priors) - 1.0) > 1e-6:
            raise OptionError(f"handover: priors: must sum to 1; got {sum(self.priors):.6g}")
        check_direction("handover: up", self.up)
        check_kind("handover: disturbance", self.disturbance, DisturbanceParameters)


class Handover:
    """Gives the held object, or takes an offered one.

    Any force that bears the weight for as long as a hand does counts as a hand: half a sine of more
    than 0.25 s upward, or an object that oscillates by its weight at less than 2 Hz.

    Parameters
    ----------
    topology : Topology
    parameters : HandoverParameters, optional
    pads : iterable of str, optional
        Patches of the gripper; all if not given.

    Attributes
    ----------
    phase : Phase
    probabilities : dict of str to float
        Of hand, light, bump and fault, as of the last cycle with an event.
    support : float
        Fraction of the weight that a person bears; negative where they load it, NaN where the
        weight is unknown.
    disturbance : Disturbance
    decisions : Decisions

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
        parameters: HandoverParameters | None = None,
        pads: Iterable[str] | None = None,
    ) -> None:
        self.parameters = HandoverParameters() if parameters is None else parameters
        self.disturbance = Disturbance(topology, self.parameters.disturbance, pads)
        self.decisions = Decisions()
        self.phase = Phase.IDLE
        self.probabilities: dict[str, float] = {}
        length = math.dist(self.parameters.up, (0.0, 0.0, 0.0))
        self._up = [value / length for value in self.parameters.up]
        self._period_s = 1.0 / topology.cycle_rate_hz
        self._gain = self._period_s / (self.parameters.smooth_s + self._period_s)
        self._pads = len(self.disturbance.pads.names)
        self._recent: deque[float] = deque(
            maxlen=round(self.parameters.ease_s / self._period_s) + 1
        )
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
            check_number("handover: weight_n", weight_n, self.parameters.least_n, 1e3)
        self._enter(Phase.GIVING, "asked to")
        self.disturbance.settle()
        self._clear()
        self._most_n = math.inf if weight_n is None else float(weight_n)

    def take(self) -> None:
        """Take an object that is put between the open pads."""
        self._enter(Phase.AWAITING, "asked to")
        self.disturbance.settle()
        self._clear()

    def stop(self) -> None:
        """Stop giving or taking."""
        self._enter(Phase.IDLE, "asked to")

    def update(self, state: State) -> Phase:
        """Process a cycle; returns the phase."""
        seen = self.disturbance
        if not seen.update(state):
            return self.phase
        if self.phase == Phase.GIVING:
            self._give()
        elif seen.settled and self.phase in (Phase.AWAITING, Phase.OFFERED):
            self._take()
        return self.phase

    @property
    def weight_n(self) -> float:
        """Load of the pads at rest, without a person's."""
        rest = self.disturbance.rest
        return min(-_dot(rest.own, self._up), -_dot(rest.load, self._up), self._most_n)

    def _clear(self) -> None:
        self._most_n = math.inf
        self.support, self._age_s, self._still_s = math.nan, 0.0, 0.0
        self._still_n = [math.inf] * 3
        self._rest, self._lift = [0.0] * self._pads, [0.0] * self._pads
        self._recent.clear()

    def _enter(self, phase: Phase, why: str) -> None:
        self.phase = phase
        self.decisions.add(self.disturbance.time_s, phase.value, why)

    def _give(self) -> None:
        """Weigh the hypotheses, and report when the object is taken."""
        p, seen = self.parameters, self.disturbance
        now = [-_dot(force, self._up) for force in zip(*seen.pad_force_n, strict=True)]
        if not seen.active:
            gain = min(seen.rest.doubt, 1.0)
            self._rest = [a + gain * (b - a) for a, b in zip(self._rest, now, strict=True)]
        weight_n = self.weight_n
        if not seen.settled or weight_n < p.least_n:
            self.support = math.nan
            return
        more_n = (weight_n - sum(self._rest)) / self._pads
        for i, lift_n in enumerate(self._lift):
            self._lift[i] += self._gain * (self._rest[i] + more_n - now[i] - lift_n)
        self.support = sum(self._lift) / weight_n
        if not seen.active:
            self._recent.clear()
            return
        hand = _even_log(self.support, *p.take)
        light = normal_log(max(self.support, p.light[0]), *p.light)
        self._age(hand > light, seen.sigma_n / weight_n)
        even = -math.log(2.0 * p.widest)
        agree = self._agree()
        logs = {
            "hand": hand + agree,
            "light": light + agree,
            "bump": even + agree + self._bump_longer_log(),
            "fault": even,
        }
        odds = [q * math.exp(v) for q, v in zip(p.priors, logs.values(), strict=True)]
        total = sum(odds)
        self.probabilities = {name: v / total for name, v in zip(logs, odds, strict=True)}
        if self.probabilities["hand"] >= p.least_confidence:
            why = (
                f"{self.probabilities['hand']:.3f} sure: {self.support:.0%} of {weight_n:.2f} N "
                f"borne for {self._age_s:.3f} s"
            )
            self._enter(Phase.TAKEN, why)

    def _age(self, is_hand: bool, sigma: float) -> None:
        """Update how long the support has been that of a hand, and near its peak."""
        if not is_hand:
            self._recent.clear()
        self._recent.append(self.support)
        least, cycles = NEAR * max(self._recent) - sigma, 0
        for support in reversed(self._recent):
            if support < least:
                break
            cycles += 1
        self._age_s = cycles * self._period_s if is_hand else 0.0

    def _bump_longer_log(self) -> float:
        """Logarithm of the fraction of bumps that stay near their peak for longer than so far."""
        return log_normal_longer_log(max(self._age_s / BUMP_NEAR, 1e-3), *self.parameters.bump_s)

    def _agree(self) -> float:
        """Log-likelihood that two pads share a lift."""
        total = sum(self._lift)
        if self._pads != 2 or total <= 0.0:
            return 0.0
        return beta_log(self._lift[0] / total, *self.parameters.agree)

    def _take(self) -> None:
        """Close on contact; an object that hangs still is received."""
        seen, p = self.disturbance, self.parameters
        if self.phase == Phase.AWAITING:
            if seen.active or seen.load_n > seen.parameters.held_n:
                self._enter(Phase.OFFERED, f"{seen.load_n:.2f} N on the pads")
                seen.settle()
            return
        now = [rest + change for rest, change in zip(seen.rest_n, seen.force_n, strict=True)]
        weight_n = -_dot(now, self._up)
        moved = math.dist(now, self._still_n) > STILL * seen.sigma_n
        if moved or not seen.held or weight_n < p.least_n:
            self._still_s, self._still_n = 0.0, now
        self._still_s += self._period_s
        if self._still_s >= p.still_s:
            self._enter(Phase.RECEIVED, f"{weight_n:.2f} N hang still for {self._still_s:.2f} s")


def _even_log(value: float, low: float, high: float, sigma: float) -> float:
    """Logarithm of a density that is uniform between two bounds, with normal tails."""
    away = value - min(max(value, low), high)
    width = math.sqrt(2.0 * math.pi) * sigma + high - low
    return -0.5 * (away / sigma) ** 2 - math.log(width)


def _dot(a, b) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
