"""GripControl: the least grip that holds an object against weight, pull and torsion.

Weight and friction are unknown. The grip follows tangential load and torsion over the lower bound
of friction, plus a margin, and the forecast load at the response time of the gripper. Friction has
a posterior (`skin.behaviours.friction`): low at first, then by what has stuck and what has slid in
short dips of the grip on an object that hangs still (`skin.behaviours.probe`).

::

    control = GripControl(topology, gripper)
    for state in skin:
        control.update(state)
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from skin.behaviours import KEPT, Decision
from skin.behaviours.demand import FAST_S, SLOW_S, Demand
from skin.behaviours.friction import LEAST_RATIO, LOWER, Friction
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.probe import Outcome, Probe
from skin.contact.record import SlipState
from skin.errors import OptionError, check_flag, check_kind, check_number, shown
from skin.state import State, if_wanted
from topology import Topology

__all__ = ["GripControl", "GripParameters", "Gripper", "Phase"]

TOUCH_N, LIFTED_N = 0.25, 0.1
"""Load above which a pad is in contact [assumed: five sigma of a pad]; tangential load above which
an object hangs [assumed: two sigma of a pad's, of which the mean over 0.1 s leaves a seventh]."""
HORIZON_S = 0.02
"""Response time of the gripper until a probe has measured it [assumed: a cycle and a servo of 15
Hz]."""
EASING_S = 0.15
"""Time constant with which the grip follows a falling load: a load that comes back soon is still
held [assumed]."""
UNHEARD_S, UNHEARD_RISE = 0.1, 0.5
"""Silence of pads after which the grip rises [assumed: the longest lost burst of frames], and by
how much of it."""
NEAR_LIMIT = 0.8
"""Used fraction of the known friction below which an incipient slip is local, at an edge, and
holds [assumed]."""
ALARM = 1.4
"""Factor of the grip where an object slides, once a response time: two of them double the grip,
which no pull outruns [assumed]."""
PULL_S = 0.3
"""Rise time of a pull as large as the weight, whose begin nothing announces [assumed: by hand]."""
FOLLOW_S, MOST_GAIN = 0.5, 1.6
"""Time constant of what the pads feel of the commanded grip; largest factor for units that feel
nothing: three of eight of them [assumed]."""
FORGET_S = 10.0
"""Time after which a weight that somebody else bears is no longer gripped for [assumed]."""
REFRACTORY_S, BOOST_S = 0.04, 0.15
"""Dead time after a slip: the grip takes as long to rise [derived]; time for which a grip that has
caught one is kept [assumed]."""
CATCHES = 1.1
"""Growth of the loop that catches a slide, from one round to the next [assumed]."""
RESTED_S = 0.3
"""Time after which a load that moved is at rest: a slide would have been caught [assumed]."""
LATEST = 5.0
"""Late cycles, in periods, for which a release continues [assumed]."""
BOUND_SIGMAS, STEP = 4.0, 0.03
"""Sigmas of noise off a ratio that bounds friction, and the least step to the next one."""
LEAST_N = 1e-3
"""Newton, lower bound of a divisor [numeric]."""
REPORTED_RISE = 0.05
"""Relative rise of the grip at a slip that is reported [assumed]."""
ARM_CYCLES, ARM_M = 10, 0.015
"""Interval of updates of the arm of the torsion, which changes with the contact [numeric]; mean
distance of the load from its centre, without a contact [assumed: a pad of 4 x 4]."""


class Phase(StrEnum):
    """Phases of the control."""

    CLOSING = "closing"
    HOLDING = "holding"
    RELEASING = "releasing"
    OPEN = "open"


class Gripper(Protocol):
    """An adapter of a real or simulated gripper; called once a cycle; must not wait.

    A force-controlled gripper closes its own loop: `squeeze` is its set point. A
    position-controlled one converts the difference to the measured load into a movement.
    """

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """Set the normal force on each pad.

        Parameters
        ----------
        wanted_n : float
            Newton, on each pad, until the next call.
        felt_n : float
            Newton: measured by the pads, mean of those that are heard; NaN where none is: keep the
            set point.
        """

    def release(self) -> None:
        """Open slowly, until the next command."""


@dataclass(frozen=True, kw_only=True)
class GripParameters:
    """Of `GripControl`; loads are newton per pad.

    Attributes
    ----------
    safety : float
        Relative margin above the least grip, in addition to those for what is not known of
        friction and for the response time of the gripper [assumed: calibration of the ratio of
        tangential to normal force, 3 %; people take 0.1 to 0.4 in all, Johansson and Westling,
        1984].
    least_friction : float
        Prior coefficient of friction [assumed: silicone on a wet or dusty surface].
    first_grip_n : float
        Before the lift [assumed: the faces are certainly in contact].
    least_grip_n, most_grip_n : float
        Bounds of the grip while it holds [assumed: eight sigma of a pad; the limit of a small
        gripper].
    release_n_per_s : float
        Newton a second, rate of release [assumed].
    probe : bool
        Whether to measure friction by short dips of the grip on an object that hangs still.

    Raises
    ------
    OptionError
        A number is out of range.
    """

    safety: float = 0.05
    least_friction: float = 0.25
    first_grip_n: float = 2.5
    least_grip_n: float = 0.4
    most_grip_n: float = 20.0
    release_n_per_s: float = 5.0
    probe: bool = True

    def __post_init__(self) -> None:
        check_number("safety", self.safety, 0.0, 10.0)
        check_number("least_friction", self.least_friction, 1e-3, 10.0)
        for name in ("first_grip_n", "least_grip_n", "most_grip_n"):
            check_number(name, getattr(self, name), 1e-6, 1e4)
        check_number("release_n_per_s", self.release_n_per_s, 1e-3, 1e4)
        check_flag("probe", self.probe)
        if not self.least_grip_n <= self.first_grip_n <= self.most_grip_n:
            raise OptionError(
                "first_grip_n: must be from least_grip_n to most_grip_n, "
                f"{self.least_grip_n:g} to {self.most_grip_n:g}; got {self.first_grip_n:g}"
            )


class GripControl:
    """Closes a gripper of two or more pads until all touch, holds, and releases.

    Parameters
    ----------
    topology : Topology
    gripper : Gripper
        The adapter of the gripper that moves the pads.
    parameters : GripParameters, optional
    pads : iterable of str, optional
        Patches of the pads; all of them if not given.

    Raises
    ------
    OptionError
        Fewer than two pads, an unknown one, or an object that is not a gripper.

    Attributes
    ----------
    phase : Phase
    decisions : deque of Decision
        Oldest first.
    load_n, shear_n : float
        Newton, mean over the pads, measured.
    wanted_n : float
        Newton, set point of the gripper.
    gain : float
        Of the command over `wanted_n`: what the pads feel less than the gripper was sent.
    friction, least_friction, kinetic : float
        Coefficients: median of the static one, its lower bound (1 %), mean of the kinetic one.
    response_s : float
        Second, from a command until half of it is felt; 0.02 until a dip has shown it.
    is_tested : bool
        Whether friction was measured: the object was lifted and hangs.
    is_steady : bool
        Set by the controller of the arm: whether the hand moves evenly or stands, so that changes
        of a load are due to friction; no probe begins otherwise.
    """

    def __init__(
        self,
        topology: Topology,
        gripper: Gripper,
        parameters: GripParameters | None = None,
        pads: tuple[str, ...] | None = None,
    ) -> None:
        self.parameters = own = GripParameters() if parameters is None else parameters
        check_kind("parameters", own, GripParameters)
        for name in ("squeeze", "release"):
            if not callable(getattr(gripper, name, None)):
                raise OptionError(f"gripper: must have {name!r}; got {shown(gripper)}")
        self._pads = Pads(topology, pads)
        if len(self._pads.names) < 2:
            raise OptionError(f"pads: must be two or more; got {', '.join(self._pads.names)}")
        self.gripper = gripper
        self.decisions: deque[Decision] = deque(maxlen=KEPT)
        self._period_s = period_s = 1.0 / topology.cycle_rate_hz
        self._demand = Demand(len(self._pads.names), period_s, HORIZON_S)
        self._probe = Probe(period_s, own.safety, own.least_grip_n, own.most_grip_n)
        self.load_n = self.shear_n = 0.0
        self.wanted_n, self.gain = own.first_grip_n, 1.0
        self.is_steady, self.response_s = True, HORIZON_S
        self._started_ns = self._stamp_ns = -1
        self._unheard_s, self._heard_s, self._slipped_s = 0.0, math.inf, math.inf
        self._sure_n, self._arm_m, self._cycles = own.first_grip_n, ARM_M, 0
        self._is_alarmed, self._sliding = False, frozenset[int]()
        self._sent_n = self._felt_n = self._held_n = 0.0
        self.close()

    @property
    def safety(self) -> float:
        """Relative margin above the least grip, now.

        While a load moves, a slide may begin unseen. The drag of a slide is kinetic friction times
        grip: with a grip of (1 + safety) times drag over static friction, the grip rises until
        nothing slides if (1 + safety) times the ratio of the two is above 1.
        """
        late_s = min(self.response_s + FAST_S + self._period_s, PULL_S)
        safety = self.parameters.safety + 0.5 * (1.0 - math.cos(math.pi * late_s / PULL_S))
        if self._rested_s > RESTED_S:
            return safety
        return max(safety, CATCHES * self.least_friction / self._least_kinetic - 1.0)

    @property
    def least_n(self) -> float:
        """The least grip for the present loads and the lower bound of friction."""
        return self._demand.forecast_n / self.least_friction

    def release(self) -> None:
        """Open slowly, from the next cycle on."""
        if self.phase in (Phase.CLOSING, Phase.HOLDING):
            self._decide("releases", f"asked to, at {self.wanted_n:.2f} N")
            self.phase = Phase.RELEASING
            self._probe.restart()

    def close(self) -> None:
        """Close on the next object, of which nothing is known. An object that is held, or being
        released, is gripped no less than now."""
        self.phase = Phase.CLOSING
        self.wanted_n = max(self.parameters.first_grip_n, self.wanted_n)
        self._posterior = Friction(self.parameters.least_friction, self._period_s)
        self._read_posterior()
        self.is_tested = False
        self._probes = self.parameters.probe
        self._floor_n = self._rested_s = self._hung_n = self._most_ratio = 0.0
        self._probe.restart()

    def _read_posterior(self) -> None:
        own = self._posterior
        self.friction, self.kinetic = own.quantile(0.5), float(own.weights @ own.kinetic)
        self.least_friction = own.quantile(LOWER)
        prior = self.parameters.least_friction * LEAST_RATIO
        self._least_kinetic = max(own.kinetic_quantile(LOWER), prior)

    def update(self, state: State) -> None:
        """Process a cycle, and set the gripper."""
        elapsed_s = self._clock(state.stamp_ns)
        loads = self._pads.read(state)
        felt = loads.load_n[np.isfinite(loads.load_n)]
        if felt.size:
            self._measure(state, loads, float(felt.mean()))
        if self.phase is Phase.CLOSING:
            self._grasp(elapsed_s, felt)
        elif self.phase is Phase.RELEASING:
            self._let_go(elapsed_s)
        elif self.phase is Phase.HOLDING:
            if felt.size == len(self._pads.names):
                self._hold(elapsed_s)
            else:
                self._keep(elapsed_s, felt.size > 0)
        if self.phase is Phase.OPEN:
            self.gripper.release()
            return
        sent_n = self.gain * (self._probe.command_n if self._probe.dips else self.wanted_n)
        sent_n = min(sent_n, self.parameters.most_grip_n)
        if felt.size and self.phase is Phase.HOLDING and self._rested_s > RESTED_S:
            self._compare(sent_n)
        self.gripper.squeeze(sent_n, self.load_n if felt.size else math.nan)

    def _measure(self, state: State, loads: PadLoads, load_n: float) -> None:
        """Grip, demand, and whether a slip begins."""
        self.load_n = load_n
        self._read_contacts(state)
        self._demand.update(loads, self._arm_m)
        self.shear_n = self._demand.fast_n
        self._held_n = self._held_n or load_n
        self._held_n -= math.expm1(-self._period_s / SLOW_S) * (load_n - self._held_n)

    def _compare(self, sent_n: float) -> None:
        """Units that feel nothing make a pad read less than a gripper with a force sensor of its
        own was sent; the command makes up for them."""
        if self._sent_n == 0.0:
            self._sent_n = self._felt_n = self.load_n
        follow = -math.expm1(-self._period_s / FOLLOW_S)
        self._sent_n += follow * (sent_n - self._sent_n)
        self._felt_n += follow * (self.load_n - self._felt_n)
        self.gain = min(max(self._sent_n / max(self._felt_n, LEAST_N), 1.0), MOST_GAIN)

    def _grasp(self, elapsed_s: float, felt: np.ndarray) -> None:
        """Hold once all pads touch; where some are silent for long, all that are heard."""
        count = len(self._pads.names)
        before_s, self._unheard_s = self._unheard_s, self._unheard_s + elapsed_s
        if felt.size == count:
            self._unheard_s = 0.0
        elif before_s <= UNHEARD_S < self._unheard_s:
            self._decide("waits", f"{count - felt.size} of {count} pads are silent")
        silent = self._unheard_s > UNHEARD_S
        if felt.size and felt.min() > TOUCH_N and (felt.size == count or silent):
            self.phase, self._unheard_s = Phase.HOLDING, 0.0
            pads = f"{felt.size} of {count}" if silent else "all"
            self._decide("holds", f"{pads} pads touch, the lightest with {felt.min():.2f} N")

    # -- holding -----------------------------------------------------------------------------------

    def _hold(self, elapsed_s: float) -> None:
        if self._unheard_s > UNHEARD_S:
            self._decide("hears all pads again", f"after {self._unheard_s:.2f} s")
        self._unheard_s = 0.0
        self._heard_s += elapsed_s
        self._slipped_s += elapsed_s
        self._learn(elapsed_s)
        if self._probes:
            self._ask()
        if not self._probe.dips:
            self._look_for_slip()
        self._set(elapsed_s)

    def _learn(self, elapsed_s: float) -> None:
        """Friction is no less than a ratio that was borne, and a weight at rest may come back."""
        demand = self._demand
        # By equal means over time of both: a load of the past was borne by the grip of the past.
        ratio = (demand.borne_n - BOUND_SIGMAS * demand.noise_n) / max(self._held_n, LEAST_N)
        if ratio > (1.0 + STEP) * self._most_ratio and not self._probe.dips:
            self._most_ratio = ratio
            if ratio > self.least_friction:
                self._posterior.bound(ratio)
                self._read_posterior()
        self._rested_s = 0.0 if demand.is_moving else self._rested_s + elapsed_s
        if self._rested_s > RESTED_S and demand.now_n > LIFTED_N:
            share = 1.0 if self._hung_n == 0.0 else -math.expm1(-elapsed_s / FORGET_S)
            self._hung_n += share * (demand.now_n - self._hung_n)

    def _set(self, elapsed_s: float) -> None:
        """Set the grip: up at once, down slowly."""
        own = self.parameters
        needed_n = max(self.least_n, self._hung_n / self.least_friction)
        hidden_n = self._demand.fast_noise_n  # a rise is hidden in so much at first
        needed_n = (1.0 + self.safety) * needed_n + hidden_n / self.least_friction
        if self._slipped_s > max(BOOST_S, 2.0 * self.response_s):
            self._floor_n = 0.0
        if not self.is_tested and self._demand.now_n < LIFTED_N:
            needed_n = max(needed_n, own.first_grip_n)
        needed_n = max(needed_n, self._floor_n)
        if needed_n < self.wanted_n:
            needed_n = self.wanted_n - math.expm1(-elapsed_s / EASING_S) * (
                needed_n - self.wanted_n
            )
        if needed_n > own.most_grip_n > self.wanted_n:
            self._decide("grips no harder", f"{needed_n:.2f} N is above {own.most_grip_n:g} N")
        self.wanted_n = min(max(needed_n, own.least_grip_n), own.most_grip_n)

    def _ask(self) -> None:
        """Continue the probe of an object that hangs."""
        demand, probe = self._demand, self._probe
        if not self.is_steady or (demand.now_n < LIFTED_N and not probe.dips):
            probe.restart()
            return
        began = not probe.dips
        outcome = probe.update(self.load_n, demand, self._posterior)
        if began and probe.dips:
            self._decide("dips", f"{demand.now_n:.2f} N hang still: how much friction is there?")
        if began and outcome is None:
            return
        self._read_posterior()
        if not math.isnan(probe.response_s) and probe.response_s != self.response_s:
            self.response_s = probe.response_s
            demand.set_horizon(min(self.response_s, PULL_S))
        known = f"friction {self.friction:.2f}, at least {self.least_friction:.2f}"
        if outcome is Outcome.DISTURBED:
            self._decide("grips again", f"the load changes: asks later; {known}")
        elif outcome is Outcome.UNFOLLOWED:
            self._probes = False
            why = f"{self.load_n:.2f} N do not follow the commanded grip"
            self._decide("asks no more", why)
        elif outcome is Outcome.DONE:
            self.is_tested, self._probes = True, False
            late = f"the gripper answers in {1e3 * self.response_s:.0f} ms"
            self._decide("eases", f"{known}; {late}")

    # -- slip --------------------------------------------------------------------------------------

    def _read_contacts(self, state: State) -> None:
        """Whether a slip begins, and, at intervals, the arm of the torsion."""
        contacts = if_wanted(state, "contacts") or ()
        self._is_alarmed = any(
            one.slip >= SlipState.INCIPIENT and one.onset_s == 0.0 for one in contacts
        )
        sliding = frozenset(one.id for one in contacts if one.slip >= SlipState.GROSS)
        self._begins, self._sliding = bool(sliding - self._sliding), sliding
        self._cycles += 1
        if contacts and self._cycles % ARM_CYCLES == 0:
            load_n, arm_m = np.array([(one.load, one.arm) for one in contacts]).T
            weight = np.where((load_n > 0.0) & (arm_m > 0.0), load_n, 0.0)
            if weight.any():
                self._arm_m = float(weight @ np.nan_to_num(arm_m) / weight.sum())

    def _look_for_slip(self) -> None:
        """Grip harder where faces begin to slip, or are at the limit of friction."""
        demand = self._demand
        if self._slipped_s < max(REFRACTORY_S, self.response_s) or demand.now_n < LIFTED_N:
            return
        ratio = demand.fast_n / max(self.load_n, LEAST_N)
        at_limit = demand.lower_n > self.least_friction * self.load_n
        near = ratio > NEAR_LIMIT * self.least_friction
        slides = bool(self._sliding) and ratio > self._least_kinetic
        if not at_limit and not slides and not (self._is_alarmed and near):
            return
        self._slipped_s = 0.0
        if at_limit or slides:
            why = "it slides" if slides else "friction is used up"
            self._floor_n = ALARM * max(self.load_n, self.wanted_n)
        else:
            why = "faces begin to slip"
            self._floor_n = (1.0 + self.safety) * demand.forecast_n / self.kinetic
        if slides and self._begins:
            self._posterior.slid(ratio)
            self._read_posterior()
        if self._floor_n > (1.0 + REPORTED_RISE) * self.wanted_n:
            self._decide("grips harder", f"{why} at a ratio of {ratio:.2f}: {self._floor_n:.2f} N")

    # -- silence and the end -----------------------------------------------------------------------

    def _keep(self, elapsed_s: float, some_heard: bool) -> None:
        """A pad is silent: never grip less; others may show that more is needed."""
        self._probe.restart()
        before_s, self._unheard_s = self._unheard_s, self._unheard_s + elapsed_s
        if before_s == 0.0:
            if self._heard_s > UNHEARD_S:  # an intermittent pad raises the grip once
                self._sure_n = self.wanted_n
            self._decide("keeps its grip", f"a pad is not heard, at {self.wanted_n:.2f} N")
        self._heard_s = 0.0
        needed_n, why = 0.0, "the other pads bear more"
        if some_heard:
            needed_n = (1.0 + self.safety) * self.least_n
        safe_n = (1.0 + UNHEARD_RISE) * self._sure_n
        if self._unheard_s > UNHEARD_S and needed_n < safe_n:
            needed_n, why = safe_n, f"a pad is silent for {self._unheard_s:.2f} s, to be safe"
        needed_n = min(needed_n, self.parameters.most_grip_n)
        if needed_n > (1.0 + REPORTED_RISE) * self.wanted_n:
            self._decide("grips harder", f"{why}: {needed_n:.2f} N")
        self.wanted_n = max(self.wanted_n, needed_n)

    def _let_go(self, elapsed_s: float) -> None:
        rate = self.parameters.release_n_per_s
        self.wanted_n -= rate * min(elapsed_s, LATEST * self._period_s)
        if self.wanted_n <= 0.0:
            self.wanted_n = 0.0
            self.phase = Phase.OPEN
            self._decide("is open", "the grip is gone")

    def _clock(self, stamp_ns: int) -> float:
        """Seconds since the last cycle."""
        if self._started_ns < 0:
            self._started_ns = self._stamp_ns = stamp_ns
            return self._period_s
        elapsed_s = max(1e-9 * (stamp_ns - self._stamp_ns), 0.0)
        self._stamp_ns = stamp_ns
        return elapsed_s

    def _decide(self, what: str, why: str) -> None:
        time_s = 1e-9 * (self._stamp_ns - self._started_ns)
        self.decisions.append(Decision(time_s, what, why))
