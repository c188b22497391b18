"""The oracle of the stress benchmark is the model, and what is wrong is found."""

from __future__ import annotations

import dataclasses
import json
from itertools import islice

import numpy as np
import pytest

from benchmarks import stress, stress_lasting, stress_time
from benchmarks.contact import plate
from benchmarks.peers_decode import array_of, counts_of, exact
from benchmarks.stress_oracle import judge, walk
from benchmarks.stress_points import (
    AT_ENDS,
    MOST_ENDS,
    _is_accepted,
    at_ends,
    bounds,
    is_held,
    points,
)
from skin.decode.decoder import Decoder
from skin.state import Status
from topology.check.models import parameter_faults

ESTIMATORS = ("sine", "field-angle")
CASES = 13
"""Of `points`."""


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_oracle_gives_known_forces(estimator):
    """The paper's figures: 540 Hz are 0.9 N, 1800 Hz 7.2 N; 10531 µT at 2 mm are 1 N."""
    skin = array_of(2, alike=True)
    counts = np.zeros((6, 2), np.int16)
    strength = 11073.0 * np.sin(0.4 * np.pi)
    table = skin.parameters["field_angle_mm"][:, 0]
    psi = np.linspace(0.5, 1.2, 100_001)
    reach = sum(table[4 * i + j] * psi ** (2 * i + 1) * 2.0**j for i in range(4) for j in range(4))
    upright = strength / np.tan(psi[np.argmin(np.abs(reach - 2.0))])
    wanted = (21.43, 2700.0, strength, 0.0, upright, 25.0)
    current = 10.0 * 12.0 ** (5.0 / 60.0)
    for channel, value in enumerate((current, *wanted[1:])):
        counts[channel] = np.rint((value - skin.offset[channel, 0]) / skin.scale[channel, 0])
    knee = np.rint((3960.0 - skin.offset[1, 0]) / skin.scale[1, 0])
    counts[1, 1] = knee
    force = judge(skin, counts, np.arange(2), estimator)
    step_n = skin.scale[1, 0] / 200.0
    assert float(force[2, 0]) == pytest.approx(7.2, abs=step_n)
    assert float(force[2, 1]) == pytest.approx(0.9, abs=step_n)
    assert float(force[0, 0]) == pytest.approx(1.0, abs=0.02)
    assert float(force[1, 0]) == 0.0


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_oracles_of_40_and_19_digits_and_of_another_hand_agree(estimator):
    skin = array_of(64, alike=False)
    counts, units = counts_of(skin), np.arange(0, 64, 7)
    told = judge(skin, counts[:, units], units, estimator)
    np.testing.assert_allclose(walk(skin, counts[:, units], units, estimator), told, atol=1e-14)
    other = exact(skin, counts, units, estimator)
    np.testing.assert_allclose(other[1:4], told.astype(float), atol=1e-14)


@pytest.fixture(scope="module")
def thirty_at_ends():
    return at_ends(30, np.random.default_rng(3))


@pytest.mark.long
@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_oracle_has_directions_and_films_that_are_corrected(estimator, thirty_at_ends):
    skin = thirty_at_ends
    counts, units = counts_of(skin), np.arange(30)
    reading = stress.decode(skin, counts, estimator, "float64")
    told = walk(skin, counts, units, estimator)
    held = is_held(reading)
    assert held.sum() > 3
    off = np.abs(reading.force - told)[:, held] / stress.full_scale_n(skin)[held]
    assert off.max() < 1e-10


def test_units_at_ends_are_let_through_and_at_their_ends():
    skin, limits = at_ends(12, np.random.default_rng(1)), bounds()
    assert not any(fault.broken.any() for fault in parameter_faults(skin.parameters))
    nominal = array_of(1, alike=True).parameters
    moved = np.zeros(12, int)
    for name in limits.keys() - {"film_x_mm", "film_y_mm"}:
        moved += skin.parameters[name] != nominal[name]
    assert moved.max() >= 1
    assert moved.max() <= MOST_ENDS


@pytest.fixture(scope="module")
def ends():
    """Skin and counts of the last case, and what the model says of them by estimator."""
    *_, (name, skin, counts) = points(quick=True)
    assert name == AT_ENDS
    told = {estimator: walk(skin, counts, np.arange(skin.n), estimator) for estimator in ESTIMATORS}
    return skin, counts, told


