"""One-sigma of readings that come without, from the noise in the unit models.

Frequency noise becomes noise of the normal force by the slope that the unit is on, and of the depth
by its slope; field noise becomes noise of the displacement along its direction by the slope of
``M0(H) sin(k R)`` (eq. 1), with what the uncertain depth does to M0, and across it by its angle;
the shear law takes both to the tangential force. Towards the crest, where the slope ends, the sigma
of the displacement stays below that of a field that touches the crest.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from topology import CHANNELS, Topology

__all__ = ["UnitNoise", "unit_noise_python"]

(
    FREQUENCY_HZ, FIELD_UT, SLOPE_HZ_PER_MM, SOFT, STIFF, BREAK_N, AMPLITUDE_UT, REFERENCE_MM,
    GROWTH_PER_MM, WAVENUMBER, SHEAR_SOFT, SHEAR_BREAK_MM, SHEAR_STIFFER, UNLOADED_N,
) = range(14)  # fmt: skip
REST_FORCE, REST_DISPLACEMENT, ROWS = 14, 17, 20
UNLOADED_SIGMAS = 2.0
"""Normal load, in sigmas, below which a unit counts as unloaded: no contact takes it."""


def unit_noise_python(force, displacement, model, force_sigma, displacement_sigma):
    """Write the one-sigma of forces and displacements; of units without load, that at rest.

    Parameters
    ----------
    force, displacement : ndarray, shape (3, n)
        Newton and millimetre, unit frame.
    model : ndarray, shape (ROWS, n), float64
        Noise and slopes of each unit.
    force_sigma, displacement_sigma : ndarray, shape (3, n)
        Written.
    """
    for i in range(force.shape[1]):
        if not force[2, i] > model[UNLOADED_N, i]:
            for a in range(3):
                force_sigma[a, i] = model[REST_FORCE + a, i]
                displacement_sigma[a, i] = model[REST_DISPLACEMENT + a, i]
            continue
        x, y, depth = displacement[0, i], displacement[1, i], displacement[2, i]
        field = model[FIELD_UT, i]
        wavenumber = model[WAVENUMBER, i]
        slope = model[SOFT, i] if force[2, i] < model[BREAK_N, i] else model[STIFF, i]
        depth_sigma = model[FREQUENCY_HZ, i] / model[SLOPE_HZ_PER_MM, i]
        growth = model[GROWTH_PER_MM, i]
        crest = model[AMPLITUDE_UT, i] * np.exp(growth * (depth - model[REFERENCE_MM, i]))
        reach = np.sqrt(x * x + y * y)
        u = min(wavenumber * reach, 0.5 * np.pi)
        share = np.sqrt((field / crest) ** 2 + (np.sin(u) * growth * depth_sigma) ** 2)
        along = share / (wavenumber * max(np.cos(u), np.sqrt(min(share, 1.0))))
        across = field / (crest * wavenumber) * (u / np.sin(u) if u > 0.0 else 1.0)
        stiff = model[SHEAR_SOFT, i]
        mean = stiff
        beyond = reach - model[SHEAR_BREAK_MM, i]
        if beyond > 0.0:
            mean += model[SHEAR_STIFFER, i] * beyond / reach
            stiff += model[SHEAR_STIFFER, i]
        cosine = x / reach if reach > 0.0 else 1.0
        square = cosine * cosine
        along *= along
        across *= across
        displacement_sigma[0, i] = np.sqrt(square * along + (1.0 - square) * across)
        displacement_sigma[1, i] = np.sqrt((1.0 - square) * along + square * across)
        displacement_sigma[2, i] = depth_sigma
        along *= stiff * stiff
        across *= mean * mean
        force_sigma[0, i] = np.sqrt(square * along + (1.0 - square) * across)
        force_sigma[1, i] = np.sqrt((1.0 - square) * along + square * across)
        force_sigma[2, i] = model[FREQUENCY_HZ, i] * slope


unit_noise = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(
    unit_noise_python
)


class UnitNoise:
    """Noise of a topology's units, cycle by cycle, for decoders that do not tell it.

    Parameters
    ----------
    topology : Topology
    dtype : "float32" or "float64"

    Attributes
    ----------
    force_sigma, displacement_sigma_mm : ndarray, shape (3, n)
        Newton and millimetre, of the last cycle.
    """

    def __init__(self, topology: Topology, dtype: str) -> None:
        p = topology.parameters
        frequency, bx, by = (topology.scale[CHANNELS.index(c)] for c in ("frequency", "bx", "by"))
        soft = p["normal_soft_n_per_hz"]
        frequency_hz = np.hypot(p["frequency_noise_hz"], frequency / np.sqrt(12.0))
        model = np.zeros((ROWS, topology.n))
        model[:REST_FORCE] = [
            frequency_hz, np.sqrt(p["field_noise_ut"] ** 2 + (bx**2 + by**2) / 24.0),
            p["frequency_slope_hz_per_mm"], soft, p["normal_stiff_n_per_hz"],
            soft * p["normal_break_hz"], p["field_amplitude_ut"], p["field_reference_mm"],
            p["field_growth_per_mm"], p["field_wavenumber_rad_per_mm"],
            p["shear_soft_n_per_mm"], p["shear_break_mm"], p["shear_stiff_n_per_mm"],
            np.full(topology.n, -np.inf),
        ]  # fmt: skip
        at_rest = np.zeros((3, topology.n))
        unit_noise_python(
            at_rest, at_rest, model, model[REST_FORCE:REST_DISPLACEMENT], model[REST_DISPLACEMENT:]
        )
        model[UNLOADED_N] = UNLOADED_SIGMAS * frequency_hz * soft
        self.model = model
        self.force_sigma = np.zeros((3, topology.n), dtype)
        self.displacement_sigma_mm = np.zeros((3, topology.n), dtype)

    def __call__(self, force: np.ndarray, displacement_mm: np.ndarray) -> None:
        """Take the readings of a cycle, shape (3, n), newton and millimetre."""
        unit_noise(force, displacement_mm, self.model, self.force_sigma,
                   self.displacement_sigma_mm)  # fmt: skip

    def warmup(self) -> None:
        """Load or compile the kernel."""
        self(np.zeros_like(self.force_sigma), np.zeros_like(self.force_sigma))
