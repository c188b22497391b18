"""Skins of any size with units that differ, and counts that make sense to them."""

from __future__ import annotations

import dataclasses
import functools
import tempfile
from pathlib import Path

import numpy as np

import topology
from skin.decode.decoder import Decoder
from topology import THETA_KNOTS, UnitModel

SPREAD = {
    "gel_current_20c_ua": 0.05,
    "gel_current_ratio": 0.1,
    "frequency_rest_hz": 0.03,
    "frequency_slope_hz_per_mm": 0.05,
    "normal_break_hz": 0.1,
    "normal_soft_n_per_hz": 0.1,
    "normal_stiff_n_per_hz": 0.1,
    "field_wavenumber_rad_per_mm": 0.08,
    "field_amplitude_ut": 0.1,
    "field_growth_per_mm": 0.1,
    "shear_soft_n_per_mm": 0.1,
    "shear_break_mm": 0.1,
    "film_drift_per_k": 0.3,
    "film_lag_s": 0.3,
    "hall_gain_per_k": 0.5,
    "hall_lag_s": 0.3,
}
"""Relative spread of the parameters among the units of a made-up calibration."""


def sine(skin, want=None, **options):
    """The paper's estimator alone, for counts whose Bz means nothing."""
    return Decoder(skin, want, "sine", consistency=False, **options)


@functools.cache
def row_of(n, layout="f3t-fd16", rate_hz=1.0):
    """A topology of n nominal units in a row."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.toml"
        file.write_text(
            f'format = 1\nname = "row"\n[[buses]]\nname = "main"\ndata_bitrate = 5_000_000\n'
            f"cycle_rate_hz = {rate_hz}\n[[patches]]\n"
            f'name = "row"\nkind = "grid"\nrows = 1\ncolumns = {n}\npitch_m = 0.01\n'
            f'bus = "main"\nlayout = "{layout}"\nfirst_id = 0x100\n'
        )
        return topology.load(file, allow_overload=True)


def with_parameters(skin, **parameters):
    """The same skin with other parameters; scalars are for all units."""
    changed = {
        name: np.broadcast_to(np.asarray(value, float), skin.parameters[name].shape).copy()
        for name, value in parameters.items()
    }
    return dataclasses.replace(skin, parameters={**skin.parameters, **changed})


def calibrated(skin, seed=0, turn_rad=0.0):
    """The same skin with a calibration of each unit's own."""
    rng = np.random.default_rng(seed)
    n = skin.n
    nominal = UnitModel()
    changed = {
        name: getattr(nominal, name) * (1.0 + spread * rng.uniform(-1.0, 1.0, n))
        for name, spread in SPREAD.items()
    }
    for axis in "xyz":
        changed[f"hall_offset_{axis}_ut"] = rng.uniform(-200.0, 200.0, n)
        changed[f"hall_drift_{axis}_ut_per_k"] = rng.uniform(-3.0, 3.0, n)
    for entry, middle in (("xx", 1.0), ("xy", 0.0), ("yx", 0.0), ("yy", 1.0)):
        changed[f"field_{entry}"] = middle + rng.uniform(-0.05, 0.05, n)
    changed["field_growth_per_mm2"] = rng.uniform(-0.02, 0.02, n)
    table = np.array(nominal.field_angle_mm)[:, np.newaxis]
    changed["field_angle_mm"] = table * (1.0 + rng.uniform(-0.02, 0.02, n))
    changed["shear_gain_per_mm"] = rng.uniform(-0.05, 0.05, n)
    changed["theta_correction_rad"] = rng.uniform(-turn_rad, turn_rad, (THETA_KNOTS, n))
    return with_parameters(skin, **changed)


def sensible_counts(skin, cycles, seed=0, most=1.1):
    """Counts in the calibrated range, shape (cycles, c, n); lateral field up to `most` crests.

    Bz is that of the lateral field by the unit's table, as far as the crest.
    """
    rng = np.random.default_rng(seed)
    p = skin.parameters
    shape = (cycles, skin.n)
    temperature = rng.uniform(p["temperature_min_c"] + 1.0, p["temperature_max_c"] - 1.0, shape)
    drop = rng.uniform(0.0, 1700.0, shape)
    depth = drop / p["frequency_slope_hz_per_mm"]
    crest = amplitude_of(skin, depth)
    strength, direction = most * crest * rng.random(shape), rng.uniform(-np.pi, np.pi, shape)
    reach = np.arcsin(np.minimum(strength / crest, 1.0)) / p["field_wavenumber_rad_per_mm"]
    angle = angle_of(skin, reach, depth)
    current = p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((temperature - 20.0) / 60.0)
    values = [
        current,
        p["frequency_rest_hz"] - drop,
        strength * np.cos(direction),
        strength * np.sin(direction),
        strength / np.tan(angle),
        temperature,
    ]
    counts = (np.stack(values, axis=1) - skin.offset) / np.where(skin.wired, skin.scale, np.inf)
    return np.clip(np.round(counts), -32767, 32766).astype(np.int16)


def amplitude_of(skin, depth):
    """M0 of each unit at its depth and at reference temperatures, µT."""
    p = skin.parameters
    deeper = depth - p["field_reference_mm"]
    growth = p["field_growth_per_mm"] * deeper + p["field_growth_per_mm2"] * deeper**2
    return p["field_amplitude_ut"] * np.exp(growth)


def angle_of(skin, reach, depth):
    """Angle of the field at which each unit's table says `reach`, by bisection."""
    table = skin.parameters["field_angle_mm"].reshape(4, 4, -1)
    low, high = np.zeros(reach.shape), np.full(reach.shape, 1.7)
    for _ in range(60):
        angle = 0.5 * (low + high)
        told = sum(
            table[i, j] * angle ** (2 * i + 1) * depth**j for i in range(4) for j in range(4)
        )
        low, high = np.where(told < reach, angle, low), np.where(told < reach, high, angle)
    return 0.5 * (low + high)


def any_counts(skin, cycles, seed=0):
    """Counts of the whole int16 domain, its ends included."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(-32768, 32768, (cycles, 6, skin.n))
    ends = rng.random(counts.shape) < 0.1
    return np.where(ends, rng.choice([-32768, -1, 0, 1, 32767], counts.shape), counts).astype(
        np.int16
    )
