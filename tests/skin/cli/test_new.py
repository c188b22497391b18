"""`skin new`: a file that every other command takes, and nothing that was there is touched."""

from __future__ import annotations

import json

import pytest

import topology
from skin.cli import main
from tests.fixtures.cases import long_after_first


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@long_after_first("is_classic", [False, True])
def test_a_new_hand_is_checked_simulated_and_tared(is_classic, folder, capsys):
    patches = ["--patches", "palm=3x4", "thumb=2x2"]
    assert main(["new", "my_hand", *patches, "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert sorted(path.name for path in folder.iterdir()) == [
        "my_hand.palm.calibration.toml", "my_hand.thumb.calibration.toml", "my_hand.toml",
    ]  # fmt: skip
    loaded = topology.load("my_hand.toml")
    assert (loaded.name, loaded.n, report["units"]) == ("my_hand", 16, 16)
    file = folder / "my_hand.toml"
    text = file.read_text().replace('interface = "socketcan"', 'interface = "memory"')
    if is_classic:  # by what the comments say
        text = text.replace("data_bitrate", "# data_bitrate").replace("f3t-fd64", "f3t-classic")
    file.write_text(text)
    assert topology.load(file).buses[0].fd == (not is_classic)
    assert main(["check", "my_hand.toml"]) == 0
    assert main(["run", "my_hand.toml", "--simulate", "--seconds", "0.2"]) == 0
    assert main(["tare", "my_hand.toml", "--simulate", "--seconds", "3"]) == 0
    assert "not used until" not in capsys.readouterr().err
    assert topology.load("my_hand.toml").tared.all()


@pytest.mark.parametrize("there", ["my_hand.toml", "my_hand.palm.calibration.toml"])
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
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(more, message, folder, capsys):
    assert main(["new", "my_hand", *more]) == 2
    assert message in "\n" + capsys.readouterr().err
    assert not list(folder.iterdir())
