"""ROS 2 messages: their definitions, and the fields that they have.

The definitions are those of ROS 2 (common_interfaces), and three of our own: one message a cycle
for all units, which names no unit; the layout, once, that names and places them.
"""

from __future__ import annotations

import functools
import re
from typing import NamedTuple

__all__ = ["DEFINITIONS", "Field", "fields_of"]

DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "geometry_msgs/msg/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/msg/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "diagnostic_msgs/msg/KeyValue": "string key\nstring value",
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\n"
        "diagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/msg/DiagnosticArray": (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status"
    ),
    "f3t_msgs/msg/Contact": """\
int64 id
geometry_msgs/Wrench wrench
float64[6] wrench_sigma
geometry_msgs/Point centroid
geometry_msgs/Vector3 normal
uint8 slip
float32 stick_ratio
float32 friction
float32 margin
uint16 units""",
    "f3t_msgs/msg/SkinState": """\
std_msgs/Header header
uint64 cycle
float32[] force
float32[] force_sigma
float32[] temperature
uint16[] status
int32[] contact
f3t_msgs/Contact[] contacts""",
    "f3t_msgs/msg/SkinLayout": """\
std_msgs/Header header
string topology
string[] names
string[] patches
int32[] patch
float64[] position
float64[] rotation""",
}
"""Text of each message, as a .msg file has it. Newton, newton metre, metre, degree Celsius."""

_LINE = re.compile(r"(?P<kind>[\w/]+)(?P<array>\[(?P<size>\d*)\])? (?P<name>\w+)")


class Field(NamedTuple):
    """A field of a message.

    Attributes
    ----------
    name : str
    kind : str
        "float64", "string", …, or the full name of a message.
    is_array : bool
    size : int
        Of an array; 0 if any.
    """

    name: str
    kind: str
    is_array: bool
    size: int


@functools.cache
def fields_of(message: str) -> tuple[Field, ...]:
    """The fields of a message, in their order.

    Examples
    --------
    >>> fields_of("geometry_msgs/msg/Wrench")[0]
    Field(name='force', kind='geometry_msgs/msg/Vector3', is_array=False, size=0)
    """
    found = []
    for line in DEFINITIONS[message].splitlines():
        parts = _LINE.fullmatch(line)
        assert parts is not None, line
        kind = parts["kind"].replace("/", "/msg/", 1)
        found.append(Field(parts["name"], kind, parts["array"] is not None,
                           int(parts["size"] or 0)))  # fmt: skip
    return tuple(found)
