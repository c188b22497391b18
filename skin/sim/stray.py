"""A uniform field over all films: what the Earth adds as the skin turns in it."""

from __future__ import annotations

import numpy as np

from skin.physics.halbach import CHIP_AXES
from skin.physics.surroundings import Surroundings
from skin.sim.field import Field
from topology import Topology

__all__ = ["StrayField"]


class StrayField:
    """A `Field` plus the ambient field of the surroundings, whose tools are left out.

    Parameters
    ----------
    topology : Topology
    field : Field
        The films.
    surroundings : Surroundings
        May be changed between calls.
    """

    def __init__(self, topology: Topology, field: Field, surroundings: Surroundings) -> None:
        self._field, self._surroundings = field, surroundings
        # to_chip[a, n, b]: component a of chip n from component b of the skin frame
        to_chip = CHIP_AXES[:, np.newaxis, np.newaxis] * topology.rotation.transpose(1, 2, 0)
        self._to_chip = np.ascontiguousarray(to_chip)

    def __call__(
        self, displacement_mm: np.ndarray, depth_mm: np.ndarray, film_temperature: np.ndarray
    ) -> np.ndarray:
        """Field in µT, shape (..., 3, n); see `Field`."""
        field = self._field(displacement_mm, depth_mm, film_temperature)
        field += self._to_chip @ self._surroundings.in_skin()
        return field
