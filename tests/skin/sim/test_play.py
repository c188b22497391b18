"""Laws of played scenes, the time lines of the paper's experiments, and the files of truth."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from skin.cli import main
from skin.errors import SceneError, SkinError
from skin.sim.node import SimulatedUnits
from skin.sim.scenes import names
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.motion import Track
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.record import Recorder
from skin.sim.scenes.script import (
    BodyTable,
    Key,
    LoadKey,
    LoadTable,
    NonIdeal,
    RoomKey,
    SceneFile,
    Sphere,
    ToolKey,
    ToolTable,
)
from skin.sim.truth import Truth
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import over
from tests.fixtures.truth import read_truth
from topology import Topology, load

IDEAL = NonIdeal.only()

PRESS = (Key(t_s=0.0, press_n=0.5), Key(t_s=0.15, press_n=3.0))
"""A press within a few cycles."""


@cache
def skin(name: str = "palm") -> Topology:
    return load(name)


def scene_of(name: str, non_ideal: NonIdeal = IDEAL, on: str = "palm") -> ScriptedScene:
    return ScriptedScene(skin(on), replace(load_scene(name, skin(on)), non_ideal=non_ideal))


@cache
def played(name: str) -> tuple[Truth, np.ndarray]:
    """100 instants of a ready-made scene, up to its end or to 30 s, and what the bodies bear."""
    scene = scene_of(name)
    truths, wrenches = [], []
    for time_s in np.linspace(0.0, min(scene.seconds, 30.0), 100):
        truths.append(scene.at(float(time_s)).copy())
        wrenches.append(scene.body_wrench())
    return Truth.stack(truths), np.array(wrenches)


def in_skin(force: np.ndarray) -> np.ndarray:
    """Sum of the units' forces in the skin frame, shape (t, 3)."""
    return np.einsum("ijn,tjn->ti", skin().rotation, force)


# -- ready-made scenes -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", names)
def test_units_together_bear_what_the_bodies_weigh(name: str) -> None:
    """In the skin frame; weights that are glued to units are no bodies."""
    truth, wrenches = played(name)
    if load_scene(name, skin()).loads:
        assert not wrenches.size
        return
    assert in_skin(truth.force) == pytest.approx(wrenches.sum(axis=1)[:, :3], abs=1e-9)
    assert truth.wrench == pytest.approx(wrenches.sum(axis=1), abs=1e-9)


@pytest.mark.parametrize("name", ["pull8", "fig4b", "fig4c", "fig6", "grasp"])
def test_the_skin_bears_the_press_and_the_drag_that_the_scene_orders(name: str) -> None:
    """On a flat skin; the drag follows within the step that moves the body."""
    scene, at_s = scene_of(name), np.linspace(0.0, 3.0, 301)
    body = scene.bodies[0]
    for time_s in at_s:
        scene.at(float(time_s))
        force = scene.body_wrench()[0, :3]
        assert -force[2] == pytest.approx(body.press_n(time_s), abs=1e-6)
        if time_s > 0.1:
            assert force[:2] == pytest.approx(body.drag_n(time_s), abs=0.08)


def test_a_body_that_is_dragged_too_hard_slides_with_the_force_of_friction() -> None:
    body = BodyTable(
        name="ball",
        shape=Sphere(radius_m=0.1),
        friction=0.2,
        keys=(Key(t_s=0.0, press_n=5.0, drag_n=(0.0, 0.0)), Key(t_s=1.0, drag_n=(4.0, 0.0))),
    )
    scene = ScriptedScene(skin(), SceneFile(format=1, seconds=1.0, bodies=(body,)))
    for time_s in np.linspace(0.0, 0.8, 81):
        truth = scene.at(float(time_s))
    assert truth.wrench[0] == pytest.approx(0.2 * 5.0, rel=0.02)
    assert scene.bodies[0].pose[1][0] > 0.001


def test_a_unit_under_two_bodies_bears_the_harder_one_alone() -> None:
    scene = scene_of("merge")
    truth = scene.at(0.0)
    met = 0
    for time_s in np.linspace(0.02, 4.0, 200):
        truth = scene.at(float(time_s))
        first, second = (body.force[2] for body in scene.bodies)
        assert not (first * second).any()
        met += int(
            (scene.bodies[0].mechanics.truth.load * scene.bodies[1].mechanics.truth.load).any()
        )
        assert (truth.force[2] >= np.maximum(first, second)).all()
    assert met > 10


