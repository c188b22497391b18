"""Tare: files beside which everything else that a calibration knows is kept, and the command."""

from __future__ import annotations

import dataclasses
import json
import tomllib

import numpy as np
import pytest

import topology
from skin.calibrate import tare as tares
from skin.calibrate.files import calibration_files, read_calibration
from skin.cli import main
from skin.decode.decoder import Decoder
from skin.physics.stencil import Stencil
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import with_parameters
from tests.skin.calibrate.test_tare import BY, apart, simulated, tare

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


def pair(folder, calibration=None):
    """A skin of two patches, of which the left one may have a calibration file."""
    named = ""
    if calibration is not None:
        (folder / "left.toml").write_text(calibration)
        named = 'calibration = "left.toml"\n'
    (folder / "pair.toml").write_text(FILE.format(calibration=named))
    return topology.load(folder / "pair.toml")


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
    taken_with, decoded_with, told, tmp_path, caplog
):
    """A stencil is theory, or so many µT along an axis beside it."""
    skin = pair(tmp_path, BEFORE)
    theory = Stencil.of(skin, degree=1)

    def stencil(off_ut):
        if off_ut is None:
            return None
        rest_ut = theory.rest_ut.copy()
        rest_ut[0] += off_ut
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
