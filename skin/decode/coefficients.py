"""From the parameters of a topology to the blocks of coefficients that the kernel reads.

Scales, offsets and maps are multiplied out here, once, in float64; whatever the kernel can decide
on a raw count becomes a range of counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bus.compiled.aligned import zeros
from bus.status import Status
from skin.decode import layout as k
from skin.decode.functions import OCTAVES_MAX
from skin.decode.laws import GAIN_MIN
from skin.errors import CalibrationError
from topology import CHANNELS, THETA_KNOTS, Topology
from topology.model import FIELD_ANGLE_TERMS

__all__ = ["Coefficients", "current_ratio", "tidy_drop"]

TURN_MAX_RAD = 1.0
"""Largest correction of a direction; the kernel's sine and cosine hold this far."""
STRETCH_MAX = 0.2
"""A frequency this share above rest is no working unit: it would be pulled to 6/5 of its height."""
PULL_SIGMAS = 6.0
"""A unit that reads as pulled by more than this many sigma has lost its tare: EXTRAPOLATED."""
IDLE_SIGMAS = 2.9
"""A unit pressed by less than this many sigma is without load: no contact takes it (3 sigma)."""
OVERREACH = 1.1
"""R from the angle is told to this many times its calibrated range; a lower bound beyond."""
STEP_SIGMA = 12.0**-0.5
"""One-sigma of rounding, in steps."""
ANOMALY_SIGMAS = 5.0
ANOMALY_SHARE = 0.15
"""Share of the field by which a unit that was never calibrated may miss its model [assumed]."""
STRAY_UT, STRAY_KNOWN_UT = 1000.0, 300.0
"""What neighbours may add to the field: all of it, or what is left where their fields at rest are
known [assumed; the field of touching units at rest is 1.07 mT]."""
NO_END_MM = 1e9
OCTAVES_MARGIN = 0.9


@dataclass(frozen=True, eq=False)
class Coefficients:
    """What the kernel must know of n units.

    Attributes
    ----------
    values : ndarray, shape (b * ROWS * LANES,), float32 or float64
        One block for every `LANES` units, or a single one where all units are alike.
    limits : ndarray, shape (b * LIMIT_ROWS * LANES,), int16
        Blocked in the same way; a single block where these are alike.
    turning : bool
        Whether any unit corrects its direction by a table.
    """

    values: np.ndarray
    limits: np.ndarray
    turning: bool

    @classmethod
    def of(
        cls,
        topology: Topology,
        dtype: np.dtype,
        *,
        angle: bool = False,
        vertical: bool = False,
        every: int = 1,
        rest_ut: np.ndarray | None = None,
        felt_ut: np.ndarray | None = None,
    ) -> Coefficients:
        """Coefficients of a topology, for arithmetic in `dtype`.

        Parameters
        ----------
        topology : Topology
        dtype : dtype
        angle : bool
            Whether R comes from the angle of the field.
        vertical : bool
            Whether Bz is used at all, and so has rails to be held to.
        every : int
            Cycles from one temperature to the next.
        rest_ut : ndarray, shape (3, n), optional
            Field that resting neighbours add, axes of the chips, and that the offsets do not hold.
            Without it the model of the field is held to less.
        felt_ut : ndarray, shape (3, n), optional
            The same, whether the offsets hold it or not: it is read with the chip's gain as it is.

        Raises
        ------
        CalibrationError
            A parameter is not one that a working unit can have.
        """
        _refuse_impossible(topology)
        values = _values(topology, angle, every, rest_ut, felt_ut).astype(dtype)
        limits = _limits(topology, vertical)
        turning = bool(topology.parameters["theta_correction_rad"].any())
        return cls(_blocks(_once(values)), _blocks(_once(limits)), turning)


def _once(rows: np.ndarray) -> np.ndarray:
    """The first column alone, where all are the same."""
    first = rows[:, :1]
    same = (rows == first) | (np.isnan(rows) & np.isnan(first))
    return first if same.all() else rows


def _blocks(rows: np.ndarray) -> np.ndarray:
    """(rows, n) to flat blocks of `LANES` units; the last one is filled up with the last unit."""
    missing = -rows.shape[1] % k.LANES
    padded = np.pad(rows, ((0, 0), (0, missing)), mode="edge")
    blocks = padded.reshape(rows.shape[0], -1, k.LANES).transpose(1, 0, 2)
    out = zeros(blocks.shape, rows.dtype)
    out[:] = blocks
    return out.reshape(-1)


