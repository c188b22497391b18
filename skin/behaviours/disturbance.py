"""Disturbance: forces of a person on a skin, or on a held object, relative to rest.

The sum of the pads' loads balances weight and pull: its change is the force of a person, in any
orientation or slip of the object. A disturbance begins where the change exceeds the noise, and ends
where it no longer does; the rest is not learned meanwhile. One that lasts too long ends, and is of
a person who leans on it from then on. To let go later is no disturbance: a change straight back to
the object's own load is a return, and ends there.

On a bare skin only contacts count, where they are wanted: this keeps out the noise of untouched
units.

Loads of silent units are estimates. When the set of heard units changes, the own load is learned
again, and nothing is reported meanwhile, nor while no unit is heard.

A load is seven numbers, newton, skin frame: three of force, three of torque over a lever, and the
sum of the pads' normal forces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaln

from skin.behaviours.pads import PadLoads, Pads
from skin.contact.record import SlipState
from skin.state import State, if_wanted
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact

__all__ = ["Disturbance", "Rest", "beta_log"]

LEARN_S, ANCHOR_S, REST_S = 0.2, 0.06, 1.0
"""Duration of learning the first rest, without reports [derived: noise of its mean is a seventh];
of learning the own load again where other units are heard [derived: a fourth]; time constant of the
rest [assumed: slower than a hand, faster than a drift]."""
SMOOTH_S, SLOW_S = 0.015, 0.06
"""Time constants of the means compared with noise [assumed: half of a short tap, of a brush]."""
ONSET, END = 34.0, 9.0
"""Squared distance from rest, in sigmas, over force and torque: 34 for six numbers and a test every
30 ms is one false onset per hour of white noise; noise exceeds 9 one time in six [derived]."""
QUIET_S, LONGEST_S = 0.05, 10.0
"""Duration below `END` that ends a disturbance; a longer change is of a person who leans on it
[assumed]."""
BACK = 0.05
"""Tolerance of a return to the own load, relative to what leaned on it [assumed]."""
WANDER_N = 0.01
"""Sigma of the rest itself [assumed]."""
LEVER_M, TOUCH_LEVER_M = 0.04, 0.005
"""Levers that convert torques to forces: of a held object, so that both have the same noise on pads
of some centimetres [derived]; of a finger that touches a skin [assumed: its radius of contact]."""
HELD_N = 0.6
"""Load at rest above which an object is held [assumed: four sigma of two pads]."""
OFF = 0.1
"""Distance of a grasp from where it was, over the lever, for which the rest is learned again
[assumed: a force is a tenth of it as torque; the centre of one cycle is 1 mm off]."""
EDGE = 0.005
"""Fractions are kept this far from 0 and 1: noise resolves no less [assumed]."""
UNKNOWN = 1e12
"""Doubt before the first cycle."""


class Rest:
    """What pads bear while nobody moves it: an object's own load, a drift, and a person's lean.

    ``now = own + drift + lean + noise``: `own` is constant. `lean`, of a person who leans on the
    object, pulls or bears it, is zero or constant for long; while there is one, what changes slowly
    is the person's. A Kalman filter of a random walk follows the sum. Its gain is its variance over
    that of the noise, too: it falls as 1/n while n cycles are learned, down to that of `REST_S`.

    Attributes
    ----------
    own, load : ndarray, shape (7,)
        The object's, and the sum.
    noise : ndarray, shape (7,)
        Newton squared: variance of the load of a cycle.
    doubt : float
        Variance of the rest over that of the noise.
    settled, known : bool
        Whether it was learned; whether it is known for the units that are heard.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._gain = period_s / (REST_S + period_s)
        self._walk = self._gain * self._gain / (1.0 - self._gain)
        self.forget()

    def forget(self) -> None:
        """Learn all of it again."""
        self.own, self.load, self.noise, self._lean = (np.zeros(7) for _ in range(4))
        self.doubt, self._cycles, self._left_s = UNKNOWN, 0, LEARN_S
        self.settled = self.known = False

    def forget_own(self) -> None:
        """Learn the own load again: other units may measure another one."""
        if self.settled:
            self.known, self.doubt, self._left_s = False, UNKNOWN, ANCHOR_S

    def follow(self, now: np.ndarray, last: np.ndarray, change: np.ndarray) -> None:
        """Learn from the load of a cycle, and of the last one, which is a change away from rest."""
        doubt = self.doubt + self._walk
        self.doubt = gain = doubt / (1.0 + doubt)
        self._cycles += 1
        off = gain * (now - change - self.load)
        if not self.known:
            self.own = self.own + off
        elif self._lean.any():
            self._lean = self._lean + off
        self.load = self.load + off
        share = max(self._gain, 1.0 / self._cycles)
        self.noise = self.noise + share * (0.5 * (now - last) ** 2 - self.noise)
        self._left_s -= self._period_s
        self.known = self._left_s < 0.5 * self._period_s
        self.settled = self.settled or self.known

    def move(self, change: np.ndarray, share: float, *, leans: bool) -> None:
        """Add a lasting change, of somebody who leans on it from now on, or who has let go."""
        self.load = self.load + change
        self._lean = self._lean + change if leans else np.zeros(7)
        self.doubt += share

    def distance(self, change: np.ndarray, share: float, allowed_n: float = 0.0) -> float:
        """Squared distance of a change from zero, in sigmas; `share` of the noise's variance is in
        it."""
        share += self.doubt - self._gain  # `WANDER_N` has what is left
        variance = share * self.noise[:6] + WANDER_N**2 + allowed_n**2
        return float((change[:6] ** 2 / variance).sum())

    def way_back(self, change: np.ndarray, share: float) -> tuple[float, float]:
        """Squared distances, in sigmas, of a change of a load that is leaned on: from the straight
        way back to the own load, and from its end."""
        lean, change = self._lean[:6], change[:6]
        square = float(lean @ lean)
        if square == 0.0:
            return math.inf, math.inf
        along = min(max(-float(lean @ change) / square, 0.0), 1.0)
        allowed_n = BACK * math.sqrt(square)
        return (self.distance(change + along * lean, share, allowed_n),
                self.distance(change + lean, share, allowed_n))  # fmt: skip


