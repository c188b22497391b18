"""Loads of the pads of a gripper, or of the fingers of a hand, where some units may be silent.

A unit that is not valid may be loaded: it is assumed to bear the fraction of its pad's load of its
last valid cycle, or the mean fraction of the others if it never was valid.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.jit import compiled, jitable
from skin.behaviours.checks import check_patches, check_state
from skin.state import State, if_wanted
from topology import Topology

__all__ = ["PadLoads", "Pads"]

SHARE_LOAD_N = 0.3
"""Load of a pad above which fractions are learned: 16 units have 0.05 N of noise [derived]."""

PRESSED = 4.0
"""Sigmas of its normal force above which a unit's tangential force counts: an unloaded unit bears
none and would add noise [derived: a false one in 30 000]. It also counts where its fraction of the
load, a mean over 25 cycles, is above a fifth of that."""

SHARE_S = 0.1
"""Time constant of the fractions [assumed]."""

LEAST_HEARD = 0.25
"""Heard fraction below which a pad's loads are not reported [assumed: three silent units of four
leave nothing to extrapolate from]."""


class PadLoads(NamedTuple):
    """Loads of p pads. Views, valid until the next cycle; NaN where too little is heard.

    Attributes
    ----------
    load_n : ndarray, shape (p,), float64
        Newton: sum of the normal forces of the units.
    force_n : ndarray, shape (3, p)
        Newton, skin frame: exerted by the world on the pad; of unloaded units only the normal
        force.
    shear_n : ndarray, shape (3, p)
        Newton, skin frame: the part of `force_n` across the mean normal.
    torsion_nm : ndarray, shape (p,)
        Newton metre: torque about the mean normal through the centre of pressure.
    load_sigma_n, force_sigma_n : ndarray, shape (p,)
        One-sigma of `load_n`, and of a component of `force_n`: noise of the units, and half of the
        estimates for those that are not valid. NaN where sigma is not wanted.
    heard : ndarray, shape (p,)
        Fraction of the load on valid units.
    temperature_c : ndarray, shape (p,)
        Degree Celsius: mean of the valid units, weighted by normal force; NaN where there is none.
    moment_nm : ndarray, shape (3, p)
        Newton metre, skin frame: torque of the world on the pad, about the skin's origin.
    centre_m : ndarray, shape (3, p)
        Metre, skin frame: centre of pressure of the valid units; NaN where nothing presses.
    """

    load_n: np.ndarray
    force_n: np.ndarray
    shear_n: np.ndarray
    torsion_nm: np.ndarray
    load_sigma_n: np.ndarray
    force_sigma_n: np.ndarray
    heard: np.ndarray
    temperature_c: np.ndarray
    moment_nm: np.ndarray
    centre_m: np.ndarray


class Pads:
    """Computes the loads of pads, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches, one a pad; all of them if not given.

    Raises
    ------
    OptionError
        No patch, one that does not exist, or one twice.
    """

    def __init__(self, topology: Topology, names: Iterable[str] | None = None) -> None:
        self.names = check_patches(topology, names)
        pad_of = {topology.patch_names.index(name): pad for pad, name in enumerate(self.names)}
        pad = np.array([pad_of.get(int(patch), -1) for patch in topology.patch], np.int64)
        self._position = np.ascontiguousarray(topology.position, float)
        self._rotation = np.ascontiguousarray(topology.rotation, float)
        count = len(self.names)
        sums = PadSums(
            *(np.zeros(count) for _ in range(7)), *(np.zeros((3, count)) for _ in range(4))
        )
        self._no_sigma = np.full((3, topology.n), np.nan, np.float32)
        self._no_temperature = np.full(topology.n, np.nan, np.float32)
        self.loads = PadLoads(
            load_n=np.zeros(count), force_n=np.zeros((3, count)), shear_n=np.zeros((3, count)),
            torsion_nm=np.zeros(count), load_sigma_n=np.zeros(count),
            force_sigma_n=np.zeros(count), heard=np.zeros(count), temperature_c=np.zeros(count),
            moment_nm=np.zeros((3, count)), centre_m=np.zeros((3, count)),
        )  # fmt: skip
        places = Places(pad, self._position, self._rotation)
        gain = min(1.0, 1.0 / (SHARE_S * topology.cycle_rate_hz))
        share = np.full(topology.n, np.nan)
        self._kept = (places, gain, share, sums, self.loads)
        self._last: Readings | None = None
        self._call: Bound | None = None

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of the units, shapes (3, n) and (3, 3, n), as `Skin.move` does."""
        self._position[:], self._rotation[:] = position, rotation

    def read(self, state: State) -> PadLoads:
        """Loads of the pads in this cycle; `state` has force, and preferably sigma and temperature.

        Raises
        ------
        OptionError
            The state is of another topology, or has no force.
        """
        units = state.units
        sigma, warmth = if_wanted(units, "force_sigma"), if_wanted(units, "temperature")
        sigma = self._no_sigma if sigma is None else sigma
        warmth = self._no_temperature if warmth is None else warmth
        last = self._last
        if (
            last is not None
            and units.force is last.force
            and sigma is last.force_sigma
            and warmth is last.temperature
            and units.valid is last.valid
        ):
            if self._call is None:
                self._call = Bound(pad_loads, last, *self._kept)
            self._call()
        else:  # arrays of a copy, or of the first cycle
            check_state(state, self._no_temperature.size, "force")
            self._last = last = Readings(units.force, sigma, warmth, units.valid)
            self._call = None
            pad_loads(last, *self._kept)
        return self.loads


