"""The friction cone, with torsion: its use, and the grip that leaves a margin."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.errors import SkinError

__all__ = ["cone_in_use", "grip_force", "grip_margin", "tangential_demand"]


@jitable
def tangential_demand(shear, torsion, arm):
    """Friction force that holds shear and torsion together, newton; also called by kernels.

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


def cone_in_use(load: float, shear: float, torsion: float, arm: float, friction: float) -> float:
    """Used fraction of the friction cone; at 1 the contact slides.

    The limit surface is an ellipsoid: ``(shear / friction load)² + (torsion / friction load arm)²
    = 1`` (Howe and Cutkosky 1996).

    Parameters
    ----------
    load, shear : float
        Newton, across and along the contact.
    torsion : float
        N·m about its normal.
    arm : float
        Metre, as in `tangential_demand`.
    friction : float
        Coefficient of friction.

    Examples
    --------
    >>> cone_in_use(load=10.0, shear=3.0, torsion=0.04, arm=0.01, friction=0.5)
    1.0
    """
    return float(tangential_demand(shear, torsion, arm)) / (friction * load)


def grip_margin(load: float, shear: float, torsion: float, arm: float, friction: float) -> float:
    """Free fraction of the friction cone: 1 unloaded, 0 at the limit; see `cone_in_use`."""
    return 1.0 - cone_in_use(load, shear, torsion, arm, friction)


def grip_force(
    shear: float, torsion: float, arm: float, friction: float, safety: float = 1.2
) -> float:
    """Normal force that holds shear and torsion with a margin.

    Parameters
    ----------
    shear, torsion, arm, friction : float
        As in `cone_in_use`.
    safety : float
        Force over the smallest one that holds.

    Returns
    -------
    float
        Newton.

    Examples
    --------
    >>> grip_force(shear=3.0, torsion=0.04, arm=0.01, friction=0.5, safety=1.2)
    12.0
    """
    if not friction > 0.0:
        raise SkinError(f"friction: must be a positive number; got {friction}")
    return safety * float(tangential_demand(shear, torsion, arm)) / friction
