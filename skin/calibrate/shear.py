"""Tangential force against tangential displacement: soft, then stiffer, and more so with depth."""

from __future__ import annotations

import numpy as np

from skin.calibrate.fit import Fit, check_levels, check_samples, gauss_newton, least_squares
from skin.errors import ScanError

__all__ = ["fit_shear"]

NAMES = ("shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm", "shear_gain_per_mm")


def fit_shear(
    force_n: np.ndarray,
    displacement_mm: np.ndarray,
    depth_mm: np.ndarray,
    *,
    reference_mm: float = 2.0,
    sigma_n: float = 0.005,
    with_depth: bool = True,
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
    with_depth : bool
        False: a scan at a single depth; the gain is left out.

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
    check_samples(
        6 if with_depth else 5, force_n=force_n, displacement_mm=displacement_mm, depth_mm=depth_mm
    )
    check_levels("displacement_mm", displacement_mm, 5, 0.02)
    if with_depth:
        check_levels("depth_mm", depth_mm, 2, 0.1)
    force, reach = np.asarray(force_n, float), np.asarray(displacement_mm, float)
    above = np.asarray(depth_mm, float) - reference_mm

    levels = np.unique(reach)
    best, least = None, np.inf
    # the break lies between the second and the last but one displacement, or it cannot be told
    for knee in np.linspace(levels[1], levels[-2], 60):
        columns = _hinge(reach, knee)
        if with_depth:
            columns = np.hstack([columns, columns * above[:, None]])
        try:
            fit = least_squares(
                columns, force, sigma_n, ("soft", "stiff", "a", "b")[: columns.shape[1]]
            )
        except ScanError:
            continue
        if fit.chi2 < least:
            gain = fit.values[2] / fit.values[0] if with_depth else 0.0
            best, least = np.array([fit.values[0], knee, fit.values[1], gain]), fit.chi2
    if best is None:
        raise ScanError(
            "displacement_mm: must lie on both sides of the break to tell shear_soft_n_per_mm and "
            f"shear_stiff_n_per_mm; got {levels[0]:.3g} to {levels[-1]:.3g} mm"
        )
    used = 4 if with_depth else 3

    def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gain = 1.0 + at[3] * above if with_depth else np.ones_like(reach)
        columns = _hinge(reach, at[1])
        law = columns @ at[[0, 2]]
        rows = [columns[:, 0] * gain, -at[2] * (reach > at[1]) * gain, columns[:, 1] * gain,
                law * above]  # fmt: skip
        return law * gain, np.stack(rows[:used], axis=1)

    found = gauss_newton(model, best[:used], force, sigma_n, NAMES[:used])
    strength = abs(found.values[2]) / found.sigma[2]
    if strength < 3.0:
        raise ScanError(
            "displacement_mm: must reach beyond the break, where the law stiffens, to tell "
            f"shear_break_mm; got a change of slope of {strength:.2g} sigma up to "
            f"{levels[-1]:.3g} mm"
        )
    return found


def _hinge(reach: np.ndarray, knee: float) -> np.ndarray:
    return np.stack([reach, np.maximum(reach - knee, 0.0)], axis=1)
