"""Tare: zeros of untouched units, saved beside everything else that a calibration knows."""

from __future__ import annotations

import dataclasses
import datetime
import json
import tomllib

import numpy as np
import pytest
from msgspec import structs

import topology
from bus.status import Status
from skin.calibrate import tare as tares
from skin.calibrate.files import calibration_files, read_calibration
from skin.calibrate.tare import chosen
from skin.cli import main
from skin.decode.decoder import Decoder
from skin.errors import CountsError, OptionError, ScanError
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from tests.fixtures.ambient import without_bz
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import calibrated, row_of, with_parameters

CYCLES = 500
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)
TARED = ("frequency_rest_hz", "hall_offset_x_ut", "hall_offset_y_ut")
FILE = """format = 1
name = "pair"

[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000

[[models]]
name = "coarse"
theta_correction_rad = [0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]

[[patches]]
name = "left"
kind = "grid"
rows = 1
columns = 3
pitch_m = 0.012
bus = "main"
model = "coarse"
layout = "f3t-fd16"
first_id = 0x100
{calibration}
[[patches]]
name = "right"
kind = "grid"
rows = 1
columns = 2
pitch_m = 0.012
pose = {{ xyz_m = [0.1, 0.0, 0.0] }}
bus = "main"
model = "f3t-paper"
layout = "f3t-fd16"
first_id = 0x200
"""
BEFORE = """# by hand
format = 1
patch = "left"
date = "2026-01-01"
bench = "bench 3"

[units.r0c0]
field_wavenumber_rad_per_mm = 0.62  # ± 0.0012
frequency_rest_hz = 4480.0  # ± 1.5
frozen_cycles = 80
theta_correction_rad = [0.01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.02]  # ± 0.003 at most

[units.r0c2]
theta_correction_rad = []
field_sigma_ut = 30.0
"""


def tare(skin, counts, status=None, *, rest_ut=None, **options):
    """Of units that are simulated alone, where nothing is said of neighbours."""
    found = tares.tare(skin, counts, status, rest_ut=rest_ut, **options)
    return found.leaving_out(np.zeros((3, skin.n))) if rest_ut is None else found


def apart(skin):
    """The same units, too far from each other to feel each other."""
    place = np.zeros((3, skin.n))
    place[0] = np.arange(skin.n)
    return dataclasses.replace(skin, position=place)


def simulated(skin, cycles=CYCLES, *, field=None, temperature=24.0, seed=1, noise=True):
    """Counts of untouched units whose true parameters are those of `skin`."""
    units = UnitSimulator(skin, field=field, seed=seed, noise=noise)
    still = np.zeros((cycles, skin.n)), np.zeros((cycles, 2, skin.n))
    warm = np.full((cycles, skin.n), temperature)
    return units.quantise(units.disturb(units.quantities(*still, warm)))


def pair(folder, calibration=None):
    """A skin of two patches, of which the left one may have a calibration file."""
    named = ""
    if calibration is not None:
        (folder / "left.toml").write_text(calibration)
        named = 'calibration = "left.toml"\n'
    (folder / "pair.toml").write_text(FILE.format(calibration=named))
    return topology.load(folder / "pair.toml")


def test_zeros_are_those_of_the_units():
    nominal = topology.load("palm")
    rng = np.random.default_rng(2)
    true = with_parameters(
        nominal, frequency_rest_hz=4500.0 + rng.uniform(-100.0, 100.0, 64),
        hall_offset_x_ut=rng.uniform(-200.0, 200.0, 64),
        hall_offset_y_ut=rng.uniform(-200.0, 200.0, 64), hall_drift_x_ut_per_k=2.0,
    )  # fmt: skip
    known = with_parameters(nominal, hall_drift_x_ut_per_k=2.0)
    found = tare(known, simulated(true, temperature=45.0))
    off = [
        (found.frequency_hz - true.parameters["frequency_rest_hz"]) / found.frequency_sigma_hz,
        (found.offset_ut[0] - true.parameters["hall_offset_x_ut"]) / found.offset_sigma_ut[0],
        (found.offset_ut[1] - true.parameters["hall_offset_y_ut"]) / found.offset_sigma_ut[1],
    ]
    assert found.frequency_sigma_hz == pytest.approx(6.0 / np.sqrt(CYCLES), rel=0.2)
    assert found.offset_sigma_ut == pytest.approx(105.0 / np.sqrt(CYCLES), rel=0.2)
    for sigmas in off:
        assert np.sqrt(np.mean(sigmas**2)) == pytest.approx(1.0, abs=0.3)
    assert found.taken.all()
    assert set(found.cycles) == {CYCLES}


