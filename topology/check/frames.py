"""Frames and the robot: a tree with the root `skin`, on the links of a model if there is one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from topology import pose
from topology.files import missing
from topology.pose import IDENTITY, Transform
from topology.robot.model import RobotModel
from topology.robot.read import try_model
from topology.schema import File, Pose
from topology.source import Key, Source

__all__ = ["ROOT", "on_link", "resolve_frames", "resolve_robot", "to_transform"]

ROOT = "skin"
"""The root frame."""

QUATERNION_TOLERANCE = 1e-3


def to_transform(given: Pose, key: Key, source: Source) -> Transform:
    """T_parent_child of a pose."""
    xyz = np.array(given.xyz_m)
    if given.rpy_deg is not None and given.quaternion_wxyz is not None:
        source.fault(key, "one of rpy_deg and quaternion_wxyz", "both")
    if given.quaternion_wxyz is None:
        return pose.from_rpy(*np.radians(given.rpy_deg or (0.0, 0.0, 0.0))), xyz
    length = math.hypot(*given.quaternion_wxyz)
    if abs(length - 1) > QUATERNION_TOLERANCE:
        source.fault((*key, "quaternion_wxyz"), "of length 1", f"length {length:.4g}")
        return IDENTITY
    return pose.from_quaternion(*given.quaternion_wxyz), xyz


def resolve_robot(file: File, source: Source) -> RobotModel | None:
    """The model of a file's robot with base and home; None where there is none, or it is wrong."""
    robot = file.robot
    if robot is None:
        return None
    path, shown = source.named_file(robot.model)
    if missing(path):
        source.fault(("robot", "model"), "an existing file", f"none at {shown}")
        return None
    model = try_model(path, shown, source.report)
    if model is None:
        return None
    base, at = model.base, ("robot", "base")
    if robot.base and source.refer(robot.base, f"a link of {robot.model}", model.names, at):
        base = model.link_names.index(robot.base)
    home = model.home.copy()
    for name, value in robot.home.items():
        at = ("robot", "home", name)
        if name not in model.joint_names and any(name == link.joint for link in model.links):
            source.fault(at, "absent, as the joint is fixed or follows another", "one")
        elif source.refer(name, f"a joint of {robot.model} that moves", model.joint_names, at):
            joint = model.joint_names.index(name)
            if value < model.lower[joint] or value > model.upper[joint]:
                source.fault(at, *model.refused(joint, value))
            home[joint] = value
    home.setflags(write=False)
    return dataclasses.replace(model, base=base, home=home)


def on_link(
    link: str, key: Key, instead_of: str, links: dict[str, Transform], source: Source
) -> Transform:
    """T_skin_link of the link that a frame or patch names.

    Parameters
    ----------
    link : str
    key : Key
        Table of the frame or patch.
    instead_of : str
        Key that is used without a robot: ``frame`` or ``parent``.
    links : dict of str to Transform
        Those of the robot; empty where its model is invalid.
    """
    at = (*key, "link")
    if instead_of in source.data[str(key[0])][key[1]]:
        source.fault(at, f"one of {instead_of} and link", "both")
    elif "robot" not in source.data:
        source.fault(at, "absent where the file has no [robot]", repr(link))
    elif links:
        source.refer(link, f"a link of {source.data['robot']['model']}", links, at)
    return links.get(link, IDENTITY)


def resolve_frames(
    file: File, links: dict[str, Transform], source: Source
) -> tuple[dict[str, Transform], dict[str, str]]:
    """T_skin_frame of every frame by name, and the link of those that hang on one.

    Parameters
    ----------
    file : File
    links : dict of str to Transform
        T_skin_link of the robot's links at home.
    source : Source
    """
    source.unique("frames", [frame.name for frame in file.frames], {ROOT})
    left = {frame.name: (("frames", i), frame) for i, frame in enumerate(file.frames)}
    found, carriers = {ROOT: IDENTITY}, {}
    names = {ROOT, *left}
    for name, (key, frame) in left.items():
        if name in links and name != ROOT:
            got = repr(name)
            source.fault((*key, "name"), "another name than those of the model's links", got)
        if frame.link is not None:
            found[name] = on_link(frame.link, key, "parent", links, source)
            carriers[name] = frame.link
        elif not source.refer(frame.parent, "a frame", names, (*key, "parent")):
            found[name] = IDENTITY
        else:
            continue
        inner = to_transform(frame.pose, (*key, "pose"), source)
        found[name] = pose.compose(found[name], inner)
    left = {name: entry for name, entry in left.items() if name not in found}
    while ready := [name for name, (_, frame) in left.items() if frame.parent in found]:
        for name in ready:
            key, frame = left.pop(name)
            inner = to_transform(frame.pose, (*key, "pose"), source)
            found[name] = pose.compose(found[frame.parent], inner)
            if frame.parent in carriers:
                carriers[name] = carriers[frame.parent]
    for key, frame in left.values():
        source.fault(
            (*key, "parent"), "a frame that hangs on 'skin' in the end", repr(frame.parent)
        )
    return found, carriers