class Readings(NamedTuple):
    """Of the units, as in `skin.state.Reading`."""

    force: np.ndarray
    force_sigma: np.ndarray
    temperature: np.ndarray
    valid: np.ndarray


class Places(NamedTuple):
    """Pad of each unit, -1 for none, shape (n,); positions (3, n) and rotations (3, 3, n)."""

    pad: np.ndarray
    position: np.ndarray
    rotation: np.ndarray


class PadSums(NamedTuple):
    """Sums over the valid units of each pad, shape (p,), or (3, p) in the skin frame.

    `load` counts normal forces, `pressed` only pressing ones; `heat` is temperature times normal
    force, `heated` that force; `lost` is the fraction of the load on units that are not valid.
    """

    load: np.ndarray
    pressed: np.ndarray
    load_variance: np.ndarray
    variance: np.ndarray
    heat: np.ndarray
    heated: np.ndarray
    lost: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    normal: np.ndarray
    centre: np.ndarray


def pad_loads_python(
    readings: Readings,
    places: Places,
    gain: float,
    share: np.ndarray,
    sums: PadSums,
    out: PadLoads,
) -> None:
    """Sum the loads of each pad's units, with estimates for silent ones."""
    _sum_valid(readings, places, share, out.load_n, sums)
    _add_lost(readings, places.pad, share, sums)
    for pad in range(sums.load.size):
        _finish(sums, pad, out)
    for i in range(share.size):
        pad = places.pad[i]
        if pad >= 0 and _is_heard(readings, i) and out.load_n[pad] > SHARE_LOAD_N:
            now = readings.force[2, i] / out.load_n[pad]
            share[i] = now if np.isnan(share[i]) else share[i] + gain * (now - share[i])


@jitable
def _is_heard(readings, i):
    """Whether a unit reports a finite force."""
    force = readings.force[0, i] + readings.force[1, i] + readings.force[2, i]
    return readings.valid[i] and np.isfinite(force)


