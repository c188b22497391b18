"""How a unit yields: the elastic laws between displacement and force, and their exact inverses."""

from __future__ import annotations

import numpy as np

from skin.physics.force_law import force, inverse, normal_law_mm, shear_law, stiffening
from topology import Topology

__all__ = ["Elastic"]


class Elastic:
    """Elastic laws of n units (`skin.physics.force_law`), and their inverses.

    Every argument may have leading axes; the unit axis is last.

    Parameters
    ----------
    topology : Topology
        Its `parameters` are the constants of the laws.

    Examples
    --------
    >>> from topology import load
    >>> elastic = Elastic(load("palm"))
    >>> round(float(elastic.normal(2.0)[0]), 9), round(float(elastic.tangential(2.0, 2.0)[0]), 9)
    (7.2, 1.0)
    """

    def __init__(self, topology: Topology) -> None:
        p = topology.parameters
        self._normal, self._shear = normal_law_mm(p), shear_law(p)
        self._deeper = p["shear_gain_per_mm"], p["field_reference_mm"]

    def normal(self, depth_mm: np.ndarray | float) -> np.ndarray:
        """Normal force in newton at a pressed depth H (Fig. 3d-e), shape (..., n)."""
        return force(depth_mm, self._normal)

    def depth(self, normal_n: np.ndarray) -> np.ndarray:
        """Pressed depth in millimetre under a normal force: the inverse of `normal`."""
        return inverse(normal_n, self._normal)

    def tangential(self, displacement_mm: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Tangential force in newton at a displacement R >= 0 and a depth H (eq. 2-3)."""
        return stiffening(depth_mm, *self._deeper) * force(displacement_mm, self._shear)

    def displacement(self, tangential_n: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Tangential displacement R in millimetre under a force: the inverse of `tangential`."""
        return inverse(tangential_n / stiffening(depth_mm, *self._deeper), self._shear)
