"""Force of a probe from the field of a foreign magnet, by the tools of calibration.

A unit of another maker has no film and no capacitor that our laws describe. Its law is a polynomial
of each channel; its order, from a straight line up, is the one that `cross_validated` chooses on
the first half of the recording, from which it is fitted by least squares. The error is that of the
second half. A law without memory cannot follow hysteresis: `hysteresis_rms` is half of the
difference of the force on the way in and out at the same place of the probe.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.recorded.eflesh import Probe
from skin.calibrate.fit import cross_validated, folds_of

__all__ = ["force_of", "per_mm"]

ORDERS = (1, 2, 3)
BIN_MM = 1.0
"""Of places that are compared on the way in and out."""
TOUCHED = 0.02
"""Of the largest force, from which the probe touches [assumed]."""


def force_of(probe: Probe) -> dict[str, Any]:
    """Errors of the force, in the file's own unit and relative to its full scale."""
    half = len(probe.force) // 2
    offset, scale = probe.field_ut[:half].mean(axis=0), probe.field_ut[:half].std(axis=0)
    channels = (probe.field_ut - offset) / scale
    first = np.arange(half)

    def error(order: int, training: np.ndarray) -> np.ndarray:
        fit = _fit(channels[:half][training], probe.force[:half][training], order)
        return (_predicted(channels[:half][~training], fit, order)
                - probe.force[:half][~training]) ** 2  # fmt: skip

    full = float(np.ptp(probe.force))
    order, _ = cross_validated(ORDERS, folds_of(half), error)
    rows = {}
    for name, each in (("linear", 1), ("chosen", int(order))):
        fit = _fit(channels[first], probe.force[first], each)
        off = _predicted(channels, fit, each) - probe.force
        own, other = (float(np.sqrt(np.mean(part**2))) for part in (off[:half], off[half:]))
        rows[name] = {"order": each, "rmse_fitted": own / full, "rmse": other / full,
                      "bias": float(off[half:].mean()) / full,
                      "rmse_file_unit": other}  # fmt: skip
    return {**rows, "full_scale_file_unit": full, "samples": len(probe.force),
            "hysteresis_rms": _hysteresis(probe) / full}  # fmt: skip


def _matrix(channels: np.ndarray, order: int) -> np.ndarray:
    powers = [channels**power for power in range(1, order + 1)]
    return np.concatenate([np.ones((len(channels), 1)), *powers], axis=1)


def _fit(channels: np.ndarray, force: np.ndarray, order: int) -> np.ndarray:
    return np.linalg.lstsq(_matrix(channels, order), force, rcond=None)[0]


def _predicted(channels: np.ndarray, fit: np.ndarray, order: int) -> np.ndarray:
    return _matrix(channels, order) @ fit


def _hysteresis(probe: Probe) -> float:
    """Root mean square of half of the difference of the force between the two ways."""
    speed = np.gradient(probe.place_mm, probe.time_s)
    place = np.rint(probe.place_mm / BIN_MM)
    differences = []
    for each in np.unique(place):
        ways = [probe.force[(place == each) & way] for way in (speed < 0.0, speed > 0.0)]
        if all(way.size for way in ways):
            differences.append(0.5 * (ways[0].mean() - ways[1].mean()))
    return float(np.sqrt(np.mean(np.square(differences))))


def per_mm(probe: Probe) -> float:
    """Change of the field of a chip a millimetre of the probe while it touches, µT: the median over
    chips of the slope of the length of the change."""
    touched = probe.force > TOUCHED * probe.force.max()
    chips = probe.field_ut.reshape(len(probe.field_ut), -1, 3)
    change = np.linalg.norm(chips - chips[~touched].mean(axis=0), axis=2)
    slopes = [abs(np.polyfit(probe.place_mm[touched], one[touched], 1)[0]) for one in change.T]
    return float(np.median(slopes))
