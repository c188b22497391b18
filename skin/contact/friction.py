"""The friction cone, with torsion: how much of it is in use, and the grip that leaves a margin."""

from __future__ import annotations

import numpy as np

from skin.errors import SkinError

__all__ = ["cone_in_use", "grip_force", "grip_margin", "torsion_arm"]


def torsion_arm(load: np.ndarray, position: np.ndarray, normal: np.ndarray) -> float:
    """Load-weighted mean distance of the units from their centre of pressure.

    A contact that turns about its centre has friction times load in every unit, across the arm of
    that unit: the torsion that it bears is friction x load x this arm, whatever the distribution
    of the load.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, normal.
    position : ndarray, shape (3, n)
        Metre.
    normal : ndarray, shape (3,)
        Of the contact.

    Returns
    -------
    float
        Metre.
    """
    away = position - (position @ load / load.sum())[:, np.newaxis]
    across = away - np.outer(normal, normal @ away)
    return float(load @ np.linalg.norm(across, axis=0) / load.sum())


def cone_in_use(load: float, shear: float, torsion: float, arm: float, friction: float) -> float:
    """Share of the friction cone that is in use; at 1 the contact slides.

    The limit surface is an ellipsoid: ``(shear / friction load)² + (torsion / friction load arm)²
    = 1`` (Howe and Cutkosky 1996).

    Parameters
    ----------
    load, shear : float
        Newton, across and along the contact.
    torsion : float
        N·m about its normal.
    arm : float
        Metre, see `torsion_arm`; 0 for a point, which bears no torsion that anybody sees.
    friction : float
        Coefficient of friction.

    Examples
    --------
    >>> cone_in_use(load=10.0, shear=3.0, torsion=0.04, arm=0.01, friction=0.5)
    1.0
    """
    return _resultant(shear, torsion, arm) / (friction * load)


def grip_margin(load: float, shear: float, torsion: float, arm: float, friction: float) -> float:
    """Share of the friction cone that is left: 1 unloaded, 0 at the brink; see `cone_in_use`."""
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
        Force over the least one that holds.

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
    return safety * _resultant(shear, torsion, arm) / friction


def _resultant(shear: float, torsion: float, arm: float) -> float:
    return float(np.hypot(shear, torsion / arm)) if arm > 0.0 else float(shear)
