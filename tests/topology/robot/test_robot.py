"""Skins on robots: what hangs on links, and where it is."""

import numpy as np
import pytest

from tests.fixtures.robots import GRIPPER, write_gripper
from topology import TopologyError, load, read_model
from topology.robot.urdf import resolve_mesh

MJCF = """<mujoco model="gripper">
  <compiler angle="degree"/>
  <worldbody>
    <body name="palm" pos="0 0 0.1">
      <body name="left" pos="-0.05 0 0.03">
        <joint name="turn" axis="0 0 1" pos="0.01 0 0" range="-90 90" ref="10"/>
        <joint name="close" type="slide" axis="1 0 0" range="0 0.05"/>
        <geom type="box" size="0.005 0.025 0.03"/>
      </body>
      <body name="right" pos="0.05 0 0.03">
        <joint name="close_right" type="slide" axis="-1 0 0" range="0 0.05"/>
        <geom type="box" size="0.005 0.025 0.03"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="close_right" joint2="close" polycoef="0.01 0.5 0 0 0"/></equality>
</mujoco>
"""


def test_patches_move_with_their_links_to_where_home_has_them(tmp_path):
    file = write_gripper(tmp_path)
    text = file.read_text()
    file.write_text(text.replace("[[buses]]", "home = { close = 0.02 }\n\n[[buses]]", 1))
    skin = load(file)
    left, right = skin.position[:, :4].mean(axis=1), skin.position[:, 4:].mean(axis=1)
    assert left == pytest.approx([-0.05 + 0.02 + 0.010, 0.0, 0.03])
    assert right == pytest.approx([0.05 - 0.02 - 0.010, 0.0, 0.03])  # it follows the left one
    assert skin.patch_links == skin.patch_frames == ("left", "right")
    outward = -skin.rotation[:, 2]
    assert outward[0] == pytest.approx([1.0] * 4 + [-1.0] * 4)


def test_the_base_is_the_frame_of_the_skin(tmp_path):
    file = write_gripper(tmp_path)
    in_root = load(file)
    file.write_text(file.read_text().replace("[[buses]]", 'base = "left"\n\n[[buses]]', 1))
    in_left = load(file)
    pose = in_root.robot.forward(np.zeros(1))[1]
    assert np.allclose(pose[:3, :3] @ in_left.position + pose[:3, 3:], in_root.position)
    assert in_left.position[0, :4] == pytest.approx([0.010] * 4)


def test_a_model_of_absurd_numbers_is_refused(tmp_path):
    absurd = GRIPPER.replace("-0.05 0 0.03", "1e308 0 0").replace("-0.01", "1e308")
    with pytest.raises(TopologyError, match="robot model: must be a model in metres"):
        load(write_gripper(tmp_path, absurd))


def test_a_joint_of_mjcf_that_others_follow_follows_none(tmp_path):
    both = '<joint joint1="close" joint2="turn" polycoef="0 1 0 0 0"/></equality>'
    (tmp_path / "gripper.xml").write_text(MJCF.replace("</equality>", both))
    assert read_model(tmp_path / "gripper.xml").joint_names == ("turn", "close")


def test_frames_on_a_link_carry_patches_with_it(tmp_path):
    file = write_gripper(tmp_path)
    text = file.read_text().replace('link = "left"', 'frame = "pad"', 1)
    frame = '[[frames]]\nname = "pad"\nlink = "left"\npose.xyz_m = [0, 0, 0.01]\n\n[[patches]]'
    file.write_text(text.replace("[[patches]]", frame, 1))
    skin = load(file)
    assert skin.patch_links == ("left", "right")
    assert skin.position[2, :4].mean() == pytest.approx(0.04)


def test_a_body_of_several_joints_stands_on_links_without_names(tmp_path):
    (tmp_path / "gripper.xml").write_text(MJCF)
    robot = read_model(tmp_path / "gripper.xml")
    assert robot.names == ("world", "palm", "left", "right")
    assert robot.link_names.count("") == 1
    assert robot.joint_names == ("turn", "close")
    assert robot.home == pytest.approx([np.radians(10.0), 0.0])
    pose = robot.forward(np.array([np.radians(100.0), 0.02]))[robot.link_names.index("left")]
    # about (0.01, 0, 0) by 90 degrees from where it was drawn, then along its own x
    assert pose[:3, 3] == pytest.approx([-0.05 + 0.01, -0.01 + 0.02, 0.13])
    right = robot.forward(np.array([0.0, 0.02]))[robot.link_names.index("right")]
    assert right[0, 3] == pytest.approx(0.05 - (0.01 + 0.5 * 0.02))


