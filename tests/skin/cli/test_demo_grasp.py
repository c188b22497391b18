"""`skin demo grasp`: an object that nobody has described is held, and the picture shows it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from skin.cli import main


def test_the_demo_holds_what_it_does_not_know(tmp_path: Path, capsys) -> None:
    picture = tmp_path / "grasp.png"
    assert (
        main(["demo", "grasp", "--fast", "--json", "--seed", "2", "--picture", str(picture)]) == 0
    )
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["dropped"] is False
    assert report["slid_mm"] < 10.0
    assert report["lifted_mm"] > 30.0
    assert 0.0 < report["margin"] < 1.0
    assert report["grip_rmse_n"] < 0.2
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed: must be an integer from 0"),
        (["--picture", "no/grasp.png"], "--picture: must be in a folder that exists"),
    ],
)
def test_bad_options_are_refused(arguments: list[str], message: str, capsys) -> None:
    assert main(["demo", "grasp", "--fast", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_without_mujoco_the_extra_is_named(monkeypatch, tmp_path: Path, capsys) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    arguments = ["demo", "grasp", "--fast", "--picture", str(tmp_path / "grasp.png")]
    assert main(arguments) == 2
    assert "f3t-skin[mujoco]" in capsys.readouterr().err
