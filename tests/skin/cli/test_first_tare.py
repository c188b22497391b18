"""The first tare of a hand: what `skin check` advises leads to a tared skin."""

from __future__ import annotations

import json
import tomllib

import pytest

import topology
from skin.cli import main

HEAD = """# My hand.
format = 1
name = "hand"

cycle_rate_hz = 250
sync_id = 0x080
[[buses]]
name = "main"
interface = "memory"
channel = "can0"
"""
PATCH = """
[[patches]]
name = "{name}"     # as on the drawing
kind = "grid"
rows = 1
columns = 2
pitch_m = 0.012
bus = "main"
layout = "f3t-classic"
first_id = {first_id:#x}
pose = {{ xyz_m = [0.0, {y}, 0.0] }}
"""
TARE = ["--simulate", "--seconds", "0.5", "--json"]


@pytest.fixture
def hand(tmp_path):
    """A topology of two patches, none of which names a calibration file."""
    file = tmp_path / "palm.toml"
    patches = (PATCH.format(name=name, first_id=first_id, y=y)
               for name, first_id, y in (("palm", 0x100, 0.0), ("tip", 0x110, 0.1)))  # fmt: skip
    file.write_text(HEAD + "".join(patches))
    return file


def run(capsys, *arguments):
    status = main([*map(str, arguments)])
    printed = capsys.readouterr()
    return status, printed, json.loads(printed.out.splitlines()[-1])


def test_the_first_tare_makes_the_files_and_prints_the_lines(hand, capsys):
    before = hand.read_text()
    status, printed, report = run(capsys, "tare", hand, *TARE)
    assert status == 0
    assert hand.read_text() == before
    assert report["lines"] == {
        name: f'calibration = "palm.{name}.calibration.toml"' for name in ("palm", "tip")
    }
    assert all(line in printed.err for line in report["lines"].values())
    text = before
    for name, line in report["lines"].items():  # as a user adds them
        text = text.replace(f'name = "{name}"', f'name = "{name}"\n{line}')
    hand.write_text(text)
    assert topology.load(hand).tared.all()


def test_a_file_that_is_named_and_not_there_is_made(hand, capsys):
    named = hand.read_text().replace('layout = "f3t', 'calibration = "{}.toml"\nlayout = "f3t')
    hand.write_text(named.replace("{}", "one", 1).replace("{}", "two", 1))
    assert main(["check", str(hand)]) == 2
    assert "(`skin tare " in capsys.readouterr().err
    status, _, report = run(capsys, "tare", hand, *TARE)
    assert (status, report["lines"]) == (0, {})
    assert topology.load(hand).tared.all()


def test_a_second_tare_keeps_what_stands_in_the_file_that_is_not_named_yet(hand, capsys):
    assert main(["tare", str(hand), *TARE]) == 0
    file = hand.with_name("palm.palm.calibration.toml")
    text = file.read_text() + "normal_max_n = 9.5\n"
    unit = tomllib.loads(text)["units"]
    file.write_text(text)
    assert main(["tare", str(hand), *TARE]) == 0
    (last,) = list(unit)[-1:]
    assert tomllib.loads(file.read_text())["units"][last]["normal_max_n"] == 9.5


def test_a_ready_made_topology_needs_a_file_to_be_given(capsys):
    assert main(["tare", "palm", *TARE]) == 2
    assert "patch 'palm': must have a calibration file to be written to" in capsys.readouterr().err
