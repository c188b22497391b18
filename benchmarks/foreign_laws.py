"""Laws of gel, capacitor and force that are not the decoder's: what a simulated bench then meets.

Each is scaled to the unit's own constants where the decoder's law is (20 and 80 °C, rest, 2 mm), so
that only its form differs.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.special import gamma

from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

GEL, FREQUENCY = CHANNELS.index("gel"), CHANNELS.index("frequency")
KELVIN = 273.15
VOGEL_K = 193.0
"""T0 of Vogel, Fulcher and Tammann: about 50 K below the glass transition of an ionic gel
[assumed]."""
PARASITIC = 0.1
"""Of the capacitance at rest, parallel to it [assumed: the fall is still near linear]."""
YEOH = (1.0, 0.25, 0.05)
"""C1, C2, C3 of Yeoh's energy of a filled silicone, over C1 [assumed]."""
INDENTER_MM, LAYER_MM = 6.0, 5.0
"""Radius of what presses, and height of the elastomer [paper]."""
TABLE_MM = np.linspace(0.0, 4.0, 161)
STRETCH = 0.6
"""Exponent of a stretched exponential, Kohlrausch [assumed]."""


def vogel(temperature: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Current of a gel over that at 20 °C, of the given ratio at 80 °C: exp(-B / (T - T0))."""
    at = 1.0 / (np.asarray(temperature) + KELVIN - VOGEL_K)
    cold, hot = (1.0 / (t + KELVIN - VOGEL_K) for t in (20.0, 80.0))
    return np.exp(np.log(ratio) * (cold - at) / (cold - hot))


def loaded(rest_hz: np.ndarray, compression: np.ndarray) -> np.ndarray:
    """Frequency of the timer with a parasitic capacitance, Hz."""
    left = 1.0 - compression
    return rest_hz * (1.0 + PARASITIC) * left / (1.0 + PARASITIC * left)


def yeoh_uniaxial(stretch: np.ndarray) -> np.ndarray:
    """Nominal stress of an incompressible solid of Yeoh, compression positive, over C1."""
    above = stretch**2 + 2.0 / stretch - 3.0
    c1, c2, c3 = YEOH
    slope = c1 + 2.0 * c2 * above + 3.0 * c3 * above**2
    return 2.0 * slope * (stretch**-2.0 - stretch)


def yeoh_shear(strain: np.ndarray) -> np.ndarray:
    """Shear stress of the same in simple shear, over C1; I1 - 3 is the square of the strain."""
    c1, c2, c3 = YEOH
    return 2.0 * strain * (c1 + 2.0 * c2 * strain**2 + 3.0 * c3 * strain**4)


def indentation(depth_mm: np.ndarray) -> np.ndarray:
    """Force of a sphere on a thin, bonded, incompressible layer over its modulus, mm²:
    Dimitriadis et al., Biophysical Journal 82 (2002) 2798, after Hertz."""
    chi = np.sqrt(INDENTER_MM * depth_mm) / LAYER_MM
    thin = 1.0 + chi * (1.133 + chi * (1.283 + chi * (0.769 + chi * 0.0975)))
    return 16.0 / 9.0 * np.sqrt(INDENTER_MM) * depth_mm**1.5 * thin


class Hyperelastic:
    """Forces of n units from a table: the thin layer's indentation, as much stiffer as Yeoh's solid
    is at the mean strain, and Yeoh's simple shear; the unit's own at H = R = 2 mm."""

    def __init__(self, topology: Topology) -> None:
        strain, own = np.maximum(TABLE_MM / LAYER_MM, 1e-9), Elastic(topology)
        stiffer = yeoh_uniaxial(1.0 - strain) / (6.0 * YEOH[0] * strain)
        self._normal = PchipInterpolator(TABLE_MM, indentation(TABLE_MM) * stiffer)
        self._shear = PchipInterpolator(TABLE_MM, yeoh_shear(TABLE_MM / LAYER_MM))
        at = np.array(2.0)
        self._normal_n, self._shear_n = own.normal(at), own.tangential(at, at)

    def normal(self, depth_mm: np.ndarray) -> np.ndarray:
        """Normal force, newton, shape (..., n)."""
        return self._normal_n * self._normal(depth_mm) / self._normal(2.0)

    def tangential(self, displacement_mm: np.ndarray, _depth_mm: np.ndarray) -> np.ndarray:
        """Tangential force, newton, shape (..., n)."""
        return self._shear_n * self._shear(displacement_mm) / self._shear(2.0)


def relaxed(time_s: np.ndarray, lag_s: float, stretch: float) -> np.ndarray:
    """Answer to a step of 1 by a stretched exponential whose mean delay is `lag_s`."""
    tau = lag_s * stretch / gamma(1.0 / stretch)
    return 1.0 - np.exp(-((time_s / tau) ** stretch))


class ForeignUnit(UnitSimulator):
    """Units whose gel and capacitor follow other laws, where `laws` names them."""

    def __init__(self, topology: Topology, laws: frozenset[str], *, seed: int) -> None:
        super().__init__(topology, seed=seed, field=HalbachField(topology, reach_m=0.0))
        self._laws = laws

    def quantities(
        self,
        depth_mm: np.ndarray,
        displacement_mm: np.ndarray,
        temperature: np.ndarray,
        film_temperature: np.ndarray | None = None,
        hall_temperature: np.ndarray | None = None,
    ) -> np.ndarray:
        """As of `UnitSimulator`."""
        p = self.topology.parameters
        values = super().quantities(
            depth_mm, displacement_mm, temperature, film_temperature, hall_temperature
        )
        if "gel" in self._laws:
            share = vogel(temperature, p["gel_current_ratio"])
            values[..., GEL, :] = p["gel_current_20c_ua"] * share
        if "capacitor" in self._laws:
            rest = p["frequency_rest_hz"]
            squeezed = depth_mm * p["frequency_slope_hz_per_mm"] / rest
            values[..., FREQUENCY, :] = loaded(rest, squeezed)
        return values