def _values(
    topology: Topology,
    angle: bool,
    every: int,
    rest_ut: np.ndarray | None,
    felt_ut: np.ndarray | None,
) -> np.ndarray:
    """Rows of coefficients, shape (ROWS, n), float64."""
    p = topology.parameters
    scale, offset, wired = topology.scale, topology.offset, topology.wired
    c = np.zeros((k.ROWS, topology.n))
    octave_c = 60.0 * np.log(2.0) / np.log(p["gel_current_ratio"])

    # Without a gel current the film counts as being at its reference temperature.
    gel = wired[k.GEL]
    c[k.GEL_SCALE] = np.where(gel, scale[k.GEL] / p["gel_current_20c_ua"], 0.0)
    c[k.GEL_OFFSET] = np.where(
        gel,
        offset[k.GEL] / p["gel_current_20c_ua"],
        2.0 ** ((p["film_reference_c"] - 20.0) / octave_c),
    )
    c[k.PER_OCTAVE] = octave_c
    per_share = octave_c / np.log(2.0)
    c[k.GEL_VARIANCE] = np.where(
        gel, (per_share * p["gel_noise_relative"]) ** 2 + p["temperature_sigma_c"] ** 2, 0.0
    )
    c[k.GEL_STEP] = per_share * np.abs(c[k.GEL_SCALE]) * STEP_SIGMA
    c[k.GEL_LOW], c[k.GEL_HIGH] = p["temperature_min_c"], p["temperature_max_c"]

    per_hz = 1.0 / p["frequency_slope_hz_per_mm"]
    slope = p["frequency_slope_hz_per_mm"]
    c[k.PER_HZ] = per_hz
    c[k.DEPTH_SCALE] = -scale[k.FREQUENCY] * per_hz
    c[k.DEPTH_OFFSET] = (p["frequency_rest_hz"] - offset[k.FREQUENCY]) * per_hz
    c[k.SOFT] = p["normal_soft_n_per_hz"] * slope
    c[k.BREAK] = p["normal_break_hz"] * per_hz
    c[k.STIFFER] = (p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]) * slope
    c[k.DEPTH_SIGMA] = frequency_sigma_hz(topology) * per_hz
    c[k.DEPTH_LOW], c[k.DEPTH_HIGH] = (end * per_hz for end in tidy_drop(topology))
    c[k.NORMAL_VARIANCE] = p["normal_sigma_relative"] ** 2

    step_s = every / topology.cycle_rate_hz
    c[k.FILM_KEEP] = _kept(step_s, p["film_lag_s"])
    c[k.CHIP_KEEP] = _kept(step_s, p["hall_lag_s"])
    c[k.FILM_REFERENCE] = p["film_reference_c"]
    c[k.FILM_DRIFT] = p["film_drift_per_k"]
    chip = wired[k.CHIP]
    c[k.CHIP_SCALE] = np.where(chip, scale[k.CHIP], 0.0)
    c[k.CHIP_OFFSET] = np.where(chip, offset[k.CHIP], 0.0) - p["hall_reference_c"]
    c[k.CHIP_FOLLOWS] = np.where(chip, 0.0, 1.0)
    c[k.CHIP_OFFSET, ~chip & ~gel] = c[k.CHIP_FOLLOWS, ~chip & ~gel] = 0.0
    c[k.CHIP_GAIN] = p["hall_gain_per_k"]

    rest = np.zeros((3, topology.n)) if rest_ut is None else rest_ut
    still = [
        offset[k.BX + i] - p[f"hall_offset_{axis}_ut"] - rest[i] for i, axis in enumerate("xyz")
    ]
    felt = np.zeros((3, topology.n)) if felt_ut is None else felt_ut
    drift = [
        p[f"hall_drift_{axis}_ut_per_k"] + p["hall_gain_per_k"] * felt[i]
        for i, axis in enumerate("xyz")
    ]
    for row, axis in ((k.X_BX, "x"), (k.Y_BX, "y")):
        from_x, from_y = p[f"field_{axis}x"], p[f"field_{axis}y"]
        c[row] = from_x * scale[k.BX]
        c[row + 1] = from_y * scale[k.BY]
        c[row + 2] = from_x * still[0] + from_y * still[1]
        c[row + 3] = -from_x * drift[0] - from_y * drift[1]
    c[k.MAP_XX], c[k.MAP_XY] = p["field_xx"], p["field_xy"]
    c[k.MAP_YX], c[k.MAP_YY] = p["field_yx"], p["field_yy"]
    c[k.Z_BZ] = scale[k.BZ]
    c[k.Z_OFFSET] = np.where(wired[k.BZ], still[2], np.nan)
    c[k.Z_DRIFT] = -drift[2]

    reference = p["field_reference_mm"]
    linear, curved = p["field_growth_per_mm"], p["field_growth_per_mm2"]
    c[k.GROWTH_0] = np.log(p["field_amplitude_ut"]) + (curved * reference - linear) * reference
    c[k.GROWTH_1] = linear - 2.0 * curved * reference
    c[k.GROWTH_2] = curved
    c[k.GROWTH_0 : k.GROWTH_2 + 1] /= np.log(2.0)
    c[k.WAVENUMBER] = p["field_wavenumber_rad_per_mm"]
    c[k.WAVENUMBER_INVERSE] = 1.0 / p["field_wavenumber_rad_per_mm"]
    c[k.FILM_X], c[k.FILM_Y] = p["film_x_mm"], p["film_y_mm"]
    c[k.ANGLE : k.ANGLE + FIELD_ANGLE_TERMS] = p["field_angle_mm"]
    c[k.ANGLE_END], angle_reach_mm = field_angle_ends(topology)
    if angle:
        _refuse_short_table(topology, angle_reach_mm)
    c[k.SHEAR_SOFT] = p["shear_soft_n_per_mm"]
    c[k.SHEAR_BREAK] = p["shear_break_mm"]
    c[k.SHEAR_STIFFER] = p["shear_stiff_n_per_mm"]
    c[k.SHEAR_GAIN] = p["shear_gain_per_mm"]
    c[k.SHEAR_GAIN_OFFSET] = 1.0 - p["shear_gain_per_mm"] * reference
    c[k.SHEAR_VARIANCE] = p["shear_sigma_relative"] ** 2
    c[k.ANGLE_VARIANCE] = p["field_angle_sigma_mm"] ** 2 if angle else 0.0

    # What the temperatures leave of the drifts they compensate: the chip's own is read in steps.
    chip_c2 = np.where(chip, (scale[k.CHIP] * STEP_SIGMA) ** 2, c[k.GEL_VARIANCE])
    drift2 = 0.5 * (p["hall_drift_x_ut_per_k"] ** 2 + p["hall_drift_y_ut_per_k"] ** 2)
    step2 = 0.5 * (scale[k.BX] ** 2 + scale[k.BY] ** 2) * STEP_SIGMA**2
    stretch2 = 0.5 * sum(p[f"field_{entry}"] ** 2 for entry in ("xx", "xy", "yx", "yy"))
    c[k.FIELD_VARIANCE] = stretch2 * (p["field_noise_ut"] ** 2 + step2 + drift2 * chip_c2)
    c[k.FIELD_VARIANCE] += p["field_sigma_ut"] ** 2
    c[k.AMPLITUDE_VARIANCE] = (
        p["field_amplitude_sigma_relative"] ** 2
        + p["film_drift_per_k"] ** 2 * c[k.GEL_VARIANCE]
        + p["hall_gain_per_k"] ** 2 * chip_c2
    )
    sigmas2 = ANOMALY_SIGMAS**2
    depth2 = (linear * c[k.DEPTH_SIGMA]) ** 2
    c[k.ANOMALY_SHARE] = ANOMALY_SHARE**2 + sigmas2 * (c[k.AMPLITUDE_VARIANCE] + depth2)
    stray2 = (STRAY_UT if rest_ut is None else STRAY_KNOWN_UT) ** 2
    c[k.ANOMALY_FIELD] = stray2 + sigmas2 * c[k.FIELD_VARIANCE]

    if angle:
        c[k.REACH] = p["field_angle_max_mm"]
    else:
        # No field reaches beyond the crest, and one that touches it is SATURATED.
        crest_mm = 0.5 * np.pi / p["field_wavenumber_rad_per_mm"]
        reach = p["tangential_max_mm"]
        c[k.REACH] = np.where(reach < crest_mm * (1.0 - 1e-6), reach, NO_END_MM)

    knots = p["theta_correction_rad"]
    bend = np.diff(np.vstack([knots, knots[:1]]), axis=0) * (THETA_KNOTS / (2.0 * np.pi))
    c[k.TURN :] = np.vstack([knots[:1], bend[:1], np.diff(bend, axis=0)])
    return c


