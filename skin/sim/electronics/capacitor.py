"""The floating capacitor of a unit and the NE555 that turns it into a frequency."""

from __future__ import annotations

import math

import numpy as np

from topology import Topology

__all__ = ["PERMITTIVITY", "Timer", "picofarad"]

COULOMB_CONSTANT = 8.9875517862e9
"""k of Coulomb's law, N·m²/C²."""

TIMER_CONSTANT = 1.44
"""f = 1.44 / ((R1 + 2 R2) C) of the astable NE555."""


RADII_MM = (2.25, 3.0, 3.75)
"""The facing plates S1, S2, S3 of the three gaps: the smaller disc of each pair of the 4.5, 6, 7.5
and 9 mm discs."""

GAP_MM = 1.0
"""Distance of the discs at rest."""

PERMITTIVITY = 150.0
"""Relative permittivity of the ionic elastomer between them [assumed]. Not given in the paper; only
its product with the timer's resistors matters, and those follow from the rest frequency."""


def picofarad(compression: np.ndarray | float = 0.0) -> np.ndarray | float:
    """Capacitance in pF of four soft discs in a stack, two of each polarity, with every gap
    narrowed by the fraction `compression` (supplement S4, Fig. S3).

    C = eps_r (3 S1 + 2 S2 + 2 S3) / (8 pi k d).

    Examples
    --------
    >>> round(picofarad() / PERMITTIVITY, 3)
    0.853
    """
    s1, s2, s3 = (math.pi * (1e-3 * r) ** 2 for r in RADII_MM)
    gap = 1e-3 * GAP_MM * (1.0 - compression)
    area = 3.0 * s1 + 2.0 * s2 + 2.0 * s3
    return PERMITTIVITY * area / (8.0 * math.pi * COULOMB_CONSTANT * gap) * 1e12


class Timer:
    """Pressed depth to frequency for n units.

    The height of the layer with the discs follows from `frequency_slope_hz_per_mm`, and the
    resistors from `frequency_rest_hz`.

    Parameters
    ----------
    topology : Topology
    """

    SQUEEZED = 0.999
    """Compression at which the discs touch: beyond it the frequency stays at its lowest."""

    def __init__(self, topology: Topology) -> None:
        rest_hz = topology.parameters["frequency_rest_hz"]
        self.layer_mm = rest_hz / topology.parameters["frequency_slope_hz_per_mm"]
        self.resistance_ohm = TIMER_CONSTANT / (rest_hz * picofarad() * 1e-12)

    def frequency(self, depth_mm: np.ndarray) -> np.ndarray:
        """Frequency in Hz at a pressed depth H, shape (..., n)."""
        compression = np.minimum(depth_mm / self.layer_mm, self.SQUEEZED)
        return TIMER_CONSTANT / (self.resistance_ohm * picofarad(compression) * 1e-12)