def test_tared_skin_reads_nothing(tmp_path):
    skin = pair(tmp_path, BEFORE)
    rng = np.random.default_rng(3)
    true = with_parameters(
        skin, frequency_rest_hz=skin.parameters["frequency_rest_hz"] + rng.uniform(-50, 50, 5),
        hall_offset_x_ut=rng.uniform(-200.0, 200.0, 5),
    )  # fmt: skip
    (tmp_path / "pair.toml").write_text(
        FILE.format(calibration='calibration = "left.toml"\n') + 'calibration = "right.toml"\n'
    )
    (tmp_path / "right.toml").write_text('format = 1\npatch = "right"\n')
    skin = topology.load(tmp_path / "pair.toml")
    tare(skin, simulated(true)).write()
    tared = topology.load(tmp_path / "pair.toml")
    still = simulated(true, 400, seed=9)
    for loaded, least, most in ((skin, 0.02, 1.0), (tared, 0.0, 0.005)):
        mean = Decoder(apart(loaded), estimator="sine", dtype="float64", sweeps=0, ambient=False)(
            still
        ).force.mean(axis=0)
        assert least < np.abs(mean[0]).max() < most
        assert least < np.abs(mean[2]).max() < most


def test_every_other_value_is_kept(tmp_path):
    skin = pair(tmp_path, BEFORE)
    found = tares.tare(skin, simulated(skin), leave_out=["left/r0c2", "right/r0c0", "right/r0c1"])
    assert found.write(date="2026-02-02") == {"left": tmp_path / "left.toml"}
    text = (tmp_path / "left.toml").read_text()
    table, before = tomllib.loads(text), tomllib.loads(BEFORE)
    assert table["date"] == "2026-02-02"
    assert table["bench"] == "bench 3; tared in place, resting neighbours left out"
    assert list(table["units"]) == ["r0c0", "r0c2", "r0c1"]
    first = table["units"]["r0c0"]
    assert {k: first[k] for k in before["units"]["r0c0"] if k not in TARED} == {
        k: v for k, v in before["units"]["r0c0"].items() if k not in TARED
    }
    assert "field_wavenumber_rad_per_mm = 0.62  # ± 0.0012\n" in text
    assert text.startswith("# by hand\nformat = 1\n")
    assert "frozen_cycles = 80\n" in text
    assert "0.02]  # ± 0.003 at most\n" in text
    assert table["units"]["r0c2"] == {"theta_correction_rad": [0.0] * 16, "field_sigma_ut": 30.0}
    written = {*TARED, "frequency_sigma_hz", "field_sigma_ut"}
    written |= {"axial_rest_ut", "axial_rest_sigma_ut"}
    assert set(table["units"]["r0c1"]) == written
    loaded = topology.load(tmp_path / "pair.toml")
    changed = {
        name
        for name, values in loaded.parameters.items()
        if not np.array_equal(values, skin.parameters[name])
    }
    assert changed == written
    assert loaded.parameters["frequency_rest_hz"][0] == found.frequency_hz[0]


def test_a_range_that_the_model_ends_before_a_crest_stays_there(tmp_path):
    """A tare measures no crest: what it writes is what it took, and what was there."""
    pair(tmp_path, BEFORE)
    (tmp_path / "left.toml").write_text(BEFORE.replace("= 0.62 ", "= 2.0 "))
    text = (tmp_path / "pair.toml").read_text()
    text = text.replace(
        'name = "coarse"', 'name = "coarse"\ntangential_max_mm = 0.7\nshear_break_mm = 0.6'
    )
    (tmp_path / "pair.toml").write_text(text)
    skin = topology.load(tmp_path / "pair.toml")
    tare(skin, simulated(skin), leave_out=["right/r0c0", "right/r0c1"]).write()
    assert "tangential_max_mm" not in (tmp_path / "left.toml").read_text()
    assert topology.load(tmp_path / "pair.toml").parameters["tangential_max_mm"][0] == 0.7