@pytest.mark.long
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_hundred_units_at_ends_are_held_and_right(ends, estimator):
    skin, counts, told = ends
    reading = stress.decode(skin, counts, estimator, "float32")
    row = stress.described(
        counts, reading, stress.worst(skin, counts, reading, estimator, told[estimator], 1)
    )
    assert row["held"] >= 100
    assert row["error_n"] < 1e-4


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["shear_gain_per_mm", "field_yx", "hall_offset_x_ut", "field_growth_per_mm2"]
)
def test_a_parameter_of_the_wrong_sign_is_noticed_at_the_ends(ends, name):
    """Only the decoder has it, in units that are let through with it."""
    skin, counts, told = ends
    value, one = skin.parameters[name].copy(), array_of(1, alike=True)
    for unit in np.flatnonzero(value):
        p = {key: values[..., [unit]] for key, values in skin.parameters.items()}
        if _is_accepted(dataclasses.replace(one, parameters=p | {name: -value[[unit]]})):
            value[unit] = -value[unit]
    wrong = dataclasses.replace(skin, parameters=skin.parameters | {name: value})
    worst_n = 0.0
    for estimator in ESTIMATORS:
        reading = stress.decode(wrong, counts, estimator, "float32")
        exact = stress.worst(skin, counts, reading, estimator, told[estimator], 1)
        worst_n = max(worst_n, stress.described(counts, reading, exact)["error_n"])
    assert worst_n > 1000.0 * stress.TARGET_N["float32"]


def test_every_count_of_every_channel_is_walked():
    """Of all cases but the last, whose units are drawn for a minute."""
    for name, skin, counts in islice(points(quick=True), CASES - 1):
        assert name != AT_ENDS
        assert counts.shape == (6, skin.n)
        assert counts.dtype == np.int16
        if name.startswith("all counts"):
            assert {-32768, 32767} <= set(np.concatenate([row[[0, -1]] for row in counts]).tolist())


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(("dtype", "most"), stress.TARGET_N.items())
def test_a_decoder_that_is_off_in_one_place_is_found(estimator, dtype, most):
    skin = array_of(500, alike=False)
    counts = counts_of(skin)
    reading = stress.decode(skin, counts, estimator, dtype)
    told = walk(skin, counts, np.arange(skin.n), estimator)
    found = stress.described(
        counts, reading, stress.worst(skin, counts, reading, estimator, told, 4)
    )
    assert found["error_n"] < most
    unit = int(np.flatnonzero(is_held(reading))[123])
    reading.force[1, unit] += 1e-3
    worst = stress.worst(skin, counts, reading, estimator, told, 4)
    found = stress.described(counts, reading, worst)
    assert found["error_n"] == pytest.approx(1e-3, abs=1e-5)
    assert found["counts"] == counts[:, unit].tolist()
    own = 1e-3 / reading.force_sigma[1, unit]
    assert found["over_sigma"] == pytest.approx(own, rel=0.01)
    reading.force_sigma[0, unit] = reading.theta_sigma[unit] = reading.theta[unit] = np.nan
    assert stress.count_nonfinite(reading) == 3


@pytest.mark.usefixtures("interpreted")
def test_bounds_are_not_held_for_values_and_shown_beside():
    skin = array_of(64, alike=True)
    counts = counts_of(skin)
    counts[2:4] = 32000
    reading = stress.decode(skin, counts, "sine", "float32")
    assert (reading.status & int(Status.SATURATED)).all()
    told = walk(skin, counts, np.arange(skin.n), "sine")
    row = stress.described(counts, reading, stress.worst(skin, counts, reading, "sine", told, 4))
    assert (row["error_n"], row["valid"]) == (0.0, 0.0)
    assert row["bound_error_n"] >= 0.0


def test_condition_is_that_of_the_arcsine_and_of_a_difference_of_frequencies():
    skin = array_of(64, alike=True)
    counts, units = counts_of(skin, most=0.3), np.arange(64)
    found = stress.condition(skin, counts, units, "field-angle")
    frequency = skin.scale[1] * counts[1] + skin.offset[1]
    least = frequency / 600.0 / stress.full_scale_n(skin)
    assert (found > 0.99 * least).all()
    near = stress.condition(skin, crest_counts(skin), units, "sine")
    assert near.max() > 2.0 * stress.condition(skin, counts, units, "sine").max()


def crest_counts(skin):
    from benchmarks.stress_points import _crest

    return _crest(skin, counts_of(skin), np.random.default_rng(0))


