"""What the decoder is measured against: numpy, the paper written out, bare arithmetic, 40 digits.

The peers take the same counts and give the same quantities of one cycle. They do less: no status
flags, no lag of the film behind the gel. `exact` shares no code with the decoder.
"""

from __future__ import annotations

import dataclasses
from math import asin, atan2, cos, exp, hypot, sin

import numpy as np
from numba import njit

import topology
from bus.compiled.aligned import zeros
from bus.compiled.intrinsics import assume_noalias
from topology import Topology

ROWS = ("temperature", "fx", "fy", "fz", "tangential", "theta", "x", "y", "h")

SPREAD = {
    "gel_current_ratio": 0.05,
    "frequency_rest_hz": 0.02,
    "frequency_slope_hz_per_mm": 0.03,
    "field_amplitude_ut": 0.05,
    "field_wavenumber_rad_per_mm": 0.03,
    "shear_soft_n_per_mm": 0.05,
}
"""Relative spread of the parameters that differ from unit to unit."""


def array_of(n: int, *, alike: bool, seed: int = 0) -> Topology:
    """A skin of n units: the ready-made palm, repeated."""
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
    return dataclasses.replace(
        palm,
        frames=dataclasses.replace(
            frames,
            units=np.where(units < n, units, -1).astype(np.int32),
            **{name: np.tile(getattr(frames, name), times)
               for name in ("bus", "can_id", "layout", "part")},
        ),
        unit_names=tuple(map(str, range(n))),
        parameters=parameters,
        enabled=repeat(palm.enabled),
        scale=repeat(palm.scale),
        offset=repeat(palm.offset),
        wired=repeat(palm.wired),
        calibrated=repeat(palm.calibrated),
        tared=repeat(palm.tared),
    )  # fmt: skip


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


