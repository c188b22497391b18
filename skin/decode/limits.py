"""Ranges of counts by which the kernel flags units: what it can decide on a raw count."""

from __future__ import annotations

import numpy as np

from bus.status import Status
from skin.decode import records as k
from skin.physics.force_law import inverse, normal_law
from skin.physics.rest import axial_at_rest_ut
from topology import CHANNELS, Topology
from topology.gel import gel_share

__all__ = ["calibrated_drop_hz", "clipped", "frequency_sigma_hz", "limits_of"]

STRETCH_MAX = 0.2
"""A frequency this share above rest is no working unit: it would be pulled to 6/5 of its height
[assumed]."""
PULL_SIGMAS = 6.0
"""A unit that reads as pulled by more than this many sigma has lost its tare: EXTRAPOLATED
[assumed]."""
IDLE_SIGMAS = 2.9
"""A unit pressed by less than this many sigma is without load [derived]: no contact takes it
(3 sigma)."""
STEP_SIGMA = 12.0**-0.5
"""One-sigma of rounding, in steps [derived]."""

Range = tuple[np.ndarray, np.ndarray]


def limits_of(topology: Topology, vertical: bool) -> dict[str, np.ndarray]:
    """Values of the record `LIMITS` of each unit; `vertical` whether Bz is used at all."""
    p = topology.parameters
    low, high = p["temperature_min_c"], p["temperature_max_c"]
    span = 0.5 * (high - low)
    possible, calibrated = (low - span, high + span), (low, high)
    rest = p["frequency_rest_hz"]
    least, most = calibrated_drop_hz(topology)
    least_load = IDLE_SIGMAS * frequency_sigma_hz(topology)
    ranges = {
        **{f"rail_{name}": ends for name, ends in _rails(topology, vertical).items()},
        "possible_gel": _counts(topology, k.GEL, *_currents(topology, *possible)),
        "possible_frequency": _counts(
            topology, k.FREQUENCY, np.abs(topology.scale[k.FREQUENCY]), (1.0 + STRETCH_MAX) * rest
        ),
        "possible_chip": _counts(topology, k.CHIP, *possible),
        "calibrated_gel": _counts(topology, k.GEL, *_currents(topology, *calibrated)),
        "calibrated_frequency": _counts(topology, k.FREQUENCY, rest - most, rest - least),
        "idle_frequency": _counts(
            topology, k.FREQUENCY, rest - least_load, np.full(topology.n, np.inf)
        ),
    }
    status = np.where(topology.enabled, 0, int(Status.DISABLED))
    status += np.where(topology.counts_only, int(Status.NOT_F3T), 0)
    note = np.where(topology.calibrated, 0, k.UNCALIBRATED)
    note += np.where(topology.tared, 0, k.UNTARED)
    note[status != 0] = 0
    return {"status": status, "note": note} | {
        name: np.stack([low, high - low]).astype(np.int64) for name, (low, high) in ranges.items()
    }


def clipped(topology: Topology) -> dict[str, np.ndarray]:
    """Channels whose signals on the wire end before what a working unit reads: their names, and
    which units, shape (n,), bool.

    A unit reads gel currents and frequencies of its calibrated range, and along z the field of its
    film at rest, or more.
    """
    p, rails, found = topology.parameters, _rails(topology, vertical=True), {}
    rest, film = p["frequency_rest_hz"], axial_at_rest_ut(topology)
    read = {
        k.GEL: _currents(topology, p["temperature_min_c"], p["temperature_max_c"]),
        k.FREQUENCY: (rest - calibrated_drop_hz(topology)[1], rest),
        k.BZ: (film, film),
    }
    for channel, ends in read.items():
        name = k.CHANNEL_NAMES[channel]
        (first, last), (low, high) = _counts(topology, channel, *ends), rails[name]
        beyond = topology.wired[channel] & ~topology.counts_only & ((first < low) | (last > high))
        if beyond.any():
            found[name] = beyond
    return found


def _currents(topology: Topology, *temperatures: np.ndarray) -> list[np.ndarray]:
    """Gel currents at temperatures, µA."""
    p = topology.parameters
    return [p["gel_current_20c_ua"] * gel_share(p, t) for t in temperatures]


def frequency_sigma_hz(topology: Topology) -> np.ndarray:
    """One-sigma of a unit's frequency, Hz, shape (n,): noise, quantisation, frequency at rest."""
    p = topology.parameters
    step = topology.scale[k.FREQUENCY] * STEP_SIGMA
    return np.sqrt(p["frequency_noise_hz"] ** 2 + step**2 + p["frequency_sigma_hz"] ** 2)


def calibrated_drop_hz(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Range of the frequency's fall, Hz, that is neither a lost tare nor beyond calibration."""
    p = topology.parameters
    return -PULL_SIGMAS * frequency_sigma_hz(topology), inverse(p["normal_max_n"], normal_law(p))


def _counts(topology: Topology, channel: int, low: np.ndarray, high: np.ndarray) -> Range:
    """Counts within a range of physical values, both ends; all counts if it is not wired."""
    wired = topology.wired[channel]
    scale = np.where(wired, topology.scale[channel], 1.0)
    ends = (np.stack([low, high]) - topology.offset[channel]) / scale
    ends.sort(axis=0)
    first = np.ceil(ends[0] - 1e-6).clip(-32768, 32767)
    last = np.floor(ends[1] + 1e-6).clip(-32768, 32767)
    return np.where(wired, first, -32768), np.where(wired, last, 32767)


def _rails(topology: Topology, vertical: bool) -> dict[str, Range]:
    """Counts that are not at a rail; the first and the last count of a signal are.

    Bz has none where it is not used. Zero is no rail of an unsigned signal: it is an impossible
    count where it means anything.
    """
    out = {
        name: (np.full(topology.n, -32768), np.full(topology.n, 32767)) for name in k.CHANNEL_NAMES
    }
    frames = topology.frames
    for number, layout in enumerate(topology.layouts):
        units = frames.units[frames.layout == number]
        for signal in layout.signals:
            if signal.name not in CHANNELS or (signal.name == "bz" and not vertical):
                continue
            slot = units[:, signal.slot]
            slot = slot[slot >= 0]
            low, high = out[k.CHANNEL_NAMES[CHANNELS.index(signal.name)]]
            bits = signal.length - signal.signed
            high[slot] = min(2**bits, 32768) - 2
            if signal.signed:
                low[slot] = 1 - 2**bits
    return out
