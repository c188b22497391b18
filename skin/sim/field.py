"""The magnetic film as its Hall chip sees it: displacement to field."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from topology import Topology

__all__ = ["Field", "SineField"]


class Field(Protocol):
    """Field of the films of n units at their own Hall chips."""

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
        ...


class SineField:
    """The paper's law, eq. 1: M_r = M0(T, H) sin(k R) along the displacement, Bz ~ M0 cos(k R).

    M0 grows exponentially as the film nears the chip and falls linearly with its temperature.
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

    def __call__(
        self, displacement_mm: np.ndarray, depth_mm: np.ndarray, film_temperature: np.ndarray
    ) -> np.ndarray:
        """Field in µT, shape (..., 3, n); see `Field`."""
        amplitude = self.amplitude(depth_mm, film_temperature)
        displacement = np.hypot(displacement_mm[..., 0, :], displacement_mm[..., 1, :])
        phase = self._wavenumber * displacement
        *lead, n = np.broadcast_shapes(phase.shape, amplitude.shape)
        field = np.empty((*lead, 3, n))
        # where the displacement is 0, so is the sine, and any divisor will do
        lateral = amplitude * np.sin(phase) / np.maximum(displacement, 1e-300)
        np.multiply(lateral[..., np.newaxis, :], displacement_mm, out=field[..., :2, :])
        np.multiply(self._vertical * amplitude, np.cos(phase), out=field[..., 2, :])
        return field

    def amplitude(self, depth_mm: np.ndarray, film_temperature: np.ndarray) -> np.ndarray:
        """M0(T, H) in µT, shape (..., n)."""
        growth = np.exp(self._growth * (depth_mm - self._reference_mm))
        drift = 1.0 + self._drift * (film_temperature - self._reference_c)
        return self._amplitude * growth * drift