def test_second_tare_of_the_same_counts_changes_nothing(tmp_path):
    skin = pair(tmp_path, BEFORE)
    counts, left_out = simulated(skin), ["right/r0c0", "right/r0c1"]
    tare(skin, counts, leave_out=left_out).write(date="2026-02-02")
    once = (tmp_path / "left.toml").read_text()
    tare(topology.load(tmp_path / "pair.toml"), counts, leave_out=left_out).write(date="2026-02-02")
    assert (tmp_path / "left.toml").read_text() == once


def test_what_changes_is_told_with_its_sigma_and_what_was_before():
    """Of the sigma of the offsets, the larger; the file has it so, too."""
    skin = with_parameters(
        topology.load("fingertip"), hall_offset_x_ut=20.0, hall_offset_y_ut=-30.0
    )
    counts = simulated(skin)
    counts[:, BY] += (8 * (counts[:, BY] % 16)).astype(np.int16)  # more noise
    found = tare(skin, counts, leave_out=[skin.unit_names[0]])
    told = found.changes()
    assert list(told) == list(skin.unit_names[1:])
    assert (found.offset_sigma_ut[1, 1:] > found.offset_sigma_ut[0, 1:]).all()
    for i, change in enumerate(told.values(), 1):
        assert change == {
            "frequency_hz": found.frequency_hz[i],
            "frequency_sigma_hz": found.frequency_sigma_hz[i],
            "frequency_before_hz": 4500.0,
            "offset_x_ut": found.offset_ut[0, i],
            "offset_y_ut": found.offset_ut[1, i],
            "offset_sigma_ut": found.offset_sigma_ut[1, i],
            "offset_x_before_ut": 20.0,
            "offset_y_before_ut": -30.0,
            "axial_ut": found.axial_ut[i],
        }


def test_sigmas_of_a_tare_stand_in_the_file(tmp_path):
    skin = pair(tmp_path, BEFORE)
    counts = simulated(skin)
    counts[:, BY] += (8 * (counts[:, BY] % 16)).astype(np.int16)  # more noise
    found = tares.tare(skin, counts)
    found.write(tmp_path / "a" / "b")
    found.write(tmp_path / "a" / "b", date="2026-02-02")
    table, fits = read_calibration(tmp_path / "a" / "b" / "right.toml")
    assert table["date"] == "2026-02-02"
    assert table["bench"] == "tared in place, resting neighbours left out"
    assert sorted(fits) == ["r0c0", "r0c1"]
    known = {name: (fit.values[0], fit.sigma[0]) for fit in fits["r0c1"] for name in fit.names}
    sigma_hz, (sigma_x, sigma_y) = found.frequency_sigma_hz[4], found.offset_sigma_ut[:, 4]
    expected = {
        "frequency_rest_hz": (found.frequency_hz[4], sigma_hz),
        "frequency_sigma_hz": (sigma_hz, np.nan),
        "hall_offset_x_ut": (found.offset_ut[0, 4], sigma_x),
        "hall_offset_y_ut": (found.offset_ut[1, 4], sigma_y),
        "field_sigma_ut": (max(sigma_x, sigma_y), np.nan),
        "axial_rest_ut": (found.axial_rest_ut[4], found.axial_rest_sigma_ut[4]),
        "axial_rest_sigma_ut": (found.axial_rest_sigma_ut[4], np.nan),
    }
    assert known.keys() == expected.keys()
    for name, (value, sigma) in expected.items():
        assert known[name][0] == value
        assert known[name][1] == pytest.approx(sigma, rel=0.05, nan_ok=True)  # two digits


def test_one_patch_goes_to_a_file_or_into_a_folder(tmp_path):
    skin = pair(tmp_path, BEFORE)
    left, both = np.arange(5) < 3, np.ones(5, bool)
    file, folder = tmp_path / "new.toml", tmp_path / "folder"
    assert calibration_files(skin, left, file) == {"left": file}
    folder.mkdir()
    assert calibration_files(skin, left, folder) == {"left": folder / "left.toml"}
    assert calibration_files(skin, both, file) == {
        "left": file / "left.toml", "right": file / "right.toml"
    }  # fmt: skip
    assert calibration_files(skin, both) == {
        "left": tmp_path / "left.toml", "right": tmp_path / "pair.right.calibration.toml"
    }  # fmt: skip


