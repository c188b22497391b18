"""What calibration says of the field of a unit that nothing touches."""

from __future__ import annotations

import numpy as np

from topology import Topology

__all__ = ["axial_at_rest_ut", "axial_sigma_ut", "film_at_rest_ut", "inverse_map"]

AXIAL_SHARE = 0.005
"""By which the own field at rest differs from what the table of angles makes of it [derived: the
fit of a film of another shape]."""


def film_at_rest_ut(topology: Topology) -> np.ndarray:
    """Field of each unit's own film at rest, its temperature that of the reference.

    On the axis of the chip it is axial: ``field_vertical_ratio * M0(H = 0)``. A film that sits
    next to that axis adds what its displacement by ``film_x_mm, film_y_mm`` makes (eq. 1).

    Returns
    -------
    ndarray, shape (3, n)
        Microtesla, as of `Reading.field_ut`.
    """
    p = topology.parameters
    up_mm = p["field_reference_mm"]
    crest = p["field_amplitude_ut"] * np.exp(
        (p["field_growth_per_mm2"] * up_mm - p["field_growth_per_mm"]) * up_mm
    )
    way = np.stack([p["film_x_mm"], p["film_y_mm"]])
    k = p["field_wavenumber_rad_per_mm"]
    phase = k * np.hypot(*way)
    lateral = crest * k * np.sinc(phase / np.pi) * way
    axial = p["field_vertical_ratio"] * crest * np.cos(phase)
    return np.concatenate([lateral, axial[np.newaxis]])


def axial_at_rest_ut(topology: Topology) -> np.ndarray:
    """Bz of each unit's own film at rest, µT, shape (n,), as the bench has found it: the lateral
    field per mm over the angle per mm, both of a small displacement; without a table of angles as
    of `film_at_rest_ut`."""
    p = topology.parameters
    crest = film_at_rest_ut(topology)[2] / p["field_vertical_ratio"]
    slope = p["field_angle_mm"][0]
    tabled = crest * p["field_wavenumber_rad_per_mm"] * slope
    return np.where(slope > 0.0, tabled, film_at_rest_ut(topology)[2])


def axial_sigma_ut(topology: Topology, lateral_ut: np.ndarray) -> np.ndarray:
    """One-sigma of what an untouched unit reads along z beyond its offset and `axial_at_rest_ut`,
    as far as the unit itself is not known, µT, shape (n,): offset, strength and table of angles.

    Parameters
    ----------
    topology : Topology
    lateral_ut : ndarray, shape (n,)
        One-sigma of a lateral offset; that along z is known as well.
    """
    relative = np.hypot(topology.parameters["field_amplitude_sigma_relative"], AXIAL_SHARE)
    return np.hypot(lateral_ut, relative * axial_at_rest_ut(topology))


def inverse_map(topology: Topology) -> np.ndarray:
    """From the lateral field of `Reading.field_ut` to what the counts read; shape (2, 2, n)."""
    p = topology.parameters
    determinant = p["field_xx"] * p["field_yy"] - p["field_xy"] * p["field_yx"]
    rows = [[p["field_yy"], -p["field_xy"]], [-p["field_yx"], p["field_xx"]]]
    return np.array(rows) / determinant
