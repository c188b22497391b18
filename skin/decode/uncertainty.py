"""Variances of what is decoded, and what the field may miss its model by until it is an anomaly.

What is constant, the sigma of a unit's parameters, counts in every reading alike; noise counts less
in the mean of many.

The stated range, over which 66 to 72 % of the errors of a calibrated unit lie within one sigma, is
that of its bench: 0 to `normal_max_n`, and R to `field_angle_max_mm` with `field-angle`. With
`sine` it is 66 to 74 % to 1.5 mm; nearer to the crest errors have no normal distribution
(`benchmarks accuracy`). Beyond the range readings are EXTRAPOLATED, and sigma grows by a fifth of
what lies beyond.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import ndtri

from skin.decode import records as k
from skin.decode.limits import STEP_SIGMA
from skin.physics.stray import HORIZON_M, field_at_rest
from topology import Topology

if TYPE_CHECKING:
    from skin.decode.crosstalk import CrossTalk

__all__ = ["Neighbours", "neighbours_of", "uncertainty"]

ANOMALY_SIGMAS = 5.0
"""Sigmas of a unit's constants by which its field may miss its model [assumed]."""
ANOMALIES_PER_DAY = 0.25
"""That noise alone may make, on the whole skin, of two readings in a row and of the mean of many
[assumed]."""
MISS_READINGS = 50.0
"""Readings over which the share is averaged by which the field misses its model [assumed: as many
as a channel may stand still]."""
ANOMALY_SHARE = 0.02
"""Share of the field by which the model of a unit may miss it, without the sigma of its constants
[derived: calibrated films with errors of fabrication are off by 0.4 %, at most 4 % far out, of
which their sigma holds four fifths]."""
STRAY_KNOWN_UT = 300.0
"""µT that neighbours may add to the field where their fields at rest are taken off [assumed; the
field of touching units at rest is 1.07 mT]."""


class Neighbours(NamedTuple):
    """What neighbours may add to the field that nothing takes off, shape (n,) each."""

    still_ut: np.ndarray
    """At rest, at most, µT."""
    lateral_ut2: np.ndarray
    """Variance of x or y, µT², that nothing takes off; what sweeps leave comes with the
    background."""
    untared_ut2: np.ndarray
    """What comes to it in units that were not tared in their places."""
    axial_ut2: np.ndarray
    """Variance along z as they move."""
    axial_rest_ut2: np.ndarray
    """The same at rest, as far as no tare has measured it."""


def neighbours_of(
    topology: Topology, rest_ut: np.ndarray | None, swept: CrossTalk | None
) -> Neighbours:
    """What neighbours may add to the field that nothing takes off.

    Beyond the distance to which resting films are summed, an array that goes on adds about as much
    as the last octave of distance does [derived: the field of a sheet of dipoles].

    Parameters
    ----------
    topology : Topology
    rest_ut : ndarray, shape (3, n), or None
        Field of resting neighbours, as it is summed; None where nothing needs it.
    swept : CrossTalk or None
        What takes off the fields of films that move; None without sweeps: then all that films may
        add as they move is unknown, and of films at rest the share by which they are made
        otherwise, and what tilts make lateral of their field along z.
    """
    still, none = np.full(topology.n, STRAY_KNOWN_UT), np.zeros(topology.n)
    if rest_ut is None:
        return Neighbours(still, none, none, none, none)
    octave_ut = rest_ut - field_at_rest(topology, 0.5 * HORIZON_M)
    still = np.hypot(still, 2.0 * np.abs(octave_ut).max(axis=0))
    if swept is not None:
        rest_ut2 = swept.stencil.rest_sigma_ut[2] ** 2
        return Neighbours(still, none, none, swept.axial_ut2, rest_ut2)
    from skin.physics.stencil import neighbours_moving_ut2, rest_sigma_ut

    lateral_ut2, axial_ut2 = neighbours_moving_ut2(topology)
    p = topology.parameters
    off = rest_sigma_ut(topology) ** 2
    tilted = p["placement_sigma_rad"] ** 2 * rest_ut[2] ** 2
    return Neighbours(still, lateral_ut2, 0.5 * (off[0] + off[1]) + tilted, axial_ut2, off[2])


