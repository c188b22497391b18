"""Disturbance: forces of a person on a skin, or on a held object, relative to rest.

The sum of the pads' loads balances weight and pull: its change is the force of a person, in any
orientation or slip of the object. A disturbance begins where the change exceeds the noise, and ends
where it no longer does; the rest is not learned meanwhile (`skin.behaviours.rest`). One that lasts
too long ends, and is of a person who leans on it from then on. To let go later is no disturbance: a
change straight back to the object's own load is a return, and ends there.

On a bare skin only contacts count, where they are wanted: this keeps out the noise of untouched
units.

Loads of silent units are estimates. When the set of heard units changes, the own load is learned
again, and nothing is reported meanwhile, nor while no unit is heard.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from skin.behaviours.disturbance_parameters import DisturbanceParameters
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.rest import Rest
from skin.behaviours.sums import centre_of, normal_of, touched
from skin.behaviours.travel import Travel
from skin.contact.record import SlipState
from skin.state import State, if_wanted
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact

__all__ = ["Disturbance"]

OFF = 0.1
"""Distance of a grasp from where it was, over the lever, for which the rest is learned again
[assumed: a force is a tenth of it as torque; the centre of one cycle is 1 mm off]."""


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
        Whether the disturbance is, so far, a return to the own load of what is held.
    time_s, began_s, duration_s : float
        Duration until the last cycle above the noise.
    force_n : list of 3 float
        Newton, skin frame: change from rest, smoothed by `smooth_s`.
    moment_nm : list of 3 float
        The same about the grasp; on a bare skin only torsion.
    rest : Rest
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
        self.rest = Rest(p, dt)
        self._gains = [dt / (time_s + dt) for time_s in (p.smooth_s, p.slow_s)]
        self._shares = [gain / (2.0 - gain) for gain in self._gains]
        self.time_s = 0.0
        self._start_ns: int | None = None
        self.heard = self.held = self.ended = False
        self._valid, self._last, self._centre = b"", [0.0] * 7, [0.0] * 3
        self.settle()
        self._forget()

    def settle(self) -> None:
        """Take the present loads as the rest: after a grasp, a lift or a turn."""
        self.rest.forget()
        self.active = self.returning = False
        self._calm()

    def _calm(self) -> None:
        """Nothing is off the rest."""
        self._change, self._slowly = [0.0] * 7, [0.0] * 7

    @property
    def settled(self) -> bool:
        """Whether the rest is known."""
        return self.rest.settled

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
        return math.sqrt(self.mean_variance(self._period_s / self._shares[0]))

    def mean_variance(self, duration_s: float) -> float:
        """Variance of a component of the mean change over a time, newton squared: of noise and
        rest."""
        noise = sum(self.rest.noise[:3]) / 3.0
        return noise * self._period_s / duration_s + self.parameters.wander_n**2

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
        self.load_n = now[6]
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
        lever_m = self.lever_m
        return [x, y, z, *(value / lever_m for value in moment), sum(loads.load_n.tolist())]

    def _check(self, loads: PadLoads) -> None:
        """Whether an object is held; if that is new, or it is elsewhere, learn the rest again."""
        held = self.rest.own[6] > self.parameters.held_n
        centre = centre_of(loads) if held else [0.0] * 3
        if held != self.held or math.dist(centre, self._centre) > OFF * self.lever_m:
            self.held, self._centre = held, centre
            self.settle()

    def _follow(self, now: list[float], last: list[float], state: State, loads: PadLoads) -> None:
        """Compare with the rest; begin, continue or end a disturbance."""
        p, rest = self.parameters, self.rest
        change, slowly, (smooth, slow) = self._change, self._slowly, self._gains
        for i, at in enumerate(rest.load):
            off = now[i] - at
            change[i] += smooth * (off - change[i])
            slowly[i] += slow * (off - slowly[i])
        mean, share = change, self._shares[0]
        distance = rest.distance(mean, share)
        is_sharp = distance > p.onset
        if not is_sharp and (not self.active or self._is_light):
            mean, share = slowly, self._shares[1]
            distance = rest.distance(mean, share)
        if not self.active:
            if distance <= p.onset:
                rest.follow(now, last, [0.0] * 7)
                return
            self._forget()
            self.active = self.returning = self._is_light = True
            self.began_s = self.time_s - (p.smooth_s if is_sharp else p.slow_s)
        self._is_light = self._is_light and not is_sharp
        self._lasted = self.time_s - self.began_s
        self._add(now, state, loads)
        size = sum([mean[i] * mean[i] - share * rest.noise[i] for i in range(6)])
        self.peak_n = max(self.peak_n, math.sqrt(max(size, 0.0)))
        from_way, from_own = rest.way_back(mean, share)
        self.returning = self.returning and from_way <= p.onset
        if distance > p.end:
            self.duration_s = self._lasted
        if from_own > p.end:
            self._away_s = self._lasted
        is_back, is_long = self._lasted - self._away_s > p.quiet_s, self._lasted > p.longest_s
        if is_back or is_long or self._lasted - self.duration_s > p.quiet_s:
            self.ended = not (self.returning and (is_back or is_long))
            self.active = self.returning = False
            self._slowly = list(change)
        if is_back or is_long:
            rest.move(mean, share, leans=not is_back)
            self._calm()
            if (rest.load[6] > p.held_n) != self.held:
                self.settle()

    def _forget(self) -> None:
        """Reset for a new disturbance."""
        self.began_s = self.time_s
        self.duration_s = self._lasted = self._away_s = self.peak_n = self.moved = 0.0
        self._impulse = [0.0] * 6
        self.energy = [0.0] * 3
        self._sliding = 0.0
        self._travel = Travel()

    def _add(self, now: list[float], state: State, loads: PadLoads) -> None:
        """Accumulate this cycle."""
        dt, n, noise, energy = self._period_s, self.normal, self.rest.noise, self.energy
        change = [now[i] - self.rest.load[i] for i in range(6)]
        squares = [change[i] * change[i] - noise[i] for i in range(6)]
        for i, value in enumerate(change):
            self._impulse[i] += dt * value
        along = change[0] * n[0] + change[1] * n[1] + change[2] * n[2]
        along_noise = noise[0] * n[0] ** 2 + noise[1] * n[1] ** 2 + noise[2] * n[2] ** 2
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
