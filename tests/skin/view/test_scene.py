"""What the renderer is asked to draw: links, names, the chosen unit, units that are not valid."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from skin.state import Status
from skin.view.colour import INVALID_COLOUR, OFF_COLOUR, rendered
from skin.view.drawing import Frame, Pose
from skin.view.links import Links
from skin.view.panel import unit_html
from skin.view.scene import CHOSEN_COLOUR, RIM_COLOUR, Scales, Scene
from tests.fixtures.asked import Asked
from tests.fixtures.robots import GRIPPER, write_gripper
from tests.fixtures.shown import Shown
from tests.naive.record import fill, snapshots
from topology import load


def snapshot_of(shown, **of_state):
    """A snapshot and its pose."""
    record = snapshots(1, shown.topology.n)
    fill(record, shown.state(**of_state))
    return record[0], Pose(*map(np.float32, shown.poses))


def drawn(shown, chosen=None, **of_state):
    """A scene of a state, and the server that was asked for it."""
    asked, (record, pose) = Asked(), snapshot_of(shown, **of_state)
    scene = Scene(asked, shown.topology, pose, print)
    scene.draw(record, pose, Scales(), unit=chosen)
    return asked, scene


@pytest.fixture
def shown():
    return Shown(4, 6)


def test_without_a_robot_there_are_no_links(shown):
    asked, scene = drawn(shown)
    assert not [name for name in asked.scene.nodes if name.startswith("/links")]
    assert scene.points.shape == (24, 3)


def test_names_of_patches_and_axes_are_there(shown):
    shown.topology = replace(
        shown.topology, patch=np.arange(24) // 12, patch_names=("lower", "upper", "of no unit")
    )
    asked, _ = drawn(shown)
    nodes = asked.scene.nodes
    assert [nodes[f"/patches/{k}"].text for k in (0, 1)] == ["lower", "upper"]
    assert "/patches/2" not in nodes
    assert (nodes["/axes"].position < nodes["/units"].batched_positions.min(axis=0)).all()


def test_the_chosen_unit_has_a_rim_of_its_own(shown):
    asked, scene = drawn(shown, 7)
    rims = asked.scene.nodes["/rims"]
    expected = np.repeat(rendered(RIM_COLOUR)[None], 24, axis=0)
    expected[7] = rendered(CHOSEN_COLOUR)
    np.testing.assert_array_equal(rims.batched_colors, expected)
    assert rims.batched_scales[7, 0] > rims.batched_scales[6, 0]
    scene.draw(*snapshot_of(shown), Scales())
    assert (rims.batched_colors == rendered(RIM_COLOUR)).all()


def test_a_click_on_a_disc_chooses_its_unit(shown):
    asked, clicked = Asked(), []
    Scene(asked, shown.topology, snapshot_of(shown)[1], clicked.append)
    asked.scene.nodes["/units"].clicked(SimpleNamespace(instance_index=5))
    assert clicked == [5]


def test_a_unit_is_described_with_the_sigma_along_its_force(shown):
    record, _ = snapshot_of(shown)
    record["force"][:, 3], record["force_sigma"][:, 3] = (0.0, 3.0, 4.0), (9.0, 0.5, 0.25)
    expected = np.hypot(0.6 * 0.5, 0.8 * 0.25)
    text = unit_html(record, 3, "thumb/u3")
    assert "thumb/u3" in text
    assert f"5.00 ± {expected:.2f} N" in text
    assert "3.00 ± 0.50 N" in text
    record["force_sigma"][:, 3] = np.nan
    assert "5.00 N" in unit_html(record, 3, "u3")
    record["force"][:, 3] = np.nan
    assert "unknown" in unit_html(record, 3, "u3")


def test_units_switched_off_are_a_dot_and_those_never_heard_have_a_cross(shown):
    status = np.zeros(24, np.uint16)
    status[3], status[5] = int(Status.DISABLED), int(Status.NEVER)
    asked, _ = drawn(shown, status=status)
    nodes = asked.scene.nodes
    colours, crosses = nodes["/units"].batched_colors, nodes["/flags"].batched_scales[:, 0]
    np.testing.assert_array_equal(colours[3], rendered(np.array(OFF_COLOUR, np.uint8)))
    np.testing.assert_array_equal(colours[5], rendered(np.array(INVALID_COLOUR, np.uint8)))
    assert np.flatnonzero(crosses > 1e-3).tolist() == [5]
    assert np.flatnonzero(np.diff(nodes["/units"].batched_scales[:, 0] < crosses.max() / 2)
                          ).tolist() == [2, 3]  # fmt: skip


def test_four_thousand_units_are_drawn_by_as_many_nodes_as_ten():
    few, _ = drawn(Shown(2, 5))
    many, _ = drawn(Shown(64, 64))
    assert len(many.scene.all) == len(few.scene.all)


ROOM = Frame(np.zeros(3), 1.0)
# Links: the gripper of the fixtures, whose fingers slide.


def pose_at(skin, robot, close, q):
    """Poses of units where the fingers are closed by a length, metre."""
    at = robot.forward(np.array([close]))
    rest = robot.forward(robot.home)
    position = np.array(skin.position)
    for u in range(skin.n):
        link = robot.link_names.index(skin.patch_links[skin.patch[u]])
        position[:, u] += at[link, :3, 3] - rest[link, :3, 3]
    return Pose(np.float32(position), np.float32(skin.rotation), np.array(q))


def links_of(folder, model=GRIPPER, frame=ROOM):
    """The links of a gripper, its nodes by their names, and the robot."""
    robot, asked = load(write_gripper(folder, model)).robot, Asked()
    links = Links(asked.scene, robot, frame)
    return links, {robot.link_names[int(k[7:])]: v for k, v in asked.scene.nodes.items()}, robot


def test_links_are_where_the_joints_are_and_hidden_where_these_are_unknown(tmp_path):
    frame = Frame(np.array([0.01, 0.02, 0.03]), 5.0)
    links, nodes, robot = links_of(tmp_path, frame=frame)
    links.move(np.array([0.02]))
    expected = robot.forward(np.array([0.02]))
    for link, node in enumerate(nodes.values()):
        assert node.kind == "add_mesh_simple"
        np.testing.assert_allclose(
            node.position, 5.0 * (expected[link, :3, 3] - frame.middle), atol=1e-4
        )
        np.testing.assert_allclose(np.abs(node.wxyz), [1.0, 0.0, 0.0, 0.0], atol=1e-4)
    size = np.ptp(nodes["left"].given[1], axis=0)
    np.testing.assert_allclose(size, 5.0 * np.array([0.01, 0.05, 0.06]), rtol=1e-5)
    corners = links.points() / 5.0 + frame.middle
    np.testing.assert_allclose(corners[:8].min(axis=0), [-0.05, -0.025, -0.02], atol=1e-6)
    for q, visible in ((np.nan, False), (0.01, True)):
        links.move(np.array([q]))
        assert nodes["left"].visible is visible


def test_a_mesh_is_drawn_with_its_place_and_scale(tmp_path):
    trimesh.creation.box((20.0, 10.0, 40.0)).export(tmp_path / "tip.stl")
    mesh = GRIPPER.replace(
        '<collision><geometry><box size="0.01 0.05 0.06"/></geometry></collision>',
        '<visual><origin xyz="0.1 0 0" rpy="0 0 1.5707963"/><geometry>'
        '<mesh filename="tip.stl" scale="0.001 0.001 0.001"/></geometry></visual>',
        1,
    )
    links, nodes, _ = links_of(tmp_path, mesh)
    vertices, faces = nodes["left"].given[1:3]
    np.testing.assert_allclose(vertices.min(axis=0), [0.095, -0.01, -0.02], atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), [0.105, 0.01, 0.02], atol=1e-6)
    assert (len(vertices), len(faces)) == (8, 12)
    assert links.problems == []


@pytest.mark.parametrize("content", [None, b"no mesh at all"])
def test_a_link_whose_mesh_cannot_be_read_is_axes_and_named(tmp_path, content, capsys):
    if content is not None:
        (tmp_path / "tip.stl").write_bytes(content)
    broken = GRIPPER.replace('<box size="0.01 0.05 0.06"/>', '<mesh filename="tip.stl"/>', 1)
    links, nodes, _ = links_of(tmp_path, broken)
    ((name, why),) = links.problems
    assert name == "left"
    assert "tip.stl: must be a mesh" in why
    assert "view: link 'left': " in capsys.readouterr().err
    assert nodes.pop("left").kind == "add_frame"
    assert {node.kind for node in nodes.values()} == {"add_mesh_simple"}


def test_a_scene_moves_its_links(tmp_path):
    skin = load(write_gripper(tmp_path))
    pose, record, asked = pose_at(skin, skin.robot, 0.0, [0.0]), snapshots(1, skin.n)[0], Asked()
    scene = Scene(asked, skin, pose, print)
    before = np.array(asked.scene.nodes["/links/1"].position)
    scene.draw(record, pose_at(skin, skin.robot, 0.03, [0.03]), Scales())
    moved = asked.scene.nodes["/links/1"].position - before
    np.testing.assert_allclose(moved, [0.03 * scene.frame.scale, 0.0, 0.0], atol=1e-5)
    assert len(scene.points) == skin.n + 3 * 8
    assert np.isfinite(asked.initial_camera.position).all()
