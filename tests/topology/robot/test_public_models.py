"""Poses of models that others made, against the libraries that others read them with."""

import mujoco
import numpy as np
import pytest
import yourdfpy

from tests.fixtures.cases import long_after_first
from tests.fixtures.robots import of_package, random_joints
from topology import read_model

URDFS = (
    "arms/ur5e/ur5e.urdf",
    "grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf",
    "grippers/schunk_egk40_magneto/schunk_egk40_magneto.urdf",
)
MJCFS = ("hand/reach.xml", "adroit_hand/adroit_door.xml", "fetch/reach.xml")
POSES = 50


@long_after_first("place", URDFS)
def test_poses_of_a_urdf_are_those_of_yourdfpy(place):
    (file,) = of_package("airo_models", place)
    robot = read_model(file)
    assert len(robot.joint_names) >= 1
    peer = yourdfpy.URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    assert list(robot.joint_names) == peer.actuated_joint_names
    worst = 0.0
    for q in random_joints(robot, POSES):
        peer.update_cfg(q)
        found = robot.forward(q)
        for link, name in enumerate(robot.link_names):
            pose = peer.get_transform(name, robot.link_names[0])
            worst = max(worst, np.abs(found[link] - pose).max())
    assert worst < 1e-12


@pytest.mark.parametrize("place", MJCFS)
def test_poses_of_an_mjcf_are_those_of_mujoco(place):
    (file,) = of_package("gymnasium_robotics", f"envs/assets/{place}")
    robot = read_model(file)
    assert len(robot.joint_names) >= 15
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    bodies = [model.body(b).name or f"body{b}" for b in range(model.nbody)]
    order = [robot.link_names.index(name) for name in bodies]
    assert sorted(bodies) == sorted(robot.names)
    worst = 0.0
    for q in random_joints(robot, POSES):
        data.qpos[:] = at_coordinates(model, robot, q)
        mujoco.mj_kinematics(model, data)
        found = robot.forward(q)[order]
        turns = data.xmat.reshape(-1, 3, 3)
        worst = max(worst, np.abs(found[:, :3, 3] - data.xpos).max())
        worst = max(worst, np.abs(found[:, :3, :3] - turns).max())
    assert worst < 1e-12


def at_coordinates(model, robot, q):
    """`qpos` of our coordinates: what follows is set by hand, as MuJoCo ties it by forces."""
    qpos = model.qpos0.copy()
    for link, name in enumerate(robot.joints):
        if name and robot.driver[link] >= 0:
            at = model.joint(name).qposadr[0]
            qpos[at] = robot.multiplier[link] * q[robot.driver[link]] + robot.offset[link]
            qpos[at] += model.qpos0[at]
    return qpos
