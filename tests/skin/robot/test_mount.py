"""`skin mount`: what sits wrong is named, and units written into a model are where they were."""

import json
import sys

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from skin.cli import main
from skin.errors import LibraryError
from skin.robot.joints import Joints
from skin.robot.mesh import read_mesh
from skin.robot.write import unit_link_name, write_mounted
from tests.fixtures.robots import GRIPPER, of_package, random_joints, write_gripper
from tests.topology.robot.test_robot import MJCF
from topology import load
from topology.robot import read_model


def mount(capsys, *arguments):
    """Exit status, and what the command says, with its JSON object."""
    status = main(["mount", *map(str, arguments), "--json"])
    said = capsys.readouterr()
    last = json.loads(said.out.splitlines()[-1]) if status < 2 else {}
    return status, last, said.out + said.err


def test_a_skin_that_sits_on_its_links_is_fine(tmp_path, capsys):
    file = write_gripper(tmp_path)
    status, found, said = mount(capsys, tmp_path / "gripper.urdf", file)
    assert status == 0
    assert found["links"] == ["palm", "left", "right"]
    assert found["joints"] == [{"name": "close", "lower": 0.0, "upper": 0.05}]
    assert "close_right (follows close)" in said
    for patch in found["patches"]:
        assert patch["distance_mm"] == pytest.approx([5.0, 5.0])
        assert patch["tilt_deg"] == pytest.approx(0.0, abs=1e-5)


def test_units_in_a_urdf_are_where_yourdfpy_sees_them(tmp_path, capsys):
    file = write_gripper(tmp_path, pitch=83)
    original = (tmp_path / "gripper.urdf").read_bytes()
    out = tmp_path / "out.urdf"
    assert mount(capsys, tmp_path / "gripper.urdf", file, "-o", out)[0] == 0
    assert (tmp_path / "gripper.urdf").read_bytes() == original
    skin = load(file)
    peer = yourdfpy.URDF.load(str(out), load_meshes=False, build_scene_graph=True)
    assert peer.actuated_joint_names == ["close"]
    for unit, name in enumerate(skin.unit_names):
        pose = peer.get_transform(unit_link_name(name), "palm")
        assert np.abs(pose[:3, 3] - skin.position[:, unit]).max() < 1e-12
        assert np.abs(pose[:3, :3] - skin.rotation[:, :, unit]).max() < 1e-9
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "gripper.toml", "gripper.urdf", "out.urdf"
    ]  # fmt: skip


def test_units_in_a_gripper_of_others_move_as_yourdfpy_moves_them(tmp_path):
    (model,) = of_package("airo_models", "grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf")
    text = model.read_text()
    file = write_gripper(tmp_path, text)
    fingers = file.read_text()
    for side in ("left", "right"):
        fingers = fingers.replace(f'link = "{side}"', f'link = "{side}_inner_finger_pad"')
    file.write_text(fingers)
    skin = load(file)
    write_mounted(skin, tmp_path / "out.urdf")
    peer = yourdfpy.URDF.load(str(tmp_path / "out.urdf"), load_meshes=False)
    joints = Joints(skin)
    for q in random_joints(skin.robot, 50):
        joints.move(q)
        peer.update_cfg(q)
        position, rotation = joints.unit_poses
        for unit, name in enumerate(skin.unit_names):
            pose = peer.get_transform(unit_link_name(name), skin.robot.link_names[0])
            assert np.abs(pose[:3, 3] - position[:, unit]).max() < 1e-12
            assert np.abs(pose[:3, :3] - rotation[:, :, unit]).max() < 1e-12


def test_units_in_an_mjcf_are_where_mujoco_sees_them(tmp_path, capsys):
    file = write_gripper(tmp_path, MJCF, name="gripper.xml", pitch=83)
    out = tmp_path / "out.xml"
    assert mount(capsys, tmp_path / "gripper.xml", file, "-o", out)[0] == 0
    skin = load(file)
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    data.joint("close_right").qpos = 0.01  # where the equality has it
    mujoco.mj_kinematics(model, data)
    for unit, name in enumerate(skin.unit_names):
        site = data.site(unit_link_name(name))
        assert np.abs(site.xpos - skin.position[:, unit]).max() < 1e-12
        assert np.abs(site.xmat.reshape(3, 3) - skin.rotation[:, :, unit]).max() < 1e-12