@pytest.mark.parametrize(
    "text", ["format = 1\npatch = 'right'\n", "format = 1\npatch = 'left'\n[units.r9c9]\n"]
)
def test_a_file_of_other_units_is_refused_before_anything_is_measured(text, tmp_path):
    skin = pair(tmp_path, BEFORE)
    (tmp_path / "other.toml").write_text(text)
    with pytest.raises(FileExistsError, match="a calibration file of patch 'left'"):
        calibration_files(skin, np.arange(5) < 3, tmp_path / "other.toml")


def test_units_that_were_tared_are_named_in_the_file_next_to_those_of_before(tmp_path):
    skin = pair(tmp_path, BEFORE.replace("bench = ", 'tared = ["r0c2"]\nbench = '))
    left_out = ["left/r0c1", "left/r0c2"]
    tare(skin, simulated(skin), leave_out=left_out).write(tmp_path / "out")
    named = {file.stem: tomllib.loads(file.read_text())["tared"]
             for file in (tmp_path / "out").iterdir()}  # fmt: skip
    assert named == {"left": ["r0c0", "r0c2"], "right": ["r0c0", "r0c1"]}


def test_zeros_are_applied_without_a_file_and_the_larger_sigma_of_the_field_is_kept():
    skin = dataclasses.replace(calibrated(row_of(4)), tared=np.arange(4) == 1)
    known_ut = np.array([30.0, 0.0, 0.0, 0.0])
    skin = with_parameters(skin, field_sigma_ut=known_ut)
    found = tare(skin, simulated(skin), leave_out=[skin.unit_names[1]])
    sigma_ut = np.array([[1.0, 1.0, 2.0, 1.0], [4.0, 4.0, 1.0, 1.0]])
    beyond_ut = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    skin_then = dataclasses.replace(found, offset_sigma_ut=sigma_ut).applied(beyond_ut)
    p, before = skin_then.parameters, skin.parameters
    taken = np.array([True, False, True, True])
    assert skin_then.tared.all(), "one was before"
    assert p["field_sigma_ut"].tolist() == [30.0, 0.0, 2.0, 1.0]
    new = {
        "frequency_rest_hz": found.frequency_hz, "hall_offset_x_ut": found.offset_ut[0],
        "hall_offset_y_ut": found.offset_ut[1], "tare_rest_x_ut": beyond_ut[0],
        "tare_rest_y_ut": beyond_ut[1],
    }  # fmt: skip
    for name, value in new.items():
        np.testing.assert_array_equal(p[name], np.where(taken, value, before[name]), name)


def test_units_that_are_off_or_of_another_kind_keep_what_they_have():
    """Nor are they looked at: whatever they read is no fault."""
    skin = row_of(4)
    layout = np.where(np.arange(4) == 2, 1, 0).astype(np.int32)
    foreign = structs.replace(skin.layouts[0], counts_only=True)
    skin = dataclasses.replace(
        skin, enabled=np.array([True, False, True, True]), layouts=(skin.layouts[0], foreign),
        frames=dataclasses.replace(skin.frames, layout=layout),
    )  # fmt: skip
    counts, status = simulated(skin), np.zeros((CYCLES, 4), np.uint16)
    counts[:, FREQUENCY, 1:3] = 9
    for good in range(3):
        status[good:, 1] = Status.LATE
        found = tare(skin, counts, status)
        assert found.taken.tolist() == [True, False, False, True]
        assert np.isnan(found.frequency_hz[1:3]).all()
        status[:] = 0
    assert chosen(skin, ["row/r0c0"]).tolist() == [False, False, False, True]


def test_a_new_file_has_the_day_and_the_larger_sigma_of_the_field(tmp_path):
    skin = pair(tmp_path, BEFORE)
    tare(skin, simulated(skin)).write(tmp_path / "out")
    table = tomllib.loads((tmp_path / "out" / "left.toml").read_text())
    assert abs(datetime.date.fromisoformat(table["date"]) - datetime.date.today()).days <= 1
    assert table["units"]["r0c2"]["field_sigma_ut"] == 30.0
    assert table["units"]["r0c0"]["field_sigma_ut"] < 10.0
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["left.toml", "right.toml"]
    assert (tmp_path / "left.toml").read_text() == BEFORE


ALTERNATELY = np.where(np.arange(CYCLES) % 2, 1, -1)
LATER = np.arange(CYCLES) >= CYCLES // 2