def uncertainty(
    topology: Topology, c: dict[str, np.ndarray], neighbours: Neighbours
) -> dict[str, np.ndarray]:
    """Variances of what is tangential, and what the field may miss its model by.

    Parameters
    ----------
    topology : Topology
    c : dict of str to ndarray, shape (n,)
        Coefficients of the kernel.
    neighbours : Neighbours
    """
    p, scale = topology.parameters, topology.scale
    gel_c2 = c["gel_variance"] + c["gel_rate"][0] ** 2 * c["gel_noise"]
    # What the temperatures leave of the drifts they compensate: the chip's own is read in steps.
    chip_c2 = np.where(
        topology.wired[k.CHIP], (scale[k.CHIP] * STEP_SIGMA) ** 2, gel_c2
    )  # fmt: skip
    drift2 = 0.5 * (p["hall_drift_x_ut_per_k"] ** 2 + p["hall_drift_y_ut_per_k"] ** 2)
    step2 = 0.5 * (scale[k.BX] ** 2 + scale[k.BY] ** 2) * STEP_SIGMA**2
    stretch2 = 0.5 * sum(p[f"field_{entry}"] ** 2 for entry in ("xx", "xy", "yx", "yy"))
    noise = stretch2 * (p["field_noise_ut"] ** 2 + step2)
    constant = stretch2 * drift2 * chip_c2 + p["field_sigma_ut"] ** 2
    constant += neighbours.lateral_ut2 + np.where(topology.tared, 0.0, neighbours.untared_ut2)
    amplitude = (
        p["field_amplitude_sigma_relative"] ** 2
        + p["film_drift_per_k"] ** 2 * gel_c2
        + p["hall_gain_per_k"] ** 2 * chip_c2
    )
    sigmas2 = ANOMALY_SIGMAS**2
    a_reading = ANOMALIES_PER_DAY / (topology.n * topology.cycle_rate_hz * 86400.0)
    # of a mean, and of each of two readings in a row, whose noise is independent
    mean_sigmas2, single_sigmas2 = (_sigmas(share) ** 2 for share in (a_reading, a_reading**0.5))
    growth2 = p["field_growth_per_mm"] ** 2
    rest2 = growth2 * (
        (p["frequency_sigma_hz"] * c["depth_per_hz"]) ** 2 + p["depth_sigma_mm"] ** 2
    )
    depth2 = growth2 * c["depth_sigma"] ** 2 - rest2
    shape = p["field_angle_variance_relative"].copy()
    shape[0] += 1.0
    step = 1.0 - np.exp(-1.0 / MISS_READINGS)
    share2 = ANOMALY_SHARE**2 + sigmas2 * (amplitude + rest2)
    axial = neighbours.axial_ut2 + neighbours.axial_rest_ut2
    constant2 = neighbours.still_ut**2 + sigmas2 * (constant + axial)
    left = mean_sigmas2 * step / (2.0 - step)  # of the variance of noise, in the mean
    return {
        "shear_variance": p["shear_sigma_relative"] ** 2,
        "shear_floor": p["shear_sigma_n"] ** 2,
        "film_variance": p["field_angle_sigma_mm"] ** 2 * shape,
        "field_variance": noise + constant,
        "axial_variance": axial,
        "amplitude_variance": amplitude,
        "anomaly_share": share2 + single_sigmas2 * depth2,
        "anomaly_field": constant2 + single_sigmas2 * noise,
        "miss_share": share2 + left * depth2,
        "miss_field": constant2 + left * noise,
        "miss_step": np.full(topology.n, step),
    }


def _sigmas(share: float) -> float:
    """Sigmas beyond which, up or down, this share of readings is by noise alone."""
    return float(-ndtri(min(0.5 * share, 0.1)))
