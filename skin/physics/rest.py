"""What calibration says of the field of a unit that nothing touches."""

from __future__ import annotations

import numpy as np

from topology import Topology

__all__ = ["axial_at_rest_ut", "film_at_rest_ut", "inverse_map"]


def film_at_rest_ut(topology: Topology) -> np.ndarray:
    """Field of each unit's own film at rest, its temperature that of the reference.

    On the axis of the chip it is axial: ``field_vertical_ratio * M0(H = 0)``. A film that sits
    beside that axis adds what its displacement by ``film_x_mm, film_y_mm`` makes (eq. 1).

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


def inverse_map(topology: Topology) -> np.ndarray:
    """From the lateral field of `Reading.field_ut` to what the counts read; shape (2, 2, n)."""
    p = topology.parameters
    determinant = p["field_xx"] * p["field_yy"] - p["field_xy"] * p["field_yx"]
    rows = [[p["field_yy"], -p["field_xy"]], [-p["field_yx"], p["field_xx"]]]
    return np.array(rows) / determinant
