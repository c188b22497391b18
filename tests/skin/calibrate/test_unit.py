"""A skin on a bench: every parameter is found again, and its sigma holds."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from skin.calibrate.film import fit_film
from skin.calibrate.unit import calibrate
from skin.errors import ScanError
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.scan import strokes
from skin.sim.bench import Bench, record
from tests.fixtures.decode import row_of, with_parameters

UNITS = 3
SPREAD = {
    "frequency_rest_hz": 0.02, "frequency_slope_hz_per_mm": 0.03, "gel_current_20c_ua": 0.05,
    "gel_current_ratio": 0.05, "normal_soft_n_per_hz": 0.05, "normal_break_hz": 0.05,
    "normal_stiff_n_per_hz": 0.05, "shear_soft_n_per_mm": 0.05, "shear_break_mm": 0.03,
    "shear_stiff_n_per_mm": 0.05, "film_drift_per_k": 0.2, "hall_gain_per_k": 0.3,
}  # fmt: skip
"""Parameters of which the simulated unit has a law, and how far they differ from the nominal."""
OFFSETS = tuple(f"hall_offset_{axis}_ut" for axis in "xyz")


@functools.cache
def skins():
    """Nominal units, and what they really are."""
    rng = np.random.default_rng(3)
    nominal = row_of(UNITS)
    made = {name: nominal.parameters[name] * (1.0 + s * rng.uniform(-1.0, 1.0, UNITS))
            for name, s in SPREAD.items()}  # fmt: skip
    for name in OFFSETS:
        made[name] = rng.uniform(-150.0, 150.0, UNITS)
    made["field_amplitude_ut"] = 11073.0 * (1.0 + 0.05 * rng.uniform(-1.0, 1.0, UNITS))
    return nominal, with_parameters(nominal, **made)


@functools.cache
def on_the_bench(fabricated=False, seed=5):
    nominal, made = skins()
    films = Fabrication.draw(UNITS, seed=3) if fabricated else None
    bench = Bench(made, fabrication=films, seed=seed, quantised=True)
    bare = Bench(with_parameters(made, field_amplitude_ut=1e-6), seed=seed + 1, quantised=True)
    return calibrate(nominal, record(bench, bare))


@pytest.mark.parametrize("name", [*SPREAD, *OFFSETS])
def test_parameters_are_found_again_within_their_sigma(name):
    _, made = skins()
    calibration = on_the_bench()
    for unit, fits in enumerate(calibration.units.values()):
        *_, fit = (fit for fit in fits if name in fit.names)
        off = fit[name] - made.parameters[name][unit]
        assert abs(off) < 4.0 * fit.sigma[fit.names.index(name)]
        assert calibration.topology.parameters[name][unit] == fit[name]


def test_a_film_as_drawn_is_followed_to_a_few_micrometres_one_with_errors_says_that_it_is_not():
    drawn, made = on_the_bench(), on_the_bench(fabricated=True)
    for name in drawn.films:
        assert drawn.films[name].sigma_mm < 0.003
        assert 0.005 < made.films[name].spread_mm < 0.03
    p = made.topology.parameters
    assert (p["field_angle_sigma_mm"] > 0.005).all()
    assert (p["field_amplitude_sigma_relative"] > 0.002).all()


def test_a_film_beside_its_chip_is_found_there():
    place = Fabrication.draw(UNITS, seed=3).centre_mm
    p = on_the_bench(fabricated=True).topology.parameters
    # a tilt looks a little like a shift
    assert np.abs(np.stack([p["film_x_mm"], p["film_y_mm"]]) - place).max() < 0.01
    p = on_the_bench().topology.parameters
    assert np.hypot(p["film_x_mm"], p["film_y_mm"]).max() < 0.004


@pytest.mark.parametrize("fabricated", [False, True])
def test_the_sigma_of_a_film_is_the_error_of_its_displacement(fabricated):
    """On poses that the fit has not seen, without noise; a component, root mean square."""
    _, made = skins()
    films = Fabrication.draw(UNITS, seed=3) if fabricated else None
    poses = strokes(np.linspace(0.1, 1.9, 7), np.linspace(0.1, 2.9, 9), np.linspace(-3.0, 3.0, 13))
    scan = Bench(made, fabrication=films, noise=False).scan(*poses)
    calibration = on_the_bench(fabricated)
    for unit, film in enumerate(calibration.films.values()):
        p = {name: values[..., unit] for name, values in calibration.topology.parameters.items()}
        field = scan.field_ut[..., unit] - np.stack([p[name] for name in OFFSETS])
        x = p["field_xx"] * field[:, 0] + p["field_xy"] * field[:, 1]
        y = p["field_yx"] * field[:, 0] + p["field_yy"] * field[:, 1]
        size, depth = np.hypot(x, y), scan.depth_mm[:, unit]
        angle = np.arctan2(size, field[:, 2])
        table = p["field_angle_mm"].reshape(4, 4)
        reach = sum(
            table[i, j] * angle ** (2 * i + 1) * depth**j for i in range(4) for j in range(4)
        )
        along = scan.direction_rad[:, unit]
        true = scan.displacement_mm[:, unit] * np.stack([np.cos(along), np.sin(along)])
        centre = np.stack([p["film_x_mm"], p["film_y_mm"]])[:, np.newaxis]
        error = np.stack([x, y]) / size * reach - centre - true
        rms = np.sqrt(np.mean(error**2))
        assert rms < 2.0 * film.sigma_mm + 0.001
        assert not fabricated or rms > 0.6 * film.sigma_mm


def test_the_range_of_the_force_ends_where_the_bench_has_pressed_to():
    calibration, (_, made) = on_the_bench(fabricated=False), skins()
    pressed = Elastic(made).normal(2.0)
    np.testing.assert_allclose(calibration.topology.parameters["normal_max_n"], pressed, rtol=5e-3)


def test_a_recording_that_cannot_tell_names_the_unit():
    nominal, made = skins()
    bench = Bench(made, seed=1)
    recordings = record(bench, bench, readings=2)
    flat = dataclasses.replace(recordings, pressed=bench.scan(np.zeros(9), 0.0))
    with pytest.raises(ScanError, match="row/r0c0: depth_mm: must have 2 levels"):
        calibrate(nominal, flat)


def test_strokes_along_one_line_do_not_tell_a_direction():
    scan = Bench(row_of(1)).scan(*strokes(np.linspace(0, 2, 6), np.linspace(0.1, 3, 9), 0.0))
    one = (scan.field_ut[..., 0], scan.depth_mm[:, 0], scan.displacement_mm[:, 0])
    with pytest.raises(ScanError, match="direction_rad: must have 4 levels"):
        fit_film(*one, scan.direction_rad[:, 0])
