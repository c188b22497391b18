"""Gestures: actions of a hand on a skin, or on a held object, with their probabilities.

Each kind of gesture has stated densities of duration, strength, direction and motion. Bayes' rule
over them gives the confidence, a probability as far as people follow the densities. While a gesture
lasts, its duration and size so far are lower bounds: their densities are replaced by survival
functions.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from skin.behaviours import KEPT, Decision
from skin.behaviours.disturbance import Disturbance, beta_log
from skin.behaviours.pads import unit_vector
from skin.state import State
from topology import Topology

__all__ = ["Gesture", "Gestures"]

LOOK_S = 0.02
"""Interval at which the confidence is computed during a gesture [assumed]."""
CONFIDENCE = 0.95
"""Confidence at which a gesture is reported before it has ended [assumed]."""
UNKNOWN_RAD = math.pi / math.sqrt(3.0)
"""One-sigma of an angle of which nothing is known [derived]."""
AWAY = 0.38
"""Cosine beyond which a force points away from the person: half of 45 degrees past perpendicular
[derived]."""


class Kind(NamedTuple):
    """Densities of one kind of gesture.

    Attributes
    ----------
    duration_s, size_n : (float, float)
        Median, and standard deviation of the logarithm, of a log-normal: of the duration of a
        rectangle of the same impulse and peak, and of the peak force, where torques are converted
        to forces by a lever.
    normal, moment, moved : (float, float)
        Beta distributions of fractions: of the energy of force along the normal; of the energy of
        force and torque that is torque; of motion (see `Disturbance.moved`).
    """

    duration_s: tuple[float, float]
    size_n: tuple[float, float]
    normal: tuple[float, float] = (1.0, 1.0)
    moment: tuple[float, float] = (1.0, 1.0)
    moved: tuple[float, float] = (1.0, 30.0)


LONG = (0.6, 0.6)
"""Duration of a deliberate, held action: 0.2 to 2 s [assumed]."""
SHORT, LIGHT = (0.035, 0.4), (0.07, 0.5)
"""Of a tap and of a brush: half a sine of 25 to 100 ms, a bell of 50 to 300 ms [assumed]."""
ACROSS, ALONG, EITHER = (1.0, 12.0), (12.0, 1.0), (0.3, 0.3)
"""Fraction along the normal: a hand acts along or across it to within some 15 degrees; short
actions may be either [assumed]."""
TURNS, NO_TURN = (6.0, 1.0), (1.0, 8.0)
"""Fraction of torque: fingers are up to half a lever off the middle [assumed]."""
PRESSED, DRAGGED, STRAIGHT = (100.0, 1.0), (8.0, 1.3), (1.0, 30.0)
"""On a bare skin: fraction along the normal of a finger that presses, and of one that drags by up
to its friction; fraction of torque without a turn [assumed]."""
STAYS, GOES = (1.2, 8.0), (5.0, 2.0)
"""Motion of a finger that stays, and of one that travels two lengths or more [assumed]."""

HELD = {
    "tap": Kind(duration_s=SHORT, size_n=(1.5, 0.7), normal=EITHER, moment=(1.0, 4.0)),
    "brush": Kind(duration_s=LIGHT, size_n=(0.25, 0.45), normal=EITHER, moment=(1.0, 3.0)),
    "press": Kind(duration_s=LONG, size_n=(1.5, 0.7), normal=ALONG, moment=NO_TURN),
    "pull": Kind(duration_s=LONG, size_n=(1.2, 0.7), normal=ACROSS, moment=NO_TURN),
    "slide": Kind(duration_s=LONG, size_n=(2.0, 0.7), normal=ACROSS, moment=NO_TURN,
                  moved=(3.0, 2.0)),
    "twist": Kind(duration_s=LONG, size_n=(1.0, 0.7), moment=TURNS),
}  # fmt: skip
"""For a held object [assumed]."""

TOUCH = {
    "tap": Kind(duration_s=SHORT, size_n=(1.5, 0.7), normal=PRESSED, moment=STRAIGHT, moved=STAYS),
    "brush": Kind(duration_s=LIGHT, size_n=(0.4, 0.5), normal=(5.0, 2.0), moment=STRAIGHT,
                  moved=GOES),
    "press": Kind(duration_s=LONG, size_n=(2.0, 0.7), normal=PRESSED, moment=STRAIGHT,
                  moved=STAYS),
    "pull": Kind(duration_s=LONG, size_n=(2.0, 0.7), normal=DRAGGED, moment=STRAIGHT, moved=STAYS),
    "slide": Kind(duration_s=LONG, size_n=(2.0, 0.7), normal=DRAGGED, moment=STRAIGHT, moved=GOES),
    "twist": Kind(duration_s=LONG, size_n=(2.5, 0.7), normal=(30.0, 1.0), moment=(2.0, 6.0),
                  moved=STAYS),
}  # fmt: skip
"""For a finger on a skin [assumed]."""


class Gesture(NamedTuple):
    """An action of a person.

    Attributes
    ----------
    kind : str
        tap, brush, press, push, pull, slide or twist.
    confidence : float
        Probability of `kind`.
    probabilities : dict of str to float
        Of all kinds; push and pull are one.
    began_s, duration_s : float
        On the behaviour's clock.
    force_n : tuple of 3 float
        Newton, skin frame: mean change of force.
    angle_rad, angle_sigma_rad : float
        Of the force in the plane of the pads, from `Gestures.right` to `Gestures.up`; a sigma of pi
        / sqrt(3) means that the angle is unknown.
    peak_n : float
    ended : bool
        False while it lasts: all values may still change.
    """

    kind: str
    confidence: float
    probabilities: dict[str, float]
    began_s: float
    duration_s: float
    force_n: tuple[float, float, float]
    angle_rad: float
    angle_sigma_rad: float
    peak_n: float
    ended: bool


class Gestures:
    """Recognises gestures, one after the other.

    A gesture is reported as soon as its confidence suffices, and again when it has ended. Call
    `settle` after a grasp or a move: the loads of the pads then are the rest that hands are
    compared with. A gesture of more than 10 s is reported as ended then; its later end is not a
    gesture.

    Parameters
    ----------
    topology : Topology
    pads : iterable of str, optional
        Patches that belong together: the fingers of a gripper, or one skin; all if not given.
    up : tuple of 3 float
        Skin frame: direction at 90 degrees.
    towards : tuple of 3 float, optional
        Skin frame: direction of the person, by which a push differs from a pull. Without it, all
        are pulls.

    Attributes
    ----------
    disturbance : Disturbance
    decisions : deque of Decision
        Oldest first.
    right, up : ndarray, shape (3,)
        Axes of the plane of the pads, skin frame, for a view onto the face of the first pad: `up`
        is the given one in the plane, or y where that is along the normal.

    Raises
    ------
    OptionError
        A direction has no length, or a patch does not exist.

    Examples
    --------
    >>> from topology import load
    >>> gestures = Gestures(load("gripper"))
    >>> (gestures.right.round() + 0.0).tolist(), (gestures.up.round() + 0.0).tolist()
    ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    """

    def __init__(
        self,
        topology: Topology,
        pads: Iterable[str] | None = None,
        *,
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        towards: tuple[float, float, float] | None = None,
    ) -> None:
        self.disturbance = Disturbance(topology, pads)
        self.decisions: deque[Decision] = deque(maxlen=KEPT)
        self.right, self.up = _plane(self.disturbance.pads.normal, unit_vector("gestures: up", up))
        self._towards = (
            np.zeros(3) if towards is None else unit_vector("gestures: towards", towards)
        )
        self._next_s = 0.0
        self._reported_kind = ""

    def settle(self) -> None:
        """Take the present loads of the pads as the rest."""
        self.disturbance.settle()
        self._reported_kind = ""

    def update(self, state: State) -> Gesture | None:
        """Process a cycle; returns a gesture that has become certain, or has ended."""
        seen = self.disturbance
        if not seen.update(state) or not (seen.active or seen.ended):
            return None
        if not seen.ended and (seen.returning or seen.time_s < self._next_s):
            return None
        self._next_s = seen.time_s + LOOK_S
        gesture = self._classify()
        is_certain = gesture.confidence >= CONFIDENCE and gesture.kind != self._reported_kind
        if not seen.ended and not is_certain:
            return None
        self._reported_kind = "" if seen.ended else gesture.kind
        belief = f"{gesture.confidence:.3f} certain {'after' if gesture.ended else 'for'}"
        size = f"{gesture.peak_n:.2f} N at most, {math.degrees(gesture.angle_rad):.0f} degrees"
        why = f"{belief} {gesture.duration_s:.3f} s, {size}"
        self.decisions.append(Decision(seen.time_s, gesture.kind, why))
        return gesture

    def _classify(self) -> Gesture:
        """Bayes' rule over the features of the disturbance."""
        seen = self.disturbance
        kinds = HELD if seen.held else TOUCH
        logs = _log_odds(list(kinds.values()), seen)
        odds = np.exp(logs - logs.max())
        odds = dict(zip(kinds, (odds / odds.sum()).tolist(), strict=True))
        kind = name = max(odds, key=odds.__getitem__)
        duration_s = max(seen.duration_s, 1e-3)
        force = seen.impulse_ns[:3] / duration_s
        u, v = float(force @ self.right), float(force @ self.up)
        length = math.hypot(u, v)
        if name == "pull" and force @ self._towards < -AWAY * length:
            kind = "push"
        x, y, z = force.tolist()
        return Gesture(
            kind=kind, confidence=odds[name], probabilities=odds, began_s=seen.began_s,
            duration_s=seen.duration_s, force_n=(x, y, z), angle_rad=math.atan2(v, u),
            angle_sigma_rad=min(math.atan2(seen.sigma_n(duration_s), length), UNKNOWN_RAD),
            peak_n=seen.peak_n, ended=seen.ended,
        )  # fmt: skip


def _log_odds(kinds: list[Kind], seen: Disturbance) -> np.ndarray:
    """Logarithm of the densities of each kind."""
    logs = np.zeros(len(kinds))
    for name, value in (("duration_s", seen.lasting_s), ("size_n", seen.peak_n)):
        median, spread = np.array([getattr(kind, name) for kind in kinds]).T
        away = np.log(max(value, 1e-3) / median) / spread
        logs += -0.5 * away**2 - np.log(spread * math.sqrt(2.0 * math.pi)) if seen.ended else (
            log_ndtr(-away)
        )  # fmt: skip
    along, across, moment = np.maximum(seen.energy, 0.0).tolist()
    force = along + across + 1e-12
    shares = {"normal": along / force, "moment": moment / (force + moment), "moved": seen.moved}
    for name, share in shares.items():
        a, b = np.array([getattr(kind, name) for kind in kinds]).T
        logs += beta_log(share, a, b)
    return logs


def _plane(normal: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two axes across the normal, the second one closest to `up`, or else to y."""
    for wanted in (up, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = wanted - normal * (normal @ wanted)
        length = float(np.linalg.norm(across))
        if length > 0.5:
            break
    across = across / length
    return np.cross(normal, across), across
