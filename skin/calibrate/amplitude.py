"""What the sine estimator needs of a unit: M0(H) and k."""

from __future__ import annotations

import functools

import numpy as np

from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, gauss_newton, least_squares

__all__ = ["fit_amplitude", "fit_crest"]

WAVENUMBER_RAD_PER_MM = (0.05, 1.5)
"""Where k is looked for; R must stay within one period of the sine [assumed]."""


def fit_amplitude(
    lateral_ut: np.ndarray,
    depth_mm: np.ndarray,
    displacement_mm: np.ndarray,
    *,
    reference_mm: float = 2.0,
    degree: int = 1,
    sigma_ut: float = 105.0,
) -> Fit:
    """k and ln M0(H) of M_r = M0(H) sin(k R), from a scan over depth and displacement.

    With k given, ln M0 is linear in its coefficients: k is found alone (variable projection), and
    all of them are then refined together on the field itself, whose noise is even.

    Parameters
    ----------
    lateral_ut : ndarray, shape (t,)
        Lateral field along the displacement, at the reference temperatures.
    depth_mm, displacement_mm : ndarray, shape (t,)
        As commanded; R up to the crest, where the decoder ends.
    reference_mm : float
        Depth at which the amplitude is given.
    degree : int
        1: ``field_growth_per_mm`` alone; 2: also ``field_growth_per_mm2``.
    sigma_ut : float

    Returns
    -------
    Fit
        ``field_wavenumber_rad_per_mm``, ``field_amplitude_ut``, and the growth.

    Raises
    ------
    ScanError
        Too few samples, depths or displacements, or a value that is not finite.
    """
    if degree not in (1, 2):
        raise ScanError(f"degree: must be 1 or 2; got {degree}")
    check_samples(
        degree + 2, lateral_ut=lateral_ut, depth_mm=depth_mm, displacement_mm=displacement_mm
    )
    check_levels("depth_mm", depth_mm, degree + 1, 0.05)
    lateral, displacement = np.asarray(lateral_ut, float), np.asarray(displacement_mm, float)
    if not (lateral > 5.0 * sigma_ut).any():
        raise ScanError(
            f"lateral_ut: must rise above 5 sigma, {5.0 * sigma_ut:.4g} µT; got "
            f"{lateral.max():.4g} at most"
        )
    moved = displacement[lateral > 5.0 * sigma_ut]
    check_levels("displacement_mm", moved, 3, 0.05)
    above = np.asarray(depth_mm, float) - reference_mm
    powers = np.vander(above, degree + 1, increasing=True)
    names = ("field_wavenumber_rad_per_mm", "ln_amplitude", "field_growth_per_mm",
             "field_growth_per_mm2")[: degree + 2]  # fmt: skip

    def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        amplitude = np.exp(np.clip(powers @ at[1:], -50.0, 50.0))
        sine, cosine = np.sin(at[0] * displacement), np.cos(at[0] * displacement)
        columns = [amplitude * displacement * cosine, *(powers * (amplitude * sine)[:, None]).T]
        return amplitude * sine, np.stack(columns, axis=1)

    start = _project(lateral, displacement, powers, sigma_ut, names[1:])
    fit = gauss_newton(model, start, lateral, sigma_ut, names)
    amplitude = np.exp(fit["ln_amplitude"])
    values, jacobian = fit.values.copy(), np.eye(degree + 2)
    values[1] = jacobian[1, 1] = amplitude
    return fit.derived((names[0], "field_amplitude_ut", *names[2:]), values, jacobian)


def _project(
    lateral: np.ndarray, displacement: np.ndarray, powers: np.ndarray, sigma: float,
    names: tuple[str, ...],
) -> np.ndarray:  # fmt: skip
    """k, and what is best of the rest with it: the start of the fit."""
    strong = (lateral > 5.0 * sigma) & (displacement > 0.0)
    low, high = WAVENUMBER_RAD_PER_MM
    high = min(high, 0.95 * np.pi / displacement[strong].max())
    tried = np.linspace(low, high, 100)
    fits = [
        least_squares(
            powers[strong], np.log(lateral[strong] / np.sin(k * displacement[strong])),
            sigma / lateral[strong], names,
        )
        for k in tried
    ]  # fmt: skip
    best = min(range(len(fits)), key=lambda i: fits[i].chi2)
    return np.concatenate([[tried[best]], fits[best].values])


def fit_crest(
    lateral: np.ndarray, depth: np.ndarray, displacement: np.ndarray, reference_mm: float,
    sigma_ut: float,
) -> Fit:  # fmt: skip
    """M0(H) and k, of what lies before the crest.

    Parameters
    ----------
    lateral, depth, displacement : ndarray, shape (t,)
        As of `fit_amplitude`.
    reference_mm, sigma_ut : float
    """
    fit = functools.partial(fit_amplitude, reference_mm=reference_mm, sigma_ut=sigma_ut)
    first = fit(lateral, depth, displacement)
    before = displacement <= 0.5 * np.pi / first["field_wavenumber_rad_per_mm"]
    return fit(lateral[before], depth[before], displacement[before], degree=2)
