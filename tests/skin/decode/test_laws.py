"""Laws of the decoder: symmetries, monotony, independence, and the truth where nothing is noisy."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.status import Status
from skin.decode.decoder import Decoder
from skin.options import ESTIMATORS
from skin.sim.unit import UnitSimulator
from skin.state import UNIT_WANTS
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import (
    any_counts,
    calibrated,
    row_of,
    sensible_counts,
    sine,
    stiffening,
    with_parameters,
)
from tests.naive.decode import naive_decode
from topology import THETA_KNOTS

pytestmark = pytest.mark.usefixtures("few_variants")

FIELDS = ("temperature", "force", "tangential", "theta", "displacement_mm", "status", "valid")
DTYPES = ("float32", "float64")
seeds = st.integers(0, 2**32 - 1)
dtypes = st.sampled_from(DTYPES)


def nominal_counts(gel=1430, frequency=12000, bx=0, by=0, chip=0, n=1, layout="f3t-fd16"):
    """One cycle of equal units, chip and gel warm, pressed 1.67 mm."""
    raw = np.zeros((6, n), np.int16)
    for row, value in zip((0, 1, 2, 3, 5), (gel, frequency, bx, by, chip), strict=True):
        raw[row] = value
    return raw


# -- truth ---------------------------------------------------------------------------------------


@given(seeds, dtypes, st.sampled_from(["f3t-fd16", "f3t-classic"]))
def test_decoding_undoes_the_simulated_unit_within_quantisation(seed, dtype, layout):
    skin = calibrated(row_of(20, layout), seed % 7, turn_rad=0.1)
    skin = with_parameters(skin, field_growth_per_mm2=0.0)  # as the simulated unit has it
    p = skin.parameters
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.0, 2.0, skin.n)
    direction = rng.uniform(-np.pi, np.pi, skin.n)
    reach = rng.uniform(0.0, 0.9, skin.n) * 0.5 * np.pi / p["field_wavenumber_rad_per_mm"]
    lateral = reach * np.stack([np.cos(direction), np.sin(direction)])
    temperature = rng.uniform(20.0, 90.0, skin.n)
    chip = np.clip(temperature, None, 85.0) if skin.wired[5].all() else temperature
    simulated = UnitSimulator(skin, noise=False)
    counts = simulated.quantise(
        simulated.quantities(depth, lateral, temperature, hall_temperature=chip)
    )
    got = Decoder(skin, estimator="sine", dtype=dtype, sweeps=0, ambient=False)(counts)

    rounding = 1.0 if dtype == "float64" else 1.001
    digits = 1e-9 if dtype == "float64" else 5e-5
    half = 0.5 * skin.scale * rounding
    current = p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((temperature - 20.0) / 60.0)
    warmer = 61.0 / np.log(p["gel_current_ratio"]) * half[0] / current
    deeper = half[1] / p["frequency_slope_hz_per_mm"]
    assert np.all(np.abs(got.temperature - temperature) <= warmer + digits)
    assert np.all(np.abs(got.displacement_mm[2] - depth) <= deeper + digits)

    crest = p["field_amplitude_ut"] * np.exp(
        p["field_growth_per_mm"] * (depth - p["field_reference_mm"])
    )
    x = np.sin(p["field_wavenumber_rad_per_mm"] * reach)
    chip_warmer = np.where(skin.wired[5], half[5], warmer)
    drift_ut = np.hypot(p["hall_drift_x_ut_per_k"], p["hall_drift_y_ut_per_k"])
    off = 1.15 * (np.hypot(half[2], half[3]) + drift_ut * chip_warmer) / (0.9 * crest)
    moved = off + 1.1 * x * (
        p["field_growth_per_mm"] * deeper
        + np.abs(p["film_drift_per_k"]) * warmer
        + np.abs(p["hall_gain_per_k"]) * chip_warmer
    )
    slope = np.sqrt(1.0 - np.minimum(x + moved, 0.9999) ** 2) * p["field_wavenumber_rad_per_mm"]
    further = moved / slope
    assert np.all(np.abs(np.hypot(*got.displacement_mm[:2]) - reach) <= further + digits)
    sideways = reach * 1.2 * off / np.maximum(x, 1e-9)
    wrong = np.hypot(*(got.displacement_mm[:2] - lateral))
    assert np.all(wrong <= further + sideways + digits)
    stiffest = p["normal_stiff_n_per_hz"] * half[1]
    normal = np.where(
        depth * p["frequency_slope_hz_per_mm"] < p["normal_break_hz"],
        depth * p["frequency_slope_hz_per_mm"] * p["normal_soft_n_per_hz"],
        p["normal_break_hz"] * p["normal_soft_n_per_hz"]
        + (depth * p["frequency_slope_hz_per_mm"] - p["normal_break_hz"])
        * p["normal_stiff_n_per_hz"],
    )
    assert np.all(np.abs(got.force[2] - normal) <= stiffest + digits)


@long_after_first("estimator", ESTIMATORS)
@long_after_first("layout", ["f3t-fd16", "f3t-fd64", "f3t-classic"])
def test_every_cycle_is_that_of_the_naive_decoder(layout, estimator):
    skin = stiffening(calibrated(row_of(37, layout), seed=3, turn_rad=0.3))
    raw = np.concatenate([sensible_counts(skin, 6, 4), sensible_counts(skin, 6, 5, most=0.3)])
    lost = np.random.default_rng(6).random((12, 37)) < 0.1
    status = np.where(lost, Status.LATE, 0).astype(np.uint16)
    expected = naive_decode(skin, raw, status, estimator, consistency=True)
    got = Decoder(skin, estimator=estimator, dtype="float64", sweeps=0, ambient=False)(raw, status)
    for name in ("status", "valid"):
        np.testing.assert_array_equal(getattr(got, name), expected[name], err_msg=name)
    for name in ("temperature", "force", "tangential", "displacement_mm"):
        np.testing.assert_allclose(getattr(got, name), expected[name], rtol=0, atol=1e-8)
    turn = np.abs(got.theta - expected["theta"])
    assert np.minimum(turn, 2.0 * np.pi - turn).max() < 1e-8


@long_after_first("estimator", ESTIMATORS)
def test_flags_are_those_of_the_naive_decoder_over_all_integers(estimator):
    for layout in ("f3t-fd16", "f3t-classic"):
        skin = calibrated(row_of(64, layout), seed=7, turn_rad=0.3)
        raw = any_counts(skin, 60, 8)
        raw[:, 5] = np.clip(raw[:, 5], -128, 127)
        expected = naive_decode(skin, raw, estimator=estimator, consistency=True)
        got = Decoder(skin, estimator=estimator, dtype="float64", sweeps=0, ambient=False)(raw)
        # The exponentials are bounded where the count is impossible, and there only.
        sure = got.status & Status.OUT_OF_RANGE == 0
        possible = expected["status"] & Status.OUT_OF_RANGE == 0
        np.testing.assert_array_equal(sure, possible)
        np.testing.assert_array_equal(got.valid, expected["valid"])
        np.testing.assert_array_equal(got.status[sure], expected["status"][sure])
        assert sure.sum() > 50


# -- symmetries ----------------------------------------------------------------------------------


@given(seeds, dtypes, st.sampled_from([(-1, -1), (-1, 1), (1, -1)]))
def test_reflected_fields_give_reflected_forces_to_the_bit(seed, dtype, signs):
    skin = row_of(40)
    raw = sensible_counts(skin, 1, seed)[0]
    decoder = sine(skin, dtype=dtype)
    before = decoder(raw)
    force, place = before.force.copy(), before.displacement_mm.copy()
    reflected = raw.copy()
    reflected[2:4] *= np.array(signs, np.int16)[:, np.newaxis]
    decoder.reset()
    after = decoder(reflected)
    signs = np.array([*signs, 1], dtype)[:, np.newaxis]
    np.testing.assert_array_equal(after.force, signs * force)
    np.testing.assert_array_equal(after.displacement_mm, signs * place)


# -- edges ---------------------------------------------------------------------------------------


def test_direction_is_corrected_by_its_table():
    """A table that is the same everywhere turns; a single knot acts between its neighbours only."""
    n, arcsine = 64, functools.partial(Decoder, estimator="sine", dtype="float64")
    direction = np.linspace(-np.pi, np.pi, n, endpoint=False) + 0.01
    raw = nominal_counts(n=n)
    raw[2], raw[3] = np.round(2000 * np.cos(direction)), np.round(2000 * np.sin(direction))
    plain = arcsine(row_of(n))(raw)
    even = with_parameters(row_of(n), theta_correction_rad=0.25)
    turned = arcsine(even)(raw)
    shift = (turned.theta - plain.theta + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(shift, 0.25, atol=1e-12)
    np.testing.assert_allclose(turned.tangential, plain.tangential, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*turned.force[:2]), turned.tangential, atol=1e-12)

    for knot in (0, 5):
        table = np.zeros((THETA_KNOTS, n))
        table[knot] = 0.2
        one = arcsine(with_parameters(row_of(n), theta_correction_rad=table))(raw)
        shift = (one.theta - plain.theta + np.pi) % (2.0 * np.pi) - np.pi
        away = (plain.theta - (-np.pi + knot * np.pi / 8.0) + np.pi) % (2.0 * np.pi) - np.pi
        hat = 0.2 * np.maximum(1.0 - np.abs(away) / (np.pi / 8.0), 0.0)
        np.testing.assert_allclose(shift, hat, atol=1e-12)


@pytest.mark.parametrize(
    ("wanted", "dtype"),
    [*(({name}, "float32") for name in UNIT_WANTS), (set(), "float32"), ({"force"}, "float64")],
)
def test_what_is_wanted_does_not_change_it(wanted, dtype):
    skin = calibrated(row_of(18), seed=5, turn_rad=0.1)
    raw = sensible_counts(skin, 2, 6, most=0.8)
    everything, some = (
        Decoder(skin, dtype=dtype, sweeps=0, ambient=False)(raw),
        Decoder(skin, wanted, dtype=dtype, sweeps=0, ambient=False)(raw),
    )
    names = dict(zip(UNIT_WANTS, FIELDS[:5], strict=False)) | {"field": "field_ut"}
    names |= {"test_ratio": "test_ratio"}
    for want, name in names.items():
        if want in wanted:
            np.testing.assert_array_equal(getattr(some, name), getattr(everything, name))
        else:
            assert getattr(some, name) is None
    np.testing.assert_array_equal(some.valid, everything.valid)
