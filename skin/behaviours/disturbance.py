"""Disturbance: forces of a person on a skin, or on a held object, relative to a slowly learned
rest.

The sum of the pads' loads balances weight and pull: its change is the force of a person, in any
orientation or slip of the object. A disturbance begins where the change exceeds the noise, and ends
where it no longer does. The rest is not learned meanwhile.

On a bare skin only contacts count, where they are wanted: this keeps out the noise of untouched
units.

A change that lasts too long becomes a new rest. The old rest is kept, since letting go later is no
new disturbance: a change straight back to it is a return, which ends there.

Loads of silent units are estimates. When the set of heard units changes, the rest is shifted by the
apparent change, and nothing is reported in that cycle. Nothing is reported while no unit is heard.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from skin.behaviours.disturbance_parameters import DisturbanceParameters
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.rest import LOAD, Rest
from skin.behaviours.sums import centre_of, normal_of, touched
from skin.behaviours.travel import Travel
from skin.contact.record import SlipState
from skin.state import State, if_wanted
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact

__all__ = ["Disturbance"]


class Disturbance:
    """Follows the change of the pads' summed wrench, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    parameters : DisturbanceParameters, optional
    pads : iterable of str, optional
        Patches that form one gripper; all if not given.

    Attributes
    ----------
    heard : bool
        Whether the loads of the pads are known in this cycle; otherwise all else is unchanged.
    held : bool
        Whether an object is held at rest; otherwise this is a bare skin.
    active, ended : bool
        Whether a disturbance is in progress; whether it ended in this cycle.
    returning : bool
        Whether the disturbance is, so far, a return to the rest before.
    time_s, began_s, duration_s : float
        Duration until the last cycle above the noise.
    force_n : list of 3 float
        Newton, skin frame: change from rest, smoothed by `smooth_s`.
    moment_nm : list of 3 float
        The same about the grasp; on a bare skin only torsion.
    rest_n : list of 3 float
        Load of the pads at rest.
    pad_force_n : list of list of float
        See `PadLoads.force_n`, of this cycle.
    load_n : float
        Sum of the normal forces of the pads.
    impulse_ns, energy : list of float
        Of the disturbance so far: integral of the change, six numbers, newton second and newton
        metre second; integrals of the squares along the pads' normal, across it and of torque over
        lever, noise subtracted.
    peak_n : float
        Of the smoothed change, including torque over lever, noise subtracted.
    moved : float
        Fraction from 0 to 1: of the time in which the held object slides; on a bare skin of the
        travel of the centre of pressure, over itself and `touch_lever_m`.
    """

    def __init__(
        self,
        topology: Topology,
        parameters: DisturbanceParameters | None = None,
        pads: Iterable[str] | None = None,
    ) -> None:
        self.parameters = p = DisturbanceParameters() if parameters is None else parameters
        self.pads = Pads(topology, pads)
        self.normal = normal_of(topology, self.pads.names)
        self._period_s = dt = 1.0 / topology.cycle_rate_hz
        self.rest = Rest(p, dt, len(self.pads.names))
        self._gains = [dt / (time_s + dt) for time_s in (p.smooth_s, p.slow_s)]
        self._shares = [gain / (2.0 - gain) for gain in self._gains]
        self.time_s = 0.0
        self._start_ns: int | None = None
        self.heard = self.held = self.ended = False
        self._valid, self._centre = b"", [0.0] * 3
        self.settle()
        self._forget()

    def settle(self) -> None:
        """Take the present loads as the rest: after a grasp, a lift or a turn."""
        self.rest.forget()
        self.active = self._straight = False
        self._calm()

    def _calm(self) -> None:
        """Nothing is off the rest."""
        self._change, self._slowly = ([0.0] * len(self.rest.own) for _ in range(2))

    @property
    def settled(self) -> bool:
        """Whether the rest is known."""
        return self.rest.settled

    @property
    def returning(self) -> bool:
        """See the class."""
        return self.active and self._straight

    @property
    def rest_n(self) -> list[float]:
        """See the class."""
        return self.rest.load[:3]

    @property
    def force_n(self) -> list[float]:
        """See the class."""
        return self._change[:3]

    @property
    def moment_nm(self) -> list[float]:
        """See the class."""
        return [self.lever_m * value for value in self._change[3:6]]

    @property
    def impulse_ns(self) -> list[float]:
        """See the class."""
        return [*self._impulse[:3], *(self.lever_m * value for value in self._impulse[3:])]

    @property
    def lever_m(self) -> float:
        """The lever in use."""
        return self.parameters.lever_m if self.held else self.parameters.touch_lever_m

    @property
    def lasting_s(self) -> float:
        """Duration of a rectangle of the same impulse and peak: a decaying oscillation adds
        nothing."""
        return math.hypot(*self._impulse) / self.peak_n if self.peak_n > 0.0 else 0.0

    @property
    def sigma_n(self) -> float:
        """One-sigma of a component of `force_n`."""
        return math.sqrt(self._variance(self._shares[0]))

    def mean_variance(self, duration_s: float) -> float:
        """Variance of a component of the mean change over a time, newton squared: of noise and
        rest."""
        return self._variance(self._period_s / duration_s)

    def _variance(self, share: float) -> float:
        return share * sum(self.rest.noise[:3]) / 3.0 + self.parameters.wander_n**2

    def update(self, state: State) -> bool:
        """Process a cycle; returns whether the loads of the pads are known."""
        self.ended = False
        if self._start_ns is None:
            self._start_ns = state.stamp_ns
        self.time_s = 1e-9 * (state.stamp_ns - self._start_ns)
        loads, rest = self.pads.read(state), self.rest
        now = self._read(loads, if_wanted(state, "contacts"))
        self.heard = all(map(math.isfinite, now))
        if not self.heard:
            return False
        self.load_n = now[LOAD]
        valid = state.units.valid.tobytes()
        if valid != self._valid:
            self._valid, self.now_n = valid, now
            rest.forget_own()
            if not self.active:
                self._calm()
        last, self.now_n = self.now_n, now
        if rest.known:
            self._follow(now, last, state, loads)
            return True
        self.heard = not rest.settled
        rest.follow(now, last, self._change)
        if rest.known and self.heard:
            self._check(loads)
        elif rest.known:
            rest.doubt += self._shares[0]
        return self.heard

    def _read(self, loads: PadLoads, contacts: list[Contact] | None) -> list[float]:
        """The load, with torque about the grasp or torsion; of all pads or contacts."""
        self.pad_force_n = loads.force_n.tolist()
        x, y, z = map(sum, self.pad_force_n)
        if self.held:
            a, b, c = map(sum, loads.moment_nm.tolist())
            u, v, w = self._centre
            moment = [a - (v * z - w * y), b - (w * x - u * z), c - (u * y - v * x)]
        else:
            torsion = float(loads.torsion_nm.sum())
            if contacts is not None and math.isfinite(x):
                x, y, z, torsion = touched(contacts)
            moment = [torsion * n for n in self.normal]
        turn = [value / self.lever_m for value in moment]
        each = loads.force_n.ravel("F").tolist()
        return [x, y, z, *turn, sum(loads.load_n.tolist()), *each]

    def _check(self, loads: PadLoads) -> None:
        """Whether an object is held; if that is new, or it is elsewhere, learn the rest again."""
        held = self.rest.own[LOAD] > self.parameters.held_n
        centre = centre_of(loads) if held else [0.0] * 3
        if held != self.held or (held and math.dist(centre, self._centre) > 1e-3):
            self.held, self._centre = held, centre
            self.settle()

    def _follow(
        self, now: list[float], last: list[float], state: State, loads: PadLoads
    ) -> None:
        """Compare with the rest; begin, continue or end a disturbance."""
        p, rest = self.parameters, self.rest
        off = [a - b for a, b in zip(now, rest.load, strict=True)]
        for mean, gain in zip((self._change, self._slowly), self._gains, strict=True):
            for i, value in enumerate(off):
                mean[i] += gain * (value - mean[i])
        mean, share = self._change, self._shares[0]
        distance = rest.distance(mean, share)
        is_sharp = distance > p.onset
        if not is_sharp and (not self.active or self._is_light):
            mean, share = self._slowly, self._shares[1]
            distance = rest.distance(mean, share)
        if not self.active:
            if distance <= p.onset:
                rest.follow(now, last, [0.0] * len(now))
                return
            self._forget()
            self.active = self._straight = self._is_light = True
            self.began_s = self.time_s - (p.smooth_s if is_sharp else p.slow_s)
        self._is_light = self._is_light and not is_sharp
        self._lasted = self.time_s - self.began_s
        self._add(off, state, loads)
        size = sum(a * a - share * b for a, b in zip(mean, rest.noise, strict=False))
        self.peak_n = max(self.peak_n, math.sqrt(max(size, 0.0)))
        from_way, from_own = rest.way_back(mean, share)
        self._straight = self._straight and from_way <= p.onset
        if distance > p.end:
            self.duration_s = self._lasted
        if from_own > p.end:
            self._away_s = self._lasted
        is_back, is_long = self._lasted - self._away_s > p.quiet_s, self._lasted > p.longest_s
        if is_back or is_long or self._lasted - self.duration_s > p.quiet_s:
            self.active = False
            self.ended = not (self._straight and (is_back or is_long))
            self._slowly = list(self._change)
        if is_back or is_long:
            rest.move(self._change, self._shares[0], leans=not is_back)
            self._calm()
            if (rest.load[LOAD] > p.held_n) != self.held:
                self.settle()

    def _forget(self) -> None:
        """Reset for a new disturbance."""
        self.began_s = self.time_s
        self.duration_s = self._lasted = self._away_s = self.peak_n = self.moved = 0.0
        self._impulse = [0.0] * 6
        self.energy = [0.0] * 3
        self._sliding = 0.0
        self._travel = Travel()

    def _add(self, change: list[float], state: State, loads: PadLoads) -> None:
        """Accumulate this cycle."""
        dt, n, noise, energy = self._period_s, self.normal, self.rest.noise, self.energy
        self._impulse = [a + dt * b for a, b in zip(self._impulse, change, strict=False)]
        along = sum(change[i] * n[i] for i in range(3))
        along_noise = sum(noise[i] * n[i] * n[i] for i in range(3))
        squares = [change[i] * change[i] - noise[i] for i in range(6)]
        energy[0] += dt * (along * along - along_noise)
        energy[1] += dt * (sum(squares[:3]) - along * along + along_noise)
        energy[2] += dt * sum(squares[3:])
        self._move(state, loads)

    def _move(self, state: State, loads: PadLoads) -> None:
        """Accumulate the travel of a finger, or the time in which the object slides."""
        if self.held:
            contacts = () if if_wanted(state, "slip") is None else state.contacts
            if any(contact.slip == SlipState.GROSS for contact in contacts):
                self._sliding += self._period_s
            self.moved = self._sliding / max(self._lasted, self._period_s)
            return
        centre, load = centre_of(loads), self.load_n
        if if_wanted(state, "contacts"):
            hardest = max(state.contacts, key=lambda contact: contact.load)
            centre, load = hardest.centroid.tolist(), hardest.load
        if math.isfinite(centre[0]) and load > 0.0:
            self._travel.add(load * load, self._lasted, centre)
            length_m = self._travel.length_m
            self.moved = length_m / (length_m + self.parameters.touch_lever_m)
