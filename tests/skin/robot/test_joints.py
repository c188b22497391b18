"""Joints of a robot: poses of the units by them, and wrenches as its links see them."""

import mujoco
import numpy as np
import pytest

import skin
from bus.errors import FaultScriptError
from bus.faults.injector import Injector
from bus.faults.script import Drop, FaultScript
from skin.contact.stream import ContactStream
from skin.errors import OptionError, SkinError
from skin.robot.joints import Joints
from tests.fixtures.robots import GRIPPER, hand_of_20_joints, random_joints, write_gripper
from topology import load

LINKS = ("tip0", "tip3", "palm")


@pytest.fixture
def gripper(tmp_path):
    return load(write_gripper(tmp_path))


@pytest.fixture
def hand(tmp_path):
    return hand_of_20_joints(tmp_path)


def test_units_go_with_their_links_as_mujoco_moves_them(hand):
    joints = Joints(hand)
    model = mujoco.MjModel.from_xml_path(str(hand.robot.path))
    data = mujoco.MjData(model)
    addresses = [model.joint(name).qposadr[0] for name in hand.robot.joint_names]

    def pose(link):
        base, of = data.body("palm"), data.body(link)
        back = base.xmat.reshape(3, 3).T
        return back @ of.xmat.reshape(3, 3), back @ (of.xpos - base.xpos)

    data.qpos[addresses] = hand.robot.home
    mujoco.mj_kinematics(model, data)
    at_home = {link: pose(link) for link in LINKS}
    for q in random_joints(hand.robot, 100):
        joints.move(q)
        data.qpos[addresses] = q
        mujoco.mj_kinematics(model, data)
        position, rotation = joints.unit_poses
        for link in LINKS:
            units = hand.patch == hand.patch_names.index(link)
            (turn, at), (turn_home, at_home_) = pose(link), at_home[link]
            local = turn_home.T @ (hand.position[:, units] - at_home_[:, np.newaxis])
            expected = turn @ local + at[:, np.newaxis]
            assert np.abs(position[:, units] - expected).max() < 1e-12
            turned = np.einsum("ij,kj,kln->iln", turn, turn_home, hand.rotation[:, :, units])
            assert np.abs(rotation[:, :, units] - turned).max() < 1e-12
            found = joints.link_pose(link)
            assert np.abs(found[0] - turn).max() < 1e-12
            assert np.abs(found[1] - at).max() < 1e-12


def test_the_wrench_of_a_fixed_contact_is_the_truth_through_many_poses(hand):
    stream = ContactStream(
        hand.position, hand.rotation, hand.area, hand.neighbour_start, hand.neighbour_index,
    )  # fmt: skip
    joints = Joints(hand)
    index, units = (
        hand.robot.link_names.index(LINKS[0]),
        hand.patch == hand.patch_names.index(LINKS[0]),
    )
    force = np.zeros((3, hand.n), np.float32)
    force[:, units] = [[0.3], [-0.2], [1.5]]
    truth = wrench_on_link(hand, index, force)
    for cycle, q in enumerate(random_joints(hand.robot, 200)):
        joints.move(q)
        stream.move(*joints.unit_poses)
        (contact,) = stream.update(force, 0.01, stamp_ns=4_000_000 * cycle)
        pose = hand.robot.forward(q)[index]
        turn, at = pose[:3, :3], pose[:3, 3]
        pushed = turn @ truth[:3]
        in_base = np.concatenate([pushed, turn @ truth[3:] + np.cross(at, pushed)])
        assert np.abs(contact.wrench - in_base).max() < 1e-4
        assert np.abs(stream.total.wrench - in_base).max() < 1e-4
        assert np.abs(joints.wrench_in(LINKS[0], contact)[0] - truth).max() < 1e-4
    assert np.linalg.norm(truth[:3]) > 10.0


def wrench_on_link(hand, index, force):
    """What forces on units add up to in the frame of a link that carries them."""
    at_home = hand.robot.forward(hand.robot.home)[index]
    turn = at_home[:3, :3].T
    local = turn @ (hand.position - at_home[:3, 3:])
    pushed = turn @ np.einsum("ijn,jn->in", hand.rotation, force)
    return np.concatenate([pushed.sum(axis=1), np.cross(local.T, pushed.T).sum(axis=0)])


def test_what_follows_a_joint_moves_with_it_and_what_is_not_named_stays(gripper):
    joints = Joints(gripper)
    joints.move({"close": 0.02})
    assert joints.link_pose("right")[1] == pytest.approx([0.03, 0.0, 0.03])
    joints.move({})
    assert joints.q.tolist() == [0.02]


