"""`skin calibrate crosstalk`, from the log of a finger on simulated units."""

from __future__ import annotations

import dataclasses
import itertools
import json

import numpy as np
import pytest

import skin
import topology
from skin.cli import main
from skin.errors import SkinError
from skin.physics.stencil import Stencil
from skin.sim.truth import Truth
from tests.fixtures.topology import PAIR


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "pad.toml"
    path.write_text(PAIR, encoding="utf-8")
    return path


class Finger:
    """A scene of a finger that presses one unit after the other, moves it in circles, and pauses as
    long, so that no window has two units that are pressed."""

    def __init__(self, n):
        self._n = n

    def at(self, time_s):
        truth = Truth.at_rest(self._n, 24.0)
        truth.time_s = time_s
        press, share = divmod((time_s - 3.0) / 0.9, 2.0)
        if press >= 0.0 and share < 1.0:
            unit, around = int(press) % self._n, 4.0 * np.pi * share
            down = np.sin(np.pi * share) ** 0.3
            truth.depth_mm[unit] = 2.0 * down
            truth.displacement_mm[:, unit] = 2.2 * down * np.array([np.cos(around), np.sin(around)])
        return truth


def recorded(file, log, seconds):
    """The log of a skin that a finger touches."""
    pad = topology.load(file)
    cycles = round(seconds * pad.cycle_rate_hz)
    finger = Finger(pad.n)
    with skin.open(pad, simulate=finger, pace=False, record=log) as opened:
        for _ in itertools.islice(opened, cycles):
            pass
    return str(log)


def test_a_finger_teaches_the_stencil_and_files_can_be_read_again(file, tmp_path, capsys):
    out, zeros = tmp_path / "stray.npz", tmp_path / "pad.pad.calibration.toml"
    log = recorded(file, tmp_path / "run.log", 9.0)
    command = ["calibrate", "crosstalk", str(file), log, str(out), "--json"]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["missing"] == []
    pad = topology.load(file)
    learned, drawn = Stencil.load(out, pad), Stencil.of(pad)
    moved = np.zeros((3, pad.n))
    moved[:, 0] = 1.0, 0.5, 1.5
    assert np.allclose(learned(moved), drawn(moved), atol=40.0)  # films are as drawn
    assert "tared in place" in zeros.read_text(encoding="utf-8")


def test_where_no_press_is_seen_nothing_is_written(file, tmp_path, capsys):
    out, zeros = tmp_path / "stray.npz", tmp_path / "pad.pad.calibration.toml"
    log = recorded(file, tmp_path / "run.log", 3.0)
    assert main(["calibrate", "crosstalk", str(file), log, str(out)]) == 1
    assert "neighbours: must be pressed one by one" in capsys.readouterr().err
    assert not out.exists()
    assert not zeros.exists()


def test_a_live_skin_takes_what_was_learned_from_its_file(tmp_path):
    palm = topology.load("palm")
    drawn = Stencil.of(palm)
    Stencil.save(dataclasses.replace(drawn, rest_ut=drawn.rest_ut + 7.0), tmp_path / "stray.npz")
    options = skin.Options(stencil=Stencil.load(tmp_path / "stray.npz", palm))
    with skin.open(palm, want={"force"}, options=options, simulate=True) as opened:
        taken = opened.pipeline.decoder.crosstalk.stencil
    assert np.array_equal(taken.rest_ut, drawn.rest_ut + 7.0)
    with pytest.raises(SkinError, match="must be the stencil of 10 units"):
        Stencil.load(tmp_path / "stray.npz", topology.load("strip"))
    options = skin.Options(sweeps=0, stencil=drawn)
    with skin.open(palm, options=options, simulate=True) as opened:
        assert opened.pipeline.decoder.rest_ut is drawn.rest_ut
    with pytest.raises(SkinError, match="stencil: must be a Stencil or None; got 3"):
        skin.Options(stencil=3)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["FILE", "a.log", "none/a.npz"], "STENCIL: must be in a folder that exists"),
        (["strip", "a.log", "a.npz"], "must have a calibration file"),
        (["FILE", "a.log", "a.npz"], "a.log: must be an existing file"),
    ],
)
def test_wrong_use_is_refused_before_anything_is_learned(words, told, file, tmp_path, monkeypatch,
                                                         capsys):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    given = [str(file) if word == "FILE" else word for word in words]
    assert main(["calibrate", "crosstalk", *given]) == 2
    assert told in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["pad.toml"]
