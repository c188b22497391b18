"""Gains of many units from one force that all of them carry together."""

from __future__ import annotations

import dataclasses
import functools
import re

import numpy as np
import pytest

from skin.calibrate.bench.array import fit_array
from skin.calibrate.bench.file import UNIT, Column, Recording, Segment, steps
from skin.calibrate.bench.series import series_of
from skin.errors import ScanError
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.bench import ORDER, Bench, Path3, skin_of_text, text_of
from skin.sim.bench import SECONDS as LASTS_S
from skin.sim.unit import UnitSimulator
from tests.fixtures.bench import counts_of

UNITS, SECONDS = 4, 60.0
STRENGTH = {"normal_soft_n_per_hz": "normal", "normal_stiff_n_per_hz": "normal",
            "shear_soft_n_per_mm": "shear", "shear_stiff_n_per_mm": "shear"}  # fmt: skip


@functools.cache
def rolled():
    """Units of which only the stiffness differs, under a ball that goes from one to the next; what
    the skin reads, and the sum of all forces by a sensor that is turned by a degree."""
    rng, nominal = np.random.default_rng(4), skin_of_text(text_of(UNITS, 1))
    gain = {kind: 1.0 + rng.uniform(-0.06, 0.06, UNITS) for kind in ("normal", "shear")}
    p = dict(nominal.parameters)
    p |= {name: p[name] * gain[kind] for name, kind in STRENGTH.items()}
    true = dataclasses.replace(nominal, parameters=p)
    field = HalbachField(true, reach_m=0.0)
    lab = Bench(nominal, lambda: UnitSimulator(true, seed=300, field=field), Elastic(true))
    time = np.arange(0.0, SECONDS, 0.02)
    total, counts = np.zeros((time.size, 3)), None
    for unit in range(UNITS):
        near = np.clip(np.sin(2.0 * np.pi * (time / 9.0 + unit / 6.0)), 0.0, None) * (time > 5.0)
        stage = np.stack([1.2 * near * np.cos(time), 1.2 * near * np.sin(time), 0.3 + 1.9 * near])
        stage[2, near == 0.0] = 0.0
        path = Path3(time, stage, np.full((3, time.size), 25.0), ())
        total += lab.force(path)[:, :, unit] @ lab.nominal.rotation[:, :, unit].T
        one = counts_of(lab, path)
        if counts is None:
            counts = one
        counts.counts[:, :, unit] = one.counts[:, :, unit]
    total += np.cross(np.radians([1.0, -1.0, 0.5]), total)
    total += 0.01 * rng.standard_normal(total.shape)
    columns = {"time": time + 0.7} | {f"force_{a}": total[:, k] for k, a in enumerate("xyz")}
    return lab, gain, counts, columns


def series(**changed):
    lab, _, counts, columns = rolled()
    recording = Recording(
        counts="", reference="", units=dict.fromkeys(lab.nominal.unit_names, ""),
        columns={"time": Column(column="time")},
        segments=(Segment(kind="tare", start_s=0.8, end_s=5.0),
                  Segment(kind="array", start_s=6.0, end_s=60.0)),
    )  # fmt: skip
    return lab.nominal, series_of(lab.nominal, recording, counts, columns | changed, ("r.csv", ""))


@pytest.mark.long
def test_gains_are_found_within_their_intervals():
    _, gain, _, _ = rolled()
    found = fit_array(*series())
    errors = []
    for unit, result in enumerate(found):
        for kind in ("normal", "shear"):
            (fit,) = result.fits
            error = result.goodness[f"{kind}_gain"] - gain[kind][unit]
            assert abs(error) < 0.02, (kind, unit)
            errors.append(error / fit[f"{kind}_sigma_relative"])
    # chi-squared of 8 errors
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def test_a_plate_that_tells_the_normal_force_alone_leaves_shear_as_the_model_has_it():
    nan = np.zeros(rolled()[3]["time"].size)
    skin, told = series()
    told = dataclasses.replace(told, force=np.stack([nan * np.nan, nan * np.nan, told.force[2]]))
    for unit, result in enumerate(fit_array(skin, told)):
        assert result.goodness["normal_gain"] == pytest.approx(
            rolled()[1]["normal"][unit], abs=0.02
        )
        assert result.kept["shear_soft_n_per_mm"].startswith("the recordings leave")


@pytest.mark.long
def test_on_calibrated_units_what_no_gain_takes_up_stays_in_sigma():
    skin, told = series()
    known = {"calibrated": np.ones(UNITS, bool)}
    p = dict(skin.parameters) | {"shear_sigma_relative": np.full(UNITS, 0.06)}
    for result in fit_array(dataclasses.replace(skin, parameters=p, **known), told):
        (fit,) = result.fits
        assert 0.63 * 0.06 < fit["shear_sigma_relative"] < 0.06
        assert fit["normal_sigma_relative"] < 0.01


def test_a_force_that_goes_the_other_way_is_refused():
    skin, told = series()
    with pytest.raises(ScanError) as caught:
        fit_array(skin, dataclasses.replace(told, force=-told.force))
    assert str(caught.value).startswith(
        "pad/r0c0: gain of the normal force: must be 0.75 to 1.25, as units of its model have; got"
    )


def test_a_recording_without_force_is_refused():
    skin, told = series()
    with pytest.raises(ScanError, match="array: must be 100 cycles or more with force"):
        fit_array(skin, dataclasses.replace(told, force=np.full_like(told.force, np.nan)))


def test_the_protocol_of_the_lab_is_that_of_the_plan():
    told = [(step.kind, float(step.seconds)) for step in UNIT if step.kind != "neighbours"]
    assert told == [(kind, LASTS_S[kind]) for kind in ORDER]


def test_the_plan_presses_the_weakest_unit_to_its_end_and_none_beyond():
    """Of units of which one is soft for long, one stiffens early and one bears little."""
    rest = skin_of_text(text_of(3, 1))
    own = {"normal_soft_n_per_hz": [0.6, 1.5, 1.0], "normal_break_hz": [2.0, 0.5, 1.0],
           "normal_max_n": [1.0, 1.0, 0.8]}  # fmt: skip
    p = rest.parameters | {name: rest.parameters[name] * own[name] for name in own}
    (text,) = (step.text for step in steps(dataclasses.replace(rest, parameters=p))[0]
               if step.text.startswith("press straight down"))  # fmt: skip
    depth_mm = float(re.search(r"to ([\d.]+) mm", text)[1])
    share = []
    for i in range(3):
        soft, knee, stiff, most = (
            p[f"normal_{name}"][i]
            for name in ("soft_n_per_hz", "break_hz", "stiff_n_per_hz", "max_n")
        )
        fall = depth_mm * p["frequency_slope_hz_per_mm"][i]
        force = soft * fall if fall < knee else soft * knee + stiff * (fall - knee)
        share.append(force / most)
    assert max(share) == pytest.approx(1.0, abs=0.02)  # the depth is given to 10 µm
