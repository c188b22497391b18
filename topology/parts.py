"""Parts of a file, resolved: buses, frames, models and wire layouts."""

from __future__ import annotations

from dataclasses import dataclass

from topology import pose
from topology.check.buses import resolve_buses
from topology.check.frames import resolve_frames
from topology.check.models import resolve_models
from topology.check.robot import link_poses, resolve_robot
from topology.check.wires import resolve_layouts
from topology.model import UnitModel
from topology.report import Report
from topology.robot.model import RobotModel
from topology.schema import Bus, File, Scale
from topology.source import Key, Source
from topology.wire import WireLayout

__all__ = ["Parts", "resolve"]


@dataclass(frozen=True)
class Parts:
    """Parts that patches and units refer to; None where one is invalid, and reported.

    Attributes
    ----------
    source : Source
        The text of the file.
    file : File
        Its tables.
    buses : dict of str to Key
        Place of each bus in the file.
    frames : dict of str to Transform or None
        T_skin_frame.
    robot : RobotModel or None
    links : dict of str to Transform
        T_skin_link of the robot's links at home.
    link_of_frame : dict of str to str
        Link of each frame on a robot.
    models : dict of str to UnitModel or None
    scales : dict of str to dict of str to Scale
        Physical scales of a model's own, by channel.
    layouts : dict of str to WireLayout or None
    """

    source: Source
    file: File
    buses: dict[str, Key]
    frames: dict[str, pose.Transform | None]
    robot: RobotModel | None
    links: dict[str, pose.Transform]
    link_of_frame: dict[str, str]
    models: dict[str, UnitModel | None]
    scales: dict[str, dict[str, Scale]]
    layouts: dict[str, WireLayout | None]

    def bus(self, key: Key) -> Bus:
        """The bus at a key."""
        return self.file.buses[int(key[1])]


def resolve(file: File, source: Source, report: Report) -> Parts:
    """Resolve the parts of a file, and report faults."""
    buses = resolve_buses(file, source, report)
    robot = resolve_robot(file, source, report)
    links = link_poses(robot)
    frames, carriers = resolve_frames(file, links, source, report)
    models, scales = resolve_models(file, source, report)
    layouts = resolve_layouts(file, source, report)
    return Parts(source, file, buses, frames, robot, links, carriers, models, scales, layouts)
