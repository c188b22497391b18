"""`skin calibrate crosstalk`, on simulated units."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import skin
import topology
from skin.cli.calibrate_crosstalk import calibrate_crosstalk
from skin.errors import SkinError
from skin.physics.stencil import Stencil
from tests.fixtures.topology import PAIR


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "pad.toml"
    path.write_text(PAIR, encoding="utf-8")
    return path


@pytest.mark.long
def test_a_finger_teaches_the_stencil_and_files_can_be_read_again(file, tmp_path, capsys):
    out, zeros = tmp_path / "stray.npz", tmp_path / "zeros.toml"
    status = calibrate_crosstalk(str(file), out, output=str(zeros), simulate=True, json=True)
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert status == 0
    assert told["missing"] == []
    pad = topology.load(file)
    learned, drawn = Stencil.load(out, pad), Stencil.of(pad)
    moved = np.zeros((3, pad.n))
    moved[:, 0] = 1.0, 0.5, 1.5
    assert np.allclose(learned(moved), drawn(moved), atol=40.0)  # films are as drawn
    assert "tared in place" in zeros.read_text(encoding="utf-8")


@pytest.mark.long
def test_where_no_press_is_seen_nothing_is_written(file, tmp_path, capsys):
    out, zeros = tmp_path / "stray.npz", tmp_path / "zeros.toml"
    status = calibrate_crosstalk(str(file), out, output=str(zeros), simulate=True, seconds=0.5)
    assert status == 1
    assert "touch: must press units one by one" in capsys.readouterr().err
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


def test_wrong_use_is_refused_before_anything_is_heard(file, tmp_path):
    with pytest.raises(SkinError, match="--seconds: must be above 0"):
        calibrate_crosstalk(str(file), tmp_path / "a.npz", seconds=0.0)
    with pytest.raises(SkinError, match="STENCIL: must be in a folder that exists"):
        calibrate_crosstalk(str(file), tmp_path / "none" / "a.npz")
    with pytest.raises(SkinError, match="must have a calibration file"):
        calibrate_crosstalk("strip", tmp_path / "a.npz", simulate=True)
