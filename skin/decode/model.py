"""From the parameters of a topology to the records of coefficients that the kernel reads.

Scales, offsets and maps are multiplied out here, once, in float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import records as k
from skin.decode.arrays import check
from skin.decode.functions import OCTAVES_MAX
from skin.decode.limits import STEP_SIGMA, calibrated_drop_hz, frequency_sigma_hz, limits_of
from skin.decode.plan import Plan, Wants
from skin.decode.resting import axial_at_rest
from skin.decode.tangential import GAIN_MIN
from skin.decode.uncertainty import Neighbours, uncertainty
from skin.errors import CalibrationError
from skin.physics.force_law import normal_law_mm, shear_law, stacked
from topology import THETA_KNOTS, Topology
from topology.gel import gel_octaves, gel_share

__all__ = ["DecodeModel", "field_angle_ends", "model_of", "refuse_impossible"]

TURN_MAX_RAD = 1.0
"""Largest correction of a direction [derived]: the kernel's sine and cosine hold this far."""
OVERREACH = 1.1
"""R from the angle is decoded to this many times its calibrated range; a lower bound beyond
[assumed]."""
NO_END_MM = 1e9
"""mm: R of a unit whose range has no known end."""
OCTAVES_MARGIN = 0.9
"""Share of `OCTAVES_MAX` that a calibration may need [assumed]."""


class DecodeModel(NamedTuple):
    """What does not change between cycles.

    Attributes
    ----------
    coefficients : ndarray, shape (b,) or (1,), records of `skin.decode.records.coefficients`
        Calibration, a block for every `LANES` units, or a single block that all share.
    limits : ndarray, shape (b,) or (1,), records of `LIMITS`
        Ranges of counts.
    look_every : int
        Cycles from one look at all units to the next; 0: only those under load are looked at.
    wants : Wants
    rows : ndarray, shape (r,), int64
        Results that anyone reads.
    """

    coefficients: np.ndarray
    limits: np.ndarray
    look_every: int
    wants: Wants
    rows: np.ndarray


def model_of(
    topology: Topology,
    plan: Plan,
    rest_ut: np.ndarray | None,
    neighbours: Neighbours,
) -> DecodeModel:
    """What a decoder of a topology must know.

    Parameters
    ----------
    topology : Topology
    plan : Plan
    rest_ut : ndarray, shape (3, n), or None
        Field that resting neighbours add, axes of the chips, which the offsets do not hold, as it
        is known without a tare; None where nothing needs it.
    neighbours : Neighbours
        What else they may add, likewise.

    Raises
    ------
    CalibrationError
        A parameter is not one that a working unit can have.
    """
    refuse_impossible(topology)
    if rest_ut is not None:
        check(topology, "rest_ut", rest_ut, np.float64, (3, topology.n))
        if not np.isfinite(rest_ut).all():
            raise CalibrationError(f"{topology.name}: rest_ut: must be finite; got NaN or infinity")
    angle = plan.estimator == "field-angle"
    rest = np.zeros((3, topology.n)) if rest_ut is None else rest_ut.copy()
    rest[2], axial_rest_ut2 = axial_at_rest(topology, rest[2], neighbours.axial_rest_ut2)
    neighbours = neighbours._replace(axial_rest_ut2=axial_rest_ut2)
    found = {
        **_temperature(topology),
        **_normal(topology),
        **_field(topology, rest),
        **_tangential(topology, angle),
    }
    found |= uncertainty(topology, found, neighbours)
    return DecodeModel(
        _blocks(found, k.coefficients(plan.dtype)),
        _blocks(limits_of(topology, vertical=angle or plan.consistency), k.LIMITS),
        0 if plan.skip and not plan.ambient else plan.look_every,
        plan.wants,
        np.array(plan.rows),
    )