@pytest.mark.parametrize("where", ["clone-2.1", "src/other-clone", "share/hand_description"])
def test_meshes_are_found_in_packages_by_the_name_in_their_package_xml(
    where, tmp_path, monkeypatch
):
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'nowhere'}:{tmp_path / 'install'}")
    model = tmp_path / "src" / "hand-ros" / "urdf" / "hand.urdf"
    own = tmp_path / {"clone-2.1": "src/hand-ros", "src/other-clone": where}.get(
        where, f"install/{where}"
    )  # fmt: skip
    for folder, name in ((tmp_path / "src" / "wrong", "hand"), (own, "hand_description")):
        mesh = folder / "meshes" / "tip.stl"
        mesh.parent.mkdir(parents=True)
        mesh.write_text("")
        text = f'<?xml version="1.0"?>\n<package format="3">\n  <name> {name} </name>\n</package>'
        (folder / "package.xml").write_text(text)
    assert resolve_mesh("package://hand_description/meshes/tip.stl", model) == mesh
    assert not resolve_mesh("package://hand_description/meshes/thumb.stl", model).exists()


def test_meshes_of_packages_are_found_around_the_model(tmp_path):
    model = tmp_path / "hand_description" / "urdf" / "hand.urdf"
    mesh = tmp_path / "hand_description" / "meshes" / "tip.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("")
    assert resolve_mesh("package://hand_description/meshes/tip.stl", model) == mesh
    assert resolve_mesh("../meshes/tip.stl", model).resolve() == mesh
    assert not resolve_mesh("package://other/tip.stl", model).exists()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<robot ", "<!DOCTYPE x [<!ENTITY a 'b'>]>\n<robot ", "a document type, whose entities"),
        ('<child link="right"/>', '<child link="left"/>', "'close' carries it already"),
        ('<link name="palm">', '<link name="other"/><link name="palm">', "got 'other, palm'"),
        ('type="prismatic"', 'type="floating"', "must be fixed, revolute, continuous"),
        ("<robot ", "<sdf ", "mismatched tag"),
        ('<mimic joint="close"/>', '<mimic joint="close_right"/>', "nearest: 'close'"),
        (
            '<mass value="0.1"/>',
            '<mass value="heavy"/>',
            "link 'left' mass value: must be a finite",
        ),
        (
            '<limit lower="0" upper="0.05"/>',
            '<limit effort="5" velocity="1"/>',
            "gripper.urdf:12: joint 'close' limit: must be lower and upper, m; got none",
        ),
        (
            '<limit lower="0" upper="0.05"/>',
            "",
            "gripper.urdf:12: joint 'close' limit: must be lower and upper, m; got none",
        ),
        (
            '<mimic joint="close"/>',
            '<mimic joint="close" offset="1"/>',
            "'close_right' limit: must be limits that hold a part of 1 to 1.05, where the joint",
        ),
        ('<mass value="0.1"/>', "<mass/>", "link 'left' mass value: must be a finite number"),
    ],
)
def test_a_urdf_that_is_no_tree_of_links_says_so_with_its_line(tmp_path, old, new, told):
    with pytest.raises(TopologyError) as raised:
        load(write_gripper(tmp_path, GRIPPER.replace(old, new, 1)))
    assert told in str(raised.value)
    assert "gripper.urdf:" in str(raised.value)


def test_a_joint_that_turns_without_limits_is_to_be_called_continuous(tmp_path):
    turns = GRIPPER.replace("prismatic", "revolute").replace('<limit lower="0" upper="0.05"/>', "")
    with pytest.raises(TopologyError) as raised:
        load(write_gripper(tmp_path, turns))
    assert "lower and upper, rad; got none (type 'continuous' has none)" in str(raised.value)
    free = load(write_gripper(tmp_path, turns.replace("revolute", "continuous"))).robot
    assert np.isnan(free.lower).all()


def test_home_is_within_the_limits_of_what_follows(tmp_path):
    model = GRIPPER.replace('<mimic joint="close"/>', '<mimic joint="close" offset="-0.02"/>')
    file = write_gripper(tmp_path, model)
    assert load(file).robot.home == pytest.approx([0.02], abs=2e-6)
    text = file.read_text()
    file.write_text(text.replace("[[buses]]", "home = { close = 0.01 }\n\n[[buses]]", 1))
    with pytest.raises(TopologyError, match=r"follows 'close', is within its limits.* to -0\.01"):
        load(file)


def test_a_joint_of_mjcf_that_follows_beyond_its_range_is_refused(tmp_path):
    file = tmp_path / "gripper.xml"
    file.write_text(MJCF)
    assert read_model(file).upper[1] == pytest.approx(0.05)  # half of it and 0.01 are within
    file.write_text(MJCF.replace("0.01 0.5 0 0 0", "0.01 2 0 0 0"))
    assert read_model(file).upper[1] == pytest.approx(0.02, abs=1e-6)
    file.write_text(MJCF.replace("0.01 0.5 0 0 0", "0.1 2 0 0 0"))
    with pytest.raises(TopologyError, match=r"xml:\d+: joint 'close_right' range: must be limits"):
        read_model(file)


def test_a_comment_does_not_tell_what_a_model_is(tmp_path):
    file = write_gripper(tmp_path, f"<!-- once <mujoco > -->{GRIPPER}")
    assert load(file).robot.link_names == ("palm", "left", "right")