LANES = 16
"""Units in a block of `Bare`, which takes whole blocks: a vector of float32."""
EXPONENTIAL = 8
"""Degree of its series for the growth of the field."""
(
    GEL_SCALE, GEL_OFFSET, WARM_4, WARM_3, WARM_2, WARM_1, WARM_0,
    DEPTH_SCALE, DEPTH_OFFSET, SOFT, BREAK, STIFFER,
    X_BX, X_BY, X_OFFSET, Y_BX, Y_BY, Y_OFFSET, CHIP_GAIN, CHIP_OFFSET, FILM_GAIN, FILM_OFFSET,
    GROWTH, GROWTH_OFFSET, CREST, REACH, SHEAR_SOFT, SHEAR_BREAK, SHEAR_STIFFER,
    BARE_ROWS,
) = range(30)  # fmt: skip


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def _bare(counts, c, series, out):
    assume_noalias()
    real = c.dtype.type
    zero, half, one = real(0.0), real(0.5), real(1.0)
    for block in range(counts.shape[1] // LANES):
        at = block * BARE_ROWS * LANES
        for lane in range(LANES):
            i, k = block * LANES + lane, at + lane
            current = c[k + GEL_SCALE * LANES] * real(counts[0, i]) + c[k + GEL_OFFSET * LANES]
            u = np.sqrt(np.sqrt(current))
            t = (c[k + WARM_4 * LANES] * u + c[k + WARM_3 * LANES]) * u + c[k + WARM_2 * LANES]
            t = (t * u + c[k + WARM_1 * LANES]) * u + c[k + WARM_0 * LANES]
            depth = c[k + DEPTH_SCALE * LANES] * real(counts[1, i]) + c[k + DEPTH_OFFSET * LANES]
            over = max(depth - c[k + BREAK * LANES], zero)
            out[3, i] = c[k + SOFT * LANES] * depth + c[k + STIFFER * LANES] * over
            bx, by = real(counts[2, i]), real(counts[3, i])
            x = c[k + X_BX * LANES] * bx + c[k + X_BY * LANES] * by + c[k + X_OFFSET * LANES]
            y = c[k + Y_BX * LANES] * bx + c[k + Y_BY * LANES] * by + c[k + Y_OFFSET * LANES]
            gain = c[k + CHIP_GAIN * LANES] * real(counts[5, i]) + c[k + CHIP_OFFSET * LANES]
            gain *= c[k + FILM_GAIN * LANES] * t + c[k + FILM_OFFSET * LANES]
            grown = c[k + GROWTH * LANES] * depth + c[k + GROWTH_OFFSET * LANES]
            crest = series[0]
            for power in range(1, EXPONENTIAL + 1):
                crest = crest * grown + series[power]
            crest *= c[k + CREST * LANES] * gain
            strength = max(np.sqrt(x * x + y * y), real(1e-6))
            each = one / (strength * crest)
            ratio = min(strength * strength * each, one)
            large = ratio > half
            rest = (one - ratio) * half
            z = rest if large else ratio * ratio
            s = np.sqrt(rest) if large else ratio
            p = real(0.0421663783)
            p = p * z + real(0.0241794679)
            p = p * z + real(0.0454703867)
            p = p * z + real(0.0749529749)
            p = p * z + real(0.166667521)
            arc = s + s * (z * p)
            arc = real(0.5 * np.pi) - (arc + arc) if large else arc
            reach = c[k + REACH * LANES] * arc
            over = max(reach - c[k + SHEAR_BREAK * LANES], zero)
            force = c[k + SHEAR_SOFT * LANES] * reach + c[k + SHEAR_STIFFER * LANES] * over
            force *= each * crest
            out[0, i] = t
            out[1, i] = force * x
            out[2, i] = force * y


class Bare:
    """Temperature and force of units with a calibration each, float32: the arithmetic alone.

    The polynomials and blocks of a fast kernel, and nothing else: no flags, limits, lags, ranges of
    validity or guard against wild counts. What a decoder takes beyond this is the price of trust;
    this itself says how fast the processor is.
    """

    def __init__(self, skin: Topology) -> None:
        p, scale, offset = skin.parameters, skin.scale, skin.offset
        c = np.zeros((BARE_ROWS, skin.n))
        c[GEL_SCALE] = scale[0] / p["gel_current_20c_ua"]
        c[GEL_OFFSET] = offset[0] / p["gel_current_20c_ua"]
        temperature = np.linspace(10.0, 90.0, 200)
        for i, ratio in enumerate(p["gel_current_ratio"]):
            root = ratio ** ((temperature - 20.0) / 240.0)
            c[WARM_4 : WARM_0 + 1, i] = np.polyfit(root, temperature, 4)
        per_hz = 1.0 / p["frequency_slope_hz_per_mm"]
        c[DEPTH_SCALE] = -scale[1] * per_hz
        c[DEPTH_OFFSET] = (p["frequency_rest_hz"] - offset[1]) * per_hz
        c[SOFT] = p["normal_soft_n_per_hz"] / per_hz
        c[BREAK] = p["normal_break_hz"] * per_hz
        c[STIFFER] = (p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]) / per_hz
        still = [offset[2 + a] - p[f"hall_offset_{axis}_ut"] for a, axis in enumerate("xy")]
        for row, axis in ((X_BX, "x"), (Y_BX, "y")):
            share = p[f"field_{axis}x"], p[f"field_{axis}y"]
            c[row], c[row + 1] = share[0] * scale[2], share[1] * scale[3]
            c[row + 2] = share[0] * still[0] + share[1] * still[1]
        c[CHIP_GAIN] = p["hall_gain_per_k"] * scale[5]
        c[CHIP_OFFSET] = 1.0 + p["hall_gain_per_k"] * (offset[5] - p["hall_reference_c"])
        c[FILM_GAIN] = p["film_drift_per_k"]
        c[FILM_OFFSET] = 1.0 - p["film_drift_per_k"] * p["film_reference_c"]
        c[GROWTH], c[GROWTH_OFFSET] = p["field_growth_per_mm"], -p["field_growth_per_mm"]
        c[CREST] = p["field_amplitude_ut"] * np.exp(
            p["field_growth_per_mm"] * (1.0 - p["field_reference_mm"])
        )
        c[REACH] = 1.0 / p["field_wavenumber_rad_per_mm"]
        c[SHEAR_SOFT] = p["shear_soft_n_per_mm"]
        c[SHEAR_BREAK] = p["shear_break_mm"]
        c[SHEAR_STIFFER] = p["shear_stiff_n_per_mm"]
        blocks = c.reshape(BARE_ROWS, -1, LANES).transpose(1, 0, 2)
        self._coefficients = zeros(blocks.shape, np.float32)
        self._coefficients[:] = blocks
        factorial = np.cumprod([1.0, *range(1, EXPONENTIAL + 1)])
        self._series = (1.0 / factorial[::-1]).astype(np.float32)
        self._out = zeros((4, skin.n), np.float32)

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        _bare(counts, self._coefficients.reshape(-1), self._series, self._out)
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
