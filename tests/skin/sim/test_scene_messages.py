"""Every broken scene file, and the messages that a user reads.

`UPDATE_GOLDEN=1 pytest tests/test_sim_scene_messages.py` writes the messages anew, for a look at
the difference before it is committed.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

from skin.cli import main
from skin.errors import SceneError
from skin.sim.node import SimulatedUnits
from skin.sim.scenes import names
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from topology import Topology, load

FOLDER = Path(__file__).parents[2] / "golden" / "scenes"
BROKEN = sorted(path.stem for path in FOLDER.glob("*.toml"))


@pytest.fixture(scope="module")
def palm() -> Topology:
    return load("palm")


def play_through(file: str | Path, topology: Topology) -> None:
    scene = ScriptedScene(topology, load_scene(file, topology))
    for time_s in np.linspace(0.0, scene.seconds, 101):
        scene.at(time_s)


def messages(file: str, topology: Topology) -> str:
    """Of a file that cannot be loaded, or not be played to its end."""
    with pytest.raises(SceneError) as raised:
        play_through(file, topology)
    return f"{raised.value}\n"


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_scene_gives_its_problems_with_their_lines(
    name: str, palm: Topology, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(FOLDER)
    text = messages(f"{name}.toml", palm)
    golden = FOLDER / f"{name}.txt"
    if os.environ.get("UPDATE_GOLDEN"):
        golden.write_text(text, "utf-8")
    assert text == golden.read_text("utf-8")


def test_every_message_names_file_line_and_what_must_be() -> None:
    assert len(BROKEN) >= 12
    for name in BROKEN:
        lines = (FOLDER / f"{name}.txt").read_text("utf-8").splitlines()
        assert lines
        for line in lines:
            assert re.fullmatch(rf"{name}\.toml:\d+: .*must .+; got:? .+", line), line


def test_lines_are_those_of_the_keys(palm: Topology, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(FOLDER)
    text = (FOLDER / "friction.toml").read_text("utf-8").splitlines()
    found = [
        int(m[1])
        for m in re.finditer(r"^friction\.toml:(\d+)", messages("friction.toml", palm), re.M)
    ]
    assert [text[line - 1].strip().split(" = ")[0] for line in found] == [
        "friction",
        "friction_share",
        "{ t_s",
    ]
    assert "-0.1" in text[found[-1] - 1]


def test_no_such_scene_names_those_there_are(palm: Topology) -> None:
    text = messages("slid", palm)
    assert "got no such file; nearest: 'slide'" in text
    assert all(name in text for name in names)


def test_a_scene_that_this_skin_cannot_have_is_refused_by_the_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(FOLDER)
    assert main(["sim", "palm", "inside.toml"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("inside.toml:16: bodies[1]")


def test_a_scene_in_which_nothing_happens_is_one(palm: Topology, tmp_path: Path) -> None:
    file = tmp_path / "rest.toml"
    file.write_text('format = 1\nname = "rest"\nseconds = 2.0\n', "utf-8")
    scene = ScriptedScene(palm, load_scene(file, palm))
    nodes = SimulatedUnits(palm, scene)
    for cycle in range(500):
        nodes.tick(cycle, nodes.batch(0))
        truth = nodes.truth
        assert not truth.contact.any()
        assert not truth.force.any()
        assert np.all(truth.temperature == truth.temperature[0])


@pytest.mark.parametrize(("on", "where"), [("", "'palm'"), ('on = "palm/r3c3"\n', "'palm/r3c3'")])
def test_a_body_that_cannot_be_there_is_told_in_whose_frame_it_stands(tmp_path, on, where):
    file = tmp_path / "deep.toml"
    file.write_text(
        f'format = 1\nseconds = 1.0\n[[bodies]]\nname = "ball"\n{on}'
        'shape = { kind = "sphere", radius_m = 0.02 }\n'
        "keys = [{ t_s = 0.0, xyz_m = [0.0, 0.0, -0.01] }]\n"
    )
    with pytest.raises(SceneError, match=re.escape(f"; its frame is that of {where}")):
        play_through(file, load("palm"))
