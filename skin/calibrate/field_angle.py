"""Tangential displacement from the angle of the field: R = P(psi, H), psi = atan2(M_r, Bz).

P is odd in psi to the seventh and cubic in H (model.md, section 3): 16 coefficients. It is fitted
in Chebyshev polynomials of scaled variables, in which it is well conditioned, and told in powers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, least_squares

__all__ = [
    "ANGLE_NAMES",
    "ANGLE_TERMS",
    "DEPTH_TERMS",
    "FieldAngle",
    "angle_powers",
    "angle_slope",
    "field_angle",
    "fit_field_angle",
]

ANGLE_TERMS, DEPTH_TERMS = 4, 4
"""Powers 1, 3, 5, 7 of the angle; powers 0 to 3 of the depth."""
ANGLE_NAMES = tuple(f"field_angle_mm[{i}]" for i in range(ANGLE_TERMS * DEPTH_TERMS))


@dataclass(frozen=True, eq=False)
class FieldAngle:
    """R(psi, H) of one unit.

    Attributes
    ----------
    coefficients : ndarray, shape (4, 4)
        Millimetre: entry [i, j] is of ``psi**(2 i + 1) * H**j``, rad and mm.
    fit : Fit
        The same, flat, with covariance; residuals in mm.
    angle_max_rad : float
        Largest angle of the scan: beyond it the polynomial extrapolates.
    depth_min_mm, depth_max_mm : float
    least_slope : float
        Smallest dR / dpsi over the samples, to two sigma short of each, mm/rad: positive, so R is
        one to one there.
    """

    coefficients: np.ndarray
    fit: Fit
    angle_max_rad: float
    depth_min_mm: float
    depth_max_mm: float
    least_slope: float

    def __call__(self, angle_rad: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """R in mm, of the shape of the arguments."""
        angle = np.asarray(angle_rad, float)
        square = angle * angle
        total = np.zeros(np.broadcast_shapes(angle.shape, np.shape(depth_mm)))
        for row in self.coefficients[::-1]:
            total = total * square + np.polynomial.polynomial.polyval(depth_mm, row)
        return total * angle

    def sigma_mm(self, angle_rad: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """One-sigma of R from the fit's own covariance, mm: what calibration adds to noise."""
        angle, depth = np.broadcast_arrays(angle_rad, depth_mm)
        row = angle_powers(angle.ravel().astype(float), depth.ravel().astype(float))
        variance = np.einsum("tp,pq,tq->t", row, self.fit.covariance, row)
        return np.sqrt(np.maximum(variance, 0.0)).reshape(angle.shape)


def field_angle(field_ut: np.ndarray, direction_rad: np.ndarray | None = None) -> np.ndarray:
    """Angle psi of the field from the chip's axis.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)
    direction_rad : ndarray, shape (t,), optional
        Known direction of the displacement: the lateral field is taken along it, and its noise has
        no bias. Without it the length of the lateral field is taken, as a decoder must.

    Returns
    -------
    ndarray, shape (t,)
        Radian.
    """
    x, y, z = np.asarray(field_ut, float).T
    if direction_rad is None:
        lateral = np.hypot(x, y)
    else:
        lateral = x * np.cos(direction_rad) + y * np.sin(direction_rad)
    return np.arctan2(lateral, z)