@jitable
def _sum_valid(readings, places, share, last_n, sums):
    """Sums over the valid units."""
    for row in (sums.load, sums.pressed, sums.load_variance, sums.variance, sums.heat, sums.heated):
        row[:] = 0.0
    for rows in (sums.force, sums.moment, sums.normal, sums.centre):
        rows[:] = 0.0
    for i in range(places.pad.size):
        pad = places.pad[i]
        if pad < 0 or not _is_heard(readings, i):
            continue
        load = readings.force[2, i]
        pressed = max(load, 0.0)
        sums.load[pad] += load
        sums.pressed[pad] += pressed
        sums.load_variance[pad] += readings.force_sigma[2, i] ** 2
        least = PRESSED * readings.force_sigma[2, i]
        is_pressed = not load < least or share[i] * last_n[pad] > 0.2 * least
        if is_pressed:
            across = readings.force_sigma[0, i] ** 2 + readings.force_sigma[1, i] ** 2
            sums.variance[pad] += 0.5 * across
        if np.isfinite(readings.temperature[i]):
            sums.heat[pad] += pressed * readings.temperature[i]
            sums.heated[pad] += pressed
        fx = readings.force[0, i] if is_pressed else 0.0
        fy, fz = readings.force[1, i] if is_pressed else 0.0, readings.force[2, i]
        turn = places.rotation[:, :, i]
        x = turn[0, 0] * fx + turn[0, 1] * fy + turn[0, 2] * fz
        y = turn[1, 0] * fx + turn[1, 1] * fy + turn[1, 2] * fz
        z = turn[2, 0] * fx + turn[2, 1] * fy + turn[2, 2] * fz
        at_x, at_y, at_z = places.position[0, i], places.position[1, i], places.position[2, i]
        sums.force[0, pad] += x
        sums.force[1, pad] += y
        sums.force[2, pad] += z
        sums.moment[0, pad] += at_y * z - at_z * y
        sums.moment[1, pad] += at_z * x - at_x * z
        sums.moment[2, pad] += at_x * y - at_y * x
        for a in range(3):
            sums.normal[a, pad] += pressed * turn[a, 2]
            sums.centre[a, pad] += pressed * places.position[a, i]


@jitable
def _add_lost(readings, pad_of, share, sums):
    """Fractions of the load on units that are not valid."""
    for pad in range(sums.lost.size):
        total, count = 0.0, 0
        for i in range(share.size):
            if pad_of[i] == pad and not np.isnan(share[i]):
                total += share[i]
                count += 1
        mean = total / count if count else 1.0
        lost, whole = 0.0, 0.0
        for i in range(share.size):
            if pad_of[i] == pad:
                own = mean if np.isnan(share[i]) else share[i]
                whole += own
                lost += 0.0 if _is_heard(readings, i) else own
        sums.lost[pad] = lost / whole if whole > 0.0 else 0.0


@jitable
def _finish(sums, pad, out):
    """Add the estimates of lost units, and split the force into normal and shear."""
    heard = min(max(1.0 - sums.lost[pad], 0.0), 1.0)
    scale = 1.0 / heard if heard >= LEAST_HEARD else np.nan
    force, moment = sums.force[:, pad], sums.moment[:, pad]
    normal, centre = sums.normal[:, pad], sums.centre[:, pad]
    pressed = sums.pressed[pad]
    length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    share = scale / length if length > 0.0 else 0.0
    along = share * (force[0] * normal[0] + force[1] * normal[1] + force[2] * normal[2])
    for a in range(3):
        out.force_n[a, pad] = scale * force[a]
        out.moment_nm[a, pad] = scale * moment[a]
        out.centre_m[a, pad] = centre[a] / pressed if pressed > 0.0 else np.nan
        out.shear_n[a, pad] = out.force_n[a, pad] - (along * normal[a] / length if length else 0.0)
    twist = 0.0
    if length > 0.0:
        cx, cy, cz = centre[0] / pressed, centre[1] / pressed, centre[2] / pressed
        twist += normal[0] * (moment[0] - cy * force[2] + cz * force[1])
        twist += normal[1] * (moment[1] - cz * force[0] + cx * force[2])
        twist += normal[2] * (moment[2] - cx * force[1] + cy * force[0])
    out.torsion_nm[pad] = share * twist
    out.load_n[pad] = scale * sums.load[pad]
    filled = 0.5 * (scale - 1.0)
    size = force[0] ** 2 + force[1] ** 2 + force[2] ** 2
    out.load_sigma_n[pad] = np.sqrt(
        scale**2 * sums.load_variance[pad] + (filled * sums.load[pad]) ** 2
    )
    out.force_sigma_n[pad] = np.sqrt(scale**2 * sums.variance[pad] + filled**2 * size)
    out.heard[pad] = heard
    heated = sums.heated[pad]
    out.temperature_c[pad] = sums.heat[pad] / heated if heated > 0.0 else np.nan


pad_loads = compiled(pad_loads_python, fastmath={"contract"})
