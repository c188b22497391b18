"""Films of other links that come near."""

import dataclasses

import numpy as np
import pytest

from skin.physics.halbach import HalbachField
from skin.robot.closeness import Closeness
from skin.robot.joints import Joints
from tests.fixtures.robots import write_gripper
from topology import load


@pytest.fixture
def gripper(tmp_path):
    return load(write_gripper(tmp_path))


def test_open_fingers_feel_nothing_of_each_other_and_closed_ones_do(gripper):
    joints = Joints(gripper)
    assert joints.close_films() == ()
    joints.move({"close": 0.035})
    found = joints.close_films()
    assert {film.unit for film in found} == set(gripper.unit_names)
    assert all(film.link != film.other_link for film in found)
    assert found[0].distance_mm == pytest.approx(10.0)
    assert found[0].field_ut > found[0].sigma_ut
    assert str(found[0]).startswith(f"{found[0].unit}: must be clear of films of other links")
    joints.move({"close": 0.0})
    assert joints.close_films() == ()


def test_what_they_add_is_what_magnet_theory_says_of_both_fingers_together(gripper):
    joints = Joints(gripper)
    joints.move({"close": 0.033})
    joints.close_films()

    def rest(position, rotation, reach_m):
        posed = dataclasses.replace(gripper, position=position, rotation=rotation)
        warm = gripper.parameters["film_reference_c"]
        field = HalbachField(posed, reach_m=reach_m)
        return field(np.zeros((2, gripper.n)), np.zeros(gripper.n), warm)

    # neighbours of one finger do not move against each other: they add the same in both poses
    closed = rest(*joints.unit_poses, 0.06)
    apart = rest(gripper.position, gripper.rotation, 0.06)
    assert np.abs(joints.closeness.field_ut - (closed - apart)).max() < 1e-3
    assert np.abs(joints.closeness.field_ut).max() > 100.0


def test_units_that_have_hardly_moved_are_not_looked_at_again(gripper, monkeypatch):
    looks = []
    monkeypatch.setattr(Closeness, "_look", lambda self: looks.append(1) or ())
    joints = Joints(gripper)
    for q in (0.0, 1e-4, 0.01, 0.0101, 0.02):
        joints.move([q])
        joints.close_films()
    assert len(looks) == 2
