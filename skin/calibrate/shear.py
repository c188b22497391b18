"""Tangential force against tangential displacement: soft, then stiffer, and more so with depth."""

from __future__ import annotations

import numpy as np

from skin.calibrate.hinge import fit_hinge
from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples

__all__ = ["fit_shear"]

NAMES = ("shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm", "shear_gain_per_mm")


def fit_shear(
    force_n: np.ndarray,
    displacement_mm: np.ndarray,
    depth_mm: np.ndarray,
    *,
    reference_mm: float = 2.0,
    sigma_n: float = 0.005,
) -> Fit:
    """Fit ``Ft = (soft R + stiff max(R - break, 0)) (1 + gain (H - reference))``.

    Parameters
    ----------
    force_n : ndarray, shape (t,)
        Tangential force of the bench's reference cell, along the displacement.
    displacement_mm, depth_mm : ndarray, shape (t,)
        As commanded.
    reference_mm : float
        Depth at which the gain is 1: `field_reference_mm`.
    sigma_n : float

    Returns
    -------
    Fit
        Parameters of `UnitModel`.

    Raises
    ------
    ScanError
        Too few samples or depths, no samples on one side of the break, or a value that is not
        finite.
    """
    check_samples(6, force_n=force_n, displacement_mm=displacement_mm, depth_mm=depth_mm)
    check_levels("displacement_mm", displacement_mm, 5, 0.02)
    check_levels("depth_mm", depth_mm, 2, 0.1)
    above = np.asarray(depth_mm, float) - reference_mm
    way = np.asarray(displacement_mm, float)
    try:
        fit = fit_hinge(np.asarray(force_n, float), way, sigma_n, above)
    except ScanError as error:
        raise ScanError(
            "displacement_mm: must reach beyond the break, where the law stiffens, to tell "
            f"shear_break_mm; got {way.min():.3g} to {way.max():.3g} mm ({error})"
        ) from None
    return fit.derived(NAMES, fit.values, np.eye(len(NAMES)))
