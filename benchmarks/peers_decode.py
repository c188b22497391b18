"""What the decoder is measured against: numpy, the paper written out, 40 digits.

The peers take the same counts and give the same quantities of one cycle. They do less: no status
flags, no lag of the film behind the gel. `exact` shares no code with the decoder.
"""

from __future__ import annotations

import dataclasses
from math import asin, atan2, cos, exp, hypot, sin

import numpy as np
from numba import njit

import topology
from benchmarks.accuracy_skin import apart
from bus.compiled.aligned import zeros
from skin.calibrate.bench.series import OF_UNITS
from topology import Topology

ROWS = ("temperature", "fx", "fy", "fz", "tangential", "theta", "x", "y", "h")

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


def numpy_decode(skin: Topology, counts: np.ndarray) -> np.ndarray:
    """The model in numpy, float64; rows as in `ROWS`."""
    p = skin.parameters
    current, frequency, bx, by, _, chip = skin.scale * counts + skin.offset
    temperature = 20.0 + 60.0 * np.log(current / p["gel_current_20c_ua"]) / np.log(
        p["gel_current_ratio"]
    )
    drop = p["frequency_rest_hz"] - frequency
    depth = drop / p["frequency_slope_hz_per_mm"]
    stiffer = p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]
    normal = p["normal_soft_n_per_hz"] * drop + stiffer * np.maximum(
        drop - p["normal_break_hz"], 0.0
    )
    gain = 1.0 + p["hall_gain_per_k"] * (chip - p["hall_reference_c"])
    bx, by = (bx - p["hall_offset_x_ut"]) / gain, (by - p["hall_offset_y_ut"]) / gain
    bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
    deeper = depth - p["field_reference_mm"]
    crest = p["field_amplitude_ut"] * np.exp(p["field_growth_per_mm"] * deeper)
    crest = crest * (1.0 + p["film_drift_per_k"] * (temperature - p["film_reference_c"]))
    ratio = np.minimum(np.hypot(bx, by) / crest, 1.0)
    reach = np.arcsin(ratio) / p["field_wavenumber_rad_per_mm"]
    tangential = p["shear_soft_n_per_mm"] * reach + p["shear_stiff_n_per_mm"] * np.maximum(
        reach - p["shear_break_mm"], 0.0
    )
    theta = np.arctan2(by, bx)
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([temperature, tangential * c, tangential * s, normal, tangential, theta,
                     reach * c, reach * s, depth])  # fmt: skip


def paper_polynomials(skin: Topology, degree: int = 6) -> np.ndarray:
    """Polynomials of the temperature in the gel current itself, highest power first."""
    p = skin.parameters
    keys, index = np.unique(
        np.stack([p["gel_current_20c_ua"], p["gel_current_ratio"]]), axis=1, return_inverse=True
    )
    temperature = np.linspace(15.0, 85.0, 200)
    fits = [np.polyfit(i20 * ratio ** ((temperature - 20.0) / 60.0), temperature, degree)
            for i20, ratio in keys.T]  # fmt: skip
    return np.array(fits).T[:, index.reshape(-1)]


@njit(error_model="numpy", nogil=True)
def _paper(counts, scale, offset, polynomial, p, out):
    for i in range(counts.shape[1]):
        current = scale[0, i] * counts[0, i] + offset[0, i]
        temperature = 0.0
        for j in range(polynomial.shape[0]):
            temperature = temperature * current + polynomial[j, i]
        drop = p[0, i] - (scale[1, i] * counts[1, i] + offset[1, i])
        depth = drop / p[1, i]
        if drop < p[2, i]:
            normal = p[3, i] * drop
        else:
            normal = p[3, i] * p[2, i] + p[4, i] * (drop - p[2, i])
        gain = 1.0 + p[13, i] * (scale[5, i] * counts[5, i] + offset[5, i] - p[14, i])
        bx = (scale[2, i] * counts[2, i] + offset[2, i]) / gain
        by = (scale[3, i] * counts[3, i] + offset[3, i]) / gain
        crest = p[5, i] * exp(p[6, i] * (depth - p[7, i]))
        crest *= 1.0 + p[8, i] * (temperature - p[9, i])
        reach = asin(min(hypot(bx, by) / crest, 1.0)) / p[10, i]
        tangential = p[11, i] * reach
        if reach > p[12, i]:
            tangential += p[15, i] * (reach - p[12, i])
        theta = atan2(by, bx)
        out[0, i] = temperature
        out[1, i] = tangential * cos(theta)
        out[2, i] = tangential * sin(theta)
        out[3, i] = normal
        out[4, i] = tangential
        out[5, i] = theta
        out[6, i] = reach * cos(theta)
        out[7, i] = reach * sin(theta)
        out[8, i] = depth


