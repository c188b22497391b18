"""What a recording lacks stays as the model has it, and is said to; what it has is found."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from benchmarks.foreign_laws import vogel
from benchmarks.lab import Lab, protocol
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.fit import fit_unit
from skin.calibrate.gel import ORDERS
from skin.errors import ScanError
from topology.gel import gel_temperature

SHARE = 0.25


@functools.cache
def lab_and_counts():
    lab, path = Lab(1, seed=5), protocol(share=SHARE)
    return lab, path, lab.counts(path)


@functools.cache
def fitted(*names):
    """The fit with these quantities of the reference alone."""
    lab, path, counts = lab_and_counts()
    columns = lab.reference(path, 0)
    kept = {name: columns[name] for name in ("time", *names)}
    return fit_unit(lab.nominal, lab.series(path, counts, 0, kept), 0)


def value(result, name):
    *_, fit = (fit for fit in result.fits if name in fit.names)
    return fit[name]


FORCE = ("force_x", "force_y", "force_z")


def test_force_alone_tells_the_force_laws_and_leaves_film_and_gel():
    result = fitted(*FORCE)
    assert result.kept["film"] == "the reference has no displacement"
    assert result.kept["gel"].startswith("temperature of the reference: must be 30 blocks")
    true = lab_and_counts()[0].true.parameters
    # per mm of a fall that the model alone knows: what is told is force over frequency
    for name in ("normal_soft_n_per_hz", "normal_stiff_n_per_hz"):
        assert value(result, name) == pytest.approx(true[name][0], rel=0.01)
    assert "frequency_slope_hz_per_mm" not in result.left


def test_temperature_alone_tells_the_gel_and_the_drifts_alone():
    result = fitted("temperature")
    true = lab_and_counts()[0].true.parameters
    assert value(result, "gel_current_ratio") == pytest.approx(
        true["gel_current_ratio"][0], rel=2e-3
    )
    assert value(result, "film_drift_per_k") == pytest.approx(true["film_drift_per_k"][0], rel=0.1)
    assert {"film", "shear"} <= set(result.kept)
    assert "normal_stiff_n_per_hz" in result.kept


def test_a_gel_of_another_law_gets_its_order_and_one_of_the_models_own_none():
    own = fitted("temperature")
    assert own.kept["gel_bend_c"] == own.kept["gel_twist_c"] == "no better by cross-validation"
    lab, path = Lab(1, seed=5, laws=frozenset({"gel"})), protocol(share=SHARE)
    columns = lab.reference(path, 0)
    series = lab.series(path, lab.counts(path), 0, {k: columns[k] for k in ("time", "temperature")})
    result = fit_unit(lab.nominal, series, 0)
    p = {name: value(result, name) for name in ORDERS[3]}
    true = {name: float(values[0]) for name, values in lab.true.parameters.items()
            if name in ("gel_current_20c_ua", "gel_current_ratio")}  # fmt: skip
    warm = np.linspace(25.0, 70.0, 20)
    current = true["gel_current_20c_ua"] * vogel(warm, np.array(true["gel_current_ratio"]))
    error = gel_temperature(p, current / p["gel_current_20c_ua"]) - warm
    assert np.abs(error).max() < 0.15
    assert 0.5 * error.std() < value(result, "temperature_sigma_c") < 0.1


def test_turn_of_the_sensor_and_touch_are_found():
    result = fitted(*FORCE, *(f"displacement_{axis}" for axis in "xyz"))
    rng = np.random.default_rng((5, 0))
    rng.uniform(size=2)
    turn = rng.uniform(-1.0, 1.0, 3)
    found = [result.goodness[f"sensor_turn_{axis}_deg"] for axis in "xyz"]
    np.testing.assert_allclose(found, turn, atol=0.1)
    assert result.goodness["touch_mm"] == pytest.approx(0.3, abs=0.005)


def test_a_lag_is_told_with_its_sigma():
    result, lab = fitted(*FORCE), lab_and_counts()[0]
    error = result.goodness["lag_s"] - lab.lag_s(0)
    assert abs(error) < 0.02
    assert 0.0 < result.goodness["lag_sigma_s"] < 0.02


def test_a_recording_that_tells_no_law_is_refused():
    lab, path, counts = lab_and_counts()
    columns = lab.reference(path, 0)
    kept = {name: columns[name] for name in ("time", "force_z")}
    series = lab.series(path, counts, 0, kept)
    series.force[:] = np.nan
    series.kind[:] = KINDS.index("neighbours")
    with pytest.raises(ScanError, match="recording: must tell a law at least; got none:\n  gel: "):
        fit_unit(lab.nominal, series, 0)
    series.segment[:] = -1
    with pytest.raises(ScanError, match="segments: must have counts of the unit; got none"):
        fit_unit(lab.nominal, series, 0)
