"""`skin demo gesture`: what a person does is told, and the picture shows it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from skin.cli import main


def test_the_demo_tells_what_a_person_does(tmp_path: Path, capsys) -> None:
    picture = tmp_path / "gesture.png"
    assert main(["demo", "gesture", "--fast", "--json", "--picture", str(picture)]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["right"] == report["asked"] == len(report["gestures"]) == 11
    assert report["direction_rms_deg"] < 5.0
    assert report["false"] == 0
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed: must be an integer from 0"),
        (["--picture", "no/gesture.png"], "--picture: must be in a folder that exists"),
    ],
)
def test_bad_options_are_refused(arguments: list[str], message: str, capsys) -> None:
    assert main(["demo", "gesture", "--fast", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_without_mujoco_the_extra_is_named(monkeypatch, tmp_path: Path, capsys) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["demo", "gesture", "--fast", "--picture", str(tmp_path / "gesture.png")]) == 2
    assert "f3t-skin[mujoco]" in capsys.readouterr().err
