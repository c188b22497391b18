"""Changes of the set of units that are heard, and the load of those that changed."""

from __future__ import annotations

import math

import numpy as np

from skin.behaviours.pads import PadLoads
from skin.state import State
from topology import Topology

__all__ = ["HeardUnits"]


class HeardUnits:
    """Compares the valid units with those of the cycle before.

    Parameters
    ----------
    topology : Topology
    names : tuple of str
        Patches, as in `PadLoads`.
    """

    def __init__(self, topology: Topology, names: tuple[str, ...]) -> None:
        of_patch = [topology.patch_names.index(name) for name in names]
        self._of_pads = np.array([topology.patch == patch for patch in of_patch])
        self._valid = self._kept = b""
        self._was = np.zeros(topology.n, bool)
        self._scale = np.ones(len(names))

    def update(self, state: State, loads: PadLoads, hung_n: np.ndarray) -> float:
        """Process a cycle in which all pads are heard.

        Parameters
        ----------
        state : State
        loads : PadLoads
        hung_n : ndarray, shape (p,)
            Newton: load of each pad before.

        Returns
        -------
        float
            Newton: one-sigma of the change due to the new set of units, since the lost ones may
            have borne nothing, or twice their part; 0 where the set is the same.
        """
        valid = state.units.valid.tobytes()
        if valid == self._valid:
            return 0.0
        is_first, self._valid = not self._valid, valid
        now = np.array(state.units.valid, bool)
        changed = (self._of_pads & (now != self._was)).sum(axis=1)
        count = np.maximum((self._of_pads & now).sum(axis=1), 1)
        scale = 1.0 / np.maximum(loads.heard, 1e-3)
        share = np.maximum(np.abs(scale - self._scale), changed / count)
        self._was, self._scale = now, scale
        return 0.0 if is_first else math.sqrt(float(np.sum((share * hung_n) ** 2)))

    def keep(self) -> None:
        """Store the current set."""
        self._kept = self._valid

    @property
    def as_kept(self) -> bool:
        """Whether the set equals the stored one."""
        return self._valid == self._kept
