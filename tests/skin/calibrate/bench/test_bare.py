"""Chips without film: what they tell, to the ambient field, and what they cannot."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from skin.calibrate.bench.file import Recording, Segment
from skin.calibrate.bench.series import Counts, series_of
from skin.calibrate.bench.unit import fit_unit
from skin.calibrate.laws import AMBIENT_UT
from skin.sim.bench import RATE_HZ, Lab, protocol
from skin.sim.unit import UnitSimulator
from tests.fixtures.bench import counts_of, series
from tests.fixtures.decode import with_parameters

AMBIENT = np.array([30.0, -15.0, -40.0])
DRIFT = [f"hall_drift_{axis}_ut_per_k" for axis in "xyz"]
OFFSET = [f"hall_offset_{axis}_ut" for axis in "xyz"]


@functools.cache
def lab():
    return Lab(1, seed=5)


def bare(hot_c):
    """A chip in the Earth's field, warmed for two minutes."""
    true = with_parameters(lab().true, field_amplitude_ut=np.full(1, 1e-6))
    count = round(120.0 * RATE_HZ)
    chip = np.linspace(24.0, hot_c, count)[:, np.newaxis]
    units = UnitSimulator(true, seed=9)
    values = units.quantities(np.zeros((count, 1)), np.zeros((count, 2, 1)), chip, chip, chip)
    gain = 1.0 + true.parameters["hall_gain_per_k"] * (chip - 25.0)
    values[:, 2:5] += gain[:, np.newaxis] * AMBIENT[:, np.newaxis]
    units.disturb(values)
    counts = Counts(np.arange(count) / RATE_HZ, units.quantise(values), np.ones((count, 1), bool))
    recording = Recording(counts="", units={true.unit_names[0]: ""},
                          segments=(Segment(kind="bare", start_s=0.0, end_s=120.0),))  # fmt: skip
    return series_of(lab().nominal, recording, counts, {}, ("", ""))


@functools.cache
def fitted(hot_c):
    path = protocol(("tare", "normal"), 0.5)
    recorded = series(lab(), path, counts_of(lab(), path), 0)
    chip = None if hot_c is None else bare(hot_c)
    return fit_unit(lab().nominal, recorded, 0, bare=chip)


def told(result):
    return {name: (fit[name], fit.sigma[i]) for fit in result.fits
            for i, name in enumerate(fit.names)}  # fmt: skip


@pytest.mark.long
def test_a_warmed_chip_tells_its_drift_and_to_the_ambient_field_its_offset():
    found, true = told(fitted(60.0)), lab().true.parameters
    for name in DRIFT:
        value, sigma = found[name]
        assert abs(value - true[name][0]) < 3.0 * sigma
        assert sigma < 0.2
    for name, field in zip(OFFSET, AMBIENT, strict=True):
        value, sigma = found[name]
        # the prior, of 150 µT, takes a ninth of it back
        assert value == pytest.approx(true[name][0] + field, abs=25.0)
        assert 0.8 * AMBIENT_UT < sigma < AMBIENT_UT


def test_a_recording_without_the_chip_is_said_to():
    silent = bare(60.0)
    silent = dataclasses.replace(silent, segment=np.full_like(silent.segment, -1))
    path = protocol(("tare", "normal"), 0.5)
    result = fit_unit(lab().nominal, series(lab(), path, counts_of(lab(), path), 0), 0, bare=silent)
    assert result.kept["bare"] == "must be a segment with counts of the unit; got none"