class Disturbance:
    """Follows the change of the wrench of some pads together, cycle by cycle.

    Attributes
    ----------
    held : bool
        Whether an object is held at rest; otherwise this is a bare skin.
    active, ended : bool
        Whether a disturbance is in progress; whether it ended in this cycle.
    returning : bool
        Whether the disturbance is, so far, a return to the own load of what is held.
    time_s, began_s, duration_s : float
        Duration until the last cycle above the noise.
    pad_force_n : ndarray, shape (3, p)
        See `PadLoads.force_n`, of this cycle; `load_n` is the sum of the normal forces.
    impulse_ns : ndarray, shape (6,)
        Integral of the change so far, newton second; torque over lever.
    energy : ndarray, shape (3,)
        Integrals of the squares along the pads' normal, across it and of torque over lever, noise
        subtracted.
    peak_n : float
        Of the smoothed change, including torque over lever, noise subtracted.
    moved : float
        Fraction from 0 to 1: of the time in which the held object slides; on a bare skin of the
        travel of the centre of pressure, over itself and `TOUCH_LEVER_M`.
    """

    def __init__(self, topology: Topology, pads: Iterable[str] | None = None) -> None:
        self.pads = Pads(topology, pads)
        self._period_s = dt = 1.0 / topology.cycle_rate_hz
        self.rest = Rest(dt)
        self._gains = [dt / (time_s + dt) for time_s in (SMOOTH_S, SLOW_S)]
        self._shares = [gain / (2.0 - gain) for gain in self._gains]
        self.time_s = self.load_n = 0.0
        self._start_ns: int | None = None
        self.held = self.ended = False
        self._valid, self._last, self._centre = b"", np.zeros(7), np.zeros(3)
        self.settle()
        self._forget()

    def settle(self) -> None:
        """Take the present loads as the rest: after a grasp, a lift or a turn."""
        self.rest.forget()
        self.active = self.returning = False
        self._calm()

    def _calm(self) -> None:
        """Nothing is off the rest."""
        self._change, self._slowly = np.zeros(7), np.zeros(7)

    @property
    def force_n(self) -> np.ndarray:
        """Newton, skin frame: change from rest, smoothed by `SMOOTH_S`; shape (3,)."""
        return self._change[:3]

    @property
    def moment_nm(self) -> np.ndarray:
        """The same about the grasp; on a bare skin only torsion."""
        return self._lever_m * self._change[3:6]

    @property
    def _lever_m(self) -> float:
        return LEVER_M if self.held else TOUCH_LEVER_M

    @property
    def lasting_s(self) -> float:
        """Duration of a rectangle of the same impulse and peak: a decaying oscillation adds
        nothing."""
        return float(np.linalg.norm(self.impulse_ns)) / self.peak_n if self.peak_n > 0.0 else 0.0

    def sigma_n(self, duration_s: float | None = None) -> float:
        """One-sigma of a component of the mean change over a time, of noise and rest; by default of
        `force_n`."""
        duration_s = 2.0 * SMOOTH_S + self._period_s if duration_s is None else duration_s
        noise = float(self.rest.noise[:3].mean()) * self._period_s / duration_s
        return math.sqrt(noise + WANDER_N**2)

    def update(self, state: State) -> bool:
        """Process a cycle; returns whether the loads of the pads are known."""
        self.ended = False
        self._start_ns = state.stamp_ns if self._start_ns is None else self._start_ns
        self.time_s = 1e-9 * (state.stamp_ns - self._start_ns)
        loads, rest = self.pads.read(state), self.rest
        now = self._read(loads, if_wanted(state, "contacts"))
        if not math.isfinite(now.sum()):
            return False
        self.load_n = float(now[6])
        valid = state.units.valid.tobytes()
        if valid != self._valid:
            self._valid, self._last = valid, now
            rest.forget_own()
            if not self.active:
                self._calm()
        last, self._last = self._last, now
        if rest.known:
            self._follow(now, last, state, loads)
            return True
        is_first = not rest.settled
        rest.follow(now, last, self._change)
        if rest.known and is_first:
            self._check(loads)
        elif rest.known:
            rest.doubt += self._shares[0]
        return is_first

    def _read(self, loads: PadLoads, contacts: list[Contact] | None) -> np.ndarray:
        """The load, with torque about the grasp or torsion; of all pads or contacts."""
        self.pad_force_n = loads.force_n
        force = loads.force_n.sum(axis=1)
        if self.held:
            (x, y, z), (u, v, w) = force.tolist(), self._centre.tolist()
            moment = loads.moment_nm.sum(axis=1) - (v * z - w * y, w * x - u * z, u * y - v * x)
        else:
            torsion = loads.torsion_nm.sum()
            if contacts is not None and np.isfinite(force).all():
                force = sum([one.wrench[:3] for one in contacts], np.zeros(3))
                torsion = np.nansum([one.torsion for one in contacts])
            moment = torsion * self.pads.normal
        return np.concatenate([force, moment / self._lever_m, [loads.load_n.sum()]])

    def _check(self, loads: PadLoads) -> None:
        """Whether an object is held; if that is new, or it is elsewhere, learn the rest again."""
        held = bool(self.rest.own[6] > HELD_N)
        centre = _centre(loads) if held else np.zeros(3)
        if held != self.held or math.dist(centre, self._centre) > OFF * self._lever_m:
            self.held, self._centre = held, centre
            self.settle()

    def _follow(self, now: np.ndarray, last: np.ndarray, state: State, loads: PadLoads) -> None:
        """Compare with the rest; begin, continue or end a disturbance."""
        rest, off = self.rest, now - self.rest.load
        self._change = self._change + self._gains[0] * (off - self._change)
        self._slowly = self._slowly + self._gains[1] * (off - self._slowly)
        mean, share = self._change, self._shares[0]
        distance = rest.distance(mean, share)
        is_sharp = distance > ONSET
        if not is_sharp and (not self.active or self._is_light):
            mean, share = self._slowly, self._shares[1]
            distance = rest.distance(mean, share)
        if not self.active:
            if distance <= ONSET:
                rest.follow(now, last, np.zeros(7))
                return
            self._forget()
            self.active = self.returning = self._is_light = True
            self.began_s = self.time_s - (SMOOTH_S if is_sharp else SLOW_S)
        self._is_light = self._is_light and not is_sharp
        self._lasted = self.time_s - self.began_s
        self._add(off, state, loads)
        size = float((mean[:6] ** 2 - share * rest.noise[:6]).sum())
        self.peak_n = max(self.peak_n, math.sqrt(max(size, 0.0)))
        from_way, from_own = rest.way_back(mean, share)
        self.returning = self.returning and from_way <= ONSET
        if distance > END:
            self.duration_s = self._lasted
        if from_own > END:
            self._away_s = self._lasted
        is_back, is_long = self._lasted - self._away_s > QUIET_S, self._lasted > LONGEST_S
        if is_back or is_long or self._lasted - self.duration_s > QUIET_S:
            self.ended = not (self.returning and (is_back or is_long))
            self.active = self.returning = False
            self._slowly = self._change
        if is_back or is_long:
            rest.move(mean, share, leans=not is_back)
            self._calm()
            if (rest.load[6] > HELD_N) != self.held:
                self.settle()

    def _forget(self) -> None:
        """Reset for a new disturbance."""
        self.began_s = self.time_s
        self.duration_s = self._lasted = self._away_s = self.peak_n = self.moved = 0.0
        self.impulse_ns, self.energy = np.zeros(6), np.zeros(3)
        self._sliding_s, self._places = 0.0, np.zeros(9)

    def _add(self, off: np.ndarray, state: State, loads: PadLoads) -> None:
        """Accumulate this cycle."""
        dt, normal, noise = self._period_s, self.pads.normal, self.rest.noise[:6]
        change = off[:6]
        self.impulse_ns = self.impulse_ns + dt * change
        squares = change**2 - noise
        along = float(change[:3] @ normal) ** 2 - float(noise[:3] @ normal**2)
        force = float(squares[:3].sum())
        self.energy = self.energy + dt * np.array([along, force - along, squares[3:].sum()])
        if self.held:
            contacts = () if if_wanted(state, "slip") is None else state.contacts
            self._sliding_s += dt * any(one.slip == SlipState.GROSS for one in contacts)
            self.moved = self._sliding_s / max(self._lasted, dt)
            return
        centre, load = _centre(loads), self.load_n
        if if_wanted(state, "contacts"):
            hardest = max(state.contacts, key=lambda one: one.load)
            centre, load = hardest.centroid, float(hardest.load)
        if np.isfinite(centre).all() and load > 0.0:
            length_m = self._travel_m(load * load, centre)
            self.moved = length_m / (length_m + TOUCH_LEVER_M)

    def _travel_m(self, weight: float, place: np.ndarray) -> float:
        """Distance that a finger has gone: speed times duration of a uniform motion with the same
        spread in time, by a weighted straight line through its places."""
        t = self._lasted
        self._places = self._places + weight * np.array([1.0, t, t * t, *place, *(t * place)])
        w, wt, wtt = self._places[:3]
        spread = wtt / w - (wt / w) ** 2
        if not spread > 0.0:
            return 0.0
        slope = (self._places[6:] - wt / w * self._places[3:6]) / w
        return float(np.linalg.norm(slope)) * math.sqrt(12.0 / spread)


def _centre(loads: PadLoads) -> np.ndarray:
    """Centre of pressure of all pads together; NaN where nothing presses."""
    weight = np.where(np.isfinite(loads.centre_m[0]), np.maximum(loads.load_n, 0.0), 0.0)
    total = weight.sum()
    return np.nan_to_num(loads.centre_m) @ weight / (total if total > 0.0 else math.nan)


def beta_log(share: float, a: np.ndarray | float, b: np.ndarray | float) -> np.ndarray:
    """Logarithm of beta densities of a fraction, which is kept off 0 and 1."""
    kept = min(max(share, EDGE), 1.0 - EDGE)
    return (a - 1.0) * math.log(kept) + (b - 1.0) * math.log(1.0 - kept) - betaln(a, b)
