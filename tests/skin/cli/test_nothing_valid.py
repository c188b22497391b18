"""Logs and calibrations from which no number may come without a word: nothing valid, another rate,
counts alone, zeros of simulated units."""

from __future__ import annotations

import csv
import json
import re
import tomllib

import numpy as np
import pytest

import skin
import topology
from skin.cli import main
from skin.errors import SkinError
from skin.physics.stencil import Stencil

HEAD = """format = 1
name = "hand"
cycle_rate_hz = 250
sync_id = 0x080
[[buses]]
name = "main"
interface = "{interface}"
channel = "can0"
"""
PATCH = """[[patches]]
name = "P"
kind = "grid"
rows = 2
columns = 2
pitch_m = 0.012
bus = "main"
layout = "{layout}"
first_id = 0x100
"""
COUNTS = """[[layouts]]
name = "field"
size = 8
counts_only = true
signals = [{ name = "bx", start = 0, length = 16, signed = true }]
"""


def written(folder, name="hand.toml", interface="socketcan", layout="f3t-classic", more=""):
    file = folder / name
    file.write_text(HEAD.format(interface=interface) + more + PATCH.format(layout=layout))
    return file


@pytest.fixture
def hand(tmp_path):
    """A topology of a real bus, and a log of its simulated units."""
    file, log = written(tmp_path), tmp_path / "run.log"
    assert main(["sim", str(file), "press", "--bus", "memory", "--record", str(log),
                 "--seconds", "0.5"]) == 0  # fmt: skip
    return file, log


def short(log):
    """The log without the last bytes of each data frame."""
    cut = log.with_name("short.log")
    cut.write_text(re.sub(r"(?m) (10[0-3]#.{12}).*", r" \1", log.read_text()))
    return cut


@pytest.mark.parametrize("more", [[], ["-o", "out.csv"], ["-o", "out"]])
def test_a_log_without_a_valid_reading_ends_with_1_and_says_why(hand, more, capsys, monkeypatch):
    file, log = hand
    monkeypatch.chdir(file.parent)
    assert main(["decode", str(file), str(short(log)), *more]) == 1
    said = capsys.readouterr().err
    assert (
        "short.log: must hold valid readings of 'hand'; got none in 125 cycles: 500 short" in said
    )
    assert main(["decode", str(file), str(log), *more]) == 0


def test_a_replay_without_a_valid_reading_ends_with_1(hand, capsys):
    file, log = hand
    given = ["replay", str(file), str(short(log)), "--speed", "0"]
    assert main(given) == 1
    assert "must hold valid readings" in capsys.readouterr().err
    played = skin.decode_log(file, short(log))
    assert not played.faults  # nothing was read yet
    assert not [state for state in played if state.units.valid.any()]
    assert len(played.faults) == 1


def test_a_log_of_another_rate_is_noted(hand, capsys):
    file, log = hand
    for rate_hz, notes in ((250, 0), (260, 0), (100, 1)):
        file.write_text(
            file.read_text().replace("cycle_rate_hz = 250", f"cycle_rate_hz = {rate_hz}")
        )
        assert main(["decode", str(file), str(log)]) == 0
        said = capsys.readouterr().err
        assert said.count("note: ") == notes
        file.write_text(file.read_text().replace(f"= {rate_hz}", "= 250"))
    assert "bus 'main': should have 100 cycles a second, as the topology says; got 250" in said


def test_counts_are_exported_where_nothing_else_is_known(hand, capsys, monkeypatch):
    _, log = hand
    monkeypatch.chdir(log.parent)
    file = written(log.parent, "field.toml", layout="field", more=COUNTS)
    for name in ("out.csv", "out.npz", "out.parquet", "out"):
        assert main(["decode", str(file), str(log), "-o", name, "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["logs"][0]["valid_share"] is None
    with open("out.csv") as table:
        rows = list(csv.DictReader(table))
    frames = re.findall(r" 100#(..)(..)", log.read_text())
    expected = [int.from_bytes(bytes.fromhex(a + b), "little", signed=True) for a, b in frames]
    assert [int(row["P/r0c0.counts_bx"]) for row in rows] == expected
    channel = topology.CHANNELS.index("bx")
    np.testing.assert_array_equal(np.load("out.npz")["counts"][:, channel, 0], expected)
    assert main(["decode", str(file), str(log)]) == 0
    assert ["valid_share", "none"] in [row.split() for row in capsys.readouterr().out.splitlines()]


def test_a_folder_of_logs_is_refused_with_what_to_name(hand, capsys):
    file, log = hand
    assert main(["decode", str(file), str(log.parent), "-o", "t"]) == 2
    assert (
        f"{log.parent}: must be a log; got a folder: name its logs, as" in capsys.readouterr().err
    )


def test_simulated_zeros_never_replace_those_of_a_real_bus(tmp_path, capsys):
    file = written(tmp_path)
    assert main(["tare", str(file), "--simulate"]) == 2
    assert "--output: must be given with --simulate" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hand.toml"]
    zeros = tmp_path / "zeros.toml"
    assert main(["tare", str(file), "--simulate", "-o", str(zeros)]) == 0
    assert tomllib.loads(zeros.read_text())["simulated"] == ["r0c0", "r0c1", "r1c0", "r1c1"]
    file.write_text(file.read_text() + 'calibration = "zeros.toml"\n')
    assert main(["check", str(file)]) == 2
    assert "must be left out where a bus is real" in capsys.readouterr().err
    inside = written(tmp_path, "inside.toml", interface="memory")
    inside.write_text(inside.read_text() + 'calibration = "zeros.toml"\n')
    assert topology.load(inside).tared.all()


def test_a_stencil_of_simulated_units_is_refused_on_a_real_bus(tmp_path):
    real, inside = (topology.load(written(tmp_path, f"{interface}.toml", interface))
                    for interface in ("socketcan", "memory"))  # fmt: skip
    file = tmp_path / "stencil.npz"
    Stencil.of(inside).save(file, simulated=True)
    assert Stencil.load(file, inside).n == 4
    with pytest.raises(SkinError, match="must be the stencil of real units"):
        Stencil.load(file, real)
