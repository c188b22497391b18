"""One sigma of every output, made of one source at a time: what that source does to the output.

Slopes are differences of the naive decoder, which knows nothing of sigmas.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.decode.decoder import Decoder
from tests.fixtures.decode import row_of, with_parameters
from tests.naive.decode import naive_decode
from tests.skin.decode.test_field_angle import counts_at
from tests.skin.decode.test_sigma import naive_rows, rows_of

pytestmark = pytest.mark.usefixtures("interpreted")

UNITS = 6
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)
STEP = 12.0**-0.5
QUIET = dict.fromkeys(("gel_noise_relative", "frequency_noise_hz", "field_noise_ut"), 0.0)
ESTIMATORS = ("sine", "field-angle")


def silent(layout="f3t-fd16", steps=None, **parameters):
    """Units without noise and with steps of counts that do not matter, but for those that do."""
    skin = row_of(UNITS, layout)
    scale = skin.scale * 1e-6
    for channel, step in (steps or {}).items():
        scale[channel] = step
    return with_parameters(dataclasses.replace(skin, scale=scale), **(QUIET | parameters))


def pose(skin, depth=1.0, reach=1.2, warm=40.0):
    """Counts of fine steps of units at a pose, in all directions; and their skin with offsets that
    tell the rest, since fine counts would not fit 16 bits."""
    nominal = row_of(UNITS)
    raw = counts_at(nominal, depth, reach, np.linspace(-2.6, 2.9, UNITS), 25.0)
    value = nominal.scale * raw + nominal.offset
    p = skin.parameters
    value[GEL] = p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((warm - 20.0) / 60.0)
    value[CHIP] = warm
    near = np.rint(value / skin.scale).clip(-30000, 30000)
    return dataclasses.replace(skin, offset=value - skin.scale * near), near.astype(np.int16)


def spread(skin, raw, channel, sigma, estimator):
    """What one sigma of a channel does to each output, shape (n,)."""
    told = []
    for way in (-0.01, 0.01):
        offset = skin.offset.copy()
        offset[channel] += way * sigma
        moved = dataclasses.replace(skin, offset=offset)
        told.append(naive_rows(naive_decode(moved, raw[np.newaxis], None, estimator)))
    return {name: np.abs(told[1][name] - told[0][name])[0] / 0.02 for name in told[0]}


def sigma_of(skin, raw, estimator):
    found = Decoder(
        skin, None, estimator, dtype="float64", consistency=False, sweeps=0, ambient=False
    )(raw[np.newaxis])
    return {name: value[0] for name, value in rows_of(found, sigma=True).items()}


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("source", ["noise", "step", "rest"])
def test_frequency(source, estimator):
    """To the depth and all that follows from it; R of the same depth is taken as independent of
    the stiffness by depth, so that this is tested where R does not depend on it."""
    given = {
        "noise": (silent(frequency_noise_hz=8.0), 8.0),
        "step": (silent(steps={FREQUENCY: 30.0}), 30.0 * STEP),
        "rest": (silent(frequency_sigma_hz=8.0), 8.0),
    }
    skin, sigma = given[source]
    skin, raw = pose(skin, depth=1.4)
    expected, found = spread(skin, raw, FREQUENCY, sigma, estimator), sigma_of(skin, raw, estimator)
    for name in ("h", "fz", "tangential"):
        np.testing.assert_allclose(found[name], expected[name], rtol=0.01, err_msg=name)
    assert np.hypot(found["x"], found["y"]) == pytest.approx(
        np.hypot(expected["x"], expected["y"]), rel=0.01
    )
    assert np.abs(found["theta"]).max() < 1e-3 * np.abs(found["tangential"]).min()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_depth_that_is_not_known_leaves_the_stiffness_by_depth_open(estimator):
    """By hand: 0.6 N at 1.2 mm, a fifth more per mm, 0.1 mm; beside what the length leaves open."""
    sigma = {}
    for gain in (0.0, 0.2):
        skin, raw = pose(silent(frequency_noise_hz=90.0, shear_gain_per_mm=gain), depth=1.4)
        sigma[gain] = sigma_of(skin, raw, estimator)["tangential"]
    softer = 1.0 + 0.2 * (1.4 - 2.0)
    expected = np.hypot(softer * sigma[0.0], 0.6 * 0.2 * 0.1)
    np.testing.assert_allclose(sigma[0.2], expected, rtol=0.003)


FIELD = {
    "steps": ({}, {BX: 60.0, BY: 20.0}, {BX: 60.0 * STEP, BY: 20.0 * STEP}),
    "map": (
        {"field_xx": 1.2, "field_xy": 0.3, "field_yx": -0.5, "field_yy": 0.8,
         "field_noise_ut": 40.0}, {}, {BX: 40.0, BY: 40.0},
    ),
    "calibration": ({"field_sigma_ut": 30.0}, {}, {BX: 30.0, BY: 30.0}),
    "drift by the chip's step": (
        {"hall_drift_x_ut_per_k": 20.0, "hall_drift_y_ut_per_k": -50.0}, {CHIP: 2.0},
        {CHIP: 2.0 * STEP},
    ),
}  # fmt: skip


@pytest.mark.parametrize("source", FIELD)
def test_sources_of_the_field_near_its_axis(source):
    """There both components are known alike; their squares add up to those of the sources."""
    parameters, steps, sigmas = FIELD[source]
    skin, raw = pose(silent(steps=steps, **parameters), reach=0.02)
    each = [spread(skin, raw, channel, sigma, "sine") for channel, sigma in sigmas.items()]
    expected = sum(one["x"] ** 2 + one["y"] ** 2 for one in each)
    found = sigma_of(skin, raw, "sine")
    np.testing.assert_allclose(found["x"] ** 2 + found["y"] ** 2, expected, rtol=0.03)


AMPLITUDE = {
    "film": ({"film_drift_per_k": -0.004, "gel_noise_relative": 0.02}, {}, "f3t-fd16", GEL, 0.02),
    "chip": ({"hall_gain_per_k": -0.003, "film_drift_per_k": 0.0}, {CHIP: 3.0}, "f3t-fd16", CHIP,
             3.0 * STEP),
    "chip that follows the gel": (
        {"hall_gain_per_k": -0.003, "film_drift_per_k": 0.0, "gel_noise_relative": 0.02}, {},
        "f3t-classic", GEL, 0.02,
    ),
}  # fmt: skip


@pytest.mark.parametrize("source", AMPLITUDE)
def test_sources_of_the_amplitude(source):
    """What temperatures leave of the gains of film and chip moves R of the arcsine; as a share of
    the gains where they are 1."""
    parameters, steps, layout, channel, sigma = AMPLITUDE[source]
    skin, raw = pose(silent(layout, steps, **parameters), warm=25.0)
    if channel == GEL:
        sigma = sigma * (skin.scale[GEL] * raw[GEL] + skin.offset[GEL])
    expected, found = spread(skin, raw, channel, sigma, "sine"), sigma_of(skin, raw, "sine")
    assert expected["tangential"].min() > 1e-3
    np.testing.assert_allclose(found["tangential"], expected["tangential"], rtol=0.03)


@pytest.mark.parametrize("source", ["noise", "step", "calibration"])
def test_temperature(source):
    given = {
        "noise": silent(gel_noise_relative=0.02),
        "step": silent(steps={GEL: 2.0}),
        "calibration": silent(temperature_sigma_c=0.4),
    }
    skin, raw = pose(given[source], warm=33.0)
    current = skin.scale[GEL] * raw[GEL] + skin.offset[GEL]
    sigma = {"noise": 0.02 * current, "step": 2.0 * STEP, "calibration": 0.0}[source]
    expected = spread(skin, raw, GEL, sigma, "sine")["temperature"]
    expected = expected if source != "calibration" else 0.4
    found = sigma_of(skin, raw, "sine")["temperature"]
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_depth_beyond_its_range_on_both_sides():
    """Pressed beyond 7.2 N at 2 mm, or pulled by more than six sigma, and a sigma more."""
    skin = silent(frequency_noise_hz=9.0)
    for depth, beyond in ((2.5, 0.5), (-0.26, 0.2), (1.0, 0.0)):
        posed, raw = pose(skin, depth=depth, reach=0.1)
        found = sigma_of(posed, raw, "sine")["h"]
        np.testing.assert_allclose(found, 0.01 + 0.2 * max(beyond - 0.01, 0.0), rtol=2e-3)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_displacement_beyond_its_range(estimator):
    """A fifth of it, along the direction."""
    skin = silent(field_noise_ut=1.0, tangential_max_mm=1.5, field_angle_max_mm=1.5)
    skin, raw = pose(skin, reach=2.0 if estimator == "sine" else 1.55)
    got = Decoder(
        skin, None, estimator, dtype="float64", consistency=False, sweeps=0, ambient=False
    )(raw)
    found = np.hypot(*got.displacement_sigma_mm[:2])
    beyond = np.hypot(*got.displacement_mm[:2]) - 1.5
    assert beyond.min() > 0.04
    np.testing.assert_allclose(found, 0.2 * beyond, rtol=0.05)


@pytest.mark.parametrize("depth", [0.0, 0.02, 0.3, 1.5])
def test_absolute_parts_of_the_forces_add_to_the_rest_but_are_no_more_than_the_force(depth):
    skin, raw = pose(silent(normal_sigma_n=0.1, shear_sigma_n=0.2), depth=depth, reach=0.7)
    got = Decoder(skin, None, "field-angle", dtype="float64", sweeps=0, ambient=False)(raw)
    normal = np.minimum(np.abs(got.force[2]), 0.1)
    np.testing.assert_allclose(got.force_sigma[2], normal, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(got.tangential_sigma, np.minimum(got.tangential, 0.2), rtol=2e-3)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_errors_of_a_film_are_such_of_its_field(estimator):
    """Across the displacement as given, and along it what a field of that size makes."""
    shape = np.array([0.5, 0.1, -0.1, 0.02, 0.03, 0.01])
    skin, raw = pose(silent(field_angle_sigma_mm=0.03))
    p = skin.parameters
    table = np.repeat(shape[:, np.newaxis], skin.n, axis=1)
    skin = with_parameters(skin, field_angle_variance_relative=table)
    got = Decoder(skin, None, estimator, dtype="float64", sweeps=0, ambient=False)(raw)
    reach, depth = np.hypot(*got.displacement_mm[:2]), got.displacement_mm[2]
    terms = [reach ** (3 * i) * depth ** (2 * j) for i in range(3) for j in range(2)]
    across = 0.03 * np.sqrt(1.0 + shape @ np.stack(terms))
    np.testing.assert_allclose(got.theta_sigma, across / reach, rtol=2e-3)
    if estimator == "sine":
        u = p["field_wavenumber_rad_per_mm"] * reach
        along = across * np.tan(u) / u
        total = np.hypot(*got.displacement_sigma_mm[:2])
        np.testing.assert_allclose(total, np.hypot(along, across), rtol=1e-2)