def _blocks(values: Mapping[str, np.ndarray], record: np.dtype) -> np.ndarray:
    """Values of units, shape (n,) or (rows, n) each, as records, one for every `LANES` units; the
    last one is filled up with the last unit. A single one where all units are alike."""
    each = {name: np.asarray(values[name]).astype(record[name].base) for name in record.names or ()}
    n = max(value.shape[-1] for value in each.values())
    alike = all(
        ((value == value[..., :1]) | (np.isnan(value) & np.isnan(value[..., :1]))).all()
        for value in each.values()
    )
    units = np.arange(k.LANES if alike else -(-n // k.LANES) * k.LANES)
    units = np.zeros_like(units) if alike else np.minimum(units, n - 1)
    out = zeros(units.size // k.LANES, record)
    for name, value in each.items():
        lanes = value[..., units].reshape(*value.shape[:-1], -1, k.LANES)
        out[name] = np.moveaxis(lanes, -2, 0)
    return out


def _temperature(topology: Topology) -> dict[str, np.ndarray]:
    """Coefficients of the temperatures of gel, film and chip."""
    p, scale, offset = topology.parameters, topology.scale, topology.offset
    octaves_c = gel_octaves(p)
    rate_c = _gel_rate(octaves_c, p)
    gel, chip = topology.wired[k.GEL], topology.wired[k.CHIP]
    # Without a gel current the film counts as being at its reference temperature.
    gel_scale = np.where(gel, scale[k.GEL] / p["gel_current_20c_ua"], 0.0)
    gel_offset = np.where(
        gel,
        offset[k.GEL] / p["gel_current_20c_ua"],
        gel_share(p, p["film_reference_c"]),
    )
    noise = p["gel_noise_relative"] / np.log(2.0)
    gel_sigma = np.sqrt((rate_c[0] * noise) ** 2 + p["temperature_sigma_c"] ** 2)
    chip_offset = np.where(chip, offset[k.CHIP], 0.0) - p["hall_reference_c"]
    step_s = 1.0 / topology.cycle_rate_hz
    return {
        "gel_scale": gel_scale,
        "gel_offset": gel_offset,
        "gel_octaves": octaves_c,
        "gel_rate": rate_c,
        "gel_noise": np.where(gel, noise**2, 0.0),
        "gel_step": np.abs(gel_scale) * STEP_SIGMA / np.log(2.0),
        "gel_variance": np.where(gel, p["temperature_sigma_c"] ** 2, 0.0),
        "gel_low": p["temperature_min_c"] - gel_sigma,
        "gel_high": p["temperature_max_c"] + gel_sigma,
        "film_keep": _kept(step_s, p["film_lag_s"]),
        "film_reference": p["film_reference_c"],
        "film_drift": p["film_drift_per_k"],
        "chip_keep": _kept(step_s, p["hall_lag_s"]),
        "chip_scale": np.where(chip, scale[k.CHIP], 0.0),
        "chip_offset": np.where(chip | gel, chip_offset, 0.0),
        "chip_follows": np.where(~chip & gel, 1.0, 0.0),
        "chip_gain": p["hall_gain_per_k"],
    }


def _gel_rate(octaves_c: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
    """Derivative of the temperature by octaves of the current, in powers of the temperature above
    20 °C, shape (3, n), °C: a parabola through it, over the calibrated range."""
    if not octaves_c[1:].any():
        return octaves_c
    share = np.linspace(0.0, 1.0, 9)[:, np.newaxis]
    t = p["temperature_min_c"] + share * (p["temperature_max_c"] - p["temperature_min_c"])
    x, above = np.log2(gel_share(p, t)), t - 20.0
    rate = octaves_c[0] + x * (2.0 * octaves_c[1] + 3.0 * x * octaves_c[2])
    # errors relative to it
    powers = np.stack([above**k / rate for k in range(3)], axis=-1).swapaxes(0, 1)
    whole = np.ones(len(share))
    return np.stack([np.linalg.lstsq(rows, whole, rcond=None)[0] for rows in powers], axis=1)


def _kept(step_s: float, lag_s: np.ndarray) -> np.ndarray:
    """Share of a one-pole filter's lag that is left after a step; 0 without a filter."""
    with np.errstate(divide="ignore"):
        return np.exp(-step_s / lag_s)


def _normal(topology: Topology) -> dict[str, np.ndarray]:
    """Coefficients of depth and normal force."""
    p = topology.parameters
    slope = p["frequency_slope_hz_per_mm"]
    per_hz = 1.0 / slope
    low, high = (drop * per_hz for drop in calibrated_drop_hz(topology))
    sigma = frequency_sigma_hz(topology) * per_hz
    depth_sigma = np.hypot(sigma, p["depth_sigma_mm"])
    return {
        "depth_scale": -topology.scale[k.FREQUENCY] * per_hz,
        "depth_offset": (p["frequency_rest_hz"] - topology.offset[k.FREQUENCY]) * per_hz,
        "depth_per_hz": per_hz,
        "depth_sigma": depth_sigma,
        # within its sigma of an end a reading may well lie inside
        "depth_low": low - sigma,
        "depth_high": high + sigma,
        "normal_law": stacked(normal_law_mm(p)),
        "normal_variance": p["normal_sigma_relative"] ** 2,
        "normal_floor": p["normal_sigma_n"] ** 2,
        "normal_sigma": sigma,
    }


def _field(topology: Topology, rest: np.ndarray) -> dict[str, np.ndarray]:
    """Coefficients of the field at the chip, less that of resting neighbours, which is read with
    the chip's gain as it is; and of the film's strength."""
    p, scale = topology.parameters, topology.scale
    still = [
        topology.offset[k.BX + i] - p[f"hall_offset_{axis}_ut"] - rest[i]
        for i, axis in enumerate("xyz")
    ]
    drift = [
        p[f"hall_drift_{axis}_ut_per_k"] + p["hall_gain_per_k"] * rest[i]
        for i, axis in enumerate("xyz")
    ]
    c = {}
    for axis in "xy":
        from_x, from_y = p[f"field_{axis}x"], p[f"field_{axis}y"]
        c[f"{axis}_bx"] = from_x * scale[k.BX]
        c[f"{axis}_by"] = from_y * scale[k.BY]
        c[f"{axis}_offset"] = from_x * still[0] + from_y * still[1]
        c[f"{axis}_drift"] = -from_x * drift[0] - from_y * drift[1]
        c[f"map_{axis}x"], c[f"map_{axis}y"] = from_x, from_y
    c["z_bz"] = scale[k.BZ]
    c["z_offset"] = np.where(topology.wired[k.BZ], still[2], np.nan)
    c["z_drift"] = -drift[2]

    reference = p["field_reference_mm"]
    linear, curved = p["field_growth_per_mm"], p["field_growth_per_mm2"]
    growth = [
        np.log(p["field_amplitude_ut"]) + (curved * reference - linear) * reference,
        linear - 2.0 * curved * reference,
        curved,
    ]
    c["amplitude_octaves"] = np.stack(growth) / np.log(2.0)
    c["wavenumber"] = p["field_wavenumber_rad_per_mm"]
    c["wavenumber_inverse"] = 1.0 / p["field_wavenumber_rad_per_mm"]
    c["film_x"], c["film_y"] = p["film_x_mm"], p["film_y_mm"]
    return c


def _tangential(topology: Topology, angle: bool) -> dict[str, np.ndarray]:
    """Coefficients of R from the angle, of directions, and of the tangential force."""
    p = topology.parameters
    angle_end, angle_reach_mm = field_angle_ends(topology)
    if angle:
        _refuse_short_table(topology, angle_reach_mm)
        displacement_max = p["field_angle_max_mm"]
    else:
        # No field reaches beyond the crest, and one that touches it is SATURATED.
        crest_mm = 0.5 * np.pi / p["field_wavenumber_rad_per_mm"]
        most = p["tangential_max_mm"]
        displacement_max = np.where(most < crest_mm * (1.0 - 1e-6), most, NO_END_MM)
    knots = p["theta_correction_rad"]
    bend = np.diff(np.vstack([knots, knots[:1]]), axis=0) * (THETA_KNOTS / (2.0 * np.pi))
    return {
        "angle": p["field_angle_mm"],
        "angle_end": angle_end,
        "theta_correction": np.vstack([knots[:1], bend[:1], np.diff(bend, axis=0)]),
        "shear_law": stacked(shear_law(p)),
        "shear_gain": p["shear_gain_per_mm"],
        "shear_gain_offset": 1.0 - p["shear_gain_per_mm"] * p["field_reference_mm"],
        "displacement_max": displacement_max,
    }


def field_angle_ends(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Where the table of R(psi, H) ends for good, over all calibrated depths.

    That is where R has passed the calibrated range at every depth, and by `OVERREACH` at one of
    them, or where it ceases to grow with the angle.

    Returns
    -------
    angle : ndarray, shape (n,)
        Radian.
    reach_mm : ndarray, shape (n,)
        Least R at that angle; 0 without a table.
    """
    p = topology.parameters
    deepest = calibrated_drop_hz(topology)[1] / p["frequency_slope_hz_per_mm"]
    keys = np.vstack([p["field_angle_mm"], p["field_angle_max_mm"], np.ceil(deepest * 4.0) / 4.0])
    keys = keys[:, :1] if (keys == keys[:, :1]).all() else keys
    keys, inverse = np.unique(keys, axis=1, return_inverse=True)
    found = np.array([_table_end(*key) for key in keys.T]).T
    return tuple(np.broadcast_to(found[:, inverse.reshape(-1)], (2, topology.n)))


def _table_end(*key: float) -> tuple[float, float]:
    """Last angle at which R grows with it at all depths, rad, and the least R there, mm."""
    table, most, deepest = np.reshape(key[:-2], (4, 4)), key[-2], key[-1]
    angle = np.linspace(0.0, np.pi, 361)
    depth = np.linspace(0.0, deepest, 9)
    odd = angle[:, np.newaxis] ** (2 * np.arange(4) + 1)
    displacement = odd @ table @ (depth ** np.arange(4)[:, np.newaxis])
    folds = (np.diff(displacement, axis=0) <= 0.0).any(axis=1)
    covered = (displacement[:-1] >= most).all(axis=1)
    over = folds | (covered & (displacement[1:] > OVERREACH * most).any(axis=1))
    last = int(np.argmax(over)) if over.any() else len(angle) - 1
    return float(angle[last]), float(displacement[last].min())


def refuse_impossible(topology: Topology) -> None:
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
        refuse(np.asarray(np.atleast_2d(wrong).any(axis=0)), name, "finite")
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
    deepest = calibrated_drop_hz(topology)[1] / p["frequency_slope_hz_per_mm"]
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
    """Raise for the first unit whose table does not give R from the angle over its whole range."""
    limit = topology.parameters["field_angle_max_mm"]
    needed = topology.feels
    for unit in np.flatnonzero(needed & (reach_mm < limit)):
        known = topology.parameters["field_angle_mm"][:, unit].any()
        raise CalibrationError(
            f"{topology.unit_names[unit]}: field_angle_mm: must be a polynomial that grows with "
            f"the angle to field_angle_max_mm = {limit[unit]:g}; "
            f"got {f'one that ends at {reach_mm[unit]:.3g}' if known else 'none'}"
        )
