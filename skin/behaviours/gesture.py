"""Gestures: actions of a hand on a skin, or on a held object, with their probabilities.

Each kind of gesture has stated densities of duration, strength, direction and motion. Bayes' rule
over them gives the confidence, a probability as far as people follow the densities. While a gesture
lasts, its duration and size so far are lower bounds: their densities are replaced by survival
functions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from skin.behaviours.decision import Decisions
from skin.behaviours.densities import beta_log, log_normal_log, log_normal_longer_log
from skin.behaviours.disturbance import Disturbance
from skin.behaviours.disturbance_parameters import DisturbanceParameters
from skin.behaviours.numbers import check_direction, check_tuple
from skin.errors import OptionError, check_kind, check_number
from skin.state import State
from topology import Topology

__all__ = ["HELD", "TOUCH", "Gesture", "GestureParameters", "Gestures", "Kind"]


@dataclass(frozen=True, kw_only=True)
class Kind:
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
    prior : float
        Relative frequency, in any unit.
    """

    duration_s: tuple[float, float]
    size_n: tuple[float, float]
    normal: tuple[float, float] = (1.0, 1.0)
    moment: tuple[float, float] = (1.0, 1.0)
    moved: tuple[float, float] = (1.0, 30.0)
    prior: float = 1.0

    def __post_init__(self) -> None:
        for name in ("duration_s", "size_n"):
            check_tuple(f"kind: {name}", getattr(self, name), (1e-6, 1e6), (1e-3, 100.0))
        for name in ("normal", "moment", "moved"):
            check_tuple(f"kind: {name}", getattr(self, name), (1e-3, 1e6), (1e-3, 1e6))
        check_number("kind: prior", self.prior, 1e-9, 1e9)


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


@dataclass(frozen=True, kw_only=True)
class GestureParameters:
    """Parameters that distinguish gestures.

    Attributes
    ----------
    held, touch : dict of str to Kind
        Densities on a held object, and on a bare skin.
    least_confidence : float
        Confidence at which a gesture is reported before it has ended [assumed].
    look_s : float
        Interval at which the confidence is computed during a gesture [assumed].
    up, towards : tuple of 3 float
        Skin frame: direction at 90 degrees; direction of the person, by which a push differs from a
        pull. (0, 0, 0) if unknown: all are pulls then.
    disturbance : DisturbanceParameters
    """

    held: dict[str, Kind] = field(default_factory=lambda: HELD)
    touch: dict[str, Kind] = field(default_factory=lambda: TOUCH)
    least_confidence: float = 0.95
    look_s: float = 0.02
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    towards: tuple[float, float, float] = (0.0, 0.0, 0.0)
    disturbance: DisturbanceParameters = field(default_factory=DisturbanceParameters)

    def __post_init__(self) -> None:
        check_number("gestures: least_confidence", self.least_confidence, 0.5, 1.0)
        check_number("gestures: look_s", self.look_s, 1e-6, 10.0)
        check_direction("gestures: up", self.up)
        check_direction("gestures: towards", self.towards, or_none=True)
        check_kind("gestures: disturbance", self.disturbance, DisturbanceParameters)
        for name in ("held", "touch"):
            kinds = getattr(self, name)
            check_kind(f"gestures: {name}", kinds, dict)
            if not kinds:
                raise OptionError(f"gestures: {name}: must be one kind or more; got none")
            for kind, densities in kinds.items():
                check_kind(f"gestures: {name} {kind!r}", densities, Kind)


