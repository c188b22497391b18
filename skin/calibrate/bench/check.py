"""A calibration held against a recording: errors over what their sigma promises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bus.status import INVALID
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import Series, decoded
from skin.calibrate.fit import noise_of, robust_sigma
from topology import CHANNELS, Topology

__all__ = ["DRIFTED", "Score", "owner_of", "score"]

DRIFTED = 1.5
"""Errors over their sigma, from which a calibration does not hold: 1 where it does [assumed]."""
FREQUENCY = CHANNELS.index("frequency")
SCORED = ("tare", "hold", "normal", "shear", "circles", "heated-free", "heated-load")


@dataclass(frozen=True)
class Score:
    """How a unit's calibration fares on a recording.

    Attributes
    ----------
    force_rmse_n, temperature_rmse_c : float
        NaN where the reference has none.
    over_sigma : dict of str to float
        Robust scatter about zero of tangential force, normal force and temperature over their own
        sigma, noise included; 1 where sigma is true.
    rest_hz : float
        Frequency in the tare less that of the calibration.
    invalid : float
        Share of readings that the decoder flags invalid.
    """

    force_rmse_n: float
    temperature_rmse_c: float
    over_sigma: dict[str, float]
    rest_hz: float
    invalid: float

    @property
    def faults(self) -> list[str]:
        """What does not hold, in words."""
        found = [f"{name}: must be within its sigma of the reference; got errors of {z:.2g} sigma"
                 for name, z in self.over_sigma.items() if z > DRIFTED]  # fmt: skip
        if self.invalid > 0.5:
            found.append(f"status: must be valid; got flags in {self.invalid:.0%} of readings")
        return found


def score(topology: Topology, series: Series, unit: int) -> Score:
    """Decode a recording by a calibration and compare it with its reference.

    The axes of the force sensor are turned to those of the unit first: a bench is no better aligned
    than a degree, and this is no fault of the calibration.

    Parameters
    ----------
    topology : Topology
        With the calibration.
    series : Series
    unit : int
    """
    reading = decoded(topology, series, unit)
    force, sigma = reading.force[:, :, 0], reading.force_sigma[:, :, 0]
    used = series.counts.heard[:, unit] & np.isin(series.kind, [KINDS.index(k) for k in SCORED])
    invalid = reading.status[:, 0] & INVALID != 0
    told, over, rmse = series.force.T, {}, float("nan")
    whole = used & np.isfinite(told).all(axis=1) & np.isfinite(force).all(axis=1)
    if whole.sum() > 2:
        pressed = whole & (np.linalg.norm(told, axis=1) > 0.5)
        if pressed.sum() > 2:
            turn = Rotation.align_vectors(force[pressed], told[pressed])[0]
            told = turn.apply(np.nan_to_num(told))
        error = (force - told)[whole]
        rmse = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        z = error / sigma[whole]
        over = {"tangential": _about_zero(z[:, :2]), "normal": _about_zero(z[:, 2])}
    elif (only := used & np.isfinite(told[:, 2]) & np.isfinite(force[:, 2])).any():
        error = (force[:, 2] - told[:, 2])[only]
        rmse = float(np.sqrt(np.mean(error**2)))
        over = {"normal": _about_zero(error / sigma[only, 2])}
    warm_rmse = float("nan")
    warm = used & np.isfinite(series.temperature)
    if warm.any():
        error = reading.temperature[warm, 0] - series.temperature[warm]
        warm_rmse = float(np.sqrt(np.mean(error**2)))
        # thermometers are no better than the gel: their own noise, from reading to reading
        sigma_c = np.hypot(reading.temperature_sigma[warm, 0], noise_of(series.temperature[warm]))
        over["temperature"] = _about_zero(error / sigma_c)
    rest = series.kind == KINDS.index("tare")
    scale, offset = (rows[FREQUENCY, unit] for rows in (topology.scale, topology.offset))
    at_rest = scale * series.counts.counts[rest, FREQUENCY, unit] + offset
    rest_hz = float("nan")
    if rest.any():
        rest_hz = float(np.median(at_rest) - topology.parameters["frequency_rest_hz"][unit])
    return Score(rmse, warm_rmse, over, rest_hz, float(invalid[used].mean()) if used.any() else 0.0)


def _about_zero(z: np.ndarray) -> float:
    """Robust scatter about zero, of which a bias is a part."""
    return robust_sigma(np.concatenate([z.ravel(), -z.ravel()]))


def owner_of(topology: Topology, series: Series, unit: int) -> int | None:
    """The other unit whose calibration holds on this recording, or None."""
    for other in np.flatnonzero(topology.calibrated):
        if other == unit:
            continue
        parameters = {name: values.copy() for name, values in topology.parameters.items()}
        for values in parameters.values():
            values[..., unit] = values[..., other]
        swapped = Topology(**{**vars(topology), "parameters": parameters})
        if not score(swapped, series, unit).faults:
            return int(other)
    return None