BOX = '<box size="0.01 0.05 0.06"/>'
WRONG = {
    "floats": (GRIPPER, {"out": 0.025}, "got 20.0 mm off (4 of 4 units): correct the pose"),
    "inverted": (GRIPPER, {"pitch": -90}, "its normals point into the link: turn the patch"),
    "tilted": (GRIPPER, {"pitch": 45}, "must be tilted by at most 30° to the surface of 'left'"),
    "massless": (
        GRIPPER.replace('value="0.1"', 'value="0"'),
        {},
        "gripper.urdf:5: link 'left' mass: must be positive; got 0: give its <inertial>",
    ),
    "no mesh": (
        GRIPPER.replace(BOX, '<mesh filename="gone.stl"/>', 1),
        {},
        "gone.stl: must be a mesh; got no such file: correct its filename",
    ),
    "a mesh of nothing in metres": (
        GRIPPER.replace(BOX, '<mesh filename="tip.stl" scale="0.001 0.001 0.001"/>', 1),
        {},
        "link 'left' mesh: must be in metres; got 6e-05 m across: if it is drawn in metres, leave "
        "out its scale",
    ),
    "a box in millimetres": (
        GRIPPER.replace(BOX, '<box size="10 50 60"/>', 1),
        {},
        "link 'left' box: must be in metres; got 60 m across: if it is drawn in millimetres, "
        "divide its lengths by 1000",
    ),
    "divided twice": (
        GRIPPER.replace("0.05 0 0.03", "0.00005 0 0.00003"),
        {},
        "lengths must be metres; got links within 0.05 mm: if they were divided by 1000 twice",
    ),
    "millimetres": (
        GRIPPER.replace("-0.05 0 0.03", "-50 0 30"),
        {},
        "lengths must be metres; got links 50 m apart: if they are millimetres, divide",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_sits_wrong_is_named_with_what_to_do_and_nothing_is_written(case, tmp_path, capsys):
    model, how, told = WRONG[case]
    trimesh.creation.box((0.01, 0.05, 0.06)).export(tmp_path / "tip.stl")
    file = write_gripper(tmp_path, model, **how)
    out = tmp_path / "out.urdf"
    status, found, said = mount(capsys, tmp_path / "gripper.urdf", file, "-o", out)
    assert status == 1
    assert not found["ok"]
    assert any(told in problem for problem in found["problems"]), said
    assert not out.exists()


def test_a_mesh_in_millimetres_is_named_and_one_with_its_scale_is_fine(tmp_path, capsys):
    trimesh.creation.box((10.0, 50.0, 6000.0)).export(tmp_path / "tip.stl")
    file = write_gripper(tmp_path, GRIPPER.replace(BOX, '<mesh filename="tip.stl"/>', 1))
    _, found, _ = mount(capsys, tmp_path / "gripper.urdf", file)
    assert any('give it scale="0.001 0.001 0.001"' in problem for problem in found["problems"])
    scaled = '<mesh filename="tip.stl" scale="0.001 0.001 0.00001"/>'
    file = write_gripper(tmp_path, GRIPPER.replace(BOX, scaled, 1))
    status, found, said = mount(capsys, tmp_path / "gripper.urdf", file)
    assert status == 0, said
    assert found["patches"][0]["distance_mm"] == pytest.approx([5.0, 5.0])


@pytest.mark.parametrize("metre", [1.0, 0.001, 0.0254])
def test_a_collada_mesh_of_a_package_is_read_in_its_own_unit(tmp_path, capsys, metre):
    box = trimesh.creation.box(np.array((0.01, 0.05, 0.06)) / metre)
    parts = [box.slice_plane((0, 0, 0), (0, 0, side), cap=False) for side in (1, -1)]
    text = trimesh.exchange.dae.export_collada(parts).decode()
    (tmp_path / "meshes").mkdir()
    asset = f'<unit name="own" meter="{metre}"/></asset>'
    (tmp_path / "meshes" / "tip.DAE").write_text(text.replace("</asset>", asset))
    (tmp_path / "package.xml").write_text("<package><name>hand</name></package>")
    mesh = '<mesh filename="package://hand/meshes/tip.DAE"/>'
    file = write_gripper(tmp_path, GRIPPER.replace(BOX, mesh, 1))
    status, found, said = mount(capsys, tmp_path / "gripper.urdf", file)
    assert status == 0, said
    assert found["patches"][0]["distance_mm"] == pytest.approx([5.0, 5.0])
    assert found["patches"][1]["distance_mm"] == pytest.approx([5.0, 5.0])


def test_a_collada_mesh_without_its_library_says_which_extra_brings_it(tmp_path, monkeypatch):
    (tmp_path / "tip.dae").write_bytes(
        trimesh.exchange.dae.export_collada(trimesh.creation.box((1, 1, 1)))
    )
    monkeypatch.setitem(sys.modules, "collada", None)
    with pytest.raises(LibraryError, match=r"pip install 'f3t-skin\[mesh\]'"):
        read_mesh(tmp_path / "tip.dae")


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("gripper.urdf", "must be another file than the model; got the model itself"),
        ("elsewhere/out.urdf", "must be a .urdf file in the folder of the model"),
        ("out.xml", "must be a .urdf file in the folder of the model"),
    ],
)
def test_a_copy_that_would_lose_something_is_refused(tmp_path, capsys, out, told):
    file = write_gripper(tmp_path)
    status, _, said = mount(capsys, tmp_path / "gripper.urdf", file, "-o", tmp_path / out)
    assert status == 2
    assert told in said