def _kept(step_s: float, lag_s: np.ndarray) -> np.ndarray:
    """Share of a one-pole filter's lag that is left after a step; 0 without a filter."""
    with np.errstate(divide="ignore"):
        return np.exp(-step_s / lag_s)


def frequency_sigma_hz(topology: Topology) -> np.ndarray:
    """One-sigma of a unit's frequency, Hz, shape (n,): noise, quantisation, frequency at rest."""
    p = topology.parameters
    step = topology.scale[k.FREQUENCY] * STEP_SIGMA
    return np.sqrt(p["frequency_noise_hz"] ** 2 + step**2 + p["frequency_sigma_hz"] ** 2)


def current_ratio(temperature: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Gel current over its value at 20 °C; `ratio` is that of 80 °C."""
    return ratio ** ((temperature - 20.0) / 60.0)


def field_angle_ends(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Where the table of R(psi, H) ends for good, over all calibrated depths.

    That is where R has passed the calibrated range by `OVERREACH` at one of the depths, or ceases
    to grow with the angle.

    Returns
    -------
    angle : ndarray, shape (n,)
        Radian.
    reach_mm : ndarray, shape (n,)
        Least R at that angle; 0 without a table.
    """
    p = topology.parameters
    deepest = tidy_drop(topology)[1] / p["frequency_slope_hz_per_mm"]
    keys = np.vstack([p["field_angle_mm"], p["field_angle_max_mm"], np.ceil(deepest * 4.0) / 4.0])
    keys, inverse = np.unique(_once(keys), axis=1, return_inverse=True)
    found = np.array([_table_end(*key) for key in keys.T]).T
    return tuple(np.broadcast_to(found[:, inverse.reshape(-1)], (2, topology.n)))


def _table_end(*key: float) -> tuple[float, float]:
    """Last angle at which R grows with it at all depths, rad, and the least R there, mm."""
    table, most, deepest = np.reshape(key[:-2], (4, 4)), key[-2], key[-1]
    angle = np.linspace(0.0, np.pi, 361)
    depth = np.linspace(0.0, deepest, 9)
    odd = angle[:, np.newaxis] ** (2 * np.arange(4) + 1)
    reach = odd @ table @ (depth ** np.arange(4)[:, np.newaxis])
    over = ((np.diff(reach, axis=0) <= 0.0) | (reach[1:] > OVERREACH * most)).any(axis=1)
    last = int(np.argmax(over)) if over.any() else len(angle) - 1
    return float(angle[last]), float(reach[last].min())


def _limits(topology: Topology, vertical: bool) -> np.ndarray:
    """Rows of limits, shape (LIMIT_ROWS, n), int16."""
    p = topology.parameters
    out = np.empty((k.LIMIT_ROWS, topology.n))
    out[k.LIMIT_STATUS] = np.where(topology.enabled, 0, int(Status.DISABLED))
    out[k.LIMIT_STATUS] += np.where(topology.counts_only, int(Status.NOT_F3T), 0)
    _rails(topology, vertical, out[k.LIMIT_RAIL : k.LIMIT_POSSIBLE])

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
    least_load = IDLE_SIGMAS * frequency_sigma_hz(topology)
    out[k.LIMIT_IDLE : k.LIMIT_IDLE + 2] = _counts(
        topology, k.FREQUENCY, rest - least_load, np.full(topology.n, np.inf)
    )
    _usual(out)
    out[k.LIMIT_RAIL + 1 :: 2] -= out[k.LIMIT_RAIL :: 2]
    return out.astype(np.int64).astype(np.int16)


def _usual(out: np.ndarray) -> None:
    """Counts that are within all ranges of their channel, from the other rows."""
    held_to = {
        k.GEL: (k.LIMIT_POSSIBLE, k.LIMIT_CALIBRATED),
        k.FREQUENCY: (k.LIMIT_POSSIBLE + 2, k.LIMIT_CALIBRATED + 2),
        k.CHIP: (k.LIMIT_POSSIBLE + 4,),
    }
    for channel in range(k.CHANNELS):
        rows = np.array([k.LIMIT_RAIL + 2 * channel, *held_to.get(channel, ())])
        low, high = out[rows].max(axis=0), out[rows + 1].min(axis=0)
        if channel not in (k.GEL, k.FREQUENCY):
            low, high = np.full_like(low, low.max()), np.full_like(high, high.min())
        out[k.LIMIT_STATUS, (low > high) & (out[k.LIMIT_STATUS] < k.UNUSUAL)] += k.UNUSUAL
        out[k.LIMIT_USUAL + 2 * channel] = low
        out[k.LIMIT_USUAL + 2 * channel + 1] = np.maximum(low, high)


def tidy_drop(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Range of the frequency's fall, Hz, that is neither a lost tare nor beyond calibration."""
    p = topology.parameters
    soft, stiff, knee = (p[f"normal_{part}"] for part in
                         ("soft_n_per_hz", "stiff_n_per_hz", "break_hz"))  # fmt: skip
    force = p["normal_max_n"]
    most = np.where(force <= soft * knee, force / soft, knee + (force - soft * knee) / stiff)
    return -PULL_SIGMAS * frequency_sigma_hz(topology), most


def _counts(topology: Topology, channel: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Counts within a range of physical values, both ends; all counts if it is not wired."""
    scale = np.where(topology.wired[channel], topology.scale[channel], 1.0)
    ends = (np.stack([low, high]) - topology.offset[channel]) / scale
    ends.sort(axis=0)
    ends = np.stack([np.ceil(ends[0] - 1e-6), np.floor(ends[1] + 1e-6)]).clip(-32768, 32767)
    return np.where(topology.wired[channel], ends, [[-32768], [32767]])


def _rails(topology: Topology, vertical: bool, out: np.ndarray) -> None:
    """Counts that are not at a rail; the first and the last count of a signal are.

    Bz has none where it is not used. Zero is no rail of an unsigned signal: it is an impossible
    count where it means anything.
    """
    out[0::2], out[1::2] = -32768, 32767
    frames = topology.frames
    for number, layout in enumerate(topology.layouts):
        units = frames.units[frames.layout == number]
        for signal in layout.signals:
            if signal.name not in CHANNELS or (signal.name == "bz" and not vertical):
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
        refuse(worst < GAIN_MIN, drift, f"a drift that leaves a gain of {GAIN_MIN:g} or more")
    octaves = OCTAVES_MARGIN * OCTAVES_MAX * np.log(2.0)
    deepest = tidy_drop(topology)[1] / p["frequency_slope_hz_per_mm"]
    for depth in (0.0, deepest):
        above = depth - p["field_reference_mm"]
        growth = (p["field_growth_per_mm2"] * above + p["field_growth_per_mm"]) * above
        refuse(
            np.abs(np.log(p["field_amplitude_ut"]) + growth) > octaves, "field_growth_per_mm",
            f"a growth that keeps M0 within {np.exp(-octaves):.0g} and {np.exp(octaves):.0g} µT",
        )  # fmt: skip
    turn = np.abs(p["theta_correction_rad"]).max(axis=0)
    refuse(turn > TURN_MAX_RAD, "theta_correction_rad", f"within {TURN_MAX_RAD:g} rad of 0 (turn "
           "the axes by field_xx, field_xy, field_yx, field_yy)")  # fmt: skip


def _refuse_short_table(topology: Topology, reach_mm: np.ndarray) -> None:
    """Raise for the first unit whose table does not tell R from the angle over its whole range."""
    limit = topology.parameters["field_angle_max_mm"]
    needed = topology.enabled & ~topology.counts_only
    for unit in np.flatnonzero(needed & (reach_mm < limit)):
        known = topology.parameters["field_angle_mm"][:, unit].any()
        raise CalibrationError(
            f"{topology.unit_names[unit]}: field_angle_mm: must be a polynomial that grows with "
            f"the angle to field_angle_max_mm = {limit[unit]:g}; "
            f"got {f'one that ends at {reach_mm[unit]:.3g}' if known else 'none'}"
        )
