"""The decoder as the model says it, step by step in numpy: slow, and plain to see."""

from __future__ import annotations

import numpy as np

from bus.status import INVALID, Status
from topology import CHANNELS, THETA_KNOTS


def naive_decode(skin, raw, status=None):
    """Decode a batch from rest; raw has the shape (t, 6, n). Return a dict of float64 arrays."""
    p = skin.parameters
    period_s = 1.0 / skin.cycle_rate_hz
    rails = _rails(skin)
    film = chip = None
    cycles = []
    for t in range(raw.shape[0]):
        known = np.zeros(skin.n, int) if status is None else status[t].astype(int)
        known[~skin.enabled] |= Status.DISABLED
        value = skin.scale * raw[t] + skin.offset
        current, frequency, bx, by, _, chip_measured = value

        temperature = 20.0 + 60.0 * np.log(np.maximum(current, 1e-9) / p["gel_current_20c_ua"]) / (
            np.log(p["gel_current_ratio"])
        )
        drop = p["frequency_rest_hz"] - frequency
        depth = drop / p["frequency_slope_hz_per_mm"]
        normal = np.where(
            drop < p["normal_break_hz"],
            p["normal_soft_n_per_hz"] * drop,
            p["normal_soft_n_per_hz"] * p["normal_break_hz"]
            + p["normal_stiff_n_per_hz"] * (drop - p["normal_break_hz"]),
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
        bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
        crest = (
            p["field_amplitude_ut"]
            * np.exp(p["field_growth_per_mm"] * (depth - p["field_reference_mm"]))
            * (1.0 + p["film_drift_per_k"] * (film_now - p["film_reference_c"]))
        )
        ratio = np.minimum(np.hypot(bx, by) / crest, 1.0)
        reach = np.arcsin(ratio) / p["field_wavenumber_rad_per_mm"]
        tangential = (
            p["shear_soft_n_per_mm"] * reach
            + p["shear_stiff_n_per_mm"] * np.maximum(reach - p["shear_break_mm"], 0.0)
        ) * (1.0 + p["shear_gain_per_mm"] * (depth - p["field_reference_mm"]))
        theta = np.arctan2(by, bx)
        theta = theta + _correction(p["theta_correction_rad"], theta)
        known = np.where(silent, known, known | _flags_of_field(skin, ratio, crest * gain, reach))

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


def _flags_of_field(skin, ratio, crest, reach):
    p = skin.parameters
    step = skin.scale[1] / np.sqrt(12.0)
    noise = p["field_noise_ut"] ** 2 + (skin.scale[2] ** 2 + skin.scale[3] ** 2) / 24.0
    sigma_mm = np.hypot(p["frequency_noise_hz"], step) / p["frequency_slope_hz_per_mm"]
    sigma = np.sqrt(noise / crest**2 + (ratio * p["field_growth_per_mm"] * sigma_mm) ** 2)
    quarter = np.pi / 2.0 / p["field_wavenumber_rad_per_mm"]
    limit = np.where(p["tangential_max_mm"] < quarter * (1.0 - 1e-6), p["tangential_max_mm"], 1e9)
    return Status.SATURATED * (ratio + sigma >= 1.0) | Status.EXTRAPOLATED * (reach > limit)


def _rails(skin):
    """First and last count of every signal that this estimator uses, shape (6, n)."""
    lowest, highest = np.full((6, skin.n), -(10**6)), np.full((6, skin.n), 10**6)
    for row in range(len(skin.frames)):
        for signal in skin.layouts[skin.frames.layout[row]].signals:
            unit = skin.frames.units[row, signal.slot]
            if unit < 0 or signal.name not in CHANNELS or signal.name == "bz":
                continue
            channel = CHANNELS.index(signal.name)
            if signal.signed:
                lowest[channel, unit] = -(2 ** (signal.length - 1))
                highest[channel, unit] = 2 ** (signal.length - 1) - 1
            else:
                highest[channel, unit] = 2**signal.length - 1
    return lowest, highest
