"""Joints of a hand: what a move of all costs, and how exact poses and wrenches are.

124 units on the palm and the five fingertips of a hand of 20 joints, four for each finger, made
here. Beside it MuJoCo's own kinematics of the same hand, without units; both take turns.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import times
from skin.contact.stream import ContactStream
from skin.robot.joints import Joints
from topology import Topology, load
from topology.robot.mjcf import mujoco_library

__all__ = ["hand_of_20_joints", "joint_figures"]

FINGERS = 5
ON_TIP, ON_PALM = (4, 5), (4, 6)
TARGET_S = 0.6
LINK = "tip0"


def hand_of_20_joints(folder: Path) -> Topology:
    """Write a hand and its skin into a folder, and load it: 124 units, 20 joints."""
    bodies, patches = [], [_patch("palm", "palm", 0x100, ON_PALM)]
    for finger in range(FINGERS):
        chain = '<geom type="capsule" size="0.008 0.012"/>{}</body>'
        link = f'<body name="{{}}{finger}" pos="0 0 0.03"><joint name="{{}}{finger}" axis="{{}}" '
        link += 'range="-1.2 1.2" pos="0 0 -0.002"/>' + chain
        tip = link.format("tip", "bend_tip", "1 0 0", "")
        middle = link.format("middle", "bend_middle", "1 0 0", tip)
        near = link.format("near", "bend_near", "1 0.1 0", middle)
        spread = link.format("spread", "spread", "0 1 0", near)
        at = f'pos="{0.025 * (finger - 2):.3f} 0 0.05"'
        bodies.append(f'<body name="root{finger}" {at}>{spread}</body>')
        patches.append(_patch(f"tip{finger}", f"tip{finger}", 0x140 + 32 * finger, ON_TIP))
    model = (
        '<mujoco model="hand"><compiler angle="radian"/><worldbody><body name="palm">'
        f'<geom type="box" size="0.06 0.02 0.05"/>{"".join(bodies)}</body></worldbody></mujoco>'
    )
    (folder / "hand.xml").write_text(model)
    head = [
        "format = 1",
        'name = "hand"',
        "sync_id = 0x80",
        "[robot]",
        'model = "hand.xml"',
        'base = "palm"',
    ]
    for bus in range(2):
        head += ["[[buses]]", f'name = "can{bus}"', 'interface = "memory"',
                 f'channel = "hand{bus}"', "data_bitrate = 5_000_000"]  # fmt: skip
    (folder / "hand.toml").write_text("\n".join([*head, *patches]))
    return load(folder / "hand.toml")


def _patch(name: str, link: str, first_id: int, shape: tuple[int, int]) -> str:
    bus = (first_id >> 5) & 1
    return (
        f'[[patches]]\nname = "{name}"\nkind = "grid"\nbus = "can{bus}"\nlayout = "f3t-fd64"\n'
        f'link = "{link}"\nrows = {shape[0]}\ncolumns = {shape[1]}\npitch_m = 0.012\n'
        f"first_id = {first_id}\npose = {{ xyz_m = [0, 0.03, 0], rpy_deg = [-90, 0, 0] }}\n"
    )


def joint_figures(quick: bool) -> dict[str, Any]:
    """Cost and exactness of moving joints.

    Returns
    -------
    dict
        ``move_joints_us`` and ``mujoco_kinematics_us``: median, least and most of the rounds;
        ``move_joints_by_name_us`` of a mapping of all joints; ``pose_error``: largest difference
        of any entry of a link's pose to MuJoCo's (m, or of a rotation); ``wrench_error_n``: largest
        difference of a fixed contact's wrench in the base frame to the truth (N, N·m), without
        noise; ``poses``, ``units`` and ``joints``.
    """
    mujoco = mujoco_library()
    with tempfile.TemporaryDirectory() as folder:
        hand = hand_of_20_joints(Path(folder))
        model = mujoco.MjModel.from_xml_path(str(Path(folder) / "hand.xml"))
    assert hand.robot is not None
    data = mujoco.MjData(model)
    stream = ContactStream(
        hand.position, hand.rotation, hand.area, hand.neighbour_start, hand.neighbour_index,
        want=("wrench",),
    )  # fmt: skip
    joints = Joints(hand)
    count = 100 if quick else 1000
    every = np.random.default_rng(0).uniform(-1.2, 1.2, (count, len(hand.robot.joint_names)))
    pose_error = wrench_error = 0.0
    force = np.zeros((3, hand.n))
    force[:, hand.patch == hand.patch_names.index(LINK)] = [[0.3], [-0.2], [1.5]]
    truth, link = _truth(hand, force)
    for cycle, q in enumerate(every):
        joints.move(q)
        stream.move(*joints.unit_poses)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        pose_error = max(pose_error, _pose_error(joints, model, data))
        stream.update(force, 0.01, stamp_ns=4_000_000 * cycle)
        pose = hand.robot.forward(q)[link]
        pushed = pose[:3, :3] @ truth[:3]
        moment = pose[:3, :3] @ truth[3:] + np.cross(pose[:3, 3], pushed)
        off = stream.total.wrench - np.concatenate([pushed, moment])
        wrench_error = max(wrench_error, float(np.abs(off).max()))
    named = dict(zip(hand.robot.joint_names, every[-1].tolist(), strict=True))
    taken = times(
        {
            "move_joints_us": lambda: joints.move(every[-1]),
            "move_joints_by_name_us": lambda: joints.move(named),
            "mujoco_kinematics_us": lambda: mujoco.mj_kinematics(model, data),
        },
        TARGET_S / 4 if quick else TARGET_S,
    )
    return {
        **{name: _microseconds(found.rounds) for name, found in taken.items()},
        "pose_error": pose_error, "wrench_error_n": wrench_error,
        "poses": count, "units": hand.n, "joints": len(hand.robot.joint_names),
    }  # fmt: skip


def _truth(hand: Topology, force: np.ndarray) -> tuple[np.ndarray, int]:
    """Wrench of forces on units in the frame of the link that carries them, and that link."""
    assert hand.robot is not None
    link = hand.robot.link_names.index(LINK)
    pose = hand.robot.forward(hand.robot.home)[link]
    local = pose[:3, :3].T @ (hand.position - pose[:3, 3:])
    pushed = pose[:3, :3].T @ np.einsum("ijn,jn->in", hand.rotation, force)
    return np.concatenate([pushed.sum(axis=1), np.cross(local.T, pushed.T).sum(axis=0)]), link


def _pose_error(joints: Joints, model: Any, data: Any) -> float:
    """Largest difference of any link's pose to MuJoCo's, in the frame of the palm at the origin."""
    worst = 0.0
    for body in range(1, model.nbody):
        rotation, translation = joints.link_pose(model.body(body).name)
        turned = np.abs(rotation - data.xmat[body].reshape(3, 3)).max()
        worst = max(worst, float(turned), float(np.abs(translation - data.xpos[body]).max()))
    return worst


def _microseconds(rounds: np.ndarray) -> dict[str, float]:
    us = 1e6 * rounds
    return {"median": float(np.median(us)), "min": float(us.min()), "max": float(us.max())}
