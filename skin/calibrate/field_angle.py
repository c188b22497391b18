"""Tangential displacement from the angle of the field: R = P(psi, H), psi = atan2(M_r, Bz).

P is odd in psi to the seventh power and cubic in H (model.md, section 3): 16 coefficients,
``field_angle_mm`` of a unit. Entry [i, j] belongs to ``psi**(2 i + 1) * H**j``, in rad and mm.
"""

from __future__ import annotations

import numpy as np

__all__ = ["ANGLE_NAMES", "angle_powers", "angle_slope", "field_angle"]

ANGLE_TERMS, DEPTH_TERMS = 4, 4
"""Powers 1, 3, 5, 7 of the angle; powers 0 to 3 of the depth [paper]."""
ANGLE_NAMES = tuple(f"field_angle_mm[{i}]" for i in range(ANGLE_TERMS * DEPTH_TERMS))


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