class Paper:
    """The paper's steps written out unit by unit, compiled: float64, branches, libm.

    Its temperature is a polynomial in the current, as in the paper's Fig. 3a.
    """

    NAMES = (
        "frequency_rest_hz", "frequency_slope_hz_per_mm", "normal_break_hz",
        "normal_soft_n_per_hz", "normal_stiff_n_per_hz", "field_amplitude_ut",
        "field_growth_per_mm", "field_reference_mm", "film_drift_per_k", "film_reference_c",
        "field_wavenumber_rad_per_mm", "shear_soft_n_per_mm", "shear_break_mm",
        "hall_gain_per_k", "hall_reference_c", "shear_stiff_n_per_mm",
    )  # fmt: skip

    def __init__(self, skin: Topology) -> None:
        parameters = np.stack([skin.parameters[name] for name in self.NAMES])
        self._fixed = (skin.scale, skin.offset, paper_polynomials(skin), parameters)
        self._out = np.empty((len(ROWS), skin.n))

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        _paper(counts, *self._fixed, self._out)
        return self._out


def exact(
    skin: Topology, counts: np.ndarray, units: np.ndarray, estimator: str = "sine"
) -> np.ndarray:
    """The model with 40 digits for some units; rows as in `ROWS`, rounded to float64."""
    try:
        from mpmath import mp, mpf
    except ImportError as error:
        raise SystemExit(
            "benchmarks: must have mpmath; not installed: pip install 'f3t-skin[test]'"
        ) from error
    out = np.empty((len(ROWS), units.size))
    with mp.workdps(40):
        for column, i in enumerate(units):
            p = {name: mpf(float(v[i])) for name, v in skin.parameters.items() if v.ndim == 1}
            current, frequency, bx, by, bz, chip = (
                mpf(float(skin.scale[c, i])) * int(counts[c, i]) + mpf(float(skin.offset[c, i]))
                for c in range(6)
            )
            t = 20 + 60 * mp.log(current / p["gel_current_20c_ua"], p["gel_current_ratio"])
            drop = p["frequency_rest_hz"] - frequency
            h = drop / p["frequency_slope_hz_per_mm"]
            over = max(drop - p["normal_break_hz"], 0)
            fz = p["normal_soft_n_per_hz"] * (drop - over) + p["normal_stiff_n_per_hz"] * over
            gain = 1 + p["hall_gain_per_k"] * (chip - p["hall_reference_c"])
            crest = p["field_amplitude_ut"] * mp.exp(
                p["field_growth_per_mm"] * (h - p["field_reference_mm"])
            )
            crest *= (1 + p["film_drift_per_k"] * (t - p["film_reference_c"])) * gain
            if estimator == "sine":
                r = mp.asin(min(mp.hypot(bx, by) / crest, 1)) / p["field_wavenumber_rad_per_mm"]
            else:
                table = [mpf(float(v)) for v in skin.parameters["field_angle_mm"][:, i]]
                psi = mp.atan2(mp.hypot(bx, by), bz)
                r = sum(table[4 * a + b] * psi ** (2 * a + 1) * h**b
                        for a in range(4) for b in range(4))  # fmt: skip
            ft = p["shear_soft_n_per_mm"] * r
            ft += p["shear_stiff_n_per_mm"] * max(r - p["shear_break_mm"], 0)
            theta = mp.atan2(by, bx)
            c, s = mp.cos(theta), mp.sin(theta)
            out[:, column] = [float(v) for v in (t, ft * c, ft * s, fz, ft, theta,
                                                 r * c, r * s, h)]  # fmt: skip
    return out