def calm(skin, temperature=24.0):
    """Counts of untouched units whose noise is what the model says, one way and the other."""
    counts = simulated(skin, temperature=temperature, noise=False)
    counts[:, FREQUENCY] += 24 * ALTERNATELY[:, np.newaxis]  # 6 Hz
    counts[:, BX:CHIP] += 52 * ALTERNATELY[:, np.newaxis, np.newaxis]  # 104 µT
    return counts


def shaken(channel, least):
    def change(skin, share):
        counts = calm(skin)
        counts[:, channel, 1] = counts[:, channel, 1].mean() + round(least * share) * ALTERNATELY
        return counts

    return change


def shifted(channel, least, when=True):
    def change(skin, share):
        counts = calm(skin)
        counts[:, channel, 1] += np.where(when, round(least * share), 0).astype(np.int16)
        return counts

    return change


def warmed(skin, share):
    return calm(skin, 24.0 + 0.5 * share * LATER[:, np.newaxis])


LIMITS = {
    "noise of the frequency": (shaken(FREQUENCY, 4 * 12.0), "frequency: must have noise"),
    "noise of the field": (shaken(BY, 210.0 / 2), "by: must have noise"),
    "five sigmas of a mean, Hz": (shifted(FREQUENCY, 4 * 2.68, LATER), "frequency: must hold"),
    "five sigmas of a mean, µT": (shifted(BX, 47.0 / 2, LATER), "bx: must hold"),
    "half a degree": (warmed, "temperature: must be steady"),
    "spread and drift": (shifted(FREQUENCY, 4 * 150.07), "frequency: must be within 150.1 Hz"),
    "2 mT": (shifted(BX, 2000.0 / 2), "bx: must be within 2000 µT"),
}
"""What a unit at rest may differ by, and how it is told of more."""


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("limit", LIMITS)
def test_what_is_below_its_limit_is_tared_and_what_is_above_is_refused(limit, way):
    skin = with_parameters(row_of(2), frequency_sigma_hz=52.0)
    change, message = LIMITS[limit]
    tare(skin, change(skin, 0.93 * way))
    with pytest.raises(ScanError) as raised:
        tare(skin, change(skin, 1.07 * way))
    assert str(raised.value).splitlines()[-1].startswith(f"row/r0c1: {message}")


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_limits_of_what_is_known_are_narrower(way):
    """60 Hz from the zero of an earlier tare, 1 mT from the field of known neighbours."""
    tared = with_parameters(row_of(2), frequency_sigma_hz=0.0)
    rest_ut = np.array([[300.0], [-500.0], [0.0]]) * np.ones(2)
    cases = (
        (tared, None, lambda share: shifted(FREQUENCY, 4 * 60.0)(tared, share), "within 60 Hz of"),
        (row_of(2), rest_ut, lambda share: near(share, 0), "bx: must be within 1000 µT of 300 µT"),
        (row_of(2), rest_ut, lambda share: near(share, 1), "by: must be within 1000 µT of -500 µT"),
    )

    def near(share, axis):
        counts = calm(row_of(2))
        counts[:, BX : BZ + 1] += (rest_ut / 2).astype(np.int16)
        counts[:, BX + axis, 1] += round(share * 1000 / 2)
        return counts

    for skin, rest, counts, message in cases:
        tare(skin, counts(0.93 * way), rest_ut=rest)
        with pytest.raises(ScanError, match=message):
            tare(skin, counts(1.07 * way), rest_ut=rest)