def test_a_model_that_has_the_skin_already_is_refused(tmp_path, capsys):
    file = write_gripper(tmp_path, GRIPPER.replace("</robot>", '<link name="left_r0c0"/></robot>'))
    (tmp_path / "gripper.urdf").write_text(
        GRIPPER.replace(
            "</robot>",
            '<link name="left_r0c0"/><joint name="j" type="fixed"><parent link="palm"/>'
            '<child link="left_r0c0"/></joint></robot>',
        )
    )
    out = tmp_path / "out.urdf"
    status, _, said = mount(capsys, tmp_path / "gripper.urdf", file, "-o", out)
    assert status == 2
    assert "must have no link 'left_r0c0', which is to be that of unit 'left/r0c0'" in said


def test_a_topology_of_another_model_is_refused(tmp_path, capsys):
    file = write_gripper(tmp_path)
    (tmp_path / "other.urdf").write_text(GRIPPER)
    status, _, said = mount(capsys, tmp_path / "other.urdf", file)
    assert status == 2
    assert "robot model: must be" in said


def test_names_that_xml_must_escape_and_any_encoding_are_written_as_they_were(tmp_path, capsys):
    odd = GRIPPER.replace('"left"', '"links &amp; \u00e4u\u00dfen"').replace('"right"', '"r"')
    text = f'<?xml version="1.0" encoding="latin-1"?>{odd}'
    file = write_gripper(tmp_path)
    (tmp_path / "gripper.urdf").write_bytes(text.encode("latin-1"))
    told = file.read_text().replace('link = "left"', 'link = "links & \u00e4u\u00dfen"')
    told = told.replace('link = "right"', 'link = "r"').replace('"gripper"', '"a--b"', 1)
    file.write_text(told, "utf-8")
    out = tmp_path / "out.urdf"
    status, _, said = mount(capsys, tmp_path / "gripper.urdf", file, "-o", out)
    assert status == 0, said
    with_skin = read_model(out)
    unit = with_skin.link_names.index("left_r0c0")
    assert with_skin.link_names[with_skin.parent[unit]] == "links & \u00e4u\u00dfen"


@pytest.mark.parametrize("name", ["gripper.urdf", "gripper.URDF", "gripper.xml"])
@pytest.mark.parametrize("mass", ["0", "-1"])
def test_a_mass_that_cannot_be_is_named_whatever_the_suffix(tmp_path, capsys, name, mass):
    file = write_gripper(tmp_path, GRIPPER.replace('value="0.1"', f'value="{mass}"'), name=name)
    status, found, _ = mount(capsys, tmp_path / name, file)
    assert status == 1
    assert f"link 'left' mass: must be positive; got {mass}" in found["problems"][0]


def test_a_link_without_mass_may_carry_one_that_has_some(tmp_path, capsys):
    carried = (
        '<link name="tip"><inertial><mass value="0.1"/></inertial></link><joint name="glued" '
        'type="fixed"><parent link="left"/><child link="tip"/></joint></robot>'
    )
    model = GRIPPER.replace('value="0.1"', 'value="0"').replace("</robot>", carried)
    file = write_gripper(tmp_path, model)
    assert mount(capsys, tmp_path / "gripper.urdf", file)[0] == 0
