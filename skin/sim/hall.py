"""The Hall chip: from the field of the film to the reported field."""

from __future__ import annotations

import numpy as np

from skin.physics.rest import inverse_map
from topology import THETA_KNOTS, Topology

__all__ = ["HallChip"]


class HallChip:
    """Assembly errors and temperature drift of the chip, as in the calibration of each unit.

    A calibration corrects the distortion of a unit; here it is applied: the direction is rotated
    back along the correction table, the lateral field passes the inverse of the 2x2 map, and gain
    and offset drift with the chip's temperature.

    Parameters
    ----------
    topology : Topology
    """

    def __init__(self, topology: Topology) -> None:
        p = topology.parameters
        self._gain_drift = p["hall_gain_per_k"]
        self._reference_c = p["hall_reference_c"]
        self._offset = np.stack([p[f"hall_offset_{axis}_ut"] for axis in "xyz"])
        self._offset_drift = np.stack([p[f"hall_drift_{axis}_ut_per_k"] for axis in "xyz"])
        self._map = _inverse_map(topology)
        self._turned = _turned_directions(topology)

    def __call__(self, field_ut: np.ndarray, hall_temperature: np.ndarray) -> np.ndarray:
        """Reported field.

        Parameters
        ----------
        field_ut : ndarray, shape (..., 3, n)
            Field of the film, µT, unit frame. Overwritten.
        hall_temperature : ndarray, shape (..., n)
            Degree Celsius.

        Returns
        -------
        ndarray, shape (..., 3, n)
            Microtesla.
        """
        if self._turned is not None:
            _turn(field_ut, self._turned)
        if self._map is not None:
            x, y = field_ut[..., 0, :].copy(), field_ut[..., 1, :].copy()
            (xx, xy), (yx, yy) = self._map
            field_ut[..., 0, :] = xx * x + xy * y
            field_ut[..., 1, :] = yx * x + yy * y
        warmer = (hall_temperature - self._reference_c)[..., np.newaxis, :]
        field_ut *= 1.0 + self._gain_drift * warmer
        field_ut += self._offset + self._offset_drift * warmer
        return field_ut


def _turn(field_ut: np.ndarray, corrected: np.ndarray) -> None:
    """Rotate the lateral field to the direction that the correction table maps back."""
    x, y = field_ut[..., 0, :], field_ut[..., 1, :]
    wanted = np.arctan2(y, x)
    wanted = corrected[0] + (wanted - corrected[0]) % (2.0 * np.pi)
    segment = np.sum(wanted[..., np.newaxis, :] >= corrected, axis=-2) - 1
    segment = np.clip(segment, 0, THETA_KNOTS - 1)
    unit = np.arange(corrected.shape[1])
    start, end = corrected[segment, unit], corrected[segment + 1, unit]
    share = (wanted - start) / (end - start)
    direction = -np.pi + (segment + share) * (2.0 * np.pi / THETA_KNOTS)
    strength = np.hypot(x, y)
    field_ut[..., 0, :] = strength * np.cos(direction)
    field_ut[..., 1, :] = strength * np.sin(direction)


def _inverse_map(topology: Topology) -> np.ndarray | None:
    """Inverse of the 2x2 map, shape (2, 2, n); None where every map is the identity."""
    inverse = inverse_map(topology)
    return None if np.all(inverse == np.eye(2)[..., np.newaxis]) else inverse


def _turned_directions(topology: Topology) -> np.ndarray | None:
    """Corrected direction at every knot and once round, rising, shape (THETA_KNOTS + 1, n), or
    None."""
    correction = topology.parameters["theta_correction_rad"]
    if not np.any(correction):
        return None
    knots = -np.pi + np.arange(THETA_KNOTS + 1) * (2.0 * np.pi / THETA_KNOTS)
    return knots[:, np.newaxis] + np.vstack([correction, correction[:1]])
