"""`skin new`: a file that every other command takes, and nothing that was there is touched."""

from __future__ import annotations

import json

import numpy as np
import pytest

import topology
from skin.cli import main
from skin.robot.mount import check_patches
from tests.fixtures.cases import long_after_first


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@long_after_first("is_classic", [False, True])
def test_a_new_hand_is_checked_simulated_and_tared(is_classic, folder, capsys):
    patches = ["--patches", "palm=3x4", "thumb=2x2"]
    assert main(["new", "my_hand", *patches, "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert sorted(path.name for path in folder.iterdir()) == [
        "my_hand.palm.calibration.toml", "my_hand.thumb.calibration.toml", "my_hand.toml",
    ]  # fmt: skip
    loaded = topology.load("my_hand.toml")
    assert (loaded.name, loaded.n, report["units"]) == ("my_hand", 16, 16)
    file = folder / "my_hand.toml"
    text = file.read_text().replace('interface = "socketcan"', 'interface = "memory"')
    if is_classic:  # by what the comments say
        text = text.replace("data_bitrate", "# data_bitrate").replace("f3t-fd64", "f3t-classic")
    file.write_text(text)
    assert topology.load(file).buses[0].fd == (not is_classic)
    assert main(["check", "my_hand.toml"]) == 0
    assert main(["run", "my_hand.toml", "--simulate", "--seconds", "0.2"]) == 0
    assert main(["tare", "my_hand.toml", "--simulate", "--seconds", "3"]) == 0
    assert "not used until" not in capsys.readouterr().err
    assert topology.load("my_hand.toml").tared.all()


def test_domes_and_cylinders_lie_next_to_one_another(capsys):
    assert main(["new", "my_hand", "--patches", "tip=dome:10mm", "side=cylinder:10mm:3x2"]) == 0
    skin = topology.load("my_hand.toml")
    assert skin.patch_names == ("tip", "side")
    tip, side = (skin.position[:, skin.patch == patch] for patch in (0, 1))
    assert (tip.shape[1], side.shape[1]) == (5, 6)
    assert side[0].min() - tip[0].max() > 0.02
    np.testing.assert_allclose(np.linalg.norm(tip - [[0], [0], [-0.01]], axis=0), 0.01)
    assert main(["run", "my_hand.toml", "--simulate", "--seconds", "0.2"]) == 0


LINK = """<link name="{name}"><collision><origin xyz="{xyz}" rpy="{rpy}"/>
<geometry>{shape}</geometry></collision></link><joint name="to_{name}" type="fixed">
<parent link="palm"/><child link="{name}"/><origin xyz="{at}"/></joint>"""
SHAPES = {
    "ball": '<sphere radius="0.012"/>',
    "thumb": '<cylinder radius="0.01" length="0.03"/>',
    "plate": '<box size="0.05 0.008 0.03"/>',
}


def test_fingertips_of_a_robot_get_patches_on_their_surfaces(folder, capsys):
    links = "".join(
        LINK.format(name=name, shape=shape, xyz="0 0 0.03", rpy="0.3 0 0.2", at=f"0 {0.1 * i} 0")
        for i, (name, shape) in enumerate(SHAPES.items())
    )
    (folder / "hand.urdf").write_text(
        f'<robot name="hand"><link name="palm"><collision><geometry><box size="0.1 0.1 0.02"/>'
        f"</geometry></collision></link>{links}</robot>"
    )
    assert main(["new", "my_hand", "--robot", "hand.urdf"]) == 0
    skin = topology.load("my_hand.toml")
    assert skin.patch_links == ("ball", "thumb", "plate")
    assert np.bincount(skin.patch).tolist() == [6, 4, 8]
    for mount in check_patches(skin):
        assert mount.problems == ()
        assert np.abs(mount.distance_mm).max() < 0.1
        assert mount.tilt_deg < 3.5
    assert main(["check", "my_hand.toml"]) == 0
    assert main(["run", "my_hand.toml", "--simulate", "--seconds", "0.2"]) == 0


def robot_of(folder, *tips):
    """A model of fingertips: name and shape of each."""
    links = "".join(
        LINK.format(name=name, shape=shape, xyz="0 0 0", rpy="0 0 0", at=f"0 {0.1 * i} 0")
        for i, (name, shape) in enumerate(tips)
    )
    (folder / "hand.urdf").write_text(f'<robot name="hand"><link name="palm"/>{links}</robot>')
    return "hand.urdf"


def test_names_of_links_become_names_of_patches_that_are_used_once(folder, capsys):
    ball = '<sphere radius="0.012"/>'
    model = robot_of(
        folder, ("tip 1", ball), ("tip_1", ball), (".tip", ball), ("指", ball), ("x" * 300, ball)
    )
    assert main(["new", "my_hand", "--robot", model, "--patches", "tip=2x2"]) == 0
    skin = topology.load("my_hand.toml")
    assert skin.patch_names == ("tip", "tip_1", "tip_1_2", "tip_2", "_", "x" * 40)
    assert skin.patch_links[1:4] == ("tip 1", "tip_1", ".tip")


@pytest.mark.parametrize(
    ("shape", "got"),
    [('<box size="30 20 50"/>', "a box of 50 m"), ('<sphere radius="10"/>', "a sphere of 20 m"),
     ('<sphere radius="0.0002"/>', "a sphere of 0.0002 m"),
     ('<cylinder radius="0.0" length="0.02"/>', "a cylinder of 0 m")],
)  # fmt: skip
def test_what_is_no_fingertip_by_its_size_is_refused(shape, got, folder, capsys):
    """A model in millimetres would have millions of units."""
    assert main(["new", "my_hand", "--robot", robot_of(folder, ("tip", shape))]) == 2
    error = capsys.readouterr().err
    assert "--robot: link 'tip': a fingertip must be 0.001 m in radius at least" in error
    assert f"got {got} (lengths of models are metres)" in error
    assert not (folder / "my_hand.toml").exists()


def test_a_hand_that_is_too_large_for_one_bus_is_written_to_be_parted(folder, capsys):
    assert main(["new", "my_hand", "--patches", "a=20x20"]) == 0
    capsys.readouterr()
    assert main(["check", "my_hand.toml"]) == 1
    assert "bus 'main' cannot carry 250 Hz" in capsys.readouterr().err


@pytest.mark.parametrize("there", ["my_hand.toml", "my_hand.palm.calibration.toml"])
def test_what_is_there_stays(there, folder, capsys):
    (folder / there).write_text("Notes of the lab\n")
    assert main(["new", "my_hand"]) == 2
    assert "must be a new file; got one that is there already" in capsys.readouterr().err
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [
        (there, "Notes of the lab\n")
    ]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            ["--patches", "palm"],
            "--patches: must be NAME=ROWSxCOLUMNS, NAME=dome:RADIUSmm or "
            "NAME=cylinder:RADIUSmm:ROWSxCOLUMNS, as in palm=8x8; got 'palm'",
        ),
        (["--patches", "tip=dome:10"], "--patches: must be NAME=ROWSxCOLUMNS"),
        (["--robot", "none.urdf"], "none.urdf: must be an existing file"),
        (["--patches", "palm=0x3"], "--patches: must be NAME=ROWSxCOLUMNS"),
        (["--patches", "a=2x2", "a=2x2"], "must be a name used once"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(more, message, folder, capsys):
    assert main(["new", "my_hand", *more]) == 2
    assert message in "\n" + capsys.readouterr().err
    assert not list(folder.iterdir())
