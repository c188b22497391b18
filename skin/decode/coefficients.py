"""From the parameters of a topology to the blocks of coefficients that the kernel reads.

Scales, offsets and maps are multiplied out here, once, in float64; whatever the kernel can decide
on a raw count becomes a range of counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from bus.status import Status
from skin.decode import kernels as k
from skin.errors import CalibrationError
from topology import CHANNELS, THETA_KNOTS, Topology

__all__ = ["Coefficients", "current_ratio", "temperature_polynomial", "tidy_drop"]

TURN_MAX_RAD = 1.0
"""Largest correction of a direction; the kernel's sine and cosine hold this far."""
STRETCH_MAX = 0.2
"""A frequency this share above rest is no working unit: it would be pulled to 6/5 of its height."""
PULL_SIGMAS = 6.0
"""A unit that reads as pulled by more than this many sigma has lost its tare: EXTRAPOLATED."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """What the kernel must know of n units.

    Attributes
    ----------
    values : ndarray, shape (b * rows * LANES,), float32 or float64
        One block for every `LANES` units, or a single one where all units are alike.
    limits : ndarray, shape (b * LIMIT_ROWS * LANES,), int16
    turning : bool or None
        True where a unit corrects its direction, else None.
    """

    values: np.ndarray
    limits: np.ndarray
    turning: bool | None

    @classmethod
    def of(cls, topology: Topology, dtype: np.dtype) -> Coefficients:
        """Coefficients of a topology, for arithmetic in `dtype`.

        Raises
        ------
        CalibrationError
            A parameter is not one that a working unit can have.
        """
        _refuse_impossible(topology)
        turning = bool(topology.parameters["theta_correction_rad"].any())
        values = _values(topology, dtype)
        if turning:
            values = np.vstack([values, _turns(topology)])
        values = values.astype(dtype)
        limits = _limits(topology)
        if (values == values[:, :1]).all() and (limits == limits[:, :1]).all():
            values, limits = values[:, :1], limits[:, :1]
        return cls(_blocks(values), _blocks(limits), turning or None)


def _blocks(rows: np.ndarray) -> np.ndarray:
    """(rows, n) to flat blocks of `LANES` units; the last one is filled up with the last unit."""
    missing = -rows.shape[1] % k.LANES
    padded = np.pad(rows, ((0, 0), (0, missing)), mode="edge")
    blocks = padded.reshape(rows.shape[0], -1, k.LANES).transpose(1, 0, 2)
    return np.ascontiguousarray(blocks).reshape(-1)


def _values(topology: Topology, dtype: np.dtype) -> np.ndarray:
    """Rows of coefficients, shape (rows, n), float64; without the correction of the direction."""
    p = topology.parameters
    scale, offset, wired = topology.scale, topology.offset, topology.wired
    single = np.dtype(dtype) == np.float32
    degree = k.DEGREE_SINGLE if single else k.DEGREE_DOUBLE
    c = np.zeros((k.POLYNOMIAL + degree + 1, topology.n))

    # Without a gel current the film counts as being at its reference temperature.
    gel = wired[k.GEL]
    c[k.GEL_SCALE] = np.where(gel, scale[k.GEL] / p["gel_current_20c_ua"], 0.0)
    c[k.GEL_OFFSET] = np.where(gel, offset[k.GEL] / p["gel_current_20c_ua"], 0.0)
    root_scale, root_offset, polynomial = temperature_polynomial(
        p["gel_current_ratio"], p["temperature_min_c"], p["temperature_max_c"], degree
    )
    c[k.ROOT_SCALE], c[k.ROOT_OFFSET] = root_scale, root_offset
    c[k.POLYNOMIAL :] = np.where(gel, polynomial, 0.0)
    c[k.POLYNOMIAL, ~gel] = p["film_reference_c"][~gel]

    c[k.DROP_SCALE] = -scale[k.FREQUENCY]
    c[k.DROP_OFFSET] = p["frequency_rest_hz"] - offset[k.FREQUENCY]
    depth_per_hz = 1.0 / p["frequency_slope_hz_per_mm"]
    c[k.DEPTH_PER_HZ] = depth_per_hz
    c[k.SOFT] = p["normal_soft_n_per_hz"]
    c[k.BREAK] = p["normal_break_hz"]
    c[k.STIFFER] = p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]

    period_s = 1.0 / topology.cycle_rate_hz
    c[k.FILM_KEEP] = _kept(period_s, p["film_lag_s"])
    c[k.CHIP_KEEP] = _kept(period_s, p["hall_lag_s"])
    c[k.FILM_REFERENCE] = p["film_reference_c"]
    c[k.FILM_DRIFT] = p["film_drift_per_k"]
    chip = wired[k.CHIP]
    c[k.CHIP_SCALE] = np.where(chip, scale[k.CHIP], 0.0)
    c[k.CHIP_OFFSET] = np.where(chip, offset[k.CHIP], 0.0) - p["hall_reference_c"]
    c[k.CHIP_FOLLOWS] = np.where(chip, 0.0, 1.0)
    c[k.CHIP_OFFSET, ~chip & ~gel] = c[k.CHIP_FOLLOWS, ~chip & ~gel] = 0.0
    c[k.CHIP_GAIN] = p["hall_gain_per_k"]

    for row, axis in ((k.X_BX, "x"), (k.Y_BX, "y")):
        from_x, from_y = p[f"field_{axis}x"], p[f"field_{axis}y"]
        c[row] = from_x * scale[k.BX]
        c[row + 1] = from_y * scale[k.BY]
        c[row + 2] = from_x * (offset[k.BX] - p["hall_offset_x_ut"]) + from_y * (
            offset[k.BY] - p["hall_offset_y_ut"]
        )
        c[row + 3] = -from_x * p["hall_drift_x_ut_per_k"] - from_y * p["hall_drift_y_ut_per_k"]

    growth, reference = p["field_growth_per_mm"], p["field_reference_mm"]
    c[k.GROWTH] = -growth * depth_per_hz
    c[k.GROWTH_OFFSET] = growth * reference
    c[k.AMPLITUDE_INVERSE] = 1.0 / p["field_amplitude_ut"]
    c[k.WAVENUMBER_INVERSE] = 1.0 / p["field_wavenumber_rad_per_mm"]
    c[k.SHEAR_SOFT] = p["shear_soft_n_per_mm"]
    c[k.SHEAR_BREAK] = p["shear_break_mm"]
    c[k.SHEAR_STIFFER] = p["shear_stiff_n_per_mm"]
    c[k.SHEAR_GAIN] = p["shear_gain_per_mm"] * depth_per_hz
    c[k.SHEAR_GAIN_OFFSET] = 1.0 - p["shear_gain_per_mm"] * reference

    step_ut2 = 0.5 * (scale[k.BX] ** 2 + scale[k.BY] ** 2)
    c[k.FIELD_VARIANCE] = p["field_noise_ut"] ** 2 + step_ut2 / 12.0
    c[k.AMPLITUDE_VARIANCE] = (growth * depth_per_hz * _frequency_sigma_hz(topology)) ** 2
    # No field reaches beyond the crest, and one that touches it is SATURATED.
    crest_mm = 0.5 * np.pi / p["field_wavenumber_rad_per_mm"]
    reach = p["tangential_max_mm"]
    c[k.REACH] = np.where(reach < crest_mm * (1.0 - 1e-6), reach, np.inf)
    return c


def _kept(period_s: float, lag_s: np.ndarray) -> np.ndarray:
    """Share of a one-pole filter's lag that is left after one cycle; 0 without a filter."""
    with np.errstate(divide="ignore"):
        return np.exp(-period_s / lag_s)


