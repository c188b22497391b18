"""`skin new`: a file that every other command takes, and nothing that was there is touched."""

from __future__ import annotations

import json

import pytest

import topology
from skin.cli import main


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("more", [[], ["--classic", "--rate-hz", "50"], ["--bus", "memory:hand"]])
def test_a_new_hand_is_checked_simulated_and_tared(more, folder, capsys):
    patches = ["--patches", "palm=3x4", "thumb=2x2"]
    assert main(["new", "my_hand", *patches, *more, "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert sorted(path.name for path in folder.iterdir()) == [
        "my_hand.toml", "palm.calibration.toml", "thumb.calibration.toml",
    ]  # fmt: skip
    loaded = topology.load("my_hand.toml")
    assert (loaded.name, loaded.n, report["units"]) == ("my_hand", 16, 16)
    assert loaded.buses[0].fd == ("--classic" not in more)
    assert main(["check", "my_hand.toml"]) == 0
    assert main(["run", "my_hand.toml", "--simulate", "--seconds", "0.2"]) == 0
    assert main(["tare", "my_hand.toml", "--simulate", "--seconds", "3"]) == 0
    assert "not used until" not in capsys.readouterr().out
    assert topology.load("my_hand.toml").tared.all()


@pytest.mark.parametrize("there", ["my_hand.toml", "palm.calibration.toml"])
def test_what_is_there_stays(there, folder, capsys):
    (folder / there).write_text("Notes of the lab\n")
    assert main(["new", "my_hand"]) == 2
    assert "must be a new file; got one that is there already" in capsys.readouterr().err
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [
        (there, "Notes of the lab\n")
    ]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--patches", "palm"], "--patches: must be NAME=ROWSxCOLUMNS, as in palm=8x8; got 'palm'"),
        (["--patches", "palm=0x3"], "--patches: must be NAME=ROWSxCOLUMNS"),
        (["--patches", "a=2x2", "a=2x2"], "must be a name used once"),
        (["--patches", "a=20x20"], "\nmy_hand.toml:"),
        (["--pitch-mm", "0.012"], "pitch_mm: must be a number from 1 to 500"),
        (["--rate-hz", "nan"], "rate_hz: must be a number from 0.1"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(more, message, folder, capsys):
    assert main(["new", "my_hand", *more]) == 2
    assert message in "\n" + capsys.readouterr().err
    assert not list(folder.iterdir())


def test_comments_are_in_one_column_and_lines_are_short(folder):
    assert main(["new", "my_hand", "--patches", "palm=12x2"]) == 0
    rows = (folder / "my_hand.toml").read_text().splitlines()
    places = {row.index("# ") for row in rows if "# " in row and not row.startswith("#")}
    assert 44 in places
    assert max(map(len, rows)) <= 110
