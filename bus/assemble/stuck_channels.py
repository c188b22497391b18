"""Stuck channels: counts that stay constant for longer than noise allows.

A channel counts as constant while its counts stay within a band about the first one. The band is
narrow against the noise of a working unit, and the time is so long that noise alone stays in it at
most `FALSE_ALARMS_PER_DAY` times a day on the whole skin, for white Gaussian noise [derived]. A
channel whose noise is far below one count is normally constant: it is not tested, nor is the chip's
temperature, whose noise is unknown.
"""

from __future__ import annotations

import numpy as np

from topology import CHANNELS, Topology
from topology.gel import gel_share

__all__ = ["FALSE_ALARMS_PER_DAY", "noise_counts", "stuck_limits"]

FALSE_ALARMS_PER_DAY = 0.5
"""Rate of healthy channels that are reported as stuck, on the whole skin [assumed]."""
LEAST_NOISE = 0.5
"""Smallest noise of a working unit, relative to that of its model [assumed]."""
BAND = 0.25
"""Half the width of the band, in sigmas of that [assumed]: a stuck converter may still toggle its
last bits."""
LONGEST_S = 600.0
"""A channel that needs a longer test is not tested [assumed]."""
SOON_S = 1.0
"""A band of the last bit is used where the test is no longer than this [assumed]."""
DAY_S = 86400.0


def noise_counts(topology: Topology) -> np.ndarray:
    """One-sigma of the noise of each channel, in counts, shape (c, n); 0 where none is known.

    For the gel, whose noise is relative to its current, at the lower end of the calibrated range of
    temperature.
    """
    p = topology.parameters
    coldest = gel_share(p, p["temperature_min_c"])
    field = p["field_noise_ut"]
    physical = {
        "gel": p["gel_noise_relative"] * p["gel_current_20c_ua"] * coldest,
        "frequency": p["frequency_noise_hz"],
        "bx": field,
        "by": field,
        "bz": field,
    }
    out = np.zeros((len(CHANNELS), topology.n))
    for name, noise in physical.items():
        channel = CHANNELS.index(name)
        wired = topology.wired[channel] & ~topology.counts_only
        out[channel, wired] = noise[wired] / np.abs(topology.scale[channel, wired])
    return out


def stuck_limits(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Bands and times of all channels.

    Returns
    -------
    band : ndarray, shape (c, n), int16
        Largest deviation of a constant channel from its first count.
    cycles : ndarray, shape (c, n), int32
        Readings within the band that show a stuck channel; 0: not tested. Never before the unit's
        `frozen_cycles`, and 0 where that is 0.
    """
    from scipy.special import log_ndtr

    sigma, rate_hz = LEAST_NOISE * noise_counts(topology), topology.cycle_rate_hz

    def cycles_of(band: np.ndarray) -> np.ndarray:
        # noise about the middle of the band, where it stays longest
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = np.log(2.0) + log_ndtr(-(band + 0.5) / sigma)
            alarms = sigma.size * rate_hz * DAY_S / FALSE_ALARMS_PER_DAY
            return 1.0 + np.log(alarms) / -np.log1p(-np.exp(beyond))

    band = np.floor(BAND * sigma)
    last_bit = (band == 0.0) & (cycles_of(np.ones_like(band)) <= SOON_S * rate_hz)
    band[last_bit] = 1.0
    cycles = cycles_of(band)
    least = topology.parameters["frozen_cycles"]
    watched = (sigma > 0.0) & (cycles <= LONGEST_S * rate_hz) & (least > 0.0)
    cycles = np.where(watched, np.ceil(np.maximum(cycles, least)), 0.0)
    return band.astype(np.int16), cycles.astype(np.int32)
