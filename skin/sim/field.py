"""Field of the magnetic film at its Hall chip, by displacement."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from topology import Topology

__all__ = ["Field", "SineField"]


Field = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Field of the films of n units at their own Hall chips, as `SineField` is called; `HalbachField`
is another."""

NEAR_MM = 1e-9
"""Displacement that counts as 0."""
REACH_SHARE, PULLED_MM, PRESSED_MM = 1.1, 0.5, 3.5
"""Ends of the table of angles: fraction of its range of R, and depths."""
STEPS = 5
"""Newton iterations, from the angle of a small displacement: 1e-12 rad within the range."""


def lever(
    displacement_mm: np.ndarray, depth_mm: np.ndarray, table: np.ndarray, reach_mm: np.ndarray
) -> np.ndarray:
    """R / tan psi in mm, where the table maps psi to R: finite at R = 0.

    Parameters
    ----------
    displacement_mm, depth_mm : ndarray, shape (..., n)
    table : ndarray, shape (16, n)
        `field_angle_mm`; a unit of zeros gets NaN.
    reach_mm : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (..., n)
    """
    displacement = np.minimum(np.maximum(displacement_mm, NEAR_MM), reach_mm)
    h = np.clip(depth_mm, -PULLED_MM, PRESSED_MM)
    a, b, c, d = (np.polyval(table[j : j + 4][::-1], h) for j in range(0, 16, 4))
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = displacement / a
        for _ in range(STEPS):
            z = angle * angle
            found = (((d * z + c) * z + b) * z + a) * angle
            slope = ((7.0 * d * z + 5.0 * c) * z + 3.0 * b) * z + a
            angle = angle - (found - displacement) / slope
        return displacement / np.tan(angle)


class SineField:
    """The paper's law, eq. 1: M_r = M0(T, H) sin(k R) along the displacement.

    M0 grows exponentially as the film nears the chip and falls linearly with its temperature. Bz is
    such that the angle of the field is that of `field_angle_mm`, so that both laws of a unit model
    hold to rounding; a unit without that table has Bz ~ M0 cos(k R).
    """

    def __init__(self, topology: Topology) -> None:
        p = topology.parameters
        self._wavenumber = p["field_wavenumber_rad_per_mm"]
        self._amplitude = p["field_amplitude_ut"]
        self._reference_mm = p["field_reference_mm"]
        self._growth = p["field_growth_per_mm"]
        self._vertical = p["field_vertical_ratio"]
        self._drift = p["film_drift_per_k"]
        self._reference_c = p["film_reference_c"]
        self._angle = p["field_angle_mm"]
        self._tabled = self._angle.any(axis=0)
        self._longest_mm = REACH_SHARE * p["field_angle_max_mm"]

    def __call__(
        self, displacement_mm: np.ndarray, depth_mm: np.ndarray, film_temperature: np.ndarray
    ) -> np.ndarray:
        """Field in µT, unit frame.

        Parameters
        ----------
        displacement_mm : ndarray, shape (..., 2, n)
            Tangential displacement of the film, unit frame.
        depth_mm : ndarray, shape (..., n)
            Pressed depth H.
        film_temperature : ndarray, shape (..., n)
            Degree Celsius.

        Returns
        -------
        ndarray, shape (..., 3, n)
        """
        amplitude = self.amplitude(depth_mm, film_temperature)
        displacement = np.hypot(displacement_mm[..., 0, :], displacement_mm[..., 1, :])
        phase = self._wavenumber * displacement
        *lead, n = np.broadcast_shapes(phase.shape, amplitude.shape)
        field = np.empty((*lead, 3, n))
        lateral = amplitude * self._wavenumber * np.sinc(phase / np.pi)
        np.multiply(lateral[..., np.newaxis, :], displacement_mm, out=field[..., :2, :])
        up = field[..., 2, :]
        up[...] = lateral * lever(displacement, depth_mm, self._angle, self._longest_mm)
        if not self._tabled.all():
            up[...] = np.where(self._tabled, up, self._vertical * amplitude * np.cos(phase))
        return field

    def amplitude(self, depth_mm: np.ndarray, film_temperature: np.ndarray) -> np.ndarray:
        """M0(T, H) in µT, shape (..., n)."""
        growth = np.exp(self._growth * (depth_mm - self._reference_mm))
        drift = 1.0 + self._drift * (film_temperature - self._reference_c)
        return self._amplitude * growth * drift