@dataclass(frozen=True, kw_only=True)
class Gesture:
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
    compared with. A gesture that outlasts `DisturbanceParameters.longest_s` is reported as ended
    then; its later end is not a gesture.

    Parameters
    ----------
    topology : Topology
    parameters : GestureParameters, optional
    pads : iterable of str, optional
        Patches that belong together: the fingers of a gripper, or one skin; all if not given.

    Attributes
    ----------
    disturbance : Disturbance
    decisions : Decisions
    last : Gesture or None
    right, up : ndarray, shape (3,)
        Axes of the plane of the pads, skin frame, for a view onto the face of the first pad: `up`
        is the given one in the plane, or y where that is along the normal.

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
        parameters: GestureParameters | None = None,
        pads: Iterable[str] | None = None,
    ) -> None:
        self.parameters = GestureParameters() if parameters is None else parameters
        self.disturbance = Disturbance(topology, self.parameters.disturbance, pads)
        self.decisions = Decisions()
        self.last: Gesture | None = None
        normal = np.array(self.disturbance.normal)
        self.right, self.up = _plane(normal, np.array(self.parameters.up))
        towards = np.array(self.parameters.towards, float)
        length = float(np.linalg.norm(towards))
        self._towards = (towards / length if length > 0.0 else towards).tolist()
        self._axes = self.right.tolist(), self.up.tolist()
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
        self._next_s = seen.time_s + self.parameters.look_s
        gesture = self._classify()
        if not seen.ended and (gesture.confidence < self.parameters.least_confidence
                               or gesture.kind == self._reported_kind):  # fmt: skip
            return None
        self._reported_kind = "" if seen.ended else gesture.kind
        self.last = gesture
        self.decisions.add(seen.time_s, gesture.kind, _why(gesture, seen))
        return gesture

    def _classify(self) -> Gesture:
        """Bayes' rule over the features of the disturbance."""
        seen = self.disturbance
        kinds = self.parameters.held if seen.held else self.parameters.touch
        logs = {name: _log_odds(kind, seen) for name, kind in kinds.items()}
        most = max(logs.values())
        total = sum(math.exp(value - most) for value in logs.values())
        odds = {name: math.exp(value - most) / total for name, value in logs.items()}
        name = max(odds, key=odds.__getitem__)
        duration_s = max(seen.duration_s, 1e-3)
        x, y, z = (value / duration_s for value in seen.impulse_ns[:3])
        right, up = self._axes
        u = x * right[0] + y * right[1] + z * right[2]
        v = x * up[0] + y * up[1] + z * up[2]
        length = math.hypot(u, v)
        away = x * self._towards[0] + y * self._towards[1] + z * self._towards[2]
        kind = "push" if name == "pull" and away < -AWAY * length else name
        noise = math.sqrt(seen.mean_variance(duration_s))
        return Gesture(
            kind=kind, confidence=odds[name], probabilities=odds, began_s=seen.began_s,
            duration_s=seen.duration_s, force_n=(x, y, z), angle_rad=math.atan2(v, u),
            angle_sigma_rad=min(math.atan2(noise, length), math.pi / math.sqrt(3.0)),
            peak_n=seen.peak_n, ended=seen.ended,
        )  # fmt: skip


AWAY = 0.38
"""Cosine beyond which a force points away from the person: half of 45 degrees past perpendicular
[derived]."""


def _log_odds(kind: Kind, seen: Disturbance) -> float:
    """Logarithm of prior times densities."""
    lasts = of_size = log_normal_log if seen.ended else log_normal_longer_log
    along, across, moment = (max(value, 0.0) for value in seen.energy)
    force = along + across + 1e-12
    return (
        math.log(kind.prior)
        + lasts(max(seen.lasting_s, 1e-3), *kind.duration_s)
        + of_size(max(seen.peak_n, 1e-3), *kind.size_n)
        + beta_log(along / force, *kind.normal)
        + beta_log(moment / (force + moment), *kind.moment)
        + beta_log(seen.moved, *kind.moved)
    )


def _plane(normal: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two axes across the normal, the second one closest to `up`, or else to y."""
    for wanted in (up, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = wanted - normal * (normal @ wanted)
        length = float(np.linalg.norm(across))
        if length > 0.5 * float(np.linalg.norm(wanted)) > 0.0:
            break
    across = across / length
    return np.cross(normal, across), across


def _why(gesture: Gesture, seen: Disturbance) -> str:
    since = "after" if gesture.ended else "for"
    return (
        f"{gesture.confidence:.3f} sure {since} {gesture.duration_s:.3f} s, {gesture.peak_n:.2f} N "
        f"at most, {math.degrees(gesture.angle_rad):.0f} degrees"
    )
