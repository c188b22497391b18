"""Layout of a skin: topology files, unit models and wire layouts, loaded into arrays."""

from topology.arrays import Frames, Topology
from topology.errors import TopologyError
from topology.load import builtin, load
from topology.model import CREEP_TERMS, MODELS, THETA_KNOTS, UnitModel
from topology.robot import RobotModel, read_model
from topology.schema import Bus, json_schema
from topology.wire import CHANNELS, LAYOUTS, Signal, WireLayout

__all__ = [
    "CHANNELS",
    "CREEP_TERMS",
    "LAYOUTS",
    "MODELS",
    "THETA_KNOTS",
    "Bus",
    "Frames",
    "RobotModel",
    "Signal",
    "Topology",
    "TopologyError",
    "UnitModel",
    "WireLayout",
    "builtin",
    "json_schema",
    "load",
    "read_model",
]
