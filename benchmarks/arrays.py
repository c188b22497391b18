"""Skins of any number of units, and counts in their calibrated range."""

from __future__ import annotations

import dataclasses

import numpy as np

import topology
from benchmarks.made import apart
from bus.compiled.aligned import zeros
from skin.calibrate.bench.series import OF_UNITS
from topology import Topology

SPREAD = {
    "gel_current_ratio": 0.05,
    "frequency_rest_hz": 0.02,
    "frequency_slope_hz_per_mm": 0.03,
    "field_amplitude_ut": 0.05,
    "field_wavenumber_rad_per_mm": 0.03,
    "shear_soft_n_per_mm": 0.05,
    "normal_stiff_n_per_hz": 0.05,
    "shear_stiff_n_per_mm": 0.05,
    "shear_gain_per_mm": 0.1,
    "field_growth_per_mm": 0.02,
    "field_angle_mm": 0.01,
    "film_drift_per_k": 0.1,
    "hall_gain_per_k": 0.1,
}
"""Relative spread of the parameters that differ from unit to unit: those that a bench writes."""


def array_of(n: int, *, alike: bool, seed: int = 0) -> Topology:
    """A skin of n units, those of the palm repeated, too far apart to feel each other."""
    palm = topology.load("palm").exact()
    times = -(-n // palm.n)
    frames = palm.frames
    units = frames.units[np.newaxis] + palm.n * np.arange(times)[:, np.newaxis, np.newaxis]
    units = np.where(frames.units >= 0, units, -1).reshape(-1, frames.units.shape[1])

    def repeat(values: np.ndarray) -> np.ndarray:
        return np.tile(values, times)[..., :n]

    rng = np.random.default_rng(seed)
    parameters = {name: repeat(values) for name, values in palm.parameters.items()}
    for name, spread in () if alike else SPREAD.items():
        parameters[name] = parameters[name] * (1.0 + spread * rng.uniform(-1.0, 1.0, n))
    tiled = dataclasses.replace(
        palm,
        frames=dataclasses.replace(
            frames,
            units=np.where(units < n, units, -1).astype(np.int32),
            **{name: np.tile(getattr(frames, name), times)
               for name in ("bus", "can_id", "layout", "part")},
        ),
        unit_names=tuple(map(str, range(n))),
        parameters=parameters,
        **{name: repeat(getattr(palm, name)) for name in OF_UNITS},
    )  # fmt: skip
    return apart(tiled)


def counts_of(skin: Topology, most: float = 0.9, seed: int = 1) -> np.ndarray:
    """Counts in the calibrated range, shape (c, n); lateral fields up to `most` of the crest.

    They begin on a cache line, as those of a live bus do.
    """
    rng = np.random.default_rng(seed)
    p = skin.parameters
    drop = rng.uniform(0.0, 1700.0, skin.n)
    temperature = rng.uniform(16.0, 80.0, skin.n)
    depth = drop / p["frequency_slope_hz_per_mm"]
    crest = p["field_amplitude_ut"] * np.exp(
        p["field_growth_per_mm"] * (depth - p["field_reference_mm"])
    )
    field = 0.93 * most * crest * np.sqrt(rng.random(skin.n))
    reach = np.arcsin(np.minimum(field / crest, 1.0)) / p["field_wavenumber_rad_per_mm"]
    direction = rng.uniform(-np.pi, np.pi, skin.n)
    values = np.stack([
        p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((temperature - 20.0) / 60.0),
        p["frequency_rest_hz"] - drop,
        field * np.cos(direction),
        field * np.sin(direction),
        field / np.tan(_angle_of(p["field_angle_mm"], reach, depth)),
        temperature,
    ])  # fmt: skip
    counts = zeros(values.shape, np.int16)
    counts[:] = np.rint((values - skin.offset) / skin.scale)
    return counts


def _angle_of(table: np.ndarray, reach: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Angle of the field at which a table says `reach`, by Newton's method."""
    row = [table[4 * i] + depth * (table[4 * i + 1] + depth * (table[4 * i + 2]
           + depth * table[4 * i + 3])) for i in range(4)]  # fmt: skip
    angle = reach / row[0]
    for _ in range(12):
        z = angle * angle
        told = angle * (row[0] + z * (row[1] + z * (row[2] + z * row[3])))
        slope = row[0] + z * (3.0 * row[1] + z * (5.0 * row[2] + z * 7.0 * row[3]))
        angle = angle - (told - reach) / slope
    return angle
