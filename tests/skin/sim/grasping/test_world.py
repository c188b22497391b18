"""A world with an open skin: what it decodes, repeats and refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import skin.sim
from skin.errors import OptionError, SceneError, SkinError
from skin.sim.grasping.episode import Episode, Ranges
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.scene import GraspScene
from tests.fixtures.cases import long_after_first
from tests.fixtures.robots import GRIPPER, write_gripper
from topology import load

CUBE = GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.06)


def played(seconds: float = 0.8, **options: object):
    """Close the gripper on a cube; the world and its last state, both still open."""
    world = skin.sim.grasp("gripper", objects=[CUBE], **options)
    world.joints["left"] = world.joints["right"] = 0.035
    for state in world:
        if world.time_s >= seconds:
            return world, state.copy()
    raise AssertionError


def test_the_skin_feels_what_the_engine_does() -> None:
    world, state = played()
    with world:
        truth = world.truth
        assert (truth.touched_by == 0).sum() == 32
        error = state.units.force - truth.units.force
        assert np.sqrt(np.mean(error**2)) < 0.06
        assert len(state.contacts) == 2
        assert truth.wrench[2, 0] + world.scene.plant.data.qfrc_constraint[-4] == pytest.approx(
            0.06 * 9.81, rel=1e-3
        )


def test_poses_of_the_skin_follow_the_joints() -> None:
    world, state = played()
    with world:
        position, _ = world.scene.unit_poses()
        own = world.skin.joints.unit_poses[0]
        assert own == pytest.approx(position, abs=1e-9)
        assert state.wrench[:3] == pytest.approx(world.truth.units.wrench[:3], abs=0.3)


def test_two_objects_are_told_apart() -> None:
    low = replace(CUBE, name="low", size_m=(0.02, 0.02, 0.012), position_m=(0.0, 0.0, -0.0175))
    high = replace(CUBE, name="high", size_m=(0.02, 0.02, 0.012), position_m=(0.0, 0.0, 0.0075))
    with skin.sim.grasp("gripper", objects=[low, high]) as world:
        world.joints["left"] = world.joints["right"] = 0.035
        for _ in world:
            if world.time_s >= 0.6:
                break
        touched = world.truth.touched_by
        assert set(touched.tolist()) >= {0, 1}
        height = world.skin.topology.position[2]
        assert height[touched == 0].max() < height[touched == 1].min()


def test_an_episode_differs_as_drawn_and_dead_units_feel_nothing() -> None:
    gripper = load("gripper")
    ranges = Ranges(friction=(0.5, 0.6), mass=(2.0, 2.0), stiffness=(0.8, 1.2), dead=(0.25, 0.25),
                    offset_m=(-1e-3, 1e-3))  # fmt: skip
    drawn = ranges.draw(gripper, seed=5)
    assert np.array_equal(drawn.stiffness, ranges.draw(gripper, seed=5).stiffness)
    world, state = played(episode=drawn, noise=False)
    with world:
        model = world.scene.plant.model
        assert model.body_mass[world.scene.plant.object_bodies[0]] == pytest.approx(0.12)
        dead = drawn.gain[2] == 0.0
        assert dead.sum() == 8
        assert np.abs(state.units.force[2, dead]).max() < 0.02
        assert world.truth.units.force[2, dead].min() > 0.1


@long_after_first(
    ("name", "target", "message"),
    [
        ("lefd", 0.01, "nearest: 'left'"),
        ("left", 0.2, "must be a target from 0 to 0.07, its limits; got 0.2"),
        ("left", float("nan"), "got nan"),
        ("left", "wide", "got 'wide'"),
    ],
)
def test_targets_that_cannot_be_are_refused(name: str, target: float, message: str) -> None:
    with skin.sim.grasp("gripper") as world, pytest.raises(OptionError, match=message):
        world.joints[name] = target


def test_pushing_what_is_not_there_is_refused() -> None:
    with skin.sim.grasp("gripper", objects=[CUBE]) as world:
        with pytest.raises(OptionError, match="nearest: 'cube'"):
            world.push("cub", (0, 0, 1))
        with pytest.raises(OptionError, match="push"):
            world.push("cube", (0, 0, float("inf")))


def test_an_object_without_a_surface_is_refused(tmp_path: Path) -> None:
    text = load("gripper").robot.path.read_text(encoding="utf-8")
    ghost = '<body name="ghost"><freejoint/><geom size="0.01" contype="0" conaffinity="0"/></body>'
    file = tmp_path / "gripper.xml"
    file.write_text(text.replace("<worldbody>", f"<worldbody>{ghost}"), encoding="utf-8")
    with pytest.raises(SceneError, match="object 'ghost': must have a geom that collides"):
        skin.sim.grasp("gripper", objects=["ghost"], model=file)


def test_a_model_without_the_links_of_the_patches_is_refused(tmp_path: Path) -> None:
    text = load("gripper").robot.path.read_text(encoding="utf-8")
    file = tmp_path / "gripper.xml"
    file.write_text(text.replace('body name="left_pad"', 'body name="left_pat"'), encoding="utf-8")
    with pytest.raises(OptionError, match="nearest: 'left_pat'"):
        skin.sim.grasp("gripper", model=file)


URDF_INERTIA = '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'


def urdf_gripper(folder: Path, name: str = "gripper.urdf") -> Path:
    """The gripper of `tests.fixtures.robots`, with inertia, on a link that is fixed to a base."""
    heavy = f'<inertial><mass value="0.1"/>{URDF_INERTIA}</inertial>'
    text = GRIPPER.replace('<inertial><mass value="0.1"/></inertial>', "")
    for link in ("palm", "left", "right"):
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{heavy}')
    fixed = (
        '<link name="ground"/><joint name="mount" type="fixed"><parent link="ground"/>'
        '<child link="palm"/><origin xyz="0 0 0.2" rpy="0 0 1"/></joint></robot>'
    )
    file = write_gripper(folder, text.replace("</robot>", fixed), name=name)
    file.write_text(file.read_text().replace("[robot]", '[robot]\nbase = "palm"'))
    return file


def test_a_joint_of_a_urdf_that_follows_another_does_so_under_the_force_of_a_grasp(
    tmp_path: Path,
) -> None:
    box = GraspObject(
        name="box",
        mass_kg=0.05,
        friction=1.0,
        position_m=(0.0, 0.0, 0.23),
        rpy_deg=(0, 0, 57.29578),
    )
    with skin.sim.grasp(urdf_gripper(tmp_path), objects=[box]) as world:
        world.scene.plant.model.opt.gravity[:] = 0.0
        assert world.joints.limits("close") == (0.0, 0.05)
        with pytest.raises(OptionError, match=r"from 0 to 0\.05, its limits; got 0\.06"):
            world.joints["close"] = 0.06
        with pytest.raises(OptionError, match="'close_right': must have an actuator; got none"):
            world.joints["close_right"] = 0.02
        world.joints["close"] = 0.024
        for _ in world:
            if world.time_s >= 0.5:
                break
        assert world.truth.normal_n.sum() > 5.0
        assert world.joints["close_right"] == pytest.approx(world.joints["close"], abs=2e-5)


@pytest.mark.parametrize("name", ["gripper.urdf", "gripper.xml"])
def test_links_that_are_fixed_stay_links_whatever_the_suffix(tmp_path: Path, name: str) -> None:
    plant = GraspScene(urdf_gripper(tmp_path, name)).plant
    assert plant.model.body(plant.base_body).name == "palm"


@pytest.mark.long
def test_a_skin_without_noise_does_not_take_standing_still_for_a_fault() -> None:
    for options in ({"noise": False}, {"episode": Episode(noise=0.0)}):
        world, state = played(0.6, **options)
        with world:
            assert state.units.valid.all()
            assert len(state.contacts) == 2


def cube(**changed: object) -> GraspObject:
    return replace(CUBE, **changed)


def grasp(*objects: object, **options: object):
    return skin.sim.grasp("gripper", objects=objects, **options)


OF_PALM = Ranges().draw(load("palm"), seed=1)
REFUSED = [
    (lambda: cube(mass_kg=0.0), "mass_kg: must be a number from 1e-06 to 1000; got 0.0"),
    (lambda: cube(shape="sfere"), "nearest: 'sphere'"),
    (lambda: cube(shape="sphere"), "size_m: must have 1 numbers of a sphere; got 3"),
    (lambda: cube(shape="mesh", file="none.stl"), "must be a mesh .*'none.stl', which is not"),
    (lambda: cube(friction=float("nan")), "friction: must be a number from 0 to 10; got nan"),
    (lambda: cube(size_m=0.02), "size_m: must have 3 numbers of a box; got 0"),
    (lambda: cube(position_m=(0.0, 0.0)), "position_m: must have 3 numbers"),
    (lambda: cube(rpy_deg=None), "rpy_deg: must have 3 numbers; got None"),
    (lambda: grasp(cube(size_m=(0.047, 0.02, 0.03))),
     "must start outside the skin; got 2.00 mm inside it at "),
    (lambda: grasp("hant"), "nearest: 'hand'"),
    (lambda: grasp(7), "objects: must be GraspObjects or names of bodies; got 7"),
    (lambda: grasp(CUBE, cube(name="left_pad")), "names of their own; got 'left_pad'"),
    (lambda: grasp(model="none.xml"), "must be an MJCF or URDF file"),
    (lambda: skin.sim.grasp("palm"), r"must have \[robot\] model"),
    (lambda: GraspScene("gripper", seed=-1), "seed: must be an integer from 0"),
    (lambda: GraspScene("gripper", noise="no"), "noise: must be True or False"),
    (lambda: Ranges(mass=(2.0, 1.0)), "mass: must be least, then largest"),
    (lambda: GraspScene("gripper", episode=OF_PALM),
     "stiffness: must be of the 32 units of 'gripper'; got 64"),
    (lambda: GraspScene("gripper", episode=Episode(stiffness=np.zeros(32))),
     "stiffness: must be above 0; got 0"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_what_cannot_be_is_refused_before_anything_moves(make, message: str) -> None:
    with pytest.raises(SkinError, match=message):
        make()


def test_a_scene_whose_body_is_in_the_other_finger_names_the_grasp(tmp_path: Path) -> None:
    text = Path(str(skin.sim.__file__)).with_name("scenes").joinpath("demo.toml").read_text()
    (own := tmp_path / "own.toml").write_text(text.replace("only_on = true\n", ""))
    with pytest.raises(SceneError, match=r"at right/.*bodies are those of `skin\.sim\.grasp`"):
        skin.open("gripper", simulate=own)


def test_a_small_thing_that_presses_a_film_onto_its_chip_ends_no_run() -> None:
    bead = GraspObject(
        name="bead", shape="sphere", size_m=(0.006,), mass_kg=0.01, friction=1.0,
        position_m=(0.0, 0.006, -0.006),
    )  # fmt: skip
    deepest_mm = 0.0
    with skin.sim.grasp("gripper", objects=[bead]) as world:
        world.joints["left"] = world.joints["right"] = 0.07
        for _ in world:
            deepest_mm = max(deepest_mm, float(world.truth.units.depth_mm.max()))
            if world.truth.bottomed.any() or world.time_s >= 0.8:
                break
        assert world.truth.bottomed.any()
        assert world.truth.normal_n.max() > 6.0
    assert deepest_mm == 3.5
