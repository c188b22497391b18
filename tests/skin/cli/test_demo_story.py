"""`skin demo pva` and `skin demo tea`: bad options, a picture, and what stands in the report."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from skin.cli import main
from skin.cli.demo_story import figures_of, reel_of, show
from skin.demos.play import COLUMNS, Change, Story
from skin.demos.runner import Passed


def story(outcome="done"):
    """A short one, made up."""
    time_s = np.linspace(0.0, 10.0, 200)
    rows = np.zeros((200, len(COLUMNS)))
    rows[:, 0] = time_s
    for name in ("inside_c", "true_c", "gel_c"):
        rows[:, COLUMNS.index(name)] = 20.0 + time_s
    rows[:, COLUMNS.index("inside_c")] += 0.5
    told = Story(outcome=outcome, rows=rows)
    told.timeline = [Passed("lift", 0.0, 2.0, "up"), Passed("heat", 2.0, 10.0, "hot")]
    told.phases = [Change(0.0, "unknown"), Change(3.0, "heating")]
    return told


@pytest.mark.parametrize("fills", [False, True])
@pytest.mark.parametrize(("outcome", "status"), [("done", 0), ("failed", 1)])
def test_a_story_is_drawn_and_its_outcome_is_the_status(tmp_path, capsys, fills, outcome, status):
    told, picture = story(outcome), tmp_path / "story.png"
    report = figures_of(3, told)
    reel = reel_of(told, told.phases, {"limit": 90.0}, fills)
    assert show(told, report, {}, reel, "told", picture, True) == status
    printed = json.loads(capsys.readouterr().out)
    assert printed["temperature_rmse_c"] == pytest.approx(0.5)
    assert printed["timeline"][1]["name"] == "heat"
    assert picture.stat().st_size > 20_000


def test_without_matplotlib_the_extra_is_named_and_the_time_line_stays(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    told = story()
    reel = reel_of(told, told.phases, {}, False)
    assert show(told, figures_of(1, told), {}, reel, "told", tmp_path / "x.png", False) == 0
    out, error = capsys.readouterr()
    assert "f3t-skin[plot]" in error
    assert "heat" in out


@pytest.mark.parametrize("name", ["pva", "tea"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed: must be an integer from 0"),
        (["--picture", "no/story.png"], "--picture: must be in a folder that exists"),
    ],
)
def test_bad_options_are_refused(name, arguments, message, capsys) -> None:
    assert main(["demo", name, "--fast", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["pva", "tea"])
def test_without_mujoco_the_extra_is_named(name, monkeypatch, tmp_path: Path, capsys) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    arguments = ["demo", name, "--fast", "--picture", str(tmp_path / "story.png")]
    assert main(arguments) == 2
    assert "f3t-skin[mujoco]" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("name", ["pva", "tea"])
def test_a_story_is_played_to_its_end(name, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "story.png"
    arguments = ["demo", name, "--fast", "--json", "--seed", "2", "--picture", str(picture)]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["outcome"] == "done"
    assert report["dropped"] is False
    assert report["temperature_rmse_c"] < 1.0
