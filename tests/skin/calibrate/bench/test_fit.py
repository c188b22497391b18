"""What a recording lacks stays as the model has it, and is said to; what it has is found."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from skin.calibrate import laws
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.unit import fit_unit
from skin.errors import ScanError
from skin.sim.bench import TOUCH_MM, Lab, protocol
from tests.fixtures.bench import ForeignLab, counts_of, series
from tests.fixtures.foreign import Hyperelastic, vogel
from topology.gel import gel_temperature

SHARE = 0.25


@functools.cache
def lab_and_counts():
    lab, path = Lab(1, seed=5), protocol(share=SHARE)
    return lab, path, counts_of(lab, path)


@functools.cache
def fitted(*names):
    """The fit with these quantities of the reference alone."""
    lab, path, counts = lab_and_counts()
    columns = lab.reference(path, 0)
    kept = {name: columns[name] for name in ("time", *names)}
    return fit_unit(lab.nominal, series(lab, path, counts, 0, kept), 0)


def value(result, name):
    *_, fit = (fit for fit in result.fits if name in fit.names)
    return fit[name]


FORCE = ("force_x", "force_y", "force_z")


@pytest.mark.long
def test_force_alone_tells_the_force_laws_and_leaves_film_and_gel():
    result = fitted(*FORCE)
    assert result.kept["film"] == "the reference has no displacement"
    assert result.kept["gel"].startswith("temperature of the reference: must be 30 blocks")
    true = lab_and_counts()[0].true.parameters
    # per mm of a fall that the model alone knows: what is told is force over frequency
    for name in ("normal_soft_n_per_hz", "normal_stiff_n_per_hz"):
        assert value(result, name) == pytest.approx(true[name][0], rel=0.01)
    assert "frequency_slope_hz_per_mm" not in result.left


def test_a_gel_of_another_law_gets_its_order_and_one_of_the_models_own_none():
    own = fitted("temperature")
    assert own.kept["gel_bend_c"] == own.kept["gel_twist_c"] == "no better by cross-validation"
    lab, path = ForeignLab(1, {"gel"}, seed=5), protocol(share=SHARE)
    columns = lab.reference(path, 0)
    given = {k: columns[k] for k in ("time", "temperature")}
    result = fit_unit(lab.nominal, series(lab, path, counts_of(lab, path), 0, given), 0)
    p = {name: value(result, name) for name in laws.GEL_LAWS[3]}
    true = {name: float(values[0]) for name, values in lab.true.parameters.items()
            if name in ("gel_current_20c_ua", "gel_current_ratio")}  # fmt: skip
    warm = np.linspace(25.0, 70.0, 20)
    current = true["gel_current_20c_ua"] * vogel(warm, np.array(true["gel_current_ratio"]))
    error = gel_temperature(p, current / p["gel_current_20c_ua"]) - warm
    assert np.abs(error).max() < 0.15
    assert 0.5 * error.std() < value(result, "temperature_sigma_c") < 0.1


DEPTH_MM = np.linspace(0.0, 2.0, 201)


def normal_n(p):
    """Normal force over the depth by the parameters of a unit, written out."""
    fall = DEPTH_MM * p["frequency_slope_hz_per_mm"]
    beyond = np.maximum(fall - p["normal_break_hz"], 0.0)
    steeper = p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]
    cube = p["normal_cubic_n_per_hz3"] * beyond**3
    return p["normal_soft_n_per_hz"] * fall + steeper * beyond + cube


def known_of(result, nominal):
    """Parameters of a unit after its fit."""
    p = {name: values[..., 0] for name, values in nominal.parameters.items()}
    for fit in result.fits:
        p |= dict(zip(fit.names, fit.values.tolist(), strict=True))
    return p


@pytest.mark.long
def test_the_law_of_another_material_is_off_evenly_and_by_its_sigma():
    """The best law of two lines and a cube for this rubber is off by 45 mN, that of two lines by
    234 (least squares over the range)."""
    lab, path = ForeignLab(1, {"force"}, seed=5), protocol(share=SHARE)
    columns = lab.reference(path, 0)
    given = {k: columns[k] for k in ("time", *FORCE, *(f"displacement_{a}" for a in "xyz"))}
    result = fit_unit(lab.nominal, series(lab, path, counts_of(lab, path), 0, given), 0)
    p = known_of(result, lab.nominal)
    error = normal_n(p) - Hyperelastic(lab.true).normal(DEPTH_MM[:, np.newaxis])[:, 0]
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert np.abs(error).max() < 0.2
    sigma = np.hypot(p["normal_sigma_n"], p["normal_sigma_relative"] * normal_n(p))
    assert 0.5 < np.sqrt(np.mean(error**2 / sigma**2)) < 2.0
    assert value(result, "normal_cubic_n_per_hz3") > 1e-9


def test_what_shallow_presses_leave_open_stays_the_models_and_the_rest_is_fitted_with_it():
    lab, path, counts = lab_and_counts()
    blocks = series(lab, path, counts, 0).blocks(lab.nominal, 0).of("tare", "normal", "circles")
    shallow = blocks.where(np.nan_to_num(blocks.displacement[2]) < TOUCH_MM + 0.45)
    p = {name: values[..., 0] for name, values in lab.nominal.parameters.items()}
    found, kept = laws.fit_normal(p, shallow, True)
    # the presses end before the break of the law, from which its second line counts
    assert kept["normal_stiff_n_per_hz"] == "the recordings leave 100% of its prior variance"
    assert "normal_stiff_n_per_hz" not in found.names
    soft = lab.true.parameters["normal_soft_n_per_hz"][0]
    assert found["normal_soft_n_per_hz"] == pytest.approx(soft, rel=0.01)


def test_a_recording_that_tells_no_law_is_refused():
    lab, path, counts = lab_and_counts()
    columns = lab.reference(path, 0)
    kept = {name: columns[name] for name in ("time", "force_z")}
    told = series(lab, path, counts, 0, kept)
    told.force[:] = np.nan
    told.kind[:] = KINDS.index("neighbours")
    with pytest.raises(
        ScanError, match="recording: must determine a law at least; got none:\n  gel: "
    ):
        fit_unit(lab.nominal, told, 0)
    told.segment[:] = -1
    with pytest.raises(ScanError, match="segments: must have counts of the unit; got none"):
        fit_unit(lab.nominal, told, 0)
