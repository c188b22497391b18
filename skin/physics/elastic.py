"""How a unit yields: the elastic laws between displacement and force, and their exact inverses."""

from __future__ import annotations

import numpy as np

from topology import Topology

__all__ = ["Elastic"]


class Elastic:
    """Elastic laws of n units: piecewise linear, continuous, and invertible in closed form.

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
        per_mm = p["frequency_slope_hz_per_mm"]
        self._normal_break_mm = p["normal_break_hz"] / per_mm
        self._normal_soft = p["normal_soft_n_per_hz"] * per_mm
        self._normal_stiff = p["normal_stiff_n_per_hz"] * per_mm
        self._normal_break_n = self._normal_soft * self._normal_break_mm
        self._shear_break_mm = p["shear_break_mm"]
        self._shear_soft = p["shear_soft_n_per_mm"]
        self._shear_stiff = p["shear_soft_n_per_mm"] + p["shear_stiff_n_per_mm"]
        self._shear_break_n = self._shear_soft * self._shear_break_mm
        self._shear_gain = p["shear_gain_per_mm"]
        self._reference_mm = p["field_reference_mm"]

    def normal(self, depth_mm: np.ndarray | float) -> np.ndarray:
        """Normal force in newton at a pressed depth H (Fig. 3d-e), shape (..., n)."""
        beyond = np.maximum(depth_mm - self._normal_break_mm, 0.0)
        within = np.minimum(depth_mm, self._normal_break_mm)
        return self._normal_soft * within + self._normal_stiff * beyond

    def depth(self, normal_n: np.ndarray) -> np.ndarray:
        """Pressed depth in millimetre under a normal force: the inverse of `normal`."""
        beyond = np.maximum(normal_n - self._normal_break_n, 0.0)
        within = np.minimum(normal_n, self._normal_break_n)
        return within / self._normal_soft + beyond / self._normal_stiff

    def tangential(self, displacement_mm: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Tangential force in newton at a displacement R >= 0 and a depth H (eq. 2-3)."""
        beyond = np.maximum(displacement_mm - self._shear_break_mm, 0.0)
        within = np.minimum(displacement_mm, self._shear_break_mm)
        force = self._shear_soft * within + self._shear_stiff * beyond
        return self._stiffening(depth_mm) * force

    def displacement(self, tangential_n: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Tangential displacement R in millimetre under a force: the inverse of `tangential`."""
        force = tangential_n / self._stiffening(depth_mm)
        beyond = np.maximum(force - self._shear_break_n, 0.0)
        within = np.minimum(force, self._shear_break_n)
        return within / self._shear_soft + beyond / self._shear_stiff

    def _stiffening(self, depth_mm: np.ndarray) -> np.ndarray:
        return 1.0 + self._shear_gain * (depth_mm - self._reference_mm)
