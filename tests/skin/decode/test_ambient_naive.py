"""Ambient field and zeros against plain numpy, from any state: each rule at its bounds."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bus.status import Status
from skin.decode import ambient_kernels as kernels
from skin.decode.ambient import Ambient
from skin.decode.ambient_kernels import MEMORY
from tests.fixtures.ambient import look
from tests.fixtures.decode import calibrated, row_of, with_parameters
from tests.naive.ambient import NaiveAmbient, state_of

UNITS = 14
BODY = np.array([0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1, 1])
FLAGS = [0, 0, 0, 0, 0, 0, Status.IDLE, Status.EXTRAPOLATED, Status.LATE, Status.SATURATED]


def tumbled(rate_hz=250.0):
    """Units of two bodies, each in an attitude and with a calibration of its own; two of them have
    no Bz."""
    rng = np.random.default_rng(0)
    skin = calibrated(row_of(UNITS, rate_hz=rate_hz), seed=5)
    skin = with_parameters(
        skin, film_x_mm=rng.uniform(-0.1, 0.1, UNITS), film_y_mm=rng.uniform(-0.1, 0.1, UNITS),
        frequency_noise_hz=rng.uniform(4.0, 8.0, UNITS),
        field_noise_ut=rng.uniform(80.0, 120.0, UNITS),
    )  # fmt: skip
    wired = skin.wired.copy()
    wired[4, [3, 9]] = False
    scale = skin.scale * rng.uniform(1.0, 40.0, skin.scale.shape)
    turns = np.moveaxis(Rotation.random(UNITS, rng=1).as_matrix(), 0, -1)
    return dataclasses.replace(
        skin, tared=np.arange(UNITS) % 5 > 0, rotation=turns, patch=BODY.astype(np.int32),
        patch_names=("a", "b"), scale=scale,
        patch_frames=("a", "b"), wired=wired, position=0.13 * skin.position,
    )  # fmt: skip


def any_state(ambient, naive, rng):
    """Memories on both sides of every bound, of units that may be pressed or not."""
    memory, n = SimpleNamespace(**{name: ambient.read(name) for name in MEMORY.names}), UNITS
    bodies = ambient._bodies
    pressed = rng.random(n) < rng.choice([0.0, 0.1, 0.6])  # none, few, or most, side by side
    pressed = np.arange(n) < rng.integers(7, n) if rng.random() < 0.2 else pressed
    load = np.where(pressed, rng.uniform(2.5, 8.0, n), rng.uniform(0.0, 2.9, n))
    memory.fast_hz[:] = naive.sigma_hz * load * rng.choice([-1.0, 1.0], n)
    memory.slow_hz[:] = naive.sigma_hz * rng.choice([0.6, 3.5], n) * rng.uniform(-1.0, 1.0, n)
    memory.long_ut[:] = rng.choice([3.0, 30.0, 400.0], n, p=[0.6, 0.2, 0.2]) * rng.uniform(
        -1.0, 1.0, (3, n)
    )
    memory.gel_c[:] = 30.0 + rng.uniform(-1.0, 1.0, n)
    memory.film_c[:] = memory.gel_c + rng.uniform(-0.3, 0.3, n)
    for times in (memory.age_s, memory.alone_s, memory.calm_s, memory.rest_s):
        times[:] = 0.25 * naive.slow_s * rng.integers(0, 48, n)
    memory.bound_hz[:] = rng.choice([0.5, 3.0, 3.0 * naive.sigma_hz.min()], n)
    if rng.random() < 0.5:
        memory.bound_hz[:] = 0.5
        memory.fast_hz[:] *= np.where(pressed, 1.0, rng.choice([0.02, 0.1, 0.3]))
    memory.rest_ut[:] = np.where(rng.random(n) < 0.3, np.nan, rng.uniform(3e3, 5e3, n))
    memory.rest_film_c[:] = memory.film_c + rng.choice([np.nan, 0.0, -9.0, 9.0], n)
    memory.marks[:] = rng.choice([0, kernels.VOTES, kernels.TOUCHED], n)
    memory.zero[:] = np.array([[60.0], [200.0], [200.0]]) * rng.choice(
        [-1.0, -0.5, 0.3, 1.0], (3, n)
    )
    for name, values in vars(memory).items():
        ambient._write(ambient._memory, name, values)
    bodies["held_s"] = rng.choice([0.0, 0.2, 3.0, 40.0], 2)
    bodies["now"]["field_ut"] = 40.0 * rng.standard_normal((2, 3))
    for covariance in bodies["now"]["covariance_ut2"]:
        root = rng.standard_normal((3, 3))
        covariance[:] = 20.0 * root @ root.T + 9.0 * np.eye(3)
    bodies["kept_s"] = rng.choice([0.0, 0.045, 0.2], 2)
    for kept in ("older", "newer"):
        bodies[kept]["field_ut"] = 40.0 * rng.standard_normal((2, 3))
        more = rng.uniform(0.5, 2.0, (2, 1, 1))
        bodies[kept]["covariance_ut2"] = more * bodies["now"]["covariance_ut2"]


def any_reading(naive, state, rng):
    n = UNITS
    drop = state.fast_hz + naive.sigma_hz * rng.uniform(-0.2, 0.2, n)
    field = 250.0 * rng.uniform(-1.0, 1.0, (3, n)) * rng.choice([0.2, 1.0, 3.0], n)
    field[2] += np.where(np.isnan(state.rest_ut), 4000.0, state.rest_ut)
    field[rng.integers(0, 3), rng.random(n) < 0.08] = np.nan
    field[:, rng.random(n) < 0.04] = np.inf
    temperature = state.gel_c + rng.uniform(-0.3, 0.3, n)
    temperature[rng.random(n) < 0.05] = np.nan
    status = rng.choice(FLAGS, n).astype(np.uint16)
    depth = np.zeros((3, n))
    depth[2] = drop / naive.skin.parameters["frequency_slope_hz_per_mm"]
    return SimpleNamespace(
        field_ut=field, displacement_mm=depth, temperature=temperature, status=status
    )


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("near_votes", [False, True])
@pytest.mark.parametrize("rate_hz", [250.0, 10.0])
def test_a_cycle_from_any_state_is_that_of_the_naive_one(near_votes, rate_hz):
    skin, rng = tumbled(rate_hz), np.random.default_rng(int(rate_hz) + near_votes)
    ambient = Ambient(skin, dtype="float64", crosstalk=near_votes)
    naive = NaiveAmbient(skin, BODY, near_votes=near_votes)
    followed = learnt = lies = 0
    for _ in range(320):
        any_state(ambient, naive, rng)
        before = state_of(ambient)
        reading = any_reading(naive, before, rng)
        dt_s = rng.choice([0.004, 0.1, 0.25 * naive.slow_s, 0.5 * naive.slow_s])
        expected = naive.step(before, reading, dt_s)
        shown = look(ambient, reading, dt_s)
        found = state_of(ambient)
        found.background, found.residue_ut2 = ambient.background, ambient.residue_ut2
        found.followed = ambient.followed
        found.lies = shown.status & Status.MAGNETIC_ANOMALY != 0
        np.testing.assert_array_equal(shown.valid, ~found.lies)
        for name, value in vars(expected).items():
            np.testing.assert_allclose(
                getattr(found, name), value, rtol=1e-7, atol=1e-7, err_msg=name
            )
        followed += expected.followed.sum()
        learnt += np.sum(expected.rest_s != before.rest_s)
        lies += expected.lies.sum()
    assert followed > 30
    assert learnt > 30
    assert lies > 10


def test_units_of_all_blocks_are_looked_at():
    """150 units are more than one block of them, and not a whole number."""
    skin, rng = row_of(150), np.random.default_rng(4)
    skin = dataclasses.replace(skin, position=0.13 * skin.position)
    ambient = Ambient(skin, dtype="float64")
    naive = NaiveAmbient(skin, np.zeros(150, int))
    state = state_of(ambient)
    for _ in range(2):
        depth = np.zeros((3, 150))
        depth[2] = rng.uniform(-0.03, 0.03, 150)
        reading = SimpleNamespace(
            field_ut=rng.uniform(-100.0, 100.0, (3, 150)), displacement_mm=depth,
            temperature=rng.uniform(20.0, 40.0, 150), status=np.zeros(150, np.uint16),
        )  # fmt: skip
        look(ambient, reading)
        state = naive.step(state, reading, 1.0)
        found = state_of(ambient)
        for name, value in vars(found).items():
            np.testing.assert_allclose(
                value, getattr(state, name), rtol=1e-7, atol=1e-7, err_msg=name
            )
