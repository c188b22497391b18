"""Frames: a tree with the root `skin`, and rigid poses."""

from __future__ import annotations

import math

import numpy as np

from topology import pose
from topology.check.names import all_named, check_name, entries, refer
from topology.check.robot import place_on_link
from topology.report import Report
from topology.schema import File, Frame, Pose
from topology.source import Key, Source

__all__ = ["ROOT", "resolve_frames", "to_transform"]

ROOT = "skin"
"""The root frame."""

QUATERNION_TOLERANCE = 1e-3


def to_transform(given: Pose, key: Key, source: Source, report: Report) -> pose.Transform | None:
    """T_parent_child of a pose; None where it is wrong."""
    if not report.sound(source, key):
        return None
    if given.rpy_deg is not None and given.quaternion_wxyz is not None:
        report.add("two-rotations", source, key)
        return None
    if given.quaternion_wxyz is None:
        rotation = pose.from_rpy(*np.radians(given.rpy_deg or (0.0, 0.0, 0.0)))
        return rotation, np.array(given.xyz_m)
    length = math.hypot(*given.quaternion_wxyz)
    if abs(length - 1) > QUATERNION_TOLERANCE:
        report.add("quaternion", source, (*key, "quaternion_wxyz"), length=length)
        return None
    return pose.from_quaternion(*given.quaternion_wxyz), np.array(given.xyz_m)


def resolve_frames(
    file: File, links: dict[str, pose.Transform], source: Source, report: Report
) -> tuple[dict[str, pose.Transform | None], dict[str, str]]:
    """T_skin_frame of every frame by name, and the link of those that hang on one.

    A transform is None where its pose or a parent is wrong.

    Parameters
    ----------
    file : File
    links : dict of str to Transform
        T_skin_link of the robot's links.
    source : Source
    report : Report
    """
    first: dict[str, Key] = {}
    frames: dict[str, Frame] = {}
    for key, frame in entries(file, "frames"):
        if report.sound(source, key, "name"):
            check_name(frame.name, key, first, {ROOT}, source, report)
            frames.setdefault(frame.name, frame)
            if frame.name in links and frame.name != ROOT:
                report.add("frame-is-link", source, (*key, "name"), name=repr(frame.name))
    frames.pop(ROOT, None)

    local = {
        name: to_transform(frames[name].pose, (*key, "pose"), source, report)
        for name, key in first.items()
    }
    parents = {}
    on_link: dict[str, pose.Transform | None] = {}
    known = {ROOT, *first}
    complete = all_named("frames", file, source, report)
    for name, key in first.items():
        parent = frames[name].parent
        at = (*key, "parent")
        if (link := frames[name].link) is not None:
            robot = file.robot
            on_link[name] = place_on_link(link, key, "parent", robot, links, source, report)
            continue
        if report.sound(source, at) and refer(
            parent, "a frame", known, at, source, report, complete
        ):
            parents[name] = parent
    for name in _on_cycles(parents):
        report.add("frame-cycle", source, (*first[name], "parent"), name=repr(parents[name]))
        del parents[name]

    absolute: dict[str, pose.Transform | None] = {ROOT: pose.IDENTITY}
    for name, outer in on_link.items():
        inner = local[name]
        absolute[name] = None if outer is None or inner is None else pose.compose(outer, inner)
    for name in first:
        chain = [name]
        while chain[-1] not in absolute and chain[-1] in parents:
            chain.append(parents[chain[-1]])
        outer = absolute.get(chain.pop()) if chain[-1] in absolute else None
        for link in reversed(chain):
            inner = local[link]
            outer = None if outer is None or inner is None else pose.compose(outer, inner)
            absolute[link] = outer
        absolute.setdefault(name, None)
    return absolute, _carriers(frames, parents)


def _carriers(frames: dict[str, Frame], parents: dict[str, str]) -> dict[str, str]:
    """Link of each frame, its own or that of its parents."""
    found: dict[str, str] = {}
    for name in frames:
        at = name
        while at in parents:
            at = parents[at]
        link = frames[at].link if at in frames else None
        if link is not None:
            found[name] = link
    return found


def _on_cycles(parents: dict[str, str]) -> list[str]:
    """Names that are their own ancestors."""
    cycles: list[str] = []
    done: set[str] = set()
    for start in parents:
        path: list[str] = []
        name = start
        while name in parents and name not in done:
            done.add(name)
            path.append(name)
            name = parents[name]
        if name in path:
            cycles += path[path.index(name) :]
    return cycles
