"""Loads of the pads of a gripper, or of the fingers of a hand, where some units may be silent.

A unit that is not valid may be loaded: it is assumed to bear the fraction of its pad's load of its
last valid cycle, or the mean fraction of the others if it never was valid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from skin.errors import OptionError, as_numbers, shown
from skin.state import State, if_wanted
from topology import Topology

__all__ = ["PadLoads", "Pads", "unit_vector"]

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
    """Loads of p pads in a cycle; NaN where too little is heard.

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
    moment_nm : ndarray, shape (3, p)
        Newton metre, skin frame: torque of the world on the pad, about the skin's origin.
    centre_m : ndarray, shape (3, p)
        Metre, skin frame: centre of pressure of the valid units; NaN where nothing presses.
    sigma_n : ndarray, shape (p,)
        One-sigma of a component of `force_n`: noise of the units, and half of the estimates for
        those that are not valid. NaN where sigma is not wanted.
    """

    load_n: np.ndarray
    force_n: np.ndarray
    shear_n: np.ndarray
    torsion_nm: np.ndarray
    moment_nm: np.ndarray
    centre_m: np.ndarray
    sigma_n: np.ndarray


class Pads:
    """Computes the loads of pads, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches, one a pad; all of them if not given.

    Attributes
    ----------
    names : tuple of str
    normal : ndarray, shape (3,)
        Mean normal of the pads, into the first one; opposing pads count alike.

    Raises
    ------
    OptionError
        No patch, one that does not exist, or one twice.
    """

    def __init__(self, topology: Topology, names: Iterable[str] | None = None) -> None:
        self.names = _patches(topology, names)
        patches = np.array([topology.patch_names.index(name) for name in self.names])
        self._of_pad = (topology.patch == patches[:, np.newaxis]).astype(float)
        self._gain = min(1.0, 1.0 / (SHARE_S * topology.cycle_rate_hz))
        self._share, self._usual_n = np.full(topology.n, np.nan), np.full(topology.n, np.nan)
        self._no_sigma = np.full((3, topology.n), np.nan, np.float32)
        position, rotation = topology.position, topology.rotation
        arms = np.cross(position[:, np.newaxis], rotation, axis=0)
        # Sums over the units of each pad are products with one matrix each.
        wrench = np.concatenate([rotation, arms])[:, np.newaxis] * self._of_pad[:, np.newaxis]
        self._wrench = wrench.reshape(6 * len(self.names), -1)
        rows = np.concatenate([rotation[:, 2], position, np.ones((1, position.shape[1]))])
        self._pressed = (rows[:, np.newaxis] * self._of_pad).reshape(7 * len(self.names), -1)
        total = np.zeros(3)
        for own in self._of_pad:
            normal = rotation[:, 2, own > 0.0].mean(axis=1)
            total = total + normal if total @ normal >= 0.0 else total - normal
        self.normal = total / np.linalg.norm(total)

    def read(self, state: State) -> PadLoads:
        """Loads of the pads in this cycle; `state` has force, and preferably sigma.

        Raises
        ------
        OptionError
            The state is of another topology, or has no force.
        """
        units, n = state.units, self._share.size
        force, sigma = if_wanted(units, "force"), if_wanted(units, "force_sigma")
        if force is None:
            raise OptionError("want: must have 'force' for this behaviour; got states without")
        if units.valid.shape != (n,):
            raise OptionError(
                f"state: must be of the {n} units of the topology; got {units.valid.size} units"
            )
        sigma, force = self._no_sigma if sigma is None else sigma, force.astype(float)
        heard, scale = units.valid & np.isfinite(force.sum(axis=0)), np.ones(len(self.names))
        if not heard.all():
            force, sigma = np.where(heard, force, 0.0), np.where(heard, sigma, 0.0)
            scale = self._scale(heard)
        least_n = PRESSED * sigma[2]
        is_pressed = ~(force[2] < least_n) | (self._usual_n > 0.2 * least_n)
        force[:2] *= is_pressed
        variance = self._of_pad @ (0.5 * is_pressed * (sigma[0] ** 2 + sigma[1] ** 2))
        loads = self._loads(force, variance, scale)
        self._learn(heard, force[2], loads.load_n)
        return loads

    def _scale(self, heard: np.ndarray) -> np.ndarray:
        """Whole load over that on heard units, by pad; NaN where too little is heard."""
        known = np.isfinite(self._share)
        mean = np.array([self._share[known & (own > 0.0)].mean() if (known & (own > 0.0)).any()
                         else 1.0 for own in self._of_pad])  # fmt: skip
        share = np.where(known, self._share, mean @ self._of_pad)
        whole, lost = self._of_pad @ share, self._of_pad @ np.where(heard, 0.0, share)
        part = 1.0 - lost / np.where(whole > 0.0, whole, np.inf)
        return 1.0 / np.where(part >= LEAST_HEARD, np.minimum(part, 1.0), np.nan)

    def _loads(self, force: np.ndarray, variance: np.ndarray, scale: np.ndarray) -> PadLoads:
        """Sum over the units of each pad, add the estimates of lost units, and split the force
        into normal and shear."""
        pads = scale.size
        total, moment = (self._wrench @ force.ravel()).reshape(2, 3, pads)
        presses = (self._pressed @ np.maximum(force[2], 0.0)).reshape(7, pads)
        length = np.sqrt((presses[:3] ** 2).sum(axis=0))
        normal = presses[:3] / np.where(length > 0.0, length, 1.0)
        centre = presses[3:6] / np.where(presses[6] > 0.0, presses[6], np.nan)
        (x, y, z), (u, v, w) = total, np.where(presses[6] > 0.0, centre, 0.0)
        own = moment - (v * z - w * y, w * x - u * z, u * y - v * x)
        along = normal * (total * normal).sum(axis=0)
        filled = 0.5 * (scale - 1.0)
        return PadLoads(
            load_n=scale * (self._of_pad @ force[2]), force_n=scale * total,
            shear_n=scale * (total - along), torsion_nm=scale * (normal * own).sum(axis=0),
            moment_nm=scale * moment, centre_m=centre,
            sigma_n=np.sqrt(scale**2 * variance + filled**2 * (total**2).sum(axis=0)),
        )  # fmt: skip

    def _learn(self, heard: np.ndarray, load: np.ndarray, load_n: np.ndarray) -> None:
        """Follow the fractions of the units, and what they bear by these."""
        of_unit = np.where(np.isfinite(load_n), load_n, 0.0) @ self._of_pad
        learns = heard & (of_unit > SHARE_LOAD_N)
        now = load / np.where(learns, of_unit, 1.0)
        before = np.where(np.isnan(self._share), now, self._share)
        self._share = np.where(learns, before + self._gain * (now - before), self._share)
        self._usual_n = self._share * of_unit


def _patches(topology: Topology, names: Iterable[str] | None) -> tuple[str, ...]:
    """Names of patches without duplicates; all patches of the topology if None."""
    if isinstance(names, str):
        raise OptionError(f"pads: must be a tuple of patches; got {names!r}")
    chosen = tuple(topology.patch_names if names is None else names)
    if not chosen:
        raise OptionError("pads: must be one patch or more; got none")
    for i, name in enumerate(chosen):
        if name not in topology.patch_names:
            raise OptionError.unknown("pads", name, topology.patch_names)
        if name in chosen[:i]:
            raise OptionError(f"pads: must name a patch once; got {name!r} twice")
    return chosen


def unit_vector(where: str, value: Any) -> np.ndarray:
    """A direction of three numbers, normalised.

    Raises
    ------
    OptionError
        It has not three finite numbers, or no length.

    Examples
    --------
    >>> unit_vector("down", (0, 0, -2)).tolist()
    [0.0, 0.0, -1.0]
    """
    vector = as_numbers(where, value)
    length = float(np.linalg.norm(vector))
    if vector.shape == (3,) and math.isfinite(length) and length > 1e-9:
        return vector / length
    raise OptionError(
        f"{where}: must be three numbers (x, y, z), not all of them 0; got {shown(value)}"
    )
