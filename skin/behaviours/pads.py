"""Loads of the pads of a gripper, or of the fingers of a hand, where some units may be silent.

A unit that is not valid may be loaded: it is assumed to bear the fraction of its pad's load of its
last valid cycle, or the mean fraction of the others if it never was valid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from skin.errors import OptionError, shown
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
        self._position = np.array(topology.position, float)
        self._rotation = np.array(topology.rotation, float)
        normals = [self._rotation[:, 2, own > 0.0].mean(axis=1) for own in self._of_pad]
        total = np.zeros(3)
        for one in normals:
            total = total + one if total @ one >= 0.0 else total - one
        self.normal = total / np.linalg.norm(total)
        self._gain = min(1.0, 1.0 / (SHARE_S * topology.cycle_rate_hz))
        self._share = np.full(topology.n, np.nan)
        self._load_n = np.zeros(len(self.names))
        self._no_sigma = np.full((3, topology.n), np.nan, np.float32)

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of the units, shapes (3, n) and (3, 3, n), as `Skin.move` does."""
        self._position[:], self._rotation[:] = position, rotation

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
        heard = units.valid & np.isfinite(force).all(axis=0)
        scale = self._heard_part(heard)
        force = np.where(heard, force, 0.0).astype(float)
        load, sigma = force[2], self._no_sigma if sigma is None else sigma
        least = PRESSED * sigma[2]
        usual = self._share * (self._load_n @ self._of_pad)
        is_pressed = ~(load < least) | (usual > 0.2 * least)
        force[:2] *= is_pressed
        variance = np.where(heard & is_pressed, 0.5 * (sigma[:2] ** 2).sum(axis=0), 0.0)
        loads = self._loads(force, self._of_pad @ variance, scale)
        self._learn(heard, load, loads.load_n)
        return loads

    def _heard_part(self, heard: np.ndarray) -> np.ndarray:
        """Whole load over that on heard units, by pad; NaN where too little is heard."""
        known = np.where(np.isnan(self._share), 0.0, 1.0)
        counts, shares = self._of_pad @ known, self._of_pad @ np.nan_to_num(self._share)
        mean = np.where(counts > 0.0, shares / np.maximum(counts, 1.0), 1.0)
        share = np.where(known > 0.0, self._share, mean @ self._of_pad)
        whole = self._of_pad @ share
        lost = np.where(whole > 0.0, self._of_pad @ np.where(heard, 0.0, share), 0.0)
        part = np.clip(1.0 - lost / np.where(whole > 0.0, whole, 1.0), 0.0, 1.0)
        return np.where(part >= LEAST_HEARD, 1.0 / np.maximum(part, LEAST_HEARD), np.nan)

    def _loads(self, force: np.ndarray, variance: np.ndarray, scale: np.ndarray) -> PadLoads:
        """Sum over the units of each pad, add the estimates of lost units, and split the force
        into normal and shear."""
        pressed, place = np.maximum(force[2], 0.0), self._position
        world = np.einsum("ijn,jn->in", self._rotation, force)
        rows = [world, np.cross(place, world, axis=0), pressed * self._rotation[:, 2],
                pressed * place]  # fmt: skip
        total, moment, normal, centre = np.stack(rows) @ self._of_pad.T
        length = np.sqrt((normal**2).sum(axis=0))
        normal = normal / np.where(length > 0.0, length, 1.0)
        presses = self._of_pad @ pressed
        centre = centre / np.where(presses > 0.0, presses, np.nan)
        along = normal * (total * normal).sum(axis=0)
        own = moment - np.cross(np.nan_to_num(centre), total, axis=0)
        filled = 0.5 * (scale - 1.0)
        return PadLoads(
            load_n=scale * (self._of_pad @ force[2]), force_n=scale * total,
            shear_n=scale * (total - along), torsion_nm=scale * (normal * own).sum(axis=0),
            moment_nm=scale * moment, centre_m=centre,
            sigma_n=np.sqrt(scale**2 * variance + filled**2 * (total**2).sum(axis=0)),
        )  # fmt: skip

    def _learn(self, heard: np.ndarray, load: np.ndarray, load_n: np.ndarray) -> None:
        """Follow the fractions of the units."""
        self._load_n = np.nan_to_num(load_n)
        of_unit = self._load_n @ self._of_pad
        learns = heard & (of_unit > SHARE_LOAD_N)
        now = load / np.where(learns, of_unit, 1.0)
        before = np.where(np.isnan(self._share), now, self._share)
        self._share = np.where(learns, before + self._gain * (now - before), self._share)


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
    try:
        vector = np.array(value, float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    length = float(np.linalg.norm(vector))
    if vector.shape == (3,) and math.isfinite(length) and length > 1e-9:
        return vector / length
    raise OptionError(
        f"{where}: must be three numbers (x, y, z), not all of them 0; got {shown(value)}"
    )
