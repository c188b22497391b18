"""Holder: a gripper that holds what it does not know, by slip onset, grip margin and one probe.

It believes in a coefficient of friction, and grips as hard as the tangential load over it asks,
with a margin. Where a contact begins to slip, or a probe finds that it slides, the ratio of the
loads at that moment is the friction there is, and the belief falls to it. That is all: weight,
size and friction are never asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skin.contact.record import SlipState
from skin.grasp.probe import Probe
from skin.state import State
from topology import Topology

__all__ = ["Holder"]

SAFETY = 0.35
"""Grip above what friction asks: people take 0.1 to 0.4 [Johansson and Westling, 1984]."""

FIRST_BELIEF = 0.5
"""Coefficient of friction before any slip [assumed: a soft silicone on what is not smooth]."""

FIRST_N = 2.5
"""Grip until something is lifted: faces are sure to be in touch [assumed]."""

LIFTED_N = 0.3
"""Tangential load of a pad from which on something hangs on it [assumed: twice what noise of 16
units seems to be]."""

LEAST_N, MOST_N = 0.5, 20.0
"""Of the grip, by pad [assumed: contact is sure above four sigma of a pad; the gripper's limit]."""

TOUCH_N = 0.25
"""Load of a pad from which on it touches [assumed: more than noise of 16 units]."""

SHARE_OF_SLIP = 0.9
"""Friction over the ratio of loads where slip begins: the faces that began it had more of it."""

LEAST_FALL = 0.75
"""Of the belief at one slip: a ratio far below tells of a load that has just fallen [assumed]."""

STILL = 0.5
"""Share of the load that sticks, above which a slide is over, whatever it is still called."""

REFRACTORY_S = 0.04
"""After a slip, before the next one is believed: the grip takes as long to rise [derived]."""

SERVO_N_PER_M = 1000.0
"""What the grip rises by, over the fingers' target [the gripper's actuators]."""

CLOSING_M_PER_S = 0.04
GAIN_PER_S = 25.0
"""Of the loop from grip to target."""

EASING_PER_S = 2.0
"""How fast the grip follows a load that falls: a load that comes back finds it held."""


@dataclass
class Grip:
    """What a holder sees and wants, newton by pad."""

    load_n: float = 0.0
    shear_n: float = 0.0
    wanted_n: float = 0.0
    belief: float = FIRST_BELIEF
    slips: int = 0
    touching: bool = False

    @property
    def margin(self) -> float:
        """Share of the friction believed in that is left."""
        held = self.belief * self.load_n
        return 1.0 - self.shear_n / held if held > 0.0 else float("nan")


class Holder:
    """Closes two fingers until both touch, and then holds.

    Parameters
    ----------
    topology : Topology
        Of two patches, one for each pad.

    Attributes
    ----------
    grip : Grip
    target_m : float
        Of both fingers.
    """

    def __init__(self, topology: Topology) -> None:
        self.grip = Grip(wanted_n=FIRST_N)
        self.target_m = 0.0
        self._period_s = 1.0 / topology.cycle_rate_hz
        self._pads = [topology.patch == pad for pad in range(2)]
        self._slipped_s = 0.0
        self._probe = Probe(self._period_s)

    @property
    def hangs(self) -> bool:
        """Whether what is lifted is known to hang, not to slide."""
        return self._probe.hangs

    def update(self, state: State) -> float:
        """Look at a cycle; the target of both fingers, metre."""
        grip, period_s = self.grip, self._period_s
        force = np.where(state.units.valid, state.units.force, 0.0)
        pads = [force[:, pad].sum(axis=1) for pad in self._pads]
        grip.load_n = float(np.mean([pad[2] for pad in pads]))
        grip.shear_n = float(np.mean([np.hypot(pad[0], pad[1]) for pad in pads]))
        grip.touching |= min(pad[2] for pad in pads) > TOUCH_N
        if not grip.touching:
            self.target_m += CLOSING_M_PER_S * period_s
            return self.target_m
        self._believe(state)
        needed_n = self._needed_n()
        factor = 1.0
        if grip.shear_n > LIFTED_N and not self.hangs:
            ratio = self._probe.update(grip.load_n, grip.shear_n)
            if ratio is not None:
                self._fall(ratio)
                needed_n = self._needed_n()
            factor = self._probe.factor
        easing = EASING_PER_S * period_s if self.hangs else 0.0
        eased_n = grip.wanted_n - easing * (grip.wanted_n - needed_n)
        grip.wanted_n = float(np.clip(max(needed_n, eased_n), LEAST_N, MOST_N))
        lacking_n = factor * grip.wanted_n - grip.load_n
        self.target_m += GAIN_PER_S * period_s * lacking_n / SERVO_N_PER_M
        return self.target_m

    def _believe(self, state: State) -> None:
        """Learn from a slip that begins."""
        grip = self.grip
        self._slipped_s += self._period_s
        slides = any(
            contact.slip == SlipState.GROSS and contact.stick_ratio < STILL
            for contact in state.contacts
        )
        late = self._slipped_s >= REFRACTORY_S
        if not late or not (state.slips or slides) or grip.shear_n < LIFTED_N:
            return
        self._slipped_s = 0.0
        self._fall(SHARE_OF_SLIP * grip.shear_n / grip.load_n)
        self.target_m += max(grip.wanted_n - grip.load_n, 0.0) / SERVO_N_PER_M

    def _fall(self, ratio: float) -> None:
        """Believe in no more friction than a slip has shown, and grip as that asks."""
        grip = self.grip
        grip.slips += 1
        grip.belief = max(min(grip.belief, ratio), LEAST_FALL * grip.belief)
        grip.wanted_n = min(max(self._needed_n(), grip.wanted_n), MOST_N)

    def _needed_n(self) -> float:
        """Grip that the belief asks for. A belief that no slip has tested lets no more be borne
        than the probe has seen borne: a flat face that slides all alike gives no warning."""
        grip, borne = self.grip, self._probe.borne
        needed_n = (1.0 + SAFETY) * grip.shear_n / grip.belief
        if grip.slips == 0 and borne > 0.0:
            needed_n = max(needed_n, grip.shear_n / borne)
        return needed_n
