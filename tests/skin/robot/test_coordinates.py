"""Joints from poses of links: forward kinematics of what is found gives the poses."""

from __future__ import annotations

import numpy as np
import pytest

from skin.robot.coordinates import coordinates
from tests.fixtures.robots import random_joints, write_gripper
from topology import load
from topology.packed import robot_of, robot_text
from topology.robot.read import read_model

FINGER = """<robot name="finger">
  <link name="palm"/><link name="near"/><link name="middle"/><link name="far"/><link name="other"/>
  <joint name="a" type="revolute"><parent link="palm"/><child link="near"/>
    <origin xyz="0.05 0.01 0" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.3" upper="1.6"/></joint>
  <joint name="b" type="revolute"><parent link="near"/><child link="middle"/>
    <origin xyz="0.045 0 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1.6"/></joint>
  <joint name="c" type="revolute"><parent link="middle"/><child link="far"/>
    <origin xyz="0.03 0 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1.2"/></joint>
  <joint name="d" type="revolute"><parent link="palm"/><child link="other"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>
</robot>"""


@pytest.fixture
def finger(tmp_path):
    (tmp_path / "finger.urdf").write_text(FINGER)
    return read_model(tmp_path / "finger.urdf")


def test_three_joints_follow_from_the_last_link_alone(finger):
    far = finger.link_names.index("far")
    for q in random_joints(finger, 40):
        found = coordinates(finger, {far: finger.forward(q)[far]}, finger.home)
        np.testing.assert_allclose(found[:3], q[:3], atol=1e-4)
        assert found[3] == finger.home[3]  # moves nothing that is seen


def test_a_base_beyond_a_joint_is_followed(finger):
    from dataclasses import replace

    robot = replace(finger, base=finger.link_names.index("near"))
    far, other = robot.link_names.index("far"), robot.link_names.index("other")
    for q in random_joints(robot, 10, seed=1):
        poses = robot.forward(q)
        found = coordinates(robot, {far: poses[far], other: poses[other]}, robot.home)
        np.testing.assert_allclose(robot.forward(found)[other], poses[other], atol=1e-4)
        np.testing.assert_allclose(robot.forward(found)[far], poses[far], atol=1e-4)


def test_slides_and_joints_that_follow_are_found(tmp_path):
    robot = load(write_gripper(tmp_path)).robot
    left = robot.link_names.index("left")
    for at in (0.0, 0.013, 0.05):
        pose = robot.forward(np.array([at]))[left]
        np.testing.assert_allclose(coordinates(robot, {left: pose}, robot.home), [at], atol=1e-6)


def test_poses_that_no_joints_have_end_at_the_limits(finger):
    far = finger.link_names.index("far")
    pose = np.eye(4)
    pose[:3, 3] = 9.0
    found = coordinates(finger, {far: pose}, finger.home)
    assert (finger.lower <= found).all()
    assert (found <= finger.upper).all()
    np.testing.assert_array_equal(coordinates(finger, {}, finger.home), finger.home)


def test_a_robot_reaches_another_process_as_it_is(finger):
    again = robot_of(robot_text(finger))
    for name, value in vars(finger).items():
        np.testing.assert_array_equal(getattr(again, name), value, name)
