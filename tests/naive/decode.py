"""The decoder as the model says it, step by step in numpy: slow, and plain to see."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from bus.status import INVALID, Status
from skin.decode.model import field_angle_ends
from topology import CHANNELS, THETA_KNOTS


def naive_decode(skin, raw, status=None, estimator="sine", consistency=False, background=0.0):
    """Decode a batch from rest; raw has the shape (t, 6, n). Return a dict of float64 arrays."""
    p = skin.parameters
    table = p["field_angle_mm"].reshape(4, 4, -1)
    uses_bz = consistency or estimator == "field-angle"
    period_s = 1.0 / skin.cycle_rate_hz
    rails = _rails(skin, uses_bz)
    film = chip = None
    missed, was_odd = np.zeros(skin.n), np.zeros(skin.n, bool)
    cycles = []
    for t in range(raw.shape[0]):
        known = np.zeros(skin.n, int) if status is None else status[t].astype(int)
        known[~skin.enabled] |= Status.DISABLED
        value = skin.scale * raw[t] + skin.offset
        value[1:5] += np.array([1.0, -1.0, -1.0, -1.0])[:, np.newaxis] * background
        current, frequency, bx, by, bz, chip_measured = value

        x = np.log(np.maximum(current, 1e-9) / p["gel_current_20c_ua"]) / (
            np.log(p["gel_current_ratio"])
        )
        bend = p["gel_bend_c"] + p["gel_twist_c"] * (2.0 * x - 1.0)
        temperature = 20.0 + 60.0 * x + bend * x * (x - 1.0)
        drop = p["frequency_rest_hz"] - frequency
        depth = drop / p["frequency_slope_hz_per_mm"]
        normal = np.where(
            drop < p["normal_break_hz"],
            p["normal_soft_n_per_hz"] * drop,
            p["normal_soft_n_per_hz"] * p["normal_break_hz"]
            + p["normal_stiff_n_per_hz"] * (drop - p["normal_break_hz"])
            + p["normal_cubic_n_per_hz3"] * (drop - p["normal_break_hz"]) ** 3,
        )
        flags = _flags_of_counts(
            skin, raw[t], *rails, temperature, frequency, chip_measured, normal, depth
        )
        silent = known & (Status.NEVER | Status.DISABLED) != 0
        known = np.where(silent, known, known | flags)

        healthy = known & INVALID == 0
        film_now = _follow(film, temperature, period_s, p["film_lag_s"])
        chip_now = _follow(chip, temperature, period_s, p["hall_lag_s"])
        film_kept = np.full(skin.n, np.nan) if film is None else film
        chip_kept = np.full(skin.n, np.nan) if chip is None else chip
        film, chip = np.where(healthy, film_now, film_kept), np.where(healthy, chip_now, chip_kept)
        above = np.where(skin.wired[5], chip_measured, chip_now) - p["hall_reference_c"]

        gain = 1.0 + p["hall_gain_per_k"] * above
        bx = (bx - p["hall_offset_x_ut"] - p["hall_drift_x_ut_per_k"] * above) / gain
        by = (by - p["hall_offset_y_ut"] - p["hall_drift_y_ut_per_k"] * above) / gain
        bz = (bz - p["hall_offset_z_ut"] - p["hall_drift_z_ut_per_k"] * above) / gain
        bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
        deeper = depth - p["field_reference_mm"]
        growth = p["field_growth_per_mm"] * deeper + p["field_growth_per_mm2"] * deeper**2
        crest = (
            p["field_amplitude_ut"]
            * np.exp(np.clip(growth, -9.0, 9.0))
            * (1.0 + p["film_drift_per_k"] * (film_now - p["film_reference_c"]))
        )
        strength = np.hypot(bx, by)
        ratio = np.minimum(strength / crest, 1.0)
        wavenumber = p["field_wavenumber_rad_per_mm"]
        angle = np.minimum(np.arctan2(np.maximum(strength, 1e-6), bz), field_angle_ends(skin)[0])
        by_angle = _polynomial(table, angle, np.clip(depth, -0.5, 4.0))
        reach = by_angle if estimator == "field-angle" else np.arcsin(ratio) / wavenumber
        theta = np.arctan2(by, bx)
        theta = theta + _correction(p["theta_correction_rad"], theta)
        outer = reach
        dx = reach * np.cos(theta) - p["film_x_mm"]
        dy = reach * np.sin(theta) - p["film_y_mm"]
        reach, theta = np.hypot(dx, dy), np.arctan2(dy, dx)
        tangential = (
            p["shear_soft_n_per_mm"] * reach
            + p["shear_stiff_n_per_mm"] * np.maximum(reach - p["shear_break_mm"], 0.0)
            + p["shear_cubic_n_per_mm3"] * np.maximum(reach - p["shear_break_mm"], 0.0) ** 3
        ) * (1.0 + p["shear_gain_per_mm"] * (depth - p["field_reference_mm"]))
        if estimator == "sine":
            flags = _flags_of_field(skin, ratio, crest * gain, outer, deeper)
        else:
            flags = Status.SATURATED * (np.arctan2(strength, bz) > field_angle_ends(skin)[0])
            flags |= Status.EXTRAPOLATED * (outer > p["field_angle_max_mm"])
        if consistency:
            whole = np.sqrt(bx**2 + by**2 + bz**2)
            model = crest * np.sin(wavenumber * by_angle)
            ratio_z = np.maximum(strength, 1e-6) / model
            # the field in the counts, with the gain still in it
            noise, drift = _field_variances(skin)
            relative = (ratio_z / (whole * gain)) ** 2
            share = 0.25 / (skin.n * skin.cycle_rate_hz * 86400.0)
            passed, passed_twice = norm.isf(0.5 * share) ** 2, norm.isf(0.5 * share**0.5) ** 2
            moved = _amplitude_variance(skin) - _residue(skin)
            constant = 0.02**2 + 25.0 * _residue(skin) + (300.0**2 + 25.0 * drift) * relative
            step = 1.0 - np.exp(-1.0 / 50.0)
            random = moved + noise * relative
            odd = (ratio_z - 1.0) ** 2 > constant + passed_twice * random
            of_mean = np.sqrt(constant + passed * step / (2.0 - step) * random)
            mean = np.where(odd, missed, missed + step * ((ratio_z - 1.0) / of_mean - missed))
            flags |= Status.MAGNETIC_ANOMALY * ((odd & was_odd) | (np.abs(mean) > 1.0))
            missed = np.where(known & INVALID == 0, mean, missed)
            was_odd = np.where(known & INVALID == 0, odd, was_odd)
        known = np.where(silent, known, known | flags)

        row = {
            "temperature": temperature,
            "force": np.stack([tangential * np.cos(theta), tangential * np.sin(theta), normal]),
            "tangential": tangential,
            "theta": (theta + np.pi) % (2.0 * np.pi) - np.pi,
            "displacement_mm": np.stack([reach * np.cos(theta), reach * np.sin(theta), depth]),
        }
        never = known & Status.NEVER != 0
        cycles.append({name: np.where(never, np.nan, value) for name, value in row.items()})
        cycles[-1] |= {"status": known, "valid": known & INVALID == 0, "ratio": ratio}
    return {name: np.stack([cycle[name] for cycle in cycles]) for name in cycles[0]}


def _polynomial(table, angle, depth):
    """R(psi, H)."""
    return sum(table[i, j] * angle ** (2 * i + 1) * depth**j for i in range(4) for j in range(4))


def _amplitude_variance(skin, deeper=0.0):
    """Relative variance of M0 from frequency noise and from temperatures that are not exact."""
    p = skin.parameters
    sigma_hz = np.hypot(p["frequency_noise_hz"], skin.scale[1] / np.sqrt(12.0))
    growth = p["field_growth_per_mm"] + 2.0 * p["field_growth_per_mm2"] * deeper
    return (growth * sigma_hz / p["frequency_slope_hz_per_mm"]) ** 2 + _residue(skin)


def _residue(skin):
    """Relative variance of M0 that temperature compensation leaves."""
    p = skin.parameters
    gel_c = 60.0 / np.log(p["gel_current_ratio"]) * p["gel_noise_relative"]
    chip_c = np.where(skin.wired[5], skin.scale[5] / np.sqrt(12.0), gel_c)
    return (p["film_drift_per_k"] * gel_c) ** 2 + (p["hall_gain_per_k"] * chip_c) ** 2


def _field_variance(skin):
    return sum(_field_variances(skin))


def _field_variances(skin):
    """Of noise, and of drifts that temperatures leave."""
    p = skin.parameters
    gel_c = 60.0 / np.log(p["gel_current_ratio"]) * p["gel_noise_relative"]
    chip_c = np.where(skin.wired[5], skin.scale[5] / np.sqrt(12.0), gel_c)
    drift = (p["hall_drift_x_ut_per_k"] ** 2 + p["hall_drift_y_ut_per_k"] ** 2) / 2.0 * chip_c**2
    stretch = sum(p[f"field_{name}"] ** 2 for name in ("xx", "xy", "yx", "yy")) / 2.0
    step = (skin.scale[2] ** 2 + skin.scale[3] ** 2) / 24.0
    return stretch * (p["field_noise_ut"] ** 2 + step), stretch * drift


def _follow(before, now, period_s, lag_s):
    if before is None:
        return now
    step = 1.0 - np.exp(-period_s / np.maximum(lag_s, 1e-12))
    return np.where(np.isnan(before), now, before + step * (now - before))


def _correction(table, theta):
    """Table value of each unit at its theta, linear between knots, periodic."""
    knots = -np.pi + 2.0 * np.pi / THETA_KNOTS * np.arange(THETA_KNOTS)
    return np.array(
        [np.interp(theta[i], knots, table[:, i], period=2.0 * np.pi) for i in range(theta.size)]
    )


def _flags_of_counts(skin, raw, lowest, highest, temperature, frequency, chip, normal, depth):
    p = skin.parameters
    railed = ((raw <= lowest) | (raw >= highest)).any(axis=0)
    low, high = p["temperature_min_c"], p["temperature_max_c"]
    span = (high - low) / 2.0
    impossible = (temperature < low - span) | (temperature > high + span)
    impossible |= skin.wired[5] & ((chip < low - span) | (chip > high + span))
    impossible |= (frequency <= 0.0) | (frequency > 1.2 * p["frequency_rest_hz"])
    sigma_hz = np.hypot(p["frequency_noise_hz"], skin.scale[1] / np.sqrt(12.0))
    beyond = (temperature < low) | (temperature > high) | (normal > p["normal_max_n"])
    beyond |= depth * p["frequency_slope_hz_per_mm"] < -6.0 * sigma_hz
    return (
        Status.SATURATED * railed | Status.OUT_OF_RANGE * impossible | Status.EXTRAPOLATED * beyond
    )


def _flags_of_field(skin, ratio, crest, reach, deeper):
    p = skin.parameters
    sigma = np.sqrt(_field_variance(skin) / crest**2 + ratio**2 * _amplitude_variance(skin, deeper))
    quarter = np.pi / 2.0 / p["field_wavenumber_rad_per_mm"]
    limit = np.where(p["tangential_max_mm"] < quarter * (1.0 - 1e-6), p["tangential_max_mm"], 1e9)
    return Status.SATURATED * (ratio + sigma >= 1.0) | Status.EXTRAPOLATED * (reach > limit)


def _rails(skin, uses_bz):
    """First and last count of every signal that this estimator uses, shape (6, n)."""
    lowest, highest = np.full((6, skin.n), -(10**6)), np.full((6, skin.n), 10**6)
    for row in range(len(skin.frames)):
        for signal in skin.layouts[skin.frames.layout[row]].signals:
            unit = skin.frames.units[row, signal.slot]
            if unit < 0 or signal.name not in CHANNELS or (signal.name == "bz" and not uses_bz):
                continue
            channel = CHANNELS.index(signal.name)
            if signal.signed:
                lowest[channel, unit] = -(2 ** (signal.length - 1))
                highest[channel, unit] = 2 ** (signal.length - 1) - 1
            else:
                highest[channel, unit] = 2**signal.length - 1
    return lowest, highest
