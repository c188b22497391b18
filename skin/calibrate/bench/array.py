"""Many units at once: their gains from one common force, of a plate, a ball or a wrist sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from bus.status import INVALID
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import AXES, Series, tared
from skin.calibrate.bench.unit import UnitResult
from skin.calibrate.fit import KEPT, Fit, as_fit, fit_law
from skin.calibrate.laws import PRIOR, TURN_RAD
from skin.decode.decoder import Decoder
from skin.errors import ScanError
from skin.physics.force_law import STIFFNESSES
from topology import Topology

__all__ = ["fit_array"]

MOST = 1500
LEAST = 100
FORCE_SIGMA_N = 0.02
"""Of the sum of all units' forces and the sensor, one cycle, at least [assumed]."""
LAG_SIGMA_S, SMOOTHED = 0.1, 11
"""What aligning leaves of the lag where the force wanders from unit to unit, which no function of
the mean frequency follows [assumed]; cycles over which both are averaged."""
NOT_A_GAIN = 0.63
"""Of what a bend of the film changes of a displacement, the share that one gain does not take up:
it is six times as much across the bend as along it [derived: dipoles on an arc]."""
FAR_SIGMAS = 5.0
"""Of the prior, beyond which a gain is none of a unit's [assumed]."""


def fit_array(topology: Topology, series: Series) -> list[UnitResult]:
    """Gains of the normal and tangential force of units that press together on one sensor.

    ``F = turn(sum_i R_i (g_i Fx, g_i Fy, h_i Fz))``, skin frame: the force of the reference is the
    sum of what all units feel. Rest frequencies come from the tare, where there is one; what a unit
    is otherwise stays as its model or its calibration has it.

    Parameters
    ----------
    topology : Topology
        What is known of the units: the prior.
    series : Series
        With segments of the kind ``array``; force in the skin frame, one axis at least.

    Raises
    ------
    ScanError
        No such segment, no force, or a gain that no unit has.
    """
    units = list(series.units)
    at_rest = tared(topology, series)
    decoder = Decoder(at_rest, dtype="float64", sweeps=0, ambient=False)
    reading = decoder(series.counts.counts)
    rows = [axis for axis in range(3) if np.isfinite(series.force[axis]).any()]
    used = series.kind == KINDS.index("array")
    used &= np.isfinite(series.force[rows]).all(axis=0) & series.counts.heard[:, units].all(axis=1)
    used &= np.isfinite(reading.force[:, :, units]).all(axis=(1, 2))
    used &= (reading.status[:, units] & INVALID == 0).all(axis=1)
    if not rows or used.sum() < LEAST:
        raise ScanError(f"array: must be {LEAST} cycles or more with force and all its units; got "
                        f"{int(used.sum()) if rows else 0}")  # fmt: skip
    at = np.flatnonzero(used)
    few = slice(None, None, max(at.size // MOST, 1))
    # noise of what is multiplied would make gains too small
    felt = uniform_filter1d(reading.force[at][:, :, units], SMOOTHED, axis=0)[few]
    own = np.einsum("abn,tbn->tabn", topology.rotation[:, :, units], felt)
    parts = {"shear": own[:, :, :2].sum(axis=2), "normal": own[:, :, 2]}
    spread = {"normal": PRIOR["normal_stiff_n_per_hz"][0], "shear": PRIOR["shear_soft_n_per_mm"][0]}
    prior = {f"{kind} {i}": (1.0, _known(topology, kind, unit, spread[kind]))
             for kind in STIFFNESSES for i, unit in enumerate(units)}  # fmt: skip
    prior |= {f"turn_{axis}": (0.0, TURN_RAD) for axis in AXES}
    prior["lag_s"] = 0.0, LAG_SIGMA_S
    told = uniform_filter1d(series.force[:, at], SMOOTHED, axis=1)
    rise = np.gradient(told, series.counts.time_s[at], axis=1)[:, few]
    force = told[:, few]

    def residual(p: dict[str, Any]) -> list[np.ndarray]:
        total = sum(parts[kind] @ np.array([p[f"{kind} {i}"] for i in range(len(units))])
                    for kind in STIFFNESSES)  # fmt: skip
        turn = np.array([p[f"turn_{axis}"] for axis in AXES])
        seen = np.asarray(total) + np.cross(turn, total)
        return [
            (force[row] - p["lag_s"] * rise[row] - seen[:, row]) / FORCE_SIGMA_N for row in rows
        ]

    fit = fit_law(residual, prior)
    return [_result(at_rest, series, unit, i, fit) for i, unit in enumerate(units)]


def _known(topology: Topology, kind: str, unit: int, spread: float) -> float:
    """How well a gain is known beforehand: of a calibrated unit by its sigma, else as units are
    alike."""
    if not topology.calibrated[unit]:
        return spread
    return max(float(topology.parameters[f"{kind}_sigma_relative"][unit]), 1e-4)


def _result(topology: Topology, series: Series, unit: int, i: int, fit: Fit) -> UnitResult:
    p = topology.parameters
    noise = float(p["frequency_noise_hz"][unit]) / np.sqrt(max(np.sum(series.kind == 0), 1))
    values = {"frequency_rest_hz": (float(p["frequency_rest_hz"][unit]), float(noise))}
    kept, left, goodness = {}, {}, {}
    for kind, stiffnesses in STIFFNESSES.items():
        names = [name for name in stiffnesses if p[name][unit] != 0.0]
        at = fit.names.index(f"{kind} {i}")
        gain, sigma, share = fit.values[at], fit.sigma[at], float(fit.left[at])
        far = FAR_SIGMAS * PRIOR[names[1]][0]
        if abs(gain - 1.0) > far:
            raise ScanError(
                f"{topology.unit_names[unit]}: gain of the {kind} force: must be {1.0 - far:g} to "
                f"{1.0 + far:g}, as units of its model have; got {gain:.3g}: are the forces in "
                "newton, in the skin frame?"
            )
        left |= dict.fromkeys(names, share)
        goodness[f"{kind}_gain"] = float(gain)
        if share > KEPT:
            kept |= dict.fromkeys(names, f"the recordings leave {share:.0%} of its prior variance")
            continue
        values |= {n: (float(gain * p[n][unit]), float(sigma * p[n][unit])) for n in names}
        if kind == "shear" and topology.calibrated[unit]:
            sigma = np.hypot(sigma, NOT_A_GAIN * _known(topology, kind, unit, 0.0))
        values[f"{kind}_sigma_relative"] = float(sigma), float("nan")
    rows = {f"force_{axis}": row for axis, row in zip(AXES, series.force, strict=True)}
    told = {name: (float(np.nanmin(row)), float(np.nanmax(row)))
            for name, row in rows.items() if np.isfinite(row).any()}  # fmt: skip
    return UnitResult(
        topology.unit_names[unit], fits=[as_fit(values)], kept=kept, left=left, goodness=goodness,
        range=told, hash=series.hash,
    )  # fmt: skip