def _frequency_sigma_hz(topology: Topology) -> np.ndarray:
    noise = topology.parameters["frequency_noise_hz"]
    return np.hypot(noise, topology.scale[k.FREQUENCY] / np.sqrt(12.0))


def current_ratio(temperature: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Gel current over its value at 20 °C; `ratio` is that of 80 °C."""
    return ratio ** ((temperature - 20.0) / 60.0)


def temperature_polynomial(
    ratio: np.ndarray, low: np.ndarray, high: np.ndarray, degree: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polynomial of the temperature in the fourth root of the gel current.

    The root is two square roots, and the polynomial needs half the degree that one in the current
    itself would need. It is interpolated at Chebyshev nodes and is within 1e-4 °C (degree 8) and
    1e-9 °C (degree 16) of the law over 15-95 °C at a ratio of 12.

    Parameters
    ----------
    ratio : ndarray, shape (n,)
        Current at 80 °C over current at 20 °C.
    low, high : ndarray, shape (n,)
        Degree Celsius, range of the fit.
    degree : int

    Returns
    -------
    scale, offset : ndarray, shape (n,)
        ``z = scale * root + offset`` lies in [-1, 1] over the range.
    polynomial : ndarray, shape (degree + 1, n)
        Degree Celsius in powers of z, lowest first.
    """
    low_root, high_root = current_ratio(low, ratio) ** 0.25, current_ratio(high, ratio) ** 0.25
    middle, half = 0.5 * (high_root + low_root), 0.5 * (high_root - low_root)
    nodes = 4 * (degree + 1)
    angle = np.pi * (np.arange(nodes) + 0.5) / nodes
    root = middle + half * np.cos(angle)[:, np.newaxis]
    temperature = 20.0 + 240.0 * np.log(root) / np.log(ratio)
    waves = np.cos(np.outer(np.arange(degree + 1), angle))
    series = _product(waves, temperature) * (2.0 / nodes)
    series[0] *= 0.5
    powers = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        powers[: i + 1, i] = chebyshev.cheb2poly(np.eye(degree + 1)[i, : i + 1])
    return 1.0 / half, -middle / half, _product(powers, series)


def _product(matrix: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Matrix product whose every column is the same to the bit, however many there are."""
    return sum(np.outer(column, row) for column, row in zip(matrix.T, columns, strict=True))


def _turns(topology: Topology) -> np.ndarray:
    """Rows of the direction's correction: start at -pi, first slope, changes of slope."""
    knots = topology.parameters["theta_correction_rad"]
    slope = np.diff(np.vstack([knots, knots[:1]]), axis=0) * (THETA_KNOTS / (2.0 * np.pi))
    return np.vstack([knots[:1], slope[:1], np.diff(slope, axis=0)])


def _limits(topology: Topology) -> np.ndarray:
    """Rows of limits, shape (LIMIT_ROWS, n), int16."""
    p = topology.parameters
    out = np.empty((k.LIMIT_ROWS, topology.n))
    out[k.LIMIT_STATUS] = np.where(topology.enabled, 0, int(Status.DISABLED))
    out[k.LIMIT_STATUS] += np.where(topology.counts_only, int(Status.NOT_F3T), 0)
    _rails(topology, out[k.LIMIT_RAIL : k.LIMIT_POSSIBLE])

    low, high = p["temperature_min_c"], p["temperature_max_c"]
    span = 0.5 * (high - low)
    coldest, warmest = low - span, high + span
    out[k.LIMIT_POSSIBLE + 4 : k.LIMIT_CALIBRATED] = _counts(topology, k.CHIP, coldest, warmest)
    for row, ends in ((k.LIMIT_POSSIBLE, (coldest, warmest)),
                      (k.LIMIT_CALIBRATED, (low, high))):  # fmt: skip
        current = [p["gel_current_20c_ua"] * current_ratio(t, p["gel_current_ratio"]) for t in ends]
        out[row : row + 2] = _counts(topology, k.GEL, *current)

    rest = p["frequency_rest_hz"]
    one_step = np.abs(topology.scale[k.FREQUENCY])
    out[k.LIMIT_POSSIBLE + 2 : k.LIMIT_POSSIBLE + 4] = _counts(
        topology, k.FREQUENCY, one_step, (1.0 + STRETCH_MAX) * rest
    )
    least, most = tidy_drop(topology)
    out[k.LIMIT_CALIBRATED + 2 : k.LIMIT_CALIBRATED + 4] = _counts(
        topology, k.FREQUENCY, rest - most, rest - least
    )
    return out.astype(np.int16)


def tidy_drop(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Range of the frequency's fall, Hz, that is neither a lost tare nor beyond calibration.

    It ends where the normal force does, and where `GROWTH_MAX` bounds the growth of the field.
    """
    p = topology.parameters
    slope = p["frequency_slope_hz_per_mm"]
    soft, stiff, knee = (p[f"normal_{part}"] for part in
                         ("soft_n_per_hz", "stiff_n_per_hz", "break_hz"))  # fmt: skip
    force = p["normal_max_n"]
    most = np.where(force <= soft * knee, force / soft, knee + (force - soft * knee) / stiff)
    bound = k.GROWTH_MAX / p["field_growth_per_mm"]
    deepest = (p["field_reference_mm"] + bound) * slope
    highest = (p["field_reference_mm"] - bound) * slope
    return np.maximum(-PULL_SIGMAS * _frequency_sigma_hz(topology), highest), np.minimum(
        most, deepest
    )


def _counts(topology: Topology, channel: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Counts within a range of physical values, both ends; all counts if it is not wired."""
    scale = np.where(topology.wired[channel], topology.scale[channel], 1.0)
    ends = (np.stack([low, high]) - topology.offset[channel]) / scale
    ends.sort(axis=0)
    ends = np.stack([np.ceil(ends[0] - 1e-6), np.floor(ends[1] + 1e-6)]).clip(-32768, 32767)
    return np.where(topology.wired[channel], ends, [[-32768], [32767]])


def _rails(topology: Topology, out: np.ndarray) -> None:
    """Counts that are not at a rail; the first and the last count of a signal are.

    Bz has none here: this estimator does not use it. Zero is no rail of an unsigned signal: it is
    an impossible count where it means anything.
    """
    out[0::2], out[1::2] = -32768, 32767
    frames = topology.frames
    for number, layout in enumerate(topology.layouts):
        units = frames.units[frames.layout == number]
        for signal in layout.signals:
            if signal.name not in CHANNELS or signal.name == "bz":
                continue
            slot = units[:, signal.slot]
            slot = slot[slot >= 0]
            row = 2 * CHANNELS.index(signal.name)
            bits = signal.length - signal.signed
            out[row + 1, slot] = min(2**bits, 32768) - 2
            if signal.signed:
                out[row, slot] = 1 - 2**bits


def _refuse_impossible(topology: Topology) -> None:
    """Raise for the first parameter that would make a reading meaningless."""
    p = topology.parameters

    def refuse(wrong: np.ndarray, name: str, expected: str) -> None:
        if wrong.any():
            unit = int(np.argmax(wrong))
            value = p[name][..., unit]
            shown = f"{value:g}" if value.ndim == 0 else np.array2string(value, precision=4)
            where = f"{topology.unit_names[unit]}: {name}"
            raise CalibrationError(f"{where}: must be {expected}; got {shown}")

    for name, values in p.items():
        wrong = ~np.isfinite(values)
        refuse(wrong.any(axis=0) if wrong.ndim > 1 else wrong, name, "finite")
    low, high = p["temperature_min_c"], p["temperature_max_c"]
    refuse(high <= low, "temperature_max_c", "above temperature_min_c")
    span = 0.5 * (high - low)
    for drift, reference in (("film_drift_per_k", "film_reference_c"),
                             ("hall_gain_per_k", "hall_reference_c")):  # fmt: skip
        worst = np.minimum(
            *(1.0 + p[drift] * (t - p[reference]) for t in (low - span, high + span))
        )
        refuse(worst < k.GAIN_MIN, drift, f"a drift that leaves a gain of {k.GAIN_MIN:g} or more")
    turn = np.abs(p["theta_correction_rad"]).max(axis=0)
    refuse(turn > TURN_MAX_RAD, "theta_correction_rad", f"within {TURN_MAX_RAD:g} rad of 0 (turn "
           "the axes by field_xx, field_xy, field_yx, field_yy)")  # fmt: skip