@pytest.mark.parametrize(
    ("q", "told"),
    [
        ({"clos": 0.0}, "nearest: 'close'"),
        ({"close_right": 0.0}, "must leave out 'close_right', which follows 'close'"),
        ({"close": 0.06}, "within the joint's limits, 0 to 0.05; got 0.06"),
        ({"close": float("nan")}, "q['close']: must be finite; got nan"),
        ({"close": "wide"}, "q['close']: must be numbers; got 'wide'"),
        ({"close": "0.01"}, "q['close']: must be numbers; got '0.01'"),
        ({"close": [0.01]}, "q['close']: must be a number; got [0.01]"),
        ({"close": True}, "q['close']: must be numbers; got True"),
        ([True], "q: must be numbers; got [True]"),
        (np.array([False]), "q: must be numbers; got array([False])"),
        ([0.0, 0.0], "must have shape (1,), one for each of close; got (2,)"),
        (["wide"], "q: must be numbers"),
        ([[0.0], [0.0, 0.0]], "q: must be numbers"),
        ({"close": 10**400}, "q['close']: must be numbers"),
        ({"close": 0.0500000001}, "limits, 0 to 0.05; got 0.0500000001"),
    ],
)
def test_joints_that_cannot_be_so_are_refused_and_nothing_moves(gripper, q, told):
    joints = Joints(gripper)
    joints.move([0.01])
    before = joints.unit_poses[0].copy()
    with pytest.raises(OptionError) as raised:
        joints.move(q)
    assert told in str(raised.value)
    assert np.array_equal(joints.unit_poses[0], before)
    assert joints.q.tolist() == [0.01]
    joints.move({})
    assert joints.q.tolist() == [0.01]


FOLLOWING = '<mimic joint="close"/>'


def test_a_joint_that_follows_beyond_its_own_limits_is_refused(tmp_path):
    model = GRIPPER.replace(FOLLOWING, '<mimic joint="close" multiplier="2" offset="0.01"/>')
    joints = Joints(load(write_gripper(tmp_path, model)))
    assert joints.robot.upper == pytest.approx([0.02], abs=1e-6)
    joints.move({"close": 0.02})
    with pytest.raises(OptionError) as raised:
        joints.move({"close": 0.03})
    assert str(raised.value) == (
        "q['close']: must be such that 'close_right', which follows 'close', is within its limits, "
        "0 to 0.05; got 0.03, which takes it to 0.07"
    )
    assert joints.q.tolist() == [0.02]
    with pytest.raises(OptionError, match=r"within the joint's limits, 0 to 0\.05; got 0\.06"):
        joints.move({"close": 0.06})


def test_a_skin_without_a_robot_says_that_it_has_none():
    with pytest.raises(SkinError, match=r"palm: must have a \[robot\]"):
        Joints(load("palm"))


def test_an_open_skin_is_moved_by_its_joints(gripper):
    with skin.open(gripper) as pads:
        pads.move_joints({"close": 0.01})
        position, _ = pads.pipeline.poses
        shift = position - gripper.position
        assert shift[0] == pytest.approx([0.01] * 4 + [-0.01] * 4)
        contacts = pads.pipeline.contacts.model
        about_middle, origin = contacts.poses["position"].T, contacts.settings["origin"].T
        assert np.allclose(about_middle + origin, position)
        pads.move_joints(np.array([0.02]))
        assert pads.link_pose("left")[1] == pytest.approx([-0.03, 0.0, 0.03])
        seen = pads.wrench_in("left", np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]))
        assert seen == pytest.approx([0, 0, 2, 0, -0.06, 0])  # 2 N at x = 0.03 of the left finger


def test_a_skin_without_contacts_is_moved_too(gripper):
    with skin.open(gripper, want={"temperature"}) as pads:
        pads.move_joints({"close": 0.03})
        position, _ = pads.pipeline.poses
        assert position[0] == pytest.approx([-0.01] * 4 + [0.01] * 4)
        pads.move_patch("left", np.eye(3), np.array([0.0, 0.0, 0.01]))
        assert pads.pipeline.poses[0][2, :4].mean() == pytest.approx(0.04)
        pads.move_joints({})
        assert np.array_equal(pads.pipeline.poses[0], position)


@pytest.mark.parametrize("wrench", [np.zeros(5), None, "none"])
def test_a_wrench_that_is_none_is_refused(gripper, wrench):
    with pytest.raises(SkinError, match=r"wrench: must (have shape \(6,\)|be numbers); got"):
        Joints(gripper).wrench_in("left", wrench)


FLAGS = {
    "move_joints": lambda hand: hand.move_joints({"close": np.True_}),
    "turn": lambda hand: hand.turn(np.eye(3, dtype=bool)),
    "move_patch": lambda hand: hand.move_patch("left", np.eye(3), [True, 0.0, 0.0]),
    "move": lambda hand: hand.move(hand.topology.position > 0.0, hand.topology.rotation),
    "wrench_in": lambda hand: hand.wrench_in("left", [True, 0, 0, 0, 0, 0]),
    "faults": lambda hand: Injector(FaultScript(faults=(Drop(probability=True),)), 0),
}


@pytest.mark.parametrize("way", FLAGS)
def test_true_and_false_are_no_numbers(gripper, way):
    with skin.open(gripper) as hand:
        with pytest.raises((SkinError, FaultScriptError), match=r"numbers; got|got `bool`"):
            FLAGS[way](hand)