@pytest.mark.parametrize("part", [slice(CYCLES // 4, CYCLES * 3 // 4), slice(CYCLES // 4)])
def test_a_touch_in_a_part_of_the_time_is_seen(part):
    """Of the middle, which both halves have alike; 0.02 mm deep."""
    skin = row_of(2)
    counts = calm(skin)
    counts[part, FREQUENCY, 1] -= round(18.0 / abs(skin.scale[FREQUENCY, 1]))
    with pytest.raises(ScanError, match="frequency: must hold still; moved by"):
        tare(skin, counts)


def test_a_hundred_readings_are_enough():
    skin = row_of(2)
    assert tare(skin, calm(skin)[:100]).cycles.tolist() == [100, 100]
    with pytest.raises(ScanError, match="must have 100 good readings or more; got 99"):
        tare(skin, calm(skin)[:99])


def test_readings_all_alike_are_those_of_a_quiet_unit_on_a_coarse_wire():
    """Below a step, noise is not seen, and a mean tells no more than a step does. A step may be
    negative."""
    skin = dataclasses.replace(row_of(2), scale=row_of(2).scale * [1.0, -1.0])
    skin = with_parameters(skin, frequency_noise_hz=0.05, field_noise_ut=np.array([1.9, 0.1]))
    counts = simulated(skin, noise=False)
    found = tare(skin, counts)
    assert found.frequency_sigma_hz == pytest.approx(0.25 / np.sqrt(12.0))
    assert found.offset_sigma_ut == pytest.approx(2.0 / np.sqrt(12.0))
    with pytest.raises(ScanError, match=r"row/r0c0: bx: .* 2.18 µT; got readings all alike"):
        tare(with_parameters(skin, field_noise_ut=np.array([2.1, 0.1])), counts)
    noisy = counts.copy()
    noisy[:, BX, 0] += ALTERNATELY  # 2 µT: the mean of such readings tells more than a step
    noisy[:, BY, 1] += ALTERNATELY > 0  # 1 µT: as half a step does, that rounding makes
    found = tare(skin, noisy)
    assert found.offset_sigma_ut[0, 0] == pytest.approx(2.0 / np.sqrt(CYCLES), rel=2e-3)
    assert found.offset_sigma_ut[1, 1] == pytest.approx(1.0 / np.sqrt(CYCLES), rel=2e-3)


@pytest.mark.parametrize("layout", ["f3t-fd16", "f3t-classic"])
def test_a_warm_skin_has_the_zeros_of_a_cold_one(layout):
    """Offsets are at the chip's reference: its drift comes off, and the field of a film beside the
    chip as weak as film and chip make it. The classic wire tells the gel's temperature alone."""
    skin = with_parameters(
        row_of(2, layout), film_x_mm=0.5, film_y_mm=-0.7, hall_offset_x_ut=150.0,
        hall_offset_y_ut=-90.0, hall_offset_z_ut=400.0, hall_drift_x_ut_per_k=3.0,
        hall_drift_y_ut_per_k=-2.0, hall_drift_z_ut_per_k=5.0, hall_gain_per_k=-0.003,
        hall_reference_c=18.0, film_drift_per_k=-0.004, film_reference_c=33.0,
        gel_current_ratio=5.5, gel_current_20c_ua=27.0, field_noise_ut=20.0,
    )  # fmt: skip
    beside = np.broadcast_to([[0.5], [-0.7]], (CYCLES, 2, 2))
    still, upright = np.zeros((CYCLES, 2)), []
    for gel_c, chip_c in ((25.0, 25.0), (60.0, 60.0), (40.0, 70.0 if skin.wired[CHIP, 0] else 40)):
        units = UnitSimulator(skin, seed=4)
        values = units.quantities(still, beside, still + gel_c, still + gel_c, still + chip_c)
        found = tare(skin, units.quantise(units.disturb(values)))
        assert found.offset_ut == pytest.approx(np.array([[150.0], [-90.0]]) * np.ones(2), abs=9.0)
        gain = (1.0 - 0.004 * (gel_c - 33.0)) * (1.0 - 0.003 * (chip_c - 18.0))
        upright.append(found.axial_ut / gain)  # told as it is, its gains in it
    assert np.ptp(upright, axis=0).max() < 9.0


def test_invalid_units_are_all_named():
    skin = topology.load("fingertip")
    status = np.zeros((CYCLES, skin.n), np.uint16)
    status[:, 3] = Status.FAULT
    status[50:, 5] = Status.LATE
    status[:300, 7] = Status.LATE
    with pytest.raises(ScanError) as raised:
        tare(skin, simulated(skin), status)
    assert str(raised.value).splitlines() == [
        "tip/r1c0: must have 100 good readings or more; got 0 (FAULT)",
        "tip/r1c2: must have 100 good readings or more; got 50 (LATE)",
    ]


def test_late_readings_do_not_count():
    skin = topology.load("fingertip")
    counts, status = simulated(skin), np.full((CYCLES, skin.n), Status.EXTRAPOLATED, np.uint16)
    counts[::3, :, 2] = 30000
    status[::3, 2] = Status.LATE
    found = tare(skin, counts, status)
    assert found.cycles[2] == CYCLES - len(range(0, CYCLES, 3))
    assert (np.delete(found.cycles, 2) == CYCLES).all()
    assert found.frequency_hz[2] == pytest.approx(4500.0, abs=2.0)


def test_neighbours_of_a_curved_skin_are_no_shear():
    """A fingertip's films add up to 1.2 mT to the side of each other's chips."""
    skin = with_parameters(topology.load("fingertip"), hall_offset_x_ut=150.0)
    counts = simulated(skin, field=HalbachField(skin, reach_m=0.1))
    rest_ut = Stencil.of(skin, degree=1).rest_ut
    assert np.abs(rest_ut[:2]).max() > 900.0
    found = tare(skin, counts, rest_ut=rest_ut)
    assert np.abs(found.offset_ut - [[150.0], [0.0]]).max() < 30.0
    counts[:, BX, 0] += 600
    with pytest.raises(ScanError, match=r"tip/r0c0: bx: must be within 1000 µT of -?\d+.* µT"):
        tare(skin, counts, rest_ut=rest_ut)


def test_field_of_resting_neighbours_that_is_known_is_left_out():
    skin = row_of(2)
    counts, rest_ut = simulated(skin), np.array([[30.0, -50.0], [70.0, 20.0], [-200.0, 90.0]])
    included, left_out = tare(skin, counts), tare(skin, counts, rest_ut=rest_ut)
    assert included.offset_ut - left_out.offset_ut == pytest.approx(rest_ut[:2])
    assert included.axial_ut - left_out.axial_ut == pytest.approx(rest_ut[2])
    assert included.axial_ut == pytest.approx(2.0 * counts[:, BZ].mean(axis=0))
    blind = tare(without_bz(skin), counts, rest_ut=rest_ut)
    assert blind.offset_ut == pytest.approx(left_out.offset_ut)
    assert np.isnan(blind.axial_ut).all()


@pytest.mark.long
def test_film_beside_its_chip_is_in_the_offsets_only_if_not_known():
    """No offset undoes it where the unit is pressed, and it must not be taken off twice."""
    nominal = topology.load("fingertip")
    made = Fabrication.perfect(nominal.n, 16)
    made.centre_mm[:] = [[0.1], [-0.05]]
    counts = simulated(nominal, field=HalbachField(nominal, fabrication=made, reach_m=0.0))
    known = with_parameters(nominal, film_x_mm=0.1, film_y_mm=-0.05)
    blind, seeing = tare(nominal, counts), tare(known, counts)
    assert np.abs(seeing.offset_ut).max() < 25.0
    assert np.hypot(*blind.offset_ut).min() > 160.0
    for skin, found in ((nominal, blind), (known, seeing)):
        offsets = {f"hall_offset_{axis}_ut": found.offset_ut[i] for i, axis in enumerate("xy")}
        tared = with_parameters(skin, frequency_rest_hz=found.frequency_hz, **offsets)
        decoder = Decoder(
            apart(tared),
            estimator="sine",
            dtype="float64",
            consistency=False,
            sweeps=0,
            ambient=False,
        )
        mean = decoder(counts).displacement_mm.mean(axis=0)
        assert np.abs(mean).max() < 0.006


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"counts": np.zeros((5, 6, 12))}, CountsError, "counts: must be an array of int16"),
        ({"counts": np.zeros((6, 12), np.int16)}, CountsError, "shape (t, 6, 12); got"),
        ({"status": np.zeros((4, 12), np.uint16)}, CountsError, "shape (500, 12); got"),
        ({"leave_out": ["tip/r0c9"]}, OptionError, "nearest: 'tip/r0c"),
        (
            {"leave_out": [f"tip/r{r}c{c}" for r in range(4) for c in range(3)]},
            OptionError,
            "must leave a unit",
        ),
    ],
)
def test_wrong_use_is_refused(given, error, message):
    skin = topology.load("fingertip")
    with pytest.raises(error) as raised:
        tare(skin, **{"counts": simulated(skin), **given})
    assert message in str(raised.value)