@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.long)])
def test_both_sides_of_slowdown_do_the_same_work(dtype):
    skin = plate(64)
    calm, other = (Decoder(skin, dtype=dtype, sweeps=0, ambient=False) for _ in range(2))
    counts = np.stack([counts_of(skin, seed=seed) for seed in range(2)])
    old = stress_time.aged(skin, dtype, counts)
    assert calm.plan == other.plan == old.plan
    assert calm._kernel is other._kernel is old._kernel
    lag = old._state["film_lag"].reshape(-1)[: skin.n]
    tiny = np.finfo(dtype).tiny
    assert ((np.abs(lag) < tiny) & (lag != 0.0)).any(), "denormal"
    runs = stress_time.cases(skin, dtype)
    for run in runs.values():
        run()
    np.testing.assert_allclose(old(counts[0]).force, calm(counts[0]).force, atol=1e-3)


@pytest.mark.long
def test_what_lasts_and_what_is_large_is_within_the_targets(monkeypatch):
    monkeypatch.setattr(stress_lasting, "CYCLES", {True: 2000})
    monkeypatch.setattr(stress_lasting, "SIZES", (1, 17, 129, 200, 201))
    monkeypatch.setattr(stress_lasting, "PITCHES_MM", (12.0,))
    for name, of in stress_lasting.LASTING.items():
        row = of(True)
        assert row["error_n_float32"] < stress.TARGET_N["float32"], name
        assert row.get("error_n_float64", 0.0) < stress.TARGET_N["float64"], name
        assert row["nonfinite"] == sum(row.get(none, 0) for none in stress.NONE) == 0, name


def test_a_filter_that_loses_its_covariance_is_found():
    from skin.options import Options
    from skin.pipeline import Pipeline

    pipeline, touched = Pipeline(array_of(64, alike=True), Options()), np.zeros(64, bool)
    assert stress_lasting._broken(pipeline, touched) == 0
    pipeline.decoder.ambient.covariance_ut2[0, 0, 1] += 1.0
    assert stress_lasting._broken(pipeline, touched) == 1
    pipeline.contacts.data.slips["lag_variance"][5] = -1e-9
    assert stress_lasting._broken(pipeline, touched) == 2
    touched[7] = True
    assert stress_lasting._broken(pipeline, touched) == 2 + len(stress_lasting.POSITIVE)


@pytest.mark.usefixtures("interpreted")
def test_readings_that_are_not_valid_hide_no_difference():
    skin = array_of(16, alike=True)
    one, other = (stress.decode(skin, counts_of(skin), "sine", dtype) for dtype in stress.DTYPES)
    one.force[:, 3], one.status[3] = np.nan, int(Status.NEVER)
    other.force[0, 5] += 1.0
    one.valid[:], other.valid[:] = True, True
    one.valid[[3, 7]] = False
    other.force[0, 7] += 5.0
    off_n, apart = stress_lasting._apart(one, other)
    assert off_n == pytest.approx(1.0, abs=1e-3)
    assert apart == 2


@pytest.mark.long
def test_report_has_its_keys_and_its_picture(monkeypatch, tmp_path):
    asked = []

    def two(quick, seed):
        asked.append(seed)
        return list(islice(points(quick, seed), 6, 8))

    monkeypatch.setattr(stress, "points", two)
    row = {"error_n_float32": 1e-6, "nonfinite": 0, "seen": "", "differ_by_size": 2}
    monkeypatch.setattr(stress, "LASTING", {"nothing": lambda _: row})
    monkeypatch.setattr(stress, "slowdowns", lambda _: {"nothing": (1.0, 0.9, 1.1)})
    monkeypatch.setattr(stress, "PICTURE", tmp_path / "stress.png")
    figures = json.loads(json.dumps(stress.run(quick=True)))
    assert figures["nonfinite_valid"] == 0
    assert 1e-7 < figures["worst_error_n_float32"] < 1e-4
    assert 0.0 < figures["worst_error_n_float64"] < 1e-9
    assert len(asked) == len(set(asked)) >= 3
    each = figures["worst_error_n_by_seed_float32"]
    assert len(set(each)) == len(asked)
    assert max(each) == figures["worst_error_n_float32"]
    assert 0.0 < figures["worst_error_over_sigma_float32"] < 0.1
    assert figures["worst_bound_error_n_float32"] > figures["worst_bound_error_n_float64"]
    assert [figures[name] for name in stress.NONE] == [0, 0, 2]
    assert figures["slowdown"] == 1.0
    assert "crest" in stress.table(figures)
    assert (tmp_path / "stress.png").stat().st_size > 10_000
