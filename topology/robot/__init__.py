"""Robot models: links, joints and shapes, read from URDF or MJCF."""

from topology.robot.model import Geom, RobotModel
from topology.robot.read import read_model

__all__ = ["Geom", "RobotModel", "read_model"]
