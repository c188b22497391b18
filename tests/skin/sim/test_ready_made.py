"""Ready-made scenes play on hands of any form."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import topology
from skin.cli import main
from skin.sim.scenes import names
from skin.sim.scenes.load import load_scene, open_scene
from skin.sim.scenes.play import DEEPEST_MM
from tests.fixtures.cases import long_after_first

OPPOSED = """
format = 1
name = "opposed"
cycle_rate_hz = 250
sync_id = 0x080
[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000
[[patches]]                     # a thumb that stands 60 mm above the palm and looks at it
name = "thumb"
kind = "dome"
radius_m = 0.012
rings = 2
pitch_m = 0.011
pose = { xyz_m = [0.0, 0.0, 0.06], rpy_deg = [180, 0, 0] }
bus = "main"
layout = "f3t-fd64"
first_id = 0x180
[[patches]]
name = "palm"
kind = "grid"
rows = 8
columns = 8
pitch_m = 0.012
bus = "main"
layout = "f3t-fd64"
first_id = 0x100
"""
PLAYED = Path(__file__).parents[2] / "golden" / "scenes" / "played.csv"
SHORT = ("demo", "edge", "merge", "press", "pull8", "tap", "tool", "twist")


@pytest.fixture(params=["opposed", *topology.builtin])
def hand(request, tmp_path):
    if request.param != "opposed":
        return topology.load(request.param)
    file = tmp_path / "opposed.toml"
    file.write_text(OPPOSED)
    return topology.load(file)


@long_after_first("name", names)
def test_every_scene_fits_every_hand(name, hand):
    script = load_scene(name, hand)
    sizes = [np.count_nonzero(hand.patch == i) for i in range(len(hand.patch_names))]
    largest = hand.patch_names[int(np.argmax(sizes))]
    scene = open_scene(name, hand)
    for body, table in zip(scene.bodies, script.bodies, strict=True):
        assert body.places == (hand.patch_names if table.on == "*" else (largest,))


def test_ready_made_scenes_play_as_they_always_did():
    """Wrench on the palm, sums of depths and displacements, mean gel temperature, at 1, 2 and 3 s.

    `UPDATE_GOLDEN=1` writes them anew, for a look at the difference before it is committed.
    """
    palm, rows = topology.load("palm"), []
    for name in names:
        scene = open_scene(name, palm)
        for time_s in (1.0, 2.0, 3.0):
            truth = scene.at(time_s)
            sums = (
                truth.depth_mm.sum(),
                *truth.displacement_mm.sum(axis=1),
                truth.temperature.mean(),
            )
            values = (time_s, *truth.wrench, *sums)
            rows.append([name, *(f"{value + 0.0:.6f}" for value in values)])
    if os.environ.get("UPDATE_GOLDEN"):
        PLAYED.write_text("\n".join(map(",".join, rows)) + "\n", "utf-8")
    golden = [line.split(",") for line in PLAYED.read_text("utf-8").splitlines()]
    assert [row[:2] for row in rows] == [row[:2] for row in golden]
    for row, expected in zip(rows, golden, strict=True):
        np.testing.assert_allclose(
            np.array(row[1:], float), np.array(expected[1:], float), atol=3e-6, err_msg=row[0]
        )


@long_after_first("name", SHORT)
def test_a_scene_begins_outside_and_touches_what_it_says(name, hand):
    scene = open_scene(name, hand)
    end_s, step_s = scene.seconds, 0.02
    if name == "demo":  # a slow one, on one patch after the other
        end_s, step_s = end_s * len(hand.patch_names), 0.06
    seen: set[str] = set()
    places = {place for body in scene.bodies for place in body.places}
    for time_s in np.arange(0.0, end_s, step_s):
        truth = scene.at(time_s)
        touched = {hand.patch_names[i] for i in np.unique(hand.patch[truth.contact])}
        if time_s == 0.0:
            assert not touched
        assert len(touched) <= 1
        assert touched <= places
        assert truth.depth_mm.max() <= DEEPEST_MM
        seen |= touched
    assert seen == places


def test_bodies_of_a_users_scene_touch_all_that_is_in_their_way(tmp_path):
    """A plate between two patches that look at each other bears on both."""
    gripper = topology.load("gripper")
    (left, right) = (gripper.position[:, gripper.patch == i].mean(axis=1) for i in range(2))
    width_m = float(np.linalg.norm(left - right)) + 0.002
    scene = tmp_path / "block.toml"
    text = f"""format = 1
seconds = 1.0
[[bodies]]
name = "block"
shape = {{ kind = "block", x_m = 0.04, y_m = 0.04, z_m = {width_m} }}
keys = [{{ t_s = 0.0, xyz_m = [0.0, 0.0, -0.001] }}]
"""
    scene.write_text(text)
    truth = open_scene(scene, gripper).at(0.0)
    assert set(gripper.patch[truth.contact]) == {0, 1}
    scene.write_text(text.replace('name = "block"', 'name = "block"\nonly_on = true'))
    truth = open_scene(scene, gripper).at(0.0)
    assert set(gripper.patch[truth.contact]) == {0}


def test_the_command_says_what_is_touched(tmp_path, capsys):
    file = tmp_path / "opposed.toml"
    file.write_text(OPPOSED)
    for more, line in (([], "scene: ball on thumb, then palm"),
                       (["tap"], "scene: finger on palm")):  # fmt: skip
        assert main(["run", str(file), "--simulate", *more, "--seconds", "0.1"]) == 0
        assert line in capsys.readouterr().err.splitlines()
