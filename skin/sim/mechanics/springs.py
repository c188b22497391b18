"""Springs with a knee: how a unit yields by itself under a force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.physics import force_law
from topology import Topology

__all__ = ["Springs", "displacement", "force", "under"]


class Springs(NamedTuple):
    """How n units yield by themselves: compliance below a knee, beyond it, and the knee.

    Attributes
    ----------
    normal : ndarray, shape (3, n)
        mm/N below the knee, mm/N beyond it, knee in newton.
    shear : ndarray, shape (3, n)
        The same for the tangential force, at the reference depth.
    gain_per_mm, reference_mm : ndarray, shape (n,)
        Relative growth of the tangential stiffness per millimetre of depth about the reference.
    """

    normal: np.ndarray
    shear: np.ndarray
    gain_per_mm: np.ndarray
    reference_mm: np.ndarray

    @classmethod
    def of(cls, topology: Topology) -> Springs:
        """The elastic laws of `skin.physics.elastic.Elastic`, seen from the force."""
        p = topology.parameters
        per_mm = p["frequency_slope_hz_per_mm"]
        soft, stiff = (p[f"normal_{part}_n_per_hz"] * per_mm for part in ("soft", "stiff"))
        shear_soft = p["shear_soft_n_per_mm"]
        shear_stiff = shear_soft + p["shear_stiff_n_per_mm"]
        return cls(
            np.array([1.0 / soft, 1.0 / stiff, soft * p["normal_break_hz"] / per_mm]),
            np.array([1.0 / shear_soft, 1.0 / shear_stiff, shear_soft * p["shear_break_mm"]]),
            p["shear_gain_per_mm"].copy(),
            p["field_reference_mm"].copy(),
        )


@jitable
def force(target, below, beyond, knee):
    """Force under which two compliances, one below the knee and one beyond, yield by `target`."""
    return force_law.inverse(target, below, knee, beyond)


@jitable
def displacement(force, below, beyond, knee):
    """The inverse of `force`."""
    return force_law.force(force, below, knee, beyond)


def under_python(springs, force, depth_mm, displacement_mm):
    """How far units are displaced under forces that no other unit shares.

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
        depth = displacement(z, normal[0, i], normal[1, i], normal[2, i])
        size = np.sqrt(x * x + y * y)
        share = 0.0
        if size > 0.0:
            stiff = force_law.stiffening(depth, gain[i], reference[i])
            way = displacement(size, shear[0, i] / stiff, shear[1, i] / stiff, shear[2, i] * stiff)
            share = way / size
        depth_mm[i] = depth
        displacement_mm[0, i], displacement_mm[1, i] = share * x, share * y


under = compiled(under_python, fastmath=("contract", "reassoc"))
