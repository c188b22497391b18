"""Springs of units: yield of a single unit under a force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
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


def under_python(springs, force, depth_mm, displacement_mm):
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
    normal, shear, gain, reference = springs
    for i in range(depth_mm.size):
        x, y, z = force[0, i], force[1, i], max(force[2, i], 0.0)
        depth = force_law.inverse(z, force_law.at(normal, i))
        size = np.sqrt(x * x + y * y)
        share = 0.0
        if size > 0.0:
            stiff = force_law.stiffening(depth, gain[i], reference[i])
            travel = force_law.inverse(size / stiff, force_law.at(shear, i))
            share = travel / size
        depth_mm[i] = depth
        displacement_mm[0, i], displacement_mm[1, i] = share * x, share * y


under = compiled(under_python, fastmath=("contract", "reassoc"))
