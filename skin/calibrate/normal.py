"""From the frequency's fall to the normal force: the press of a unit on a bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skin.calibrate.hinge import fit_hinge
from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, least_squares

__all__ = ["fit_frequency", "fit_normal"]


def fit_frequency(frequency_hz: np.ndarray, depth_mm: np.ndarray, *, sigma_hz: float = 6.0) -> Fit:
    """Rest frequency and its fall per mm from a scan over depth: f = f0 - slope H.

    Parameters
    ----------
    frequency_hz, depth_mm : ndarray, shape (t,)
    sigma_hz : float

    Raises
    ------
    ScanError
        Too few samples or depths, or a value that is not finite.
    """
    check_samples(2, frequency_hz=frequency_hz, depth_mm=depth_mm)
    check_levels("depth_mm", depth_mm, 2, 0.05)
    matrix = np.stack([np.ones(len(depth_mm)), -np.asarray(depth_mm, float)], axis=1)
    names = ("frequency_rest_hz", "frequency_slope_hz_per_mm")
    return least_squares(matrix, np.asarray(frequency_hz, float), sigma_hz, names)


def fit_normal(
    force_n: np.ndarray,
    fall_hz: np.ndarray,
    *,
    sigma_n: float = 0.005,
    fall_sigma_relative: float = 0.0,
) -> Fit:
    """Normal force against the frequency's fall: soft up to a break, then stiff (Fig. 3e).

    Parameters
    ----------
    force_n : ndarray, shape (t,)
        Of the bench's reference cell.
    fall_hz : ndarray, shape (t,)
        Without noise: the slope of `fit_frequency` times the commanded depth.
    sigma_n : float
    fall_sigma_relative : float
        Of that slope: a common factor of all falls.

    Returns
    -------
    Fit
        ``normal_soft_n_per_hz``, ``normal_break_hz``, ``normal_stiff_n_per_hz``.

    Raises
    ------
    ScanError
        Too few samples, none on one side of the break, or a value that is not finite.
    """
    check_samples(5, force_n=force_n, fall_hz=fall_hz)
    check_levels("fall_hz", fall_hz, 5, 5.0)
    fall = np.asarray(fall_hz, float)
    try:
        fit = fit_hinge(np.asarray(force_n, float), fall, sigma_n)
    except ScanError as error:
        raise ScanError(
            "fall_hz: must reach beyond the break, where the law stiffens, to tell "
            f"normal_break_hz; got {fall.min():.4g} to {fall.max():.4g} Hz ({error})"
        ) from None
    soft, knee, stiffer = fit.values
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    names = ("normal_soft_n_per_hz", "normal_break_hz", "normal_stiff_n_per_hz")
    told = fit.derived(names, np.array([soft, knee, soft + stiffer]), jacobian)
    common = fall_sigma_relative * told.values * [-1.0, 1.0, -1.0]
    return replace(told, covariance=told.covariance + np.outer(common, common))
