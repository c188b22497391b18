"""How a skin sits on its robot, as `skin check` says it: what sits wrong, and what to do."""

import json
import sys

import numpy as np
import pytest
import trimesh

from skin.cli import main
from skin.errors import LibraryError
from skin.robot.mesh import distance_to, read_mesh, shape_triangles
from tests.fixtures.robots import GRIPPER, write_gripper
from topology import load
from topology.robot.model import Geom


def check(capsys, file):
    """Exit status, what the command tells of the robot, and all that it prints."""
    status = main(["check", str(file), "--json"])
    printed = capsys.readouterr()
    return status, json.loads(printed.out)["robot"], printed.err


def test_a_skin_that_sits_on_its_links_is_fine(tmp_path, capsys):
    status, robot, _ = check(capsys, write_gripper(tmp_path))
    assert (status, robot["problems"]) == (0, [])
    assert robot["links"] == ["palm", "left", "right"]
    assert robot["joints"] == [{"name": "close", "lower": 0.0, "upper": 0.05}]
    for patch in robot["patches"]:
        assert patch["distance_mm"] == pytest.approx([5.0, 5.0])
        assert patch["tilt_deg"] == pytest.approx(0.0, abs=1e-5)
    assert len(list(tmp_path.iterdir())) == 2  # nothing is written


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
    "of no mass at all": (
        GRIPPER.replace('value="0.1"', 'value="-1"'),
        {},
        "mass: must be positive; got -1: give",
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
def test_what_sits_wrong_is_named_with_what_to_do(case, tmp_path, capsys):
    model, how, told = WRONG[case]
    trimesh.creation.box((0.01, 0.05, 0.06)).export(tmp_path / "tip.stl")
    status, robot, said = check(capsys, write_gripper(tmp_path, model, **how))
    assert status == 1
    assert any(told in problem for problem in robot["problems"]), said
    assert told in said


def test_a_mesh_in_millimetres_is_named_and_one_with_its_scale_is_fine(tmp_path, capsys):
    trimesh.creation.box((10.0, 50.0, 6000.0)).export(tmp_path / "tip.stl")
    file = write_gripper(tmp_path, GRIPPER.replace(BOX, '<mesh filename="tip.stl"/>', 1))
    _, robot, _ = check(capsys, file)
    assert any('give it scale="0.001 0.001 0.001"' in problem for problem in robot["problems"])
    scaled = '<mesh filename="tip.stl" scale="0.001 0.001 0.00001"/>'
    status, robot, said = check(
        capsys, write_gripper(tmp_path, GRIPPER.replace(BOX, scaled, 1))
    )  # fmt: skip
    assert status == 0, said
    assert robot["patches"][0]["distance_mm"] == pytest.approx([5.0, 5.0])


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
    status, robot, said = check(capsys, write_gripper(tmp_path, GRIPPER.replace(BOX, mesh, 1)))
    assert status == 0, said
    assert robot["patches"][0]["distance_mm"] == pytest.approx([5.0, 5.0])
    assert robot["patches"][1]["distance_mm"] == pytest.approx([5.0, 5.0])


def test_without_the_library_of_meshes_the_rest_is_checked(tmp_path, monkeypatch, capsys):
    file = write_gripper(tmp_path, pitch=-90)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    monkeypatch.setitem(sys.modules, "trimesh.creation", None)
    status, robot, said = check(capsys, file)
    assert (status, robot["patches"]) == (0, [])
    assert "how the skin sits on the robot was not checked: trimesh: must be installed" in said
    assert "pip install 'f3t-skin[mesh]'" in said


def test_a_collada_mesh_without_its_library_says_which_extra_brings_it(tmp_path, monkeypatch):
    (tmp_path / "tip.dae").write_bytes(
        trimesh.exchange.dae.export_collada(trimesh.creation.box((1, 1, 1)))
    )
    monkeypatch.setitem(sys.modules, "collada", None)
    with pytest.raises(LibraryError, match=r"pip install 'f3t-skin\[mesh\]'"):
        read_mesh(tmp_path / "tip.dae")


def test_a_link_without_mass_may_carry_one_that_has_some(tmp_path, capsys):
    carried = (
        '<link name="tip"><inertial><mass value="0.1"/></inertial></link><joint name="glued" '
        'type="fixed"><parent link="left"/><child link="tip"/></joint></robot>'
    )
    model = GRIPPER.replace('value="0.1"', 'value="0"').replace("</robot>", carried)
    assert check(capsys, write_gripper(tmp_path, model))[0] == 0


SHAPES = {
    "box": ((0.01, 0.02, 0.03), (0.04, 0.0, 0.0), 0.03, (1, 0, 0)),
    "sphere": ((0.02,), (0.0, 0.0, 0.015), -0.005, (0, 0, 1)),
    "cylinder": ((0.02, 0.05), (0.0, 0.03, 0.01), 0.01, (0, 1, 0)),
    "capsule": ((0.01, 0.03), (0.0, 0.0, 0.05), 0.01, (0, 0, 1)),
    "ellipsoid": ((0.01, 0.02, 0.04), (0.0, 0.025, 0.0), 0.005, (0, 1, 0)),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_distances_to_shapes_are_those_of_their_formulas(kind):
    size, point, off, outward = SHAPES[kind]
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    geom = Geom(0, kind, size, xyz=(0.1, 0.2, 0.3), rotation=tuple(turn.ravel()))
    point = turn @ np.array(point) + [0.1, 0.2, 0.3]
    distance, normal = distance_to(shape_triangles(geom), point[:, np.newaxis])
    assert distance[0] == pytest.approx(off, abs=1e-4)
    assert np.degrees(np.arccos(min(1.0, normal[:, 0] @ turn @ outward))) < 4.0


def test_a_mirrored_mesh_is_not_turned_inside_out(tmp_path):
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "tip.stl")
    for scale in ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)):
        geom = Geom(0, "mesh", mesh=str(tmp_path / "tip.stl"), scale=scale)
        distance, normal = distance_to(shape_triangles(geom), np.array([[0.03], [0.0], [0.0]]))
        assert distance == pytest.approx([0.02])
        assert normal[:, 0] == pytest.approx([1.0, 0.0, 0.0])


def test_a_patch_on_a_link_without_shapes_is_not_judged(tmp_path, capsys):
    bare = GRIPPER.replace(f"<collision><geometry>{BOX}</geometry></collision>", "", 1)
    status, robot, _ = check(capsys, write_gripper(tmp_path, bare))
    assert (status, robot["patches"][0]["distance_mm"]) == (0, None)
    assert load(tmp_path / "gripper.toml").n == 8
