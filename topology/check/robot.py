"""The robot of a file: its model, its base link, and its home."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from topology import pose
from topology.check.names import refer
from topology.files import missing
from topology.report import Report
from topology.robot.model import RobotModel
from topology.robot.read import try_model
from topology.schema import File, Robot
from topology.source import Key, Source

__all__ = ["link_poses", "place_on_link", "resolve_robot"]

AT: Key = ("robot",)


def resolve_robot(file: File, source: Source, report: Report) -> RobotModel | None:
    """The model of a file's robot with base and home; None where there is none, or it is wrong."""
    robot = file.robot
    if robot is None or not report.sound(source, AT, "model"):
        return None
    path = source.path.parent / robot.model
    shown = str(Path(source.shown).parent / robot.model)
    if missing(path):
        report.add("no-file", source, (*AT, "model"), path=shown)
        return None
    model = try_model(path, shown, report)
    if model is None:
        report.spoil(source, (*AT, "model"))
        return None
    base = model.base
    if robot.base is not None and report.sound(source, AT, "base"):
        at, kind = (*AT, "base"), f"a link of {robot.model}"
        if refer(robot.base, kind, model.names, at, source, report):
            base = model.link_names.index(robot.base)
    home = _home(robot, model, source, report)
    return dataclasses.replace(model, base=base, home=home)


def _home(robot: Robot, model: RobotModel, source: Source, report: Report) -> np.ndarray:
    """Coordinates of all joints at home: those not in the file are the model's."""
    home = model.home.copy()
    for name, value in (robot.home or {}).items():
        at = (*AT, "home", name)
        if value is None or not report.sound(source, at):
            continue
        if name not in model.joint_names:
            if name in model.joints and model.driver[model.joints.index(name)] >= 0:
                report.add("home-follows", source, at)
            else:
                kind = f"a joint of {robot.model} that moves"
                refer(name, kind, model.joint_names, at, source, report)
            continue
        joint = model.joint_names.index(name)
        if value < model.lower[joint] or value > model.upper[joint]:
            report.add("home-limits", source, at, low=model.lower[joint],
                       high=model.upper[joint], got=value)  # fmt: skip
            continue
        home[joint] = value
    home.setflags(write=False)
    return home


def link_poses(model: RobotModel | None) -> dict[str, pose.Transform]:
    """T_skin_link of every link at home, by name."""
    if model is None:
        return {}
    poses = model.forward(model.home)
    return {
        name: (poses[link, :3, :3], poses[link, :3, 3])
        for link, name in enumerate(model.link_names)
        if name
    }


def place_on_link(
    link: str,
    key: Key,
    instead_of: str,
    robot: Robot | None,
    links: dict[str, pose.Transform],
    source: Source,
    report: Report,
) -> pose.Transform | None:
    """T_skin_link of the link of a frame or patch; None where it is wrong, and reported.

    Parameters
    ----------
    link : str
    key : Key
        Table of the frame or patch.
    instead_of : str
        Key that is used without a robot: ``frame`` or ``parent``.
    robot : Robot or None
        That of the file.
    links : dict of str to Transform
        Empty where the model is invalid.
    """
    at = (*key, "link")
    table = source.data[str(key[0])][key[1]]
    if instead_of in table:
        report.add("frame-or-link", source, at, frame=instead_of)
        return None
    if "robot" not in source.data:
        report.add("no-robot", source, at, name=repr(link))
        return None
    kind = "a link" if robot is None else f"a link of {robot.model}"
    if not refer(link, kind, links, at, source, report, complete=bool(links)):
        return None
    return links[link]
