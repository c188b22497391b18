"""The fits tell what was put in, know how well they know it, and refuse scans that cannot tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skin.calibrate.amplitude import (
    fit_amplitude,
    fit_bare_chip,
    fit_drift,
)
from skin.calibrate.gel import fit_gel
from skin.calibrate.normal import fit_frequency, fit_normal
from skin.calibrate.shear import fit_shear
from skin.errors import ScanError
from skin.physics.least_squares import least_squares
from skin.physics.scan import strokes
from skin.sim.bench import Bench
from tests.fixtures.decode import calibrated, row_of, with_parameters
from topology.gel import gel_temperature

SEEDS = range(12)
DEPTHS, REACHES = np.linspace(0.0, 2.0, 6), np.linspace(0.0, 2.5, 14)
PRESS, SLIDE, _ = strokes(DEPTHS, REACHES)
AMPLITUDE = {"field_wavenumber_rad_per_mm": 0.63, "field_amplitude_ut": 10900.0,
             "field_growth_per_mm": 0.73, "field_growth_per_mm2": 0.02}  # fmt: skip
SHEAR = {"shear_soft_n_per_mm": 0.48, "shear_break_mm": 1.93, "shear_stiff_n_per_mm": 2.2,
         "shear_gain_per_mm": 0.04}  # fmt: skip
FALL = np.linspace(0.0, 1800.0, 80)
NORMAL = {"normal_soft_n_per_hz": 0.0017, "normal_break_hz": 523.0,
          "normal_stiff_n_per_hz": 0.0049}  # fmt: skip
GEL = {"gel_current_20c_ua": 10.4, "gel_current_ratio": 11.6}
FREQUENCY = {"frequency_rest_hz": 4567.0, "frequency_slope_hz_per_mm": 883.0}
DRIFT = {"film_drift_per_k": -0.0011, "hall_gain_per_k": 0.0005, "hall_drift_x_ut_per_k": 1.5,
         "hall_drift_y_ut_per_k": -2.0, "hall_drift_z_ut_per_k": 0.3}  # fmt: skip
BARE = {"hall_offset_x_ut": 120.0, "hall_drift_x_ut_per_k": 1.0, "hall_offset_y_ut": -80.0,
        "hall_drift_y_ut_per_k": 0.0, "hall_offset_z_ut": 300.0,
        "hall_drift_z_ut_per_k": -2.5}  # fmt: skip


def lateral(rng, noise=105.0):
    k, amplitude, growth, quadratic = AMPLITUDE.values()
    above = PRESS - 2.0
    field = amplitude * np.exp(growth * above + quadratic * above**2) * np.sin(k * SLIDE)
    return field + noise * rng.standard_normal(field.shape)


def scan_amplitude(rng):
    return fit_amplitude(lateral(rng), PRESS, SLIDE, degree=2)


def scan_shear(rng):
    soft, knee, stiff, gain = SHEAR.values()
    force = soft * SLIDE + stiff * np.maximum(SLIDE - knee, 0.0)
    force *= 1.0 + gain * (PRESS - 2.0)
    return fit_shear(force + 0.005 * rng.standard_normal(force.shape), SLIDE, PRESS)


def scan_normal(rng):
    soft, knee, stiff = NORMAL.values()
    force = np.where(FALL < knee, soft * FALL, soft * knee + stiff * (FALL - knee))
    return fit_normal(force + 0.005 * rng.standard_normal(FALL.size), FALL)


def scan_gel(rng):
    warm = np.linspace(20.0, 80.0, 60)
    current = GEL["gel_current_20c_ua"] * GEL["gel_current_ratio"] ** ((warm - 20.0) / 60.0)
    return fit_gel(current * (1.0 + 0.002 * rng.standard_normal(60)), warm)


def scan_frequency(rng):
    rest, slope = FREQUENCY.values()
    return fit_frequency(rest - slope * PRESS + 6.0 * rng.standard_normal(PRESS.size), PRESS)


def heated(rng, samples=150):
    """Four poses of known field, film and chip heated apart from each other."""
    poses = np.array([[0.0, 0.0, 17000.0], [9000.0, 0.0, 6e3], [0.0, 9e3, 6e3], [0.0, 0.0, 4e3]])
    pose = rng.integers(0, 4, samples)
    film, chip = rng.uniform(20.0, 80.0, samples), rng.uniform(20.0, 60.0, samples)
    a_film, a_chip, *drift = DRIFT.values()
    gain = (1.0 + a_film * (film - 25.0)) * (1.0 + a_chip * (chip - 25.0))
    field = gain[:, None] * poses[pose] + np.outer(chip - 25.0, drift)
    return field + 105.0 * rng.standard_normal(field.shape), film, chip, pose


def scan_drift(rng):
    return fit_drift(*heated(rng))


def scan_bare(rng):
    chip = rng.uniform(20.0, 70.0, 200)
    field = np.reshape(list(BARE.values()), (3, 2)) @ np.stack([np.ones(200), chip - 25.0])
    return fit_bare_chip(field.T + 105.0 * rng.standard_normal((200, 3)), chip)


def vogel(warm):
    """Current over that at 20 °C of a gel by Vogel, Fulcher and Tammann, 12 at 80 °C."""
    at = [1.0 / (t + 273.15 - 193.0) for t in (20.0, warm, 80.0)]
    return 12.0 ** ((at[0] - at[1]) / (at[0] - at[2]))


@pytest.mark.parametrize("seed", range(6))
def test_a_gel_of_another_law_gets_the_order_that_it_needs_and_an_exponential_one_none(seed):
    rng, warm = np.random.default_rng(seed), np.repeat(np.linspace(20.0, 80.0, 25), 4)
    noise = 1.0 + 0.002 * rng.standard_normal(warm.size)
    assert fit_gel(10.0 * 12.0 ** ((warm - 20.0) / 60.0) * noise, warm).names == tuple(GEL)
    other = fit_gel(10.4 * vogel(warm) * noise, warm)
    assert other.names == (*GEL, "gel_bend_c", "gel_twist_c")
    p = {name: other[name] for name in other.names}
    between = np.linspace(21.0, 79.0, 40)
    told = gel_temperature(p, 10.4 * vogel(between) / p["gel_current_20c_ua"])
    assert np.abs(told - between).max() < 0.2
    first = fit_gel(10.4 * vogel(warm) * noise, warm, order=1)
    p = {"gel_bend_c": 0.0, "gel_twist_c": 0.0} | {name: first[name] for name in first.names}
    told = gel_temperature(p, 10.4 * vogel(between) / p["gel_current_20c_ua"])
    assert np.abs(told - between).max() > 2.0


def test_three_temperatures_tell_no_order():
    warm = np.repeat([20.0, 50.0, 80.0], 30)
    noise = 1.0 + 0.002 * np.random.default_rng(1).standard_normal(warm.size)
    assert fit_gel(10.0 * vogel(warm) * noise, warm).names == tuple(GEL)


FITS = {
    "amplitude": (scan_amplitude, AMPLITUDE),
    "shear": (scan_shear, SHEAR),
    "frequency": (scan_frequency, FREQUENCY),
    "normal": (scan_normal, NORMAL),
    "gel": (scan_gel, GEL),
    "drift": (scan_drift, DRIFT),
    "bare chip": (scan_bare, BARE),
}


@pytest.mark.parametrize("name", FITS)
def test_parameters_lie_within_three_sigma_of_the_truth_as_often_as_the_covariance_says(name):
    scan, truth = FITS[name]
    true = np.array(list(truth.values()))
    squares, off = [], []
    for seed in SEEDS:
        fit = scan(np.random.default_rng(seed))
        assert fit.names == tuple(truth)
        squares.append((fit.values - true) @ np.linalg.solve(fit.covariance, fit.values - true))
        off.append((fit.values - true) / fit.sigma)
        assert 0.6 < fit.chi2 < 1.5
    off = np.abs(off)
    assert np.mean(off < 3.0) > 0.97
    assert 0.5 < np.mean(off < 1.0) < 0.9
    # the whole covariance, not its diagonal alone: chi square of p degrees, mean of 12
    assert 0.4 < np.mean(squares) / true.size < 1.8


def test_the_bench_tells_each_unit_its_own_calibration():
    skin = calibrated(row_of(4), seed=3)
    p = skin.parameters
    bench = Bench(skin, seed=1)
    strike = bench.scan(*strokes(DEPTHS, np.linspace(0.0, 2.6, 14)))
    for unit in range(skin.n):
        frequency = fit_frequency(strike.frequency_hz[:, unit], strike.depth_mm[:, unit])
        shear = fit_shear(
            strike.force_n[:, 0, unit], strike.displacement_mm[:, unit], strike.depth_mm[:, unit]
        )
        for fit in (frequency, shear):
            truth = np.array([p[name][unit] for name in fit.names])
            assert (np.abs(fit.values - truth) < 4.0 * fit.sigma).all()


def test_the_sine_law_fits_the_film_of_magnet_theory():
    scan = Bench(row_of(1), noise=False).scan(PRESS, SLIDE)
    field = scan.field_ut[:, 0, 0]
    linear = fit_amplitude(field, PRESS, SLIDE, sigma_ut=1.0)
    quadratic = fit_amplitude(field, PRESS, SLIDE, sigma_ut=1.0, degree=2)
    assert linear.residual_rms < 0.002 * linear["field_amplitude_ut"]
    assert quadratic.residual_rms < linear.residual_rms
    assert 0.61 < linear["field_wavenumber_rad_per_mm"] < 0.64
    # where the law does not hold to the stated noise, the covariance owns up to it
    surer = fit_amplitude(field, PRESS, SLIDE, sigma_ut=0.01)
    np.testing.assert_allclose(surer.sigma, linear.sigma, rtol=1e-3)


@settings(max_examples=10)
@given(st.permutations(range(PRESS.size)))
def test_the_order_of_the_samples_does_not_matter(order):
    field = lateral(np.random.default_rng(3))
    one = fit_amplitude(field, PRESS, SLIDE)
    other = fit_amplitude(field[order], PRESS[order], SLIDE[order])
    np.testing.assert_allclose(other.values, one.values, rtol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_least_squares_is_numpys(seed, scale):
    rng = np.random.default_rng(seed)
    matrix, values = rng.standard_normal((30, 4)), rng.standard_normal(30)
    sigma = scale * rng.uniform(0.5, 2.0, 30)
    fit = least_squares(matrix * [1.0, 1e6, 1e-6, 1.0], values, sigma, "abcd")
    naive = np.linalg.lstsq(matrix / sigma[:, None], values / sigma, rcond=None)[0]
    np.testing.assert_allclose(fit.values * [1.0, 1e6, 1e-6, 1.0], naive, rtol=1e-8, atol=1e-10)


def test_units_do_not_disturb_each_others_scans():
    skin = calibrated(row_of(3), seed=2)
    others = {name: values.copy() for name, values in skin.parameters.items()}
    for name in ("field_amplitude_ut", "frequency_rest_hz", "hall_offset_x_ut"):
        others[name][1:] *= 1.3
    poses = strokes(DEPTHS, REACHES)
    one = Bench(skin, noise=False).scan(*poses)
    other = Bench(with_parameters(skin, **others), noise=False).scan(*poses)
    assert (one.field_ut[..., 0] == other.field_ut[..., 0]).all()
    assert (one.frequency_hz[:, 0] == other.frequency_hz[:, 0]).all()
    assert (one.field_ut[..., 1] != other.field_ut[..., 1]).any()


def test_the_benchs_field_knows_no_parameter_of_the_sine_law_but_the_amplitude():
    skin = row_of(1)
    bent = with_parameters(
        skin, field_wavenumber_rad_per_mm=0.4, field_growth_per_mm=0.5, field_vertical_ratio=1.0
    )
    scans = [Bench(s, noise=False).scan(PRESS, SLIDE).field_ut for s in (skin, bent)]
    assert (scans[0] == scans[1]).all()


def test_averaging_readings_lowers_the_noise_by_the_root_of_their_number():
    skin = row_of(16)
    exact = Bench(skin, noise=False).scan(PRESS, 1.0).field_ut
    for readings in (1, 9):
        noise = Bench(skin, seed=4).scan(PRESS, 1.0, readings=readings).field_ut - exact
        assert np.std(noise) == pytest.approx(105.0 / np.sqrt(readings), rel=0.05)


def test_quantised_readings_are_what_the_wire_carries():
    skin = row_of(2)
    scan = Bench(skin, seed=4, quantised=True).scan(PRESS, SLIDE)
    counts = scan.counts[:, 2:5] * skin.scale[2:5] + skin.offset[2:5]
    np.testing.assert_allclose(scan.field_ut, counts, atol=1e-9)


# -- refusals ------------------------------------------------------------------------------------

FIELD = lateral(np.random.default_rng(0))
SPOILT = np.where(np.arange(PRESS.size) == 7, np.nan, FIELD)
HEAT = heated(np.random.default_rng(0))
AROUND = np.linspace(-np.pi, np.pi, 64, endpoint=False)
ROUND = 9e3 * np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)
REFUSED = {
    "one depth": (
        lambda: fit_amplitude(FIELD, np.full(PRESS.size, 2.0), SLIDE),
        "depth_mm: must have 2 levels or more, 0.05 apart, to tell its effect; got 1 between 2 "
        "and 2",
    ),
    "not a number": (
        lambda: fit_amplitude(SPOILT, PRESS, SLIDE),
        "lateral_ut[7]: must be finite; got nan (and 0 more such samples)",
    ),
    "too few": (
        lambda: fit_amplitude(FIELD[:2], PRESS[:2], SLIDE[:2]),
        "lateral_ut: must be 3 samples or more; got 2",
    ),
    "lengths": (
        lambda: fit_amplitude(FIELD, PRESS[:-1], SLIDE),
        "depth_mm: must be 84 samples, as lateral_ut; got 83",
    ),
    "no shear": (
        lambda: fit_amplitude(0.0 * FIELD, PRESS, SLIDE),
        "lateral_ut: must rise above 5 sigma, 525 µT; got 0 at most",
    ),
    "frequency at one depth": (
        lambda: fit_frequency(FIELD, np.zeros(PRESS.size)),
        "depth_mm: must have 2 levels or more, 0.05 apart, to tell its effect; got 1 between 0 "
        "and 0",
    ),
    "film and chip together": (
        lambda: fit_drift(HEAT[0], HEAT[1], HEAT[1], HEAT[3]),
        "film_temperature, chip_temperature: must change apart from each other to tell "
        "film_drift_per_k and hall_gain_per_k apart (heat film and chip in turn); got "
        "temperatures of which one follows the other",
    ),
    "one pose": (
        lambda: fit_drift(*HEAT[:3], np.zeros(150, int)),
        "pose: must be 2 or more, of different fields, to tell the chip's gain from its offset's "
        "drift; got 1",
    ),
    "normal force before the break": (
        lambda: fit_normal(FALL / 600.0, FALL),
        "fall_hz: must reach beyond the break, where the law stiffens, to tell normal_break_hz; "
        "got 0 to 1800 Hz",
    ),
    "gel at one temperature": (
        lambda: fit_gel(np.full(9, 10.0), np.full(9, 20.0)),
        "temperature: must have 2 levels or more, 5 apart, to tell its effect; got 1 between 20 "
        "and 20",
    ),
    "no current": (
        lambda: fit_gel(np.array([10.0, 0.0]), np.array([20.0, 80.0])),
        "current_ua[1]: must be above 0; got 0",
    ),
    "before the break": (
        lambda: fit_shear(0.5 * SLIDE, 0.5 * SLIDE, PRESS),
        "displacement_mm: must reach beyond the break, where the law stiffens, to tell "
        "shear_break_mm",
    ),
    "force at one depth": (
        lambda: fit_shear(0.5 * SLIDE, SLIDE, np.full(PRESS.size, 1.0)),
        "depth_mm: must have 2 levels or more, 0.1 apart, to tell its effect; got 1 between 1 "
        "and 1",
    ),
    "two names for one effect": (
        lambda: least_squares(np.ones((5, 2)), np.ones(5), 1.0, ("left", "right")),
        "scan: must tell left, right apart; got samples in which they have one and the same effect",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_scan_that_cannot_tell_is_refused_by_what_it_lacks(case):
    fit, message = REFUSED[case]
    with pytest.raises(ScanError) as caught:
        fit()
    assert str(caught.value).startswith(message)


def test_a_slope_that_is_not_well_known_is_in_the_normal_law():
    force = np.where(FALL < 540.0, FALL / 600.0, 0.9 + (FALL - 540.0) / 200.0)
    sure, unsure = (fit_normal(force, FALL, fall_sigma_relative=s) for s in (0.0, 0.01))
    assert (unsure.values == sure.values).all()
    np.testing.assert_allclose(unsure.sigma, np.hypot(sure.sigma, 0.01 * sure.values))
    # one factor: where the fall reads too large, N/Hz are too few and the break too far
    spread = unsure.covariance - sure.covariance
    assert spread[0, 2] > 0.0 > spread[0, 1]
