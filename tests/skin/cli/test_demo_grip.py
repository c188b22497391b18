"""`skin demo grip`: the grip follows what pulls, and the picture shows it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from skin.cli import main


def test_the_demo_holds_what_is_pulled(tmp_path: Path, capsys) -> None:
    picture = tmp_path / "grip.png"
    arguments = ["demo", "grip", "--fast", "--json", "--seed", "4", "--picture", str(picture)]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["dropped"] is False
    assert report["slid_mm"] < 10.0
    assert 0.0 < report["margin_rest"] < 1.0
    assert report["friction_believed"] == pytest.approx(report["friction"], rel=0.2)
    assert any("dips" in one for one in report["decisions"])
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed: must be an integer from 0"),
        (["--picture", "no/grip.png"], "--picture: must be in a folder that exists"),
    ],
)
def test_bad_options_are_refused(arguments: list[str], message: str, capsys) -> None:
    assert main(["demo", "grip", "--fast", *arguments]) == 2
    assert message in capsys.readouterr().err
