"""Magnetic surroundings of a skin: the Earth's field as the hand turns, and tools of steel."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

__all__ = ["Surroundings", "Tool", "dipole_field_ut"]

EARTH_UT = (20.0, 0.0, -44.0)
"""North and up, in central Europe."""

UT_MM3_PER_AM2 = 1e8
"""mu0 / 4 pi = 1e-7 T m / A, in µT mm³ per A m²."""


@dataclass(frozen=True)
class Tool:
    """A small body of iron: a permeable sphere in a field that is even over its width.

    It answers the field that it is in with the dipole ``4 pi a³/mu0 (mu_r - 1)/(mu_r + 2) B``
    (exact for a sphere in a uniform field), and adds its own remanent one. The films themselves do
    not feel it.

    Attributes
    ----------
    position : tuple of 3 floats
        Metre, skin frame.
    radius_m : float
    permeability : float
        Relative, mu_r.
    remanent_am2 : tuple of 3 floats
        Moment that it keeps without any field, A m², skin frame.
    """

    position: tuple[float, float, float]
    radius_m: float = 0.005
    permeability: float = 1000.0
    remanent_am2: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def moment(self, field_ut: np.ndarray) -> np.ndarray:
        """Dipole moment, µT mm³ (times mu0/4 pi), in a field of shape (..., 3)."""
        answer = (1e3 * self.radius_m) ** 3 * (self.permeability - 1.0) / (self.permeability + 2.0)
        return answer * field_ut + UT_MM3_PER_AM2 * np.array(self.remanent_am2)


@dataclass
class Surroundings:
    """What a skin feels of the world; may change from call to call.

    Attributes
    ----------
    ambient_ut : ndarray, shape (3,)
        Uniform field, µT, world frame.
    attitude : ndarray, shape (3, 3)
        Columns are the axes of the skin in the world (R_world_skin).
    tools : tuple of Tool
        They feel the ambient field and the films, not each other.
    """

    ambient_ut: np.ndarray = field(default_factory=lambda: np.array(EARTH_UT))
    attitude: np.ndarray = field(default_factory=lambda: np.eye(3))
    tools: tuple[Tool, ...] = ()

    def in_skin(self) -> np.ndarray:
        """Ambient field in the skin frame, µT, shape (3,)."""
        return np.asarray(self.attitude).T @ self.ambient_ut


def dipole_field_ut(moment: np.ndarray, offset_mm: np.ndarray) -> np.ndarray:
    """Field of a dipole at n points, µT, shape (..., 3, n).

    Parameters
    ----------
    moment : ndarray, shape (..., 3)
        µT mm³: the moment times mu0 / 4 pi.
    offset_mm : ndarray, shape (3, n)
        From the dipole to the points.
    """
    distance = np.sqrt(np.sum(offset_mm**2, axis=0))
    along = offset_mm / distance
    lengthwise = along * (moment @ along)[..., np.newaxis, :]
    return (3.0 * lengthwise - moment[..., np.newaxis]) / distance**3
