"""Units that pads are heard by: whether they are others than before, and what those bore."""

from __future__ import annotations

import math

import numpy as np

from skin.behaviours.pads import PadLoads
from skin.state import State
from topology import Topology

__all__ = ["HeardUnits"]


class HeardUnits:
    """Compares the units that are valid with those of the cycle before.

    Parameters
    ----------
    topology : Topology
    names : tuple of str
        Patches, as of the `PadLoads`.
    """

    def __init__(self, topology: Topology, names: tuple[str, ...]) -> None:
        of_patch = [topology.patch_names.index(name) for name in names]
        self._of_pads = np.array([topology.patch == patch for patch in of_patch])
        self._valid = self._kept = b""
        self._was = np.zeros(topology.n, bool)
        self._scale = np.ones(len(names))

    def update(self, state: State, loads: PadLoads, hung_n: np.ndarray) -> float:
        """Look at a cycle in which all pads are heard.

        Parameters
        ----------
        state : State
        loads : PadLoads
        hung_n : ndarray, shape (p,)
            Newton: what hung on each pad before.

        Returns
        -------
        float
            Newton: one-sigma of what is told otherwise because others are heard, as those that
            went may have borne nothing, or twice their share; 0 where they are the same.
        """
        told = state.units.valid.tobytes()
        if told == self._valid:
            return 0.0
        is_first, self._valid = not self._valid, told
        now = np.array(state.units.valid, bool)
        changed = (self._of_pads & (now != self._was)).sum(axis=1)
        count = np.maximum((self._of_pads & now).sum(axis=1), 1)
        scale = 1.0 / np.maximum(loads.heard, 1e-3)
        share = np.maximum(np.abs(scale - self._scale), changed / count)
        self._was, self._scale = now, scale
        return 0.0 if is_first else math.sqrt(float(np.sum((share * hung_n) ** 2)))

    def keep(self) -> None:
        """Remember who is heard now."""
        self._kept = self._valid

    @property
    def as_kept(self) -> bool:
        """Whether the same are heard as then."""
        return self._valid == self._kept