# -- the command -----------------------------------------------------------------------------------


def test_command_tares_a_simulated_skin(tmp_path, capsys):
    out = tmp_path / "strip.toml"
    arguments = ["tare", "strip", "--simulate", "--seconds", "1", "-o", str(out), "--json"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    report = json.loads(printed.splitlines()[-1])
    assert report["tared"] == 10
    assert report["cycles"] == 250
    assert report["files"] == {"strip": str(out)}
    assert "strip/r0c0" in printed
    values = tomllib.loads(out.read_text())["units"]
    for name, change in report["changes"].items():
        rest = values[name.removeprefix("strip/")]["frequency_rest_hz"]
        assert rest == change["frequency_hz"] == pytest.approx(4500.0, abs=2.0)
        assert change["axial_ut"] == pytest.approx(4176.0, rel=0.03)


def test_command_leaves_neighbours_out(tmp_path, capsys):
    """On a fingertip they add up to 1.2 mT to the side."""
    assert main(["tare", "fingertip", "--simulate", "--seconds", "1", "-o", str(tmp_path),
                 "--json"]) == 0  # fmt: skip
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["files"] == {"tip": str(tmp_path / "tip.toml")}
    assert "neighbours left out" in (tmp_path / "tip.toml").read_text()
    offsets = [[c["offset_x_ut"], c["offset_y_ut"]] for c in report["changes"].values()]
    assert np.abs(offsets).max() < 40.0


def test_command_refuses_and_writes_nothing(tmp_path, capsys):
    out = tmp_path / "strip.toml"
    arguments = ["tare", "strip", "--simulate", "--seconds", "0.1", "-o", str(out), "--json"]
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert "strip/r0c0: must have 100 good readings or more; got " in printed.err
    assert len(json.loads(printed.out.splitlines()[-1])["refused"]) == 10
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["strip", "--seconds", "0"], "--seconds: must be above 0"),
        (["strip", "--simulate"], "patch 'strip': must have a calibration file"),
        (["strpi"], "nearest: 'strip'"),
    ],
)
def test_command_refuses_wrong_use(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["tare", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@long_after_first("axis", [0, 1])
@long_after_first(
    ("taken_with", "decoded_with", "told"),
    [
        (None, None, None),
        (80.0, 80.0, None),
        (80.0, 81.0, None),  # refined by what was felt since: less than the sigma of the zeros
        (80.0, None, "by a learned stencil; got another, 57 µT off"),
        (80.0, -20.0, "by a learned stencil; got another, 71 µT off"),
        (None, 80.0, "by magnet theory; got another, 57 µT off"),
    ],
)
def test_zeros_that_were_taken_with_another_stencil_are_named(
    taken_with, decoded_with, told, axis, tmp_path, caplog
):
    """A stencil is theory, or so many µT along an axis beside it."""
    skin = pair(tmp_path, BEFORE)
    theory = Stencil.of(skin, degree=1)

    def stencil(off_ut):
        if off_ut is None:
            return None
        rest_ut = theory.rest_ut.copy()
        rest_ut[axis] += off_ut
        return dataclasses.replace(theory, rest_ut=rest_ut, drawn=False)

    with_it = stencil(taken_with)
    right = [name for name in skin.unit_names if name.startswith("right/")]
    found = tares.tare(
        skin, simulated(skin), rest_ut=None if with_it is None else with_it.rest_ut,
        leave_out=right,
    )  # fmt: skip
    found.write()
    for tared in (topology.load(tmp_path / "pair.toml"), found.applied()):
        caplog.clear()
        Decoder(tared, stencil=stencil(decoded_with))
        expected = [] if told is None else [
            "pair: patch 'left': must be decoded with the stencil of its zeros, which leave out "
            f"resting neighbours {told}: its units read as sheared (stencil = that of its zeros, "
            "or tare it with this one)"
        ]  # fmt: skip
        assert [text for text in caplog.messages if "neighbours" in text] == expected


def test_a_tare_by_theory_takes_the_place_of_one_by_a_stencil(tmp_path, caplog):
    skin = pair(tmp_path, BEFORE)
    rest_ut = Stencil.of(skin, degree=1).rest_ut + 80.0
    right = [name for name in skin.unit_names if name.startswith("right/")]
    for rest in (rest_ut, None):
        tares.tare(skin, simulated(skin), rest_ut=rest, leave_out=right).write()
        skin = topology.load(tmp_path / "pair.toml")
    Decoder(skin)
    assert not [text for text in caplog.messages if "neighbours" in text]
    assert not skin.parameters["tare_rest_x_ut"].any()
