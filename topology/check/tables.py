"""The tables of a file one by one: names, references, buses, and the shapes of patches."""

from __future__ import annotations

import math

import numpy as np

from topology import pose
from topology.check.frames import on_link, resolve_frames, resolve_robot, to_transform
from topology.check.layouts import resolve_layouts
from topology.check.models import resolve_models
from topology.layout import count, overfull, widest_pitch_m
from topology.model import MODELS
from topology.pose import Transform
from topology.robot.model import RobotModel
from topology.schema import Cylinder, Dome, File, List, ListUnit, Patch
from topology.source import Key, Source
from topology.wire import LAYOUTS

__all__ = ["Tables"]

MOST_UNITS = 100_000
"""Upper bound of units: at 250 Hz a bus carries 90, so a larger number is a mistake."""

FARTHEST_LINK_M = 1e6
"""Of any link from the base: with more, distances between units overflow."""

SHORTEST_AXIS = 1e-6


class Tables:
    """What the units of a file refer to.

    Attributes
    ----------
    source : Source
        The text of the file.
    file : File
        Its tables.
    robot : RobotModel or None
    poses : list of Transform
        T_skin_patch of each patch.
    links : tuple of str
        Link of the robot that carries each patch; "" without one.
    models : dict of str to UnitModel
    scales : dict of str to dict of str to Scale
        Physical scales of a model's own, by channel.
    layouts : dict of str to WireLayout

    Raises
    ------
    TopologyError
        With all faults of the tables.
    """

    def __init__(self, file: File, source: Source) -> None:
        self.file, self.source = file, source
        _check_buses(file, source)
        self.robot = resolve_robot(file, source)
        links = {} if self.robot is None else _link_poses(self.robot, source)
        frames, link_of_frame = resolve_frames(file, links, source)
        self.models, self.scales = resolve_models(file, source)
        self.layouts = resolve_layouts(file, source)
        _check_references(file, source)
        self.poses: list[Transform] = []
        for index, patch in enumerate(file.patches):
            key = ("patches", index)
            _check_shape(patch, key, source)
            if patch.link is not None:
                base = on_link(patch.link, key, "frame", links, source)
            else:
                base = frames.get(patch.frame, pose.IDENTITY)
            inner = to_transform(patch.pose, (*key, "pose"), source)
            self.poses.append(pose.compose(base, inner))
        _check_count(file, source)
        source.report.raise_if_any()
        self.links = tuple(p.link or link_of_frame.get(p.frame, "") for p in file.patches)


def _link_poses(robot: RobotModel, source: Source) -> dict[str, Transform]:
    """T_skin_link of every link at home, by name; none where the model's numbers are absurd."""
    with np.errstate(all="ignore"):
        poses = robot.forward(robot.home)
    if not np.abs(poses).max() < FARTHEST_LINK_M:
        got = f"one that reaches {FARTHEST_LINK_M:g} m and more at home"
        source.fault(("robot", "model"), "a model in metres", got)
        return {}
    return {
        name: (poses[link, :3, :3], poses[link, :3, 3])
        for link, name in enumerate(robot.link_names)
        if name
    }


def _check_buses(file: File, source: Source) -> None:
    source.unique("buses", [bus.name for bus in file.buses])
    channels: dict[tuple[str, str], int] = {}
    for index, bus in enumerate(file.buses):
        key = ("buses", index)
        if bus.data_bitrate is not None and bus.data_bitrate < bus.bitrate:
            expected = f"at least the bitrate, {bus.bitrate}"
            source.fault((*key, "data_bitrate"), expected, bus.data_bitrate)
        other = channels.setdefault((bus.interface, bus.channel), index)
        if bus.channel and other != index:  # each would read the other's frames as foreign
            line = source.line(("buses", other, "channel"))
            got = f"{bus.channel!r}, also of bus {file.buses[other].name!r} (line {line})"
            source.fault((*key, "channel"), "a channel of its own", got)


def _check_references(file: File, source: Source) -> None:
    """Names that patches use."""
    known = {
        "bus": {bus.name for bus in file.buses},
        "layout": {*LAYOUTS, *(layout.name for layout in file.layouts)},
        "model": {*MODELS, *(model.name for model in file.models)},
        "frame": {"skin", *(frame.name for frame in file.frames)},
    }
    source.unique("patches", [patch.name for patch in file.patches])
    for index, patch in enumerate(file.patches):
        for what, names in known.items():
            source.refer(getattr(patch, what), f"a {what}", names, ("patches", index, what))
    for index, override in enumerate(file.overrides):
        if override.model is not None:
            at = ("overrides", index, "model")
            source.refer(override.model, "a model", known["model"], at)


def _check_shape(patch: Patch, key: Key, source: Source) -> None:
    if isinstance(patch, List):
        for index, unit in enumerate(patch.units):
            _check_axes(unit, (*key, "units", index), source)
        names = [unit.name or str(index) for index, unit in enumerate(patch.units)]
        source.unique((*key, "units"), names)
    elif (over := overfull(patch)) is not None:
        name, limit = over
        if limit < 1 and isinstance(patch, Cylinder | Dome):  # no number of them would do
            room = f"for which a {type(patch).__name__.lower()} with radius_m = {patch.radius_m:g}"
            expected = f"at most {widest_pitch_m(patch):.4g}, {room} has room"
            source.fault((*key, "pitch_m"), expected, f"{patch.pitch_m:g}")
        else:
            ends = {"columns": "once around the cylinder", "rings": "before the far side"}
            source.fault((*key, name), f"at most {limit}, {ends[name]}", getattr(patch, name))


def _check_axes(unit: ListUnit, at: Key, source: Source) -> None:
    short = False
    for name, axis in {"normal": unit.normal, "x_axis": unit.x_axis}.items():
        if axis is not None and (length := math.hypot(*axis)) < SHORTEST_AXIS:
            source.fault((*at, name), "a direction", f"a vector of length {length:.3g}")
            short = True
    if unit.x_axis is not None and not short:
        across = math.hypot(*np.cross(unit.x_axis, unit.normal))
        if across < 1e-6 * math.hypot(*unit.normal) * math.hypot(*unit.x_axis):
            source.fault((*at, "x_axis"), "a direction across the normal", "one along it")


def _check_count(file: File, source: Source) -> None:
    total = 0
    for index, patch in enumerate(file.patches):
        total += count(patch)
        if total > MOST_UNITS:
            expected = f"a skin of at most {MOST_UNITS} units"
            source.fault(("patches", index), expected, total)
            return
