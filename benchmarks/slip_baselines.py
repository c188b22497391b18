"""Slip detectors of the usual kinds, to be compared with; they are told when the motion begins.

Before that they are silent. What they need to know is given to them: the true friction up to an
error, the noise, the gain error. Their limits are those that did best on the trials on which the
detector was tuned.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from benchmarks.slip_play import Trial, skin_of
from benchmarks.slip_seen import Seen

__all__ = ["BASELINES", "band_power", "friction_ratio", "light_units_cusum"]

LOWPASS_HZ = 25.0
USED = 0.9
"""Share of the friction in use at which the ratio alarms."""
FRICTION_ERROR = 0.3
BAND_HZ, BAND_S, BAND_RISE = (20.0, 100.0), 0.05, 4.0
DRIFT, LIMIT, GAIN_ERROR = 0.5, 40.0, 0.01
REST_S = 0.2
"""Before the motion begins: what is quiet."""


def friction_ratio(trial: Trial, seen: Seen) -> np.ndarray:
    """Tangential over normal force of the contact, above 0.9 times a friction that is known to
    ±30 %; shape (t,), bool."""
    error = np.random.default_rng(trial.plan.seed).uniform(-FRICTION_ERROR, FRICTION_ERROR)
    known = float(trial.plan.friction.mean()) * (1.0 + error)
    load = np.maximum(_smooth(trial, _touching(seen) * seen.force[:, 2]).sum(axis=1), 1e-3)
    shear = np.linalg.norm(_smooth(trial, _shear(trial, seen)), axis=1)
    return shear > USED * known * load


def band_power(trial: Trial, seen: Seen) -> np.ndarray:
    """Power of the total shear between 20 and 100 Hz, 4 times what it is at rest."""
    filtered = sosfilt(
        butter(2, BAND_HZ, "bandpass", fs=trial.plan.rate_hz, output="sos"),
        _shear(trial, seen),
        axis=0,
    )
    keep = np.exp(-1.0 / (BAND_S * trial.plan.rate_hz))
    power = lfilter([1.0 - keep], [1.0, -keep], (filtered**2).sum(axis=1))
    return power > BAND_RISE * power[_rest(trial)].mean()


def light_units_cusum(trial: Trial, seen: Seen) -> np.ndarray:
    """CUSUM (drift 0.5, limit 40) of how far light units lag behind heavy ones, in sigmas."""
    rest = _rest(trial)
    load = seen.force[rest, 2].mean(axis=0)
    touched = np.flatnonzero(_touching(seen)[rest].all(axis=0))
    order = touched[np.argsort(load[touched])]
    third = max(1, order.size // 3)
    light, heavy = order[:third], order[-third:]
    rotation = skin_of(trial.plan.skin, trial.plan.pitch_m).rotation
    moved = np.einsum("abn,tbn->tan", rotation[:, :2], seen.displacement_mm[:, :2])
    moved = moved - moved[rest].mean(axis=0)
    lead = _smooth(trial, moved[:, :, heavy].mean(axis=2))
    size = np.linalg.norm(lead, axis=1)
    lag = size - (_smooth(trial, moved[:, :, light].mean(axis=2)) * lead).sum(axis=1) / np.maximum(
        size, 1e-9
    )
    sigma = np.hypot(lag[rest].std(), GAIN_ERROR * size)
    level, out = 0.0, np.zeros(len(lag), bool)
    for t in np.flatnonzero(trial.moving):
        level = max(0.0, level + lag[t] / sigma[t] - DRIFT)
        out[t] = level > LIMIT
    return out


def _rest(trial: Trial) -> np.ndarray:
    begins_s = trial.plan.begins_s
    return (trial.time_s > begins_s - REST_S) & (trial.time_s <= begins_s)


def _touching(seen: Seen) -> np.ndarray:
    return seen.force[:, 2] > 5.0 * seen.force_sigma[:, 2]


def _shear(trial: Trial, seen: Seen) -> np.ndarray:
    """Tangential force of the units that touch, skin frame, shape (t, 3)."""
    rotation = skin_of(trial.plan.skin, trial.plan.pitch_m).rotation
    return np.einsum(
        "abn,tbn->ta", rotation[:, :2], _touching(seen)[:, np.newaxis] * seen.force[:, :2]
    )


def _smooth(trial: Trial, values: np.ndarray) -> np.ndarray:
    keep = np.exp(-2.0 * np.pi * LOWPASS_HZ / trial.plan.rate_hz)
    return lfilter([1.0 - keep], [1.0, -keep], values, axis=0)


BASELINES = {
    "friction ratio": friction_ratio,
    "band power": band_power,
    "light units' CUSUM": light_units_cusum,
}
