"""What the laws of a unit are off by on its own recording, one sigma of each.

An error that noise makes is each block's own; what goes on from block to block is the law's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.calibrate.spread import even_spread, law_spread
from skin.physics.force_law import force, normal_law, shear_law, slope
from skin.physics.least_squares import Fit, robust_sigma
from topology.gel import gel_temperature

__all__ = [
    "depth_spread",
    "fit_sigma",
    "gel_unknown",
    "misfit_sigma",
    "normal_spread",
    "rms",
    "shear_spread",
]


def rms(values: np.ndarray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def misfit_sigma(fit: Fit, noise: float) -> float:
    """One sigma of a fitted law: how far it is off beyond the noise, and its covariance.

    Over its own samples, the covariance of p parameters amounts to p / t of a residual's variance.
    """
    count = len(fit.values)
    variance = fit.residual_rms**2 * fit.samples / (fit.samples - count)
    misfit = max(variance - noise**2, 0.0)
    return float(np.sqrt(misfit + max(variance, noise**2) * count / fit.samples))


def fit_sigma(error: np.ndarray, law: np.ndarray, parameters: int) -> float:
    """What a fit of so many samples leaves unknown of a law, relative to its size."""
    noise = robust_sigma(np.diff(error)) / np.sqrt(2.0) if error.size > 1 else 0.0
    return float(noise * np.sqrt(parameters / error.size) / max(rms(law), 1e-9))


def gel_unknown(p: dict[str, Any], fit: Fit, current: np.ndarray) -> float:
    """What the covariance of the gel's law leaves of the temperature at either end, °C."""
    ends = np.percentile(current, [2.0, 98.0])

    def told(values: np.ndarray) -> np.ndarray:
        at = {**p, **dict(zip(fit.names, values.tolist(), strict=True))}
        return gel_temperature(at, ends / at["gel_current_20c_ua"])

    steps = np.diag(1e-3 * fit.sigma)
    rows = np.stack([(told(fit.values + step) - told(fit.values - step)) for step in steps])
    rows = rows / (2e-3 * fit.sigma)[:, np.newaxis]
    return float(np.sqrt(np.einsum("ia,ij,ja->a", rows, fit.covariance, rows).max()))


def normal_spread(
    p: dict[str, Any], frequency_hz: np.ndarray, force_n: np.ndarray, unknown: float
) -> dict[str, float]:
    """Of the normal force as a decoder has it, from the frequency.

    Parameters
    ----------
    p : dict of str to float
    frequency_hz, force_n : ndarray, shape (b,)
        Measured.
    unknown : float
        Relative, in addition to the misfit.
    """
    fall = float(p["frequency_rest_hz"]) - frequency_hz
    law, noise_hz = force(fall, normal_law(p)), float(p["frequency_noise_hz"])
    found = law_spread(law - force_n, law, slope(fall, normal_law(p)) * noise_hz)
    return {
        "normal_sigma_relative": float(np.hypot(found.relative, unknown)),
        "normal_sigma_n": found.absolute,
    }


def depth_spread(p: dict[str, Any], frequency_hz: np.ndarray, depth_mm: np.ndarray) -> float:
    """Of the depth, where the face is pressed, mm."""
    slope = float(p["frequency_slope_hz_per_mm"])
    error = (float(p["frequency_rest_hz"]) - frequency_hz) / slope - depth_mm
    return even_spread(error[depth_mm > 0.0], float(p["frequency_noise_hz"]) / slope)


def shear_spread(
    p: dict[str, Any], error: np.ndarray, law: np.ndarray, length_mm: np.ndarray, unknown: float
) -> dict[str, float]:
    """Of the tangential force at a displacement that is known.

    Parameters
    ----------
    p : dict of str to float
    error, law, length_mm : ndarray, shape (b,)
        Newton, newton, displacement.
    unknown : float
        Relative, in addition to the misfit.
    """
    noise_mm = p["field_noise_ut"] / (p["field_amplitude_ut"] * p["field_wavenumber_rad_per_mm"])
    found = law_spread(error, law, slope(length_mm, shear_law(p)) * float(noise_mm))
    return {
        "shear_sigma_relative": float(np.hypot(found.relative, unknown)),
        "shear_sigma_n": found.absolute,
    }
