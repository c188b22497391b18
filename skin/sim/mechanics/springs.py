"""Springs of units: yield of a single unit under a force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.physics import force_law
from topology import Topology

__all__ = ["Springs", "under", "yields"]


class Springs(NamedTuple):
    """Yield of n single units.

    Attributes
    ----------
    normal : ndarray, shape (terms, n)
        Laws of the normal force by the depth, as `skin.physics.force_law.at` takes them.
    shear : ndarray, shape (terms, n)
        The same of the tangential force, at the reference depth.
    gain_per_mm, reference_mm : ndarray, shape (n,)
        Relative growth of the tangential stiffness per millimetre of depth about the reference.
    """

    normal: np.ndarray
    shear: np.ndarray
    gain_per_mm: np.ndarray
    reference_mm: np.ndarray

    @classmethod
    def of(cls, topology: Topology) -> Springs:
        """The elastic laws of `skin.physics.elastic.Elastic`."""
        p = topology.parameters
        return cls(
            force_law.stacked(force_law.normal_law_mm(p)),
            force_law.stacked(force_law.shear_law(p)),
            p["shear_gain_per_mm"].copy(),
            p["field_reference_mm"].copy(),
        )


@jitable
def yields(target, law, series):
    """Displacement of a unit, of what it and a compliance in series yield together."""
    return force_law.inverse(target, force_law.in_series(law, series))


def under(
    springs: Springs, force: np.ndarray, depth_mm: np.ndarray, displacement_mm: np.ndarray
) -> None:
    """Displacements of independent units under forces.

    Parameters
    ----------
    springs : Springs
    force : ndarray, shape (3, n)
        Newton, unit frame; a pull, below 0 along z, counts as no load.
    depth_mm : ndarray, shape (n,)
        Written.
    displacement_mm : ndarray, shape (2, n)
        Written.
    """
    depth_mm[:] = force_law.inverse(np.maximum(force[2], 0.0), tuple(springs.normal))
    stiff = force_law.stiffening(depth_mm, springs.gain_per_mm, springs.reference_mm)
    size = np.hypot(force[0], force[1])
    travel = force_law.inverse(size / stiff, tuple(springs.shear))
    displacement_mm[:] = force[:2] * (travel / np.where(size > 0.0, size, 1.0))
