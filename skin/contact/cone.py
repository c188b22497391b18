"""The friction cone, with torsion."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable

__all__ = ["tangential_demand"]


@jitable
def tangential_demand(shear, torsion, arm):
    """Friction force that holds shear and torsion together, newton.

    The limit surface is an ellipsoid: ``(shear / friction load)² + (torsion / friction load arm)²
    = 1`` (Howe and Cutkosky 1996).

    Parameters
    ----------
    shear : float
        Newton, along the contact.
    torsion : float
        N·m about its normal.
    arm : float
        Metre; load-weighted mean distance from the centre of pressure. 0 for a point, which bears
        no measurable torsion.

    Returns
    -------
    float
    """
    square = shear**2
    if arm > 0.0:
        square += (torsion / arm) ** 2
    return np.sqrt(square)
