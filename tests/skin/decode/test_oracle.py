"""The decoder against the model's own formulae, evaluated with 40 digits, sharing no code."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp, mpf

from skin.decode.decoder import Decoder
from tests.fixtures.decode import calibrated, row_of, sensible_counts, sine, with_parameters

CYCLES = 4
QUANTITIES = ("temperature", "fx", "fy", "fz", "tangential", "theta", "x", "y", "h")


def oracle(skin, raw):
    """Decode with 40 digits; return {quantity: list over cycles of lists over units}."""
    rows = []
    with mp.workdps(40):
        film, chip = [None] * skin.n, [None] * skin.n
        for cycle in raw:
            row = []
            for i in range(skin.n):
                row.append(one_unit(skin, cycle[:, i], i, film, chip))
            rows.append(row)
    return rows


def one_unit(skin, counts, i, film, chip):
    p = {
        name: mpf(float(value[i]))
        if value.ndim == 1
        else [mpf(float(knot)) for knot in value[:, i]]
        for name, value in skin.parameters.items()
    }
    current, frequency, bx, by, _, own = (
        mpf(float(skin.scale[c, i])) * int(counts[c]) + mpf(float(skin.offset[c, i]))
        for c in range(6)
    )
    share = mp.log(current / p["gel_current_20c_ua"]) / mp.log(p["gel_current_ratio"])
    bend = p["gel_bend_c"] + p["gel_twist_c"] * (2 * share - 1)
    t = 20 + 60 * share + bend * share * (share - 1)
    period = 1 / mpf(skin.cycle_rate_hz)
    for kept, lag in ((film, "film_lag_s"), (chip, "hall_lag_s")):
        step = 1 - mp.exp(-period / p[lag])
        kept[i] = t if kept[i] is None else (1 - step) * kept[i] + step * t

    drop = p["frequency_rest_hz"] - frequency
    h = drop / p["frequency_slope_hz_per_mm"]
    soft, stiff, knee = (
        p["normal_soft_n_per_hz"],
        p["normal_stiff_n_per_hz"],
        p["normal_break_hz"],
    )
    fz = soft * drop if drop <= knee else soft * knee + stiff * (drop - knee)

    above = (own if skin.wired[5, i] else chip[i]) - p["hall_reference_c"]
    gain = 1 + p["hall_gain_per_k"] * above
    bx = (bx - p["hall_offset_x_ut"] - p["hall_drift_x_ut_per_k"] * above) / gain
    by = (by - p["hall_offset_y_ut"] - p["hall_drift_y_ut_per_k"] * above) / gain
    bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
    from_reference = h - p["field_reference_mm"]
    growth = p["field_growth_per_mm"] + p["field_growth_per_mm2"] * from_reference
    crest = p["field_amplitude_ut"] * mp.exp(growth * from_reference)
    crest *= 1 + p["film_drift_per_k"] * (film[i] - p["film_reference_c"])
    ratio = mp.sqrt(bx * bx + by * by) / crest
    r = mp.asin(min(ratio, 1)) / p["field_wavenumber_rad_per_mm"]
    ft = p["shear_soft_n_per_mm"] * r
    if r > p["shear_break_mm"]:
        ft += p["shear_stiff_n_per_mm"] * (r - p["shear_break_mm"])
    ft *= 1 + p["shear_gain_per_mm"] * from_reference

    theta = mp.atan2(by, bx)
    knots = p["theta_correction_rad"]
    place = (theta + mp.pi) / (2 * mp.pi) * len(knots)
    segment = int(mp.floor(place)) % len(knots)
    share = place - mp.floor(place)
    theta += (1 - share) * knots[segment] + share * knots[(segment + 1) % len(knots)]
    x, y = mp.cos(theta), mp.sin(theta)
    decoded = (t, ft * x, ft * y, fz, ft, mp.atan2(y, x), r * x, r * y, h)
    return {**dict(zip(QUANTITIES, decoded, strict=True)), "ratio": ratio}


def decoded(skin, raw, dtype):
    """Decode the same, in the oracle's names, float64 arrays of shape (t, n)."""
    reading = Decoder(skin, estimator="sine", dtype=dtype, sweeps=0, ambient=False)(raw)
    rows = (reading.temperature, *reading.force.swapaxes(0, 1), reading.tangential, reading.theta)
    rows = (*rows, *reading.displacement_mm.swapaxes(0, 1))
    return {name: row.astype(float) for name, row in zip(QUANTITIES, rows, strict=True)}


