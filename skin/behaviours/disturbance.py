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
from skin.behaviours.pads import Pads
from skin.behaviours.sums import centre_of, normal_of, touched
from skin.behaviours.travel import Travel
from skin.contact.record import SlipState
from skin.state import State, if_wanted
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact

__all__ = ["Disturbance"]


KNOWN = 10**9
"""Cycles since the set of heard units changed, where the rest was learned after that."""


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
        self.parameters = DisturbanceParameters() if parameters is None else parameters
        self.pads = Pads(topology, pads)
        self.normal = normal_of(topology, self.pads.names)
        self._period_s = 1.0 / topology.cycle_rate_hz
        p, dt = self.parameters, self._period_s
        self._smooth = dt / (p.smooth_s + dt)
        self._slow = dt / (p.slow_s + dt)
        self._noise_gain = dt / (p.rest_s + dt)
        self.time_s = 0.0
        self._start_ns: int | None = None
        self.heard = self.held = self.active = self.ended = False
        self._valid = b""
        self._missed, self._mean = KNOWN, [0.0] * 6
        self._last = [0.0] * 6
        self.settle()
        self._forget()

    def settle(self) -> None:
        """Take the present loads as the rest: after a grasp, a lift or a turn."""
        self._before: list[float] | None = None
        self._restart_learning()

    def _restart_learning(self) -> None:
        self._count = 0
        self._straight, self._there = False, 0
        self.active = False
        self._rest = [0.0] * 6
        self._noise = [0.0] * 6
        self._centre = [0.0] * 3
        self._loads = 0.0
        self._change = [0.0] * 6
        self._slowly = [0.0] * 6
        self._is_light = True
        self._doubt = 0.0  # variance of the rest over the noise of a cycle

    @property
    def settled(self) -> bool:
        """Whether the rest is known."""
        return self._count * self._period_s >= self.parameters.learn_s

    @property
    def returning(self) -> bool:
        """See the class."""
        return self.active and self._straight

    @property
    def rest_n(self) -> list[float]:
        """See the class."""
        return self._rest[:3]

    @property
    def force_n(self) -> list[float]:
        """See the class."""
        return self._change[:3]

    @property
    def moment_nm(self) -> list[float]:
        """See the class."""
        return self._change[3:]

    @property
    def lever_m(self) -> float:
        """The lever in use."""
        return self.parameters.lever_m if self.held else self.parameters.touch_lever_m

    @property
    def lasting_s(self) -> float:
        """Duration of a rectangle of the same impulse and peak: a decaying oscillation adds
        nothing."""
        x, y, z, a, b, c = self.impulse_ns
        moment = (a * a + b * b + c * c) / self.lever_m**2
        impulse = math.sqrt(x * x + y * y + z * z + moment)
        return impulse / self.peak_n if self.peak_n > 0.0 else 0.0

    @property
    def sigma_n(self) -> float:
        """One-sigma of a component of `force_n`."""
        share = self._smooth / (2.0 - self._smooth)
        return math.sqrt(share * sum(self._noise[:3]) / 3.0 + self.parameters.wander_n**2)

    def mean_variance(self, duration_s: float) -> float:
        """Variance of a component of the mean change over a time, newton squared: of noise and
        rest."""
        noise = (self._noise[0] + self._noise[1] + self._noise[2]) / 3.0
        return noise * self._period_s / duration_s + self.parameters.wander_n**2

    def update(self, state: State) -> bool:
        """Process a cycle; returns whether the loads of the pads are known."""
        self.ended = False
        if self._start_ns is None:
            self._start_ns = state.stamp_ns
        self.time_s = 1e-9 * (state.stamp_ns - self._start_ns)
        loads = self.pads.read(state)
        wrench = self._wrench(loads, if_wanted(state, "contacts"))
        self.heard = all(map(math.isfinite, wrench))
        if not self.heard:
            return False
        self.load_n = sum(loads.load_n.tolist())
        valid = state.units.valid.tobytes()
        if valid != self._valid:
            self._valid, self._last = valid, wrench
            self._missed, self._mean = 0 if self.settled else KNOWN, [0.0] * 6
        if self.settled and self._missed * self._period_s < self.parameters.anchor_s:
            self.heard = False
            self._anchor(wrench)
        elif not self.settled:
            self._learn(wrench, loads)
        else:
            self._follow(wrench, state, loads)
        self._last = wrench
        return self.heard

    def _wrench(self, loads, contacts: list[Contact] | None) -> list[float]:
        """Force, and torque about the grasp or torsion, of all pads or contacts."""
        self.pad_force_n = loads.force_n.tolist()
        x, y, z = map(sum, self.pad_force_n)
        if not self.held:
            torsion = float(loads.torsion_nm.sum())
            if contacts is not None and math.isfinite(x):
                x, y, z, torsion = touched(contacts)
            return [x, y, z, *(torsion * n for n in self.normal)]
        a, b, c = map(sum, loads.moment_nm.tolist())
        u, v, w = self._centre
        return [x, y, z, a - (v * z - w * y), b - (w * x - u * z), c - (u * y - v * x)]

    def _anchor(self, wrench: list[float]) -> None:
        """Shift the rest so that the change stays the same for another set of units; the rest is
        unknown meanwhile."""
        self._missed += 1
        share = 1.0 / self._missed
        for i in range(6):
            self._mean[i] += share * (wrench[i] - self._mean[i])
        if self._missed * self._period_s >= self.parameters.anchor_s:
            kept = self._change if self.active else [0.0] * 6
            rest = [mean - change for mean, change in zip(self._mean, kept, strict=True)]
            if self._before is not None:
                moved = zip(self._before, rest, self._rest, strict=True)
                self._before = [before + now - then for before, now, then in moved]
            self._rest = rest
            self._doubt += share + self._smooth / (2.0 - self._smooth)

    def _learn(self, wrench: list[float], loads) -> None:
        """Learn the first rest; restart half-way, when it is known whether an object is held."""
        self._count += 1
        share = 1.0 / self._count
        for i in range(6):
            step = wrench[i] - self._last[i] if self._count > 1 else 0.0
            self._noise[i] += share * (0.5 * step * step - self._noise[i])
            self._rest[i] += share * (wrench[i] - self._rest[i])
        self._loads += share * (self.load_n - self._loads)
        if not self.settled:
            return
        held = self._loads > self.parameters.held_n
        centre = centre_of(loads) if held else [0.0] * 3
        if held != self.held or (held and math.dist(centre, self._centre) > 1e-3):
            self._before = self._about(centre) if held and self.held else None
            self.held = held
            self._restart_learning()
            self._centre = centre

    def _about(self, centre: list[float]) -> list[float] | None:
        """The rest before, with its torque about another centre."""
        if self._before is None:
            return None
        x, y, z, a, b, c = self._before
        u, v, w = (now - then for now, then in zip(centre, self._centre, strict=True))
        return [x, y, z, a - (v * z - w * y), b - (w * x - u * z), c - (u * y - v * x)]

    def _follow(self, wrench: list[float], state: State, loads) -> None:
        """Compare with the rest; begin, continue or end a disturbance."""
        p = self.parameters
        distance, size = self._compare(wrench, self._change, self._smooth)
        is_sharp = distance > p.onset
        if not self.active or self._is_light:
            slow, slow_size = self._compare(wrench, self._slowly, self._slow)
            if not is_sharp:
                distance, size = slow, slow_size
        if not self.active:
            if distance <= p.onset:
                self._rest_on(wrench)
                return
            self._forget()
            self.active = self._is_light = True
            self._straight, self._there = self._before is not None, 0
            self.began_s = self.time_s - (p.smooth_s if is_sharp else p.slow_s)
        self._is_light = self._is_light and not is_sharp
        self._add(wrench, state, loads)
        self.peak_n = max(self.peak_n, math.sqrt(max(size, 0.0)))
        self._lasted = self.time_s - self.began_s
        if distance > p.end:
            self.duration_s = self._lasted
        if self._before is not None and self._is_back(self._before):
            return
        if self._lasted - self.duration_s > p.quiet_s or self._lasted > p.longest_s:
            is_long = self._lasted > p.longest_s
            self.active, self.ended = False, not (is_long and self._straight)
            self._slowly = list(self._change)
            if is_long:
                self._before = self._before or list(self._rest)
                self._restart_learning()

    def _is_back(self, before: list[float]) -> bool:
        """Whether the load is back at the rest before, which then is the rest again."""
        p, change = self.parameters, self._change
        back = [then - now for then, now in zip(before, self._rest, strict=True)]
        scales = [1.0] * 3 + [self.lever_m**-2] * 3
        product = sum(s * a * b for s, a, b in zip(scales, back, change, strict=True))
        square = sum(s * a * a for s, a in zip(scales, back, strict=True))
        share = min(max(product / max(square, 1e-12), 0.0), 1.0)
        off = [b - share * a for a, b in zip(back, change, strict=True)]
        allowed = (p.back * p.back) * square
        self._straight = self._straight and self._off_by(off, scales, allowed) <= p.onset
        rest = [b - a for a, b in zip(back, change, strict=True)]
        self._there = self._there + 1 if self._off_by(rest, scales, allowed) <= p.end else 0
        if self._there * self._period_s < p.quiet_s:
            return False
        self._rest, self._before = list(before), None
        self._change, self._slowly = [0.0] * 6, [0.0] * 6
        self.active, self.ended = False, not self._straight
        return True

    def _off_by(self, off: list[float], scales: list[float], allowed: float) -> float:
        """Squared distance in sigmas, with an allowed square of it."""
        share = self._smooth / (2.0 - self._smooth) + self._doubt
        wander = self.parameters.wander_n**2 + allowed
        rows = zip(off, self._noise, scales, strict=True)
        return sum(a * a / (share * noise + wander / s) for a, noise, s in rows)

    def _compare(
        self, wrench: list[float], change: list[float], gain: float
    ) -> tuple[float, float]:
        """Smooth the change from rest; returns its squared distance in sigmas and its squared
        size."""
        rest, noise, share = self._rest, self._noise, gain / (2.0 - gain)
        wander, lever_square = self.parameters.wander_n**2, self.lever_m**2
        distance = size = 0.0
        for i in range(6):
            change[i] += gain * (wrench[i] - rest[i] - change[i])
            square, scale = change[i] * change[i], 1.0 if i < 3 else lever_square
            distance += square / ((share + self._doubt) * noise[i] + wander * scale)
            size += (square - share * noise[i]) / scale
        return distance, size

    def _rest_on(self, wrench: list[float]) -> None:
        """Update the rest and the noise."""
        gain, rest, noise, last = self._noise_gain, self._rest, self._noise, self._last
        self._doubt -= gain * self._doubt
        for i in range(6):
            step = wrench[i] - last[i]
            noise[i] += gain * (0.5 * step * step - noise[i])
            rest[i] += gain * (wrench[i] - rest[i])

    def _forget(self) -> None:
        """Reset for a new disturbance."""
        self.began_s = self.time_s
        self.duration_s = self._lasted = self.peak_n = self.moved = 0.0
        self.impulse_ns = [0.0] * 6
        self.energy = [0.0] * 3
        self._sliding = 0.0
        self._travel = Travel()

    def _add(self, wrench: list[float], state: State, loads) -> None:
        """Accumulate this cycle."""
        dt, n = self._period_s, self.normal
        change = [wrench[i] - self._rest[i] for i in range(6)]
        noise = self._noise
        for i in range(6):
            self.impulse_ns[i] += dt * change[i]
        along = change[0] * n[0] + change[1] * n[1] + change[2] * n[2]
        whole = change[0] ** 2 + change[1] ** 2 + change[2] ** 2
        along_noise = sum(noise[i] * n[i] * n[i] for i in range(3))
        scale = 1.0 / (self.lever_m * self.lever_m)
        moment = change[3] ** 2 + change[4] ** 2 + change[5] ** 2
        energy = self.energy
        energy[0] += dt * (along * along - along_noise)
        energy[1] += dt * (whole - along * along - (noise[0] + noise[1] + noise[2] - along_noise))
        energy[2] += dt * scale * (moment - noise[3] - noise[4] - noise[5])
        self._move(state, loads)

    def _move(self, state: State, loads) -> None:
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