def fit_field_angle(
    field_ut: np.ndarray,
    depth_mm: np.ndarray,
    displacement_mm: np.ndarray,
    direction_rad: np.ndarray | None = None,
    *,
    sigma_ut: float = 105.0,
) -> FieldAngle:
    """Fit R(psi, H) to a scan over depth and displacement.

    The angle carries the noise, so each sample weighs by ``dR/dpsi * sigma_ut / |B|``. Average
    readings of a pose before the fit: noise of an angle is no noise of R, and a share
    ``(sigma_ut / |B|)**2`` of it stays in the coefficients however many samples there are.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)
        Without offsets of the chip and without neighbours' fields.
    depth_mm, displacement_mm : ndarray, shape (t,)
        As commanded.
    direction_rad : ndarray, shape (t,), optional
    sigma_ut : float
        One-sigma of each axis, after averaging.

    Raises
    ------
    ScanError
        Too few samples, depths or displacements, a value that is not finite, or a polynomial that
        is not one to one over the scan.
    """
    given = {"field_ut": field_ut, "depth_mm": depth_mm, "displacement_mm": displacement_mm}
    if direction_rad is not None:
        given["direction_rad"] = direction_rad
    check_samples(len(ANGLE_NAMES), **given)
    check_levels("depth_mm", depth_mm, DEPTH_TERMS, 0.05)
    check_levels("displacement_mm", displacement_mm, ANGLE_TERMS, 0.05)
    field, depth = np.asarray(field_ut, float), np.asarray(depth_mm, float)
    angle = field_angle(field, direction_rad)
    widest, low, high = float(np.abs(angle).max()), float(depth.min()), float(depth.max())
    widest_mm = float(np.abs(displacement_mm).max())
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    matrix = _waves(angle / widest, (depth - middle) / half)
    to_powers = _to_powers(widest, middle, half)
    noise = sigma_ut / np.linalg.norm(field, axis=1)
    typical = widest_mm / widest
    sigma = typical * noise
    # the slope that weighs the samples is that of the fit itself: twice is enough
    for _ in range(3):
        waves = least_squares(matrix, np.asarray(displacement_mm, float), sigma, ANGLE_NAMES)
        fit = waves.derived(ANGLE_NAMES, to_powers @ waves.values, to_powers)
        shape = (ANGLE_TERMS, DEPTH_TERMS)
        coefficients = fit.values.reshape(shape)
        slope = angle_slope(coefficients, angle, depth)
        sigma = np.clip(slope, 0.5 * typical, 2.0 * typical) * noise
    # noise carries single samples beyond the scan, where the polynomial means nothing
    within = np.maximum(np.abs(angle) - 2.0 * noise, 0.0)
    least = float(angle_slope(coefficients, within, depth).min())
    if least <= 0.0:
        raise ScanError(
            "field_ut: must have an angle that grows with displacement over the scan, and noise "
            f"that does not hide it; got a fit with dR/dpsi down to {least:.3g} mm/rad"
        )
    return FieldAngle(coefficients, fit, widest, low, high, least)


def angle_slope(coefficients: np.ndarray, angle: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """dR / dpsi in mm/rad, shape (t,)."""
    power = 2 * np.arange(ANGLE_TERMS)
    even = angle[:, np.newaxis] ** power * (power + 1.0)
    return np.einsum(
        "ti,ij,tj->t", even, coefficients, np.vander(depth, DEPTH_TERMS, increasing=True)
    )


def angle_powers(angle: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """``psi**(2 i + 1) * H**j``, shape (t, 16): R is their product with the coefficients."""
    odd = angle[:, np.newaxis] ** (2 * np.arange(ANGLE_TERMS) + 1)
    return (odd[:, :, np.newaxis] * np.vander(depth, DEPTH_TERMS, increasing=True)[:, np.newaxis]
            ).reshape(len(angle), -1)  # fmt: skip


def _waves(angle: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Chebyshev products of variables within [-1, 1], shape (t, 16)."""
    odd = chebyshev.chebvander(angle, 2 * ANGLE_TERMS - 1)[:, 1::2]
    even = chebyshev.chebvander(depth, DEPTH_TERMS - 1)
    return (odd[:, :, np.newaxis] * even[:, np.newaxis, :]).reshape(len(angle), -1)


def _to_powers(widest: float, middle: float, half: float) -> np.ndarray:
    """The linear map from Chebyshev coefficients to those of powers, shape (16, 16)."""
    of_angle = np.zeros((ANGLE_TERMS, ANGLE_TERMS))
    for term in range(ANGLE_TERMS):
        powers = chebyshev.cheb2poly(np.eye(2 * ANGLE_TERMS)[2 * term + 1])[1::2]
        scaled = powers / widest ** (2 * np.arange(len(powers)) + 1)
        of_angle[: len(powers), term] = scaled
    of_depth = np.zeros((DEPTH_TERMS, DEPTH_TERMS))
    scale = np.polynomial.Polynomial([-middle / half, 1.0 / half])
    for term in range(DEPTH_TERMS):
        powers = np.polynomial.Polynomial(chebyshev.cheb2poly(np.eye(DEPTH_TERMS)[term]))(scale)
        of_depth[: len(powers.coef), term] = powers.coef
    return np.kron(of_angle, of_depth)
