"""The slip detector and the usual ones on a recording, each told only what the file tells.

Detectors are causal: what they say of a sample follows from it and those before. (The scale of
readings that are in no unit may not be: see `benchmarks.recorded.arq`.) The usual ones are those of
`benchmarks.slip_baselines`, which know there when the motion begins and what the friction is. Here
nobody tells that: each gives a figure a sample, and its limit is found in hindsight
(`benchmarks.recorded.score.at_most`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from benchmarks.recorded.recording import Recording
from skin.contact.model import neighbour_graph
from skin.contact.record import SlipState
from skin.contact.stream import ContactStream

__all__ = ["FIGURES", "watch"]

REACH = 1.5
"""Neighbours lie within so many times the least distance of two taxels [derived]: diagonals too."""
TOUCH_SIGMAS = 5.0
"""[assumed] as in `benchmarks.slip_baselines`."""
LOWPASS_HZ = 25.0
BAND_HZ = (20.0, 100.0)
FAST_S, SLOW_S = 0.05, 1.0
"""[assumed] windows of the power: now, and what it is compared with."""
HIGHEST = 0.45
"""Of the rate: highest frequency of the band [derived] below half of it."""
SETTLE_S, REFER_S = 0.3, 0.2
"""[assumed] after a contact began: when it has settled, and how long its lags are learned."""
DRIFT = 0.5
GAIN_ERROR = 0.01


def watch(recording: Recording) -> np.ndarray:
    """Where the slip detector says that a contact slips, incipient or gross; shape (t,), bool."""
    at_m = 1e-3 * recording.position_mm
    n = at_m.shape[1]
    position = np.zeros((3, n))
    position[:2] = at_m * [[1.0], [-1.0]]  # z points into the skin, so y is the other way round
    rotation = np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, np.newaxis], n, axis=2)
    pitch_m = _pitch(at_m)
    stream = ContactStream(
        position, rotation, pitch_m**2, *neighbour_graph(position, REACH * pitch_m),
        want={"slip"}, rate_hz=recording.rate_hz,
    )  # fmt: skip
    stamps_ns = np.rint(1e9 * recording.time_s).astype(np.int64).tolist()
    alarm = np.zeros(len(stamps_ns), bool)
    for t, stamp_ns in enumerate(stamps_ns):
        contacts = stream.update(
            recording.force[t], recording.force_sigma, recording.displacement_mm[t],
            recording.displacement_sigma_mm, stamp_ns=stamp_ns,
        )  # fmt: skip
        alarm[t] = any(contact.slip >= SlipState.INCIPIENT for contact in contacts)
    return alarm


def friction_ratio(recording: Recording) -> np.ndarray:
    """Shear over load of what touches, low-passed; 0 where nothing does. Shape (t,)."""
    touching = _touching(recording)
    load = _smooth(recording, (touching * recording.force[:, 2]).sum(axis=1))
    shear = _smooth(recording, _shear(recording, touching))
    least = TOUCH_SIGMAS * float(recording.force_sigma[2].max())
    return np.where(load > least, np.hypot(*shear.T) / np.maximum(load, least), 0.0)


def band_power(recording: Recording) -> np.ndarray:
    """Power of the total shear between 20 and 100 Hz, over what it was of late. Shape (t,)."""
    rate_hz = recording.rate_hz
    high_hz = min(BAND_HZ[1], HIGHEST * rate_hz)
    low_hz = min(BAND_HZ[0], 0.5 * high_hz)
    sections = butter(2, (low_hz, high_hz), "bandpass", fs=rate_hz, output="sos")
    shear = _shear(recording, _touching(recording))
    power = (np.asarray(sosfilt(sections, shear, axis=0)) ** 2).sum(axis=1)
    noise = float((recording.force_sigma[:2] ** 2).sum())
    return _lowpass(power, FAST_S * rate_hz) / (_lowpass(power, SLOW_S * rate_hz) + noise)


def light_units_cusum(recording: Recording) -> np.ndarray:
    """CUSUM of how far light taxels lag behind heavy ones since the contact settled, in sigmas.
    Shape (t,)."""
    touching = _touching(recording)
    level = np.zeros(len(touching))
    together = touching.sum(axis=1) >= 3
    settle, refer = (round(s * recording.rate_hz) for s in (SETTLE_S, REFER_S))
    for begin, end in runs(together):
        first = begin + settle + refer
        if first >= end:
            continue
        learned = slice(begin + settle, first)
        load = recording.force[learned, 2].mean(axis=0)
        there = np.flatnonzero(touching[learned].all(axis=0))
        if there.size < 3:
            continue
        order = there[np.argsort(load[there])]
        third = order.size // 3
        moved = recording.displacement_mm[begin:end, :2].astype(float)
        moved = moved - moved[settle : settle + refer].mean(axis=0)
        lead = _smooth(recording, moved[:, :, order[-third:]].mean(axis=2))
        light = _smooth(recording, moved[:, :, order[:third]].mean(axis=2))
        size = np.hypot(*lead.T)
        lag = size - (light * lead).sum(axis=1) / np.maximum(size, 1e-9)
        noise = max(float(lag[settle : settle + refer].std()), 1e-6)
        score = lag / np.hypot(noise, GAIN_ERROR * size) - DRIFT
        now = 0.0
        for t in range(first, end):
            now = max(0.0, now + score[t - begin])
            level[t] = now
    return level


FIGURES: dict[str, Callable[[Recording], np.ndarray]] = {
    "friction ratio": friction_ratio,
    "band power": band_power,
    "light units' CUSUM": light_units_cusum,
}


def runs(on: np.ndarray) -> list[tuple[int, int]]:
    """First sample and the one after the last of each time that something is on.

    Examples
    --------
    >>> runs(np.array([True, False, True, True]))
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _pitch(at: np.ndarray) -> float:
    """Least distance of two taxels."""
    away = np.hypot(*(at[:, :, np.newaxis] - at[:, np.newaxis]))
    return float(away[~np.eye(at.shape[1], dtype=bool)].min())


def _touching(recording: Recording) -> np.ndarray:
    return recording.force[:, 2] > TOUCH_SIGMAS * recording.force_sigma[2]


def _shear(recording: Recording, touching: np.ndarray) -> np.ndarray:
    return (touching[:, np.newaxis] * recording.force[:, :2]).sum(axis=2)


def _smooth(recording: Recording, values: np.ndarray) -> np.ndarray:
    return _lowpass(values, recording.rate_hz / (2.0 * np.pi * LOWPASS_HZ))


def _lowpass(values: np.ndarray, samples: float) -> np.ndarray:
    """First-order low-pass with a time constant in samples."""
    keep = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, axis=0))
