"""Holds of a bench: of a material that is none of the decoder's, and of one that does not relax."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from scipy.stats import chi2

from skin import Decoder
from skin.calibrate.bench.check import score
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.unit import fit_unit
from skin.calibrate.files import with_fits
from skin.sim.bench import HELD_MM, protocol
from tests.fixtures.bench import ForeignLab, counts_of, unseen
from tests.fixtures.bench import series as series_of
from tests.fixtures.creep import SHARE, STRETCH, TIME_S, UNLIKE

CREEP = frozenset({"creep"})
RARE = 1e-3
"""Probability of a unit that a sigma is not too small for."""


@functools.cache
def series(laws=frozenset()):
    lab, path = ForeignLab(1, laws, seed=5), protocol(share=0.25)
    return lab, series_of(lab, path, counts_of(lab, path), 0)


def known(lab, result):
    return with_fits(lab.nominal, {result.unit: result.fits})


def scored(lab, skin):
    """Root mean square error on a way that was not recorded, N; errors over their sigma and
    sigmas, N, shape (t, 3)."""
    path = unseen(40.0, seed=17)
    counts = lab.counts(path, noise=False)
    reading = Decoder(skin, dtype="float64", sweeps=0, ambient=False)(counts)
    error, sigma = reading.force[:, :, 0] - lab.force(path)[:, :, 0], reading.force_sigma[:, :, 0]
    return float(np.sqrt(np.mean(error**2))), error / sigma, sigma


def cut(recorded, seconds):
    """The recording with a hold that ends so long after the step; without one if that is none."""
    hold = recorded.kind == KINDS.index("hold")
    if not seconds:
        return dataclasses.replace(recorded, segment=np.where(hold, -1, recorded.segment))
    time_s = recorded.counts.time_s
    step_s = time_s[hold][np.argmax(recorded.displacement[0, hold] > 0.5 * HELD_MM[1])]
    late = hold & (time_s > step_s + seconds)
    return dataclasses.replace(recorded, segment=np.where(late, -1, recorded.segment))


@pytest.mark.long
@pytest.mark.parametrize("seconds", [100.0, 24.0])
def test_a_unit_that_relaxes_by_another_law_is_right_on_ways_that_were_not_recorded(seconds):
    """Errors are within sigma, and stiffnesses off by no more than what relaxes after the hold.

    A unit without a hold has the same laws with more error, which its sigma has, too. All readings
    of an axis share the error of its law: their mean square over the variance is bounded as that of
    one error is.
    """
    lab, recorded = series(CREEP)
    result = fit_unit(lab.nominal, cut(recorded, seconds), 0)
    skin = known(lab, result)
    without = known(lab, fit_unit(lab.nominal, cut(recorded, 0.0), 0))
    (rms, off, sigma), (elastic, without_off, without_sigma) = (
        scored(lab, each) for each in (skin, without)
    )
    assert rms < 0.5 * elastic
    assert np.mean(np.abs(off) <= 1.0) > 0.68
    assert (sigma.mean(axis=0) < without_sigma.mean(axis=0)).all()
    for each in (off, without_off):
        assert (np.mean(each**2, axis=0) < chi2.isf(RARE, df=1)).all()
    later = (1.0 + UNLIKE) * SHARE * np.exp(-((seconds / (1.0 + UNLIKE) / TIME_S) ** STRETCH))
    for name in ("normal_stiff_n_per_hz", "shear_soft_n_per_mm"):
        (fit,) = (fit for fit in result.fits if name in fit.names)
        true = lab.true.parameters[name][0]
        assert abs(fit[name] - true) < later * true + 3.0 * fit.sigma[fit.names.index(name)]


@pytest.mark.long
def test_a_unit_that_does_not_relax_gets_no_term_and_the_same_laws():
    lab, recorded = series()
    result = fit_unit(lab.nominal, recorded, 0)
    skin = known(lab, result)
    assert not Decoder(skin, sweeps=0, ambient=False).plan.creep
    why = "terms predict no better than none, by cross-validation"
    assert result.kept["normal_creep"] == result.kept["shear_creep"] == why
    without = fit_unit(lab.nominal, cut(recorded, 0.0), 0)
    assert without.kept["creep"] == "hold: must be a segment whose force was measured; got none"
    laws = known(lab, without).parameters
    for name in ("normal_soft_n_per_hz", "normal_stiff_n_per_hz", "shear_soft_n_per_mm"):
        np.testing.assert_array_equal(skin.parameters[name], laws[name])
    # what the holds leave unknown is in sigma, and little
    for name in ("normal_sigma_relative", "shear_sigma_relative"):
        assert laws[name] < skin.parameters[name] < laws[name] + 0.002


@pytest.mark.long
def test_a_component_that_was_not_held_is_said_to():
    lab, recorded = series(CREEP)
    pressed = recorded.force.copy()
    pressed[:2] = np.nan
    result = fit_unit(lab.nominal, dataclasses.replace(recorded, force=pressed), 0)
    assert result.kept["shear_creep"] == "hold: time_s: must be 30 samples or more; got 0"
    skin = known(lab, result)
    assert skin.parameters["normal_creep_relative"].sum() > 0.1
    assert not skin.parameters["shear_creep_relative"].any()


def of_the_hold(laws):
    """Score of a recording's hold alone, by the unit's own elastic laws."""
    lab, path = ForeignLab(1, laws, seed=5), protocol(("tare", "hold"))
    recorded = series_of(lab, path, counts_of(lab, path), 0)
    held = np.where(recorded.kind == KINDS.index("hold"), recorded.kind, -1)
    return score(lab.true.exact(), dataclasses.replace(recorded, kind=held), 0)


@pytest.mark.long
def test_a_hold_counts_and_shows_a_relaxation_that_the_calibration_lacks():
    elastic, relaxing = of_the_hold(set()), of_the_hold({"creep"})
    assert 0.8 < elastic.over_sigma["normal"] < 1.15
    assert relaxing.over_sigma["normal"] > 1.2 * elastic.over_sigma["normal"]
