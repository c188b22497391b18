"""Laws of the decoder: the truth where nothing is noisy, the naive one, and no more than asked."""

from __future__ import annotations

import numpy as np
import pytest

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

FIELDS = ("temperature", "force", "tangential", "theta", "displacement_mm", "status", "valid")


def off_centre(skin, seed=2, most_mm=0.15):
    """The same skin with films beside their chips' axes."""
    place = np.random.default_rng(seed).uniform(-most_mm, most_mm, (2, skin.n))
    return with_parameters(skin, film_x_mm=place[0], film_y_mm=place[1])


# -- truth ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["f3t-fd16", "f3t-classic"])
def test_decoding_undoes_the_simulated_unit_within_its_steps(layout):
    """Poses of all depths, displacements below the crest, and temperatures; without noise."""
    skin, rng = calibrated(row_of(40, layout), 3, turn_rad=0.1), np.random.default_rng(1)
    skin = with_parameters(skin, field_growth_per_mm2=0.0)  # as the simulated unit has it
    shape = (12, skin.n)
    depth, around = rng.uniform(0.0, 2.0, shape), rng.uniform(-np.pi, np.pi, shape)
    reach = rng.uniform(0.0, 0.85, shape) * 0.5 * np.pi
    reach = reach / skin.parameters["field_wavenumber_rad_per_mm"]
    place = reach[:, np.newaxis] * np.stack([np.cos(around), np.sin(around)], axis=1)
    warm = np.broadcast_to(rng.uniform(20.0, 80.0, skin.n), shape)
    units = UnitSimulator(skin, noise=False)
    counts = units.quantise(units.quantities(depth, place, warm))
    got = sine(skin, dtype="float64")(counts)
    step = np.abs(skin.scale).max(axis=1)
    assert np.abs(got.temperature - warm).max() < 0.5
    assert np.abs(got.displacement_mm[:, 2] - depth).max() < 0.6 * step[1] / 800.0
    assert np.abs(got.displacement_mm[:, :2] - place).max() < 1e-3 * step[2]


@long_after_first("estimator", ESTIMATORS)
@long_after_first("layout", ["f3t-fd16", "f3t-fd64", "f3t-classic"])
def test_every_cycle_is_that_of_the_naive_decoder(layout, estimator):
    skin = off_centre(stiffening(calibrated(row_of(37, layout), seed=3, turn_rad=0.3)))
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


# -- no more than is asked for ------------------------------------------------------------------


@pytest.mark.usefixtures("interpreted")
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


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_the_tangential_force_follows_the_field_as_by_differences(estimator):
    skin = off_centre(stiffening(calibrated(row_of(21), seed=1)))
    counts, step = sensible_counts(skin, 1, most=0.9)[0], 1e-3
    options = {"dtype": "float64", "consistency": False, "sweeps": 0, "ambient": False}
    expected = np.empty((2, 3, skin.n))
    for axis in range(3):
        by = np.zeros((4, skin.n))
        by[1 + axis] = step
        more, less = (
            Decoder(skin, None, estimator, **options)(counts, background=way * by)
            for way in (-1, 1)
        )
        expected[:, axis] = (more.force[:2] - less.force[:2]) / (2.0 * step)
    decoder = Decoder(skin, None, estimator, **options)
    decoder(counts)
    found = decoder.force_per_ut.reshape(2, 3, skin.n)
    turn = np.array([[skin.parameters[f"field_{row}{column}"] for column in "xy"] for row in "xy"])
    np.testing.assert_allclose(
        np.einsum("abn,bcn->acn", found[:, :2], turn), expected[:, :2], rtol=1e-4, atol=1e-9
    )
    np.testing.assert_allclose(found[:, 2], expected[:, 2], rtol=1e-4, atol=1e-9)
