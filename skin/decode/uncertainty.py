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

import numpy as np
from scipy.special import ndtri

from skin.decode import records as k
from skin.decode.limits import STEP_SIGMA
from skin.physics.stray import HORIZON_M, field_at_rest
from topology import Topology

__all__ = ["neighbours_ut", "uncertainty"]

ANOMALY_SIGMAS = 5.0
"""Sigmas of a unit's constants by which its field may miss its model [assumed]."""
ANOMALIES_PER_DAY = 0.25
"""That noise alone may make, on the whole skin, of two readings in a row and of the mean of many
[assumed]."""
MISS_READINGS = 50.0
"""Readings over which the share is averaged by which the field misses its model [assumed: as many
as a channel may stand still]."""
ANOMALY_SHARE = 0.02
"""Share of the field by which the model of a unit may miss it, beside the sigma of its constants
[derived: calibrated films with errors of fabrication are off by 0.4 %, at most 4 % far out, of
which their sigma holds four fifths]."""
STRAY_UT, STRAY_KNOWN_UT = 1000.0, 300.0
"""µT that neighbours may add to the field: all of it, or what is left where their fields at rest
are known [assumed; the field of touching units at rest is 1.07 mT]."""


def neighbours_ut(topology: Topology, felt_ut: np.ndarray | None, rest_known: bool) -> np.ndarray:
    """What neighbours may add to the field that nothing takes off, µT, shape (n,).

    Beyond the distance to which resting films are summed, an array that goes on adds about as much
    as the last octave of distance does [derived: the field of a sheet of dipoles].

    Parameters
    ----------
    topology : Topology
    felt_ut : ndarray, shape (3, n), or None
        Field of resting neighbours, as it is summed.
    rest_known : bool
        Whether that is taken off, or in the offsets.
    """
    known = np.full(topology.n, STRAY_KNOWN_UT if rest_known else STRAY_UT)
    if felt_ut is None:
        return known
    octave_ut = felt_ut - field_at_rest(topology, 0.5 * HORIZON_M)
    return np.hypot(known, 2.0 * np.abs(octave_ut).max(axis=0))


def uncertainty(
    topology: Topology, c: dict[str, np.ndarray], stray_ut: np.ndarray
) -> dict[str, np.ndarray]:
    """Variances of what is tangential, and what the field may miss its model by.

    Parameters
    ----------
    topology : Topology
    c : dict of str to ndarray, shape (n,)
        Coefficients of the kernel.
    stray_ut : ndarray, shape (n,)
        As of `neighbours_ut`.
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
    constant2 = stray_ut**2 + sigmas2 * constant
    left = mean_sigmas2 * step / (2.0 - step)  # of the variance of noise, in the mean
    return {
        "shear_variance": p["shear_sigma_relative"] ** 2,
        "shear_floor": p["shear_sigma_n"] ** 2,
        "film_variance": p["field_angle_sigma_mm"] ** 2 * shape,
        "field_variance": noise + constant,
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