def errors(skin, raw, dtype, truth):
    """Absolute errors, {quantity: (t, n)}, and the ratio of the field to the crest."""
    got = decoded(skin, raw, dtype)
    out = {}
    for name in QUANTITIES:
        exact = np.array([[float(u[name] - mpf(float(g))) for u, g in zip(row, line, strict=True)]
                          for row, line in zip(truth, got[name], strict=True)])  # fmt: skip
        out[name] = np.abs(exact)
    out["theta"] = np.minimum(out["theta"], 2.0 * np.pi - out["theta"])
    return out, np.array([[float(u["ratio"]) for u in row] for row in truth])


@pytest.fixture(scope="module", params=["f3t-fd16", "f3t-classic"])
def case(request):
    """Units that all differ, on a wire with and on one without the chip's own temperature; half of
    them with gels whose current is not exponential."""
    skin = calibrated(row_of(40, request.param), seed=11, turn_rad=0.2)
    bent = np.random.default_rng(13).uniform([[0.0], [0.0]], [[28.0], [7.0]], (2, 40))
    bent[:, ::2] = 0.0
    skin = with_parameters(skin, gel_bend_c=bent[0], gel_twist_c=bent[1])
    raw = sensible_counts(skin, CYCLES, seed=12, most=1.02)
    return skin, raw, oracle(skin, raw)


@pytest.mark.long_but_first
def test_float64_is_the_model(case):
    error, ratio = errors(*case[:2], "float64", case[2])
    assert (ratio > 0.99).any()
    assert (ratio > 1.0).any()
    for name in QUANTITIES:
        assert error[name].max() <= 1e-9, name


@pytest.mark.long_but_first
def test_float32_is_the_model_below_the_crest(case):
    error, ratio = errors(*case[:2], "float32", case[2])
    below = ratio < 0.9
    assert below.sum() > 50
    assert error["temperature"].max() <= 1e-4
    for name in ("fx", "fy", "fz", "tangential"):
        assert error[name][below].max() <= 2e-5, name
    for name in ("x", "y", "h"):
        assert error[name][below].max() <= 2e-5, name
    assert error["theta"][below].max() <= 5e-6


def test_float32_loses_digits_only_as_the_crest_does(case):
    """Near the crest dR/dx is 1 / (k sqrt(1 - x²)): a rounded x must not cost more than that."""
    skin, raw, truth = case
    error, ratio = errors(skin, raw, "float32", truth)
    rounding = 2e-6
    share = 1.0 - np.minimum(ratio, 1.0)
    wavenumber = skin.parameters["field_wavenumber_rad_per_mm"]
    bound_mm = 1e-6 + np.minimum(rounding / np.sqrt(2.0 * share + 1e-300),
                                 np.sqrt(2.0 * rounding)) / wavenumber  # fmt: skip
    stiffest = 1.2 * (skin.parameters["shear_soft_n_per_mm"]
                      + skin.parameters["shear_stiff_n_per_mm"])  # fmt: skip
    assert np.all(error["tangential"] <= stiffest * bound_mm + 2e-6)


@pytest.mark.parametrize(("dtype", "limit"), [("float32", 1e-4), ("float64", 1e-9)])
def test_temperature_polynomial_is_the_exponential_law(dtype, limit):
    """Every count of the calibrated range, not a sample of it."""
    skin = row_of(1)
    p = {name: float(value[0]) for name, value in skin.parameters.items() if value.ndim == 1}
    ends = [p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((t - 20.0) / 60.0) / 0.007
            for t in (p["temperature_min_c"], p["temperature_max_c"])]  # fmt: skip
    gel = np.arange(np.ceil(ends[0]), np.floor(ends[1]) + 1)
    raw = np.zeros((gel.size, 6, 1), np.int16)
    raw[:, 0, 0] = gel
    got = sine(skin, dtype=dtype)(raw).temperature[:, 0]
    law = 20.0 + 60.0 * np.log(gel * 0.007 / 10.0) / np.log(12.0)
    assert np.abs(got - law).max() <= limit