def test_what_goes_wrong_between_keys_is_told_with_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A turn about the middle takes the corner of a block through the skin and out again."""
    path = tmp_path / "turn.toml"
    path.write_text(
        'format = 1\nseconds = 2.0\n\n[[bodies]]\nname = "block"\n'
        'shape = { kind = "block", x_m = 0.03, y_m = 0.03, z_m = 0.03 }\nkeys = [\n'
        "    { t_s = 0.0, xyz_m = [0.0, 0.0, 0.001], rpy_deg = [0.0, 0.0, 0.0] },\n"
        "    { t_s = 1.0, rpy_deg = [0.0, 90.0, 0.0] },\n]\n"
    )
    assert main(["sim", "palm", str(path)]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    start = f"{path}:9: bodies[0] 'block' keys[1] (at 0."
    assert said.startswith(start)
    assert "must press no unit deeper than 3.5 mm; got " in said


# -- frames, tracks, weights -----------------------------------------------------------------------


@given(
    times=st.lists(st.floats(0.0, 100.0), min_size=2, max_size=6, unique=True),
    data=st.data(),
    ease=st.sampled_from(["smooth", "linear", "hold"]),
)
def test_a_track_goes_through_its_keys_and_stays_between_them(
    times: list[float], data: st.DataObject, ease: str
) -> None:
    times = sorted(times)
    values = data.draw(st.lists(st.floats(-50, 200), min_size=len(times), max_size=len(times)))
    rows = [RoomKey(t_s=t, temperature_c=v, ease=ease) for t, v in zip(times, values, strict=True)]
    track = Track("temperature_c", rows, (), 24.0)
    for t, value in zip(times, values, strict=True):
        assert float(track(t)) == value
    at = data.draw(st.floats(-1.0, 101.0))
    assert min(values) - 1e-9 <= float(track(at)) <= max(values) + 1e-9


@given(x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0), z=st.floats(0.0, 7.0))
def test_a_weight_is_borne_by_its_unit_alone(x: float, y: float, z: float) -> None:
    load_table = LoadTable(units=("palm/r3c3",), keys=(LoadKey(t_s=0.0, force_n=(x, y, z)),))
    scene = ScriptedScene(skin(), SceneFile(format=1, seconds=1.0, loads=(load_table,)))
    truth = scene.at(0.5)
    unit = skin().index("palm/r3c3")
    assert truth.force[:, unit] == pytest.approx([x, y, z])
    assert np.abs(truth.force).sum() == pytest.approx(abs(x) + abs(y) + z)
    direction = truth.displacement_mm[:, unit]
    assert direction @ np.array([-y, x]) == pytest.approx(0.0, abs=1e-9)


# -- non-idealities --------------------------------------------------------------------------------


@long_after_first("name", NonIdeal.__struct_fields__)
def test_each_non_ideality_alone_changes_the_counts(name: str) -> None:
    counts = []
    for non_ideal in (IDEAL, NonIdeal.only(name)):
        scene = scene_of("slide", non_ideal)
        counts.append(np.stack([scene.units.counts(scene.at(t)) for t in np.arange(0.5, 4.0, 0.1)]))
    assert (counts[0] != counts[1]).any()


def test_a_tool_is_felt_by_the_units_near_it_and_by_no_other() -> None:
    """Iron draws the lines of the films into itself: |B| changes most where it is nearest."""
    felt = []
    script = replace(load_scene("tool", skin()), non_ideal=NonIdeal.only("magnet"))
    for tools in ((), script.tools):
        scene = ScriptedScene(skin(), replace(script, tools=tools))
        away, near = (scene.units.values(scene.at(t))[2:5].copy() for t in (0.0, 3.75))
        felt.append(np.sqrt((near**2).sum(axis=0)) - np.sqrt((away**2).sum(axis=0)))
    by_tool = np.abs(felt[1] - felt[0])
    away_m = np.hypot(skin().position[0] - 0.030, skin().position[1])
    assert by_tool[away_m < 0.012].min() > 20.0
    assert by_tool[away_m > 0.045].max() < 1.0


def test_a_tool_that_enters_a_unit_between_its_keys_is_refused() -> None:
    keys = tuple(ToolKey(t_s=t, xyz_m=(x, 0.006, -0.001)) for t, x in ((0.0, -0.1), (1.0, 0.1)))
    script = SceneFile(format=1, seconds=1.0, tools=(ToolTable(name="tip", keys=keys),))
    scene = ScriptedScene(skin(), script)
    words = (
        r"^tools\[0\] 'tip' keys\[1\] \(at 0\.\d+ s\): must be outside of all units .*; got .* into"
    )
    with pytest.raises(SceneError, match=words):
        scene.at(1.0)


# -- the paper's experiments -----------------------------------------------------------------------


def test_fig4a_follows_the_time_line_of_the_paper() -> None:
    """100 g from 50 s on, the same along x from 100 s, along y from 150 s; 20 to 80 °C."""
    scene = scene_of("fig4a")
    seen = {t: scene.at(float(t)).copy() for t in (0, 49, 51, 99, 101, 149, 151, 200)}
    weight = 0.1 * 9.81
    expected = {
        0: (0, 0, 0), 49: (0, 0, 0), 51: (0, 0, 1), 99: (0, 0, 1),
        101: (1, 0, 1), 149: (1, 0, 1), 151: (1, 1, 1), 200: (1, 1, 1),
    }  # fmt: skip
    for time_s, loads in expected.items():
        truth = seen[time_s]
        assert truth.force == pytest.approx(
            np.outer(np.multiply(loads, weight), np.ones(skin().n)), abs=1e-9
        )
    # the gel follows the room, which warms by 0.3 K a second, with a lag of a minute or less
    for time_s, truth in seen.items():
        room = 20.0 + 0.3 * time_s
        assert (room - 0.3 * 60.0 - 1e-9 <= truth.temperature).all()
        assert (truth.temperature <= room + 1e-9).all()
    assert float(seen[200].temperature.mean()) > 70.0


# -- truth files, frames, the command --------------------------------------------------------------


def test_a_truth_file_is_what_the_scene_said(tmp_path: Path) -> None:
    path = tmp_path / "truth.npz"
    with Recorder(scene_of("merge"), path) as scene:
        said = Truth.stack([scene.at(0.04 * k).copy() for k in range(100)])
    truth, more = read_truth(path)
    for name in ("time_s", "contact", "wrench", "centroid"):
        assert np.array_equal(getattr(truth, name), getattr(said, name), equal_nan=True)
    for name in ("depth_mm", "displacement_mm", "force", "temperature", "hall_temperature"):
        assert getattr(truth, name).dtype == np.float32
        assert getattr(truth, name) == pytest.approx(getattr(said, name), rel=1e-6, abs=1e-9)
    assert list(more["body_names"]) == ["left", "right"]
    assert tuple(more["unit_names"]) == skin().unit_names
    assert more["body_wrench"].sum(axis=1) == pytest.approx(said.wrench, abs=1e-9)
    assert more["body_position"][-1, 0, 0] == pytest.approx(-0.004, abs=1e-6)
    assert (str(more["topology"]), str(more["scene"])) == ("palm", "merge")
    assert list(tmp_path.iterdir()) == [path]


def test_a_truth_file_keeps_what_came_before_an_error(tmp_path: Path) -> None:
    path = tmp_path / "truth.npz"
    recorder = Recorder(scene_of("press"), path)
    with pytest.raises(SkinError):
        with recorder as scene:
            [scene.at(time_s) for time_s in (0.0, 1.0, 0.5)]
    assert read_truth(path)[0].time_s.tolist() == [0.0, 1.0]
    with Recorder(scene_of("press"), tmp_path / "none.npz"):
        pass
    assert list(tmp_path.iterdir()) == [path]


def test_a_truth_file_needs_a_folder_to_be_in(tmp_path: Path) -> None:
    with pytest.raises(SkinError, match="must be a place to write to"):
        Recorder(scene_of("press"), tmp_path / "nowhere" / "truth.npz")


def test_a_played_scene_is_felt_through_a_bus(tmp_path: Path) -> None:
    """Frames on the bus and the truth file tell the same, cycle by cycle."""
    script = load_scene("fig4b", skin())
    script = replace(script, bodies=(replace(script.bodies[0], keys=PRESS),))
    path, felt = tmp_path / "truth.npz", []
    with Recorder(ScriptedScene(skin(), replace(script, non_ideal=IDEAL)), path) as recorder:
        nodes = SimulatedUnits(skin(), recorder)
        with over(skin(), nodes.in_process(), pace=False) as host:
            for state, _ in zip(host, range(50), strict=False):
                felt.append((state.cycle, state.units.force[2].sum()))
    truth, _ = read_truth(path)
    cycles, loads = np.array(felt).T
    said = truth.force[(cycles - cycles[0]).astype(int), 2].sum(axis=1)
    assert said.max() > 2.0
    assert loads == pytest.approx(said, abs=0.05)


def test_the_command_plays_a_scene_and_writes_its_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "truth.npz"
    assert main(
        ["sim", "palm", "slide", "--seconds", "2", "--truth", str(path), "--json"]
    ) == 0  # fmt: skip
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["scene"], report["cycles"], report["truth"]) == ("slide", 500, str(path))
    assert report["frames"] >= 500 * len(skin().frames)
    assert read_truth(path)[0].force.shape == (500, 3, 64)


def test_truth_is_of_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "palm", "--truth", "x.npz"]) == 2
    assert capsys.readouterr().err == "--truth: must be given with a scene; got none\n"
