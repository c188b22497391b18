"""ROS 2 messages: their definitions and fields.

Those of ROS are as in ROS 2 Humble and later (common_interfaces). Those of ``f3t_msgs`` are our
own: received frames, the state of a whole skin in one message, the layout of the skin, and its
moving poses.
"""

from __future__ import annotations

import functools
import re
from typing import NamedTuple

from skin.contact.field import Quantity
from skin.contact.record import QUANTITIES

__all__ = ["FIELDS", "NUMBERS", "STATE_VERSION", "Field", "definitions", "fields_of", "schema"]

STATE_VERSION = max(4, *(one.since for one in QUANTITIES))
"""Of ``f3t_msgs/msg/SkinState`` and its parts. Version 1 had no `version`, `test_ratio` and
`whole`; up to 2 `force_sigma` was a number where the unit is invalid; up to 3 a contact had fewer
fields, in another order."""


def _line_of(one: Quantity) -> str:
    """The line that declares a field of a contact."""
    units = [one.unit] if isinstance(one.unit, str) else [*dict.fromkeys(one.unit)]
    words = [f"{number} {word}" for number, word in enumerate(one.words)]
    notes = [", ".join(filter(None, units)), ", ".join(words), one.doc]
    return f"{one.message} {one.name}  # {'; '.join(filter(None, notes))}"


NUMBERS = {
    "bool": "?", "byte": "u1", "uint8": "u1", "uint16": "<u2", "int32": "<i4", "uint32": "<u4",
    "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
"""Number types of the definitions, as numpy types."""
FIELDS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/msg/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/msg/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/msg/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "geometry_msgs/msg/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "diagnostic_msgs/msg/KeyValue": "string key\nstring value",
    "diagnostic_msgs/msg/DiagnosticStatus": """\
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values""",
    "diagnostic_msgs/msg/DiagnosticArray": (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status"
    ),
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/msg/PointField": """\
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count""",
    "sensor_msgs/msg/PointCloud2": """\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense""",
    "visualization_msgs/msg/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/msg/MeshFile": "string filename\nuint8[] data",
    "visualization_msgs/msg/Marker": """\
int32 ARROW=0
int32 CUBE=1
int32 SPHERE=2
int32 CYLINDER=3
int32 LINE_STRIP=4
int32 LINE_LIST=5
int32 CUBE_LIST=6
int32 SPHERE_LIST=7
int32 POINTS=8
int32 TEXT_VIEW_FACING=9
int32 MESH_RESOURCE=10
int32 TRIANGLE_LIST=11
int32 ADD=0
int32 MODIFY=0
int32 DELETE=2
int32 DELETEALL=3
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials""",
    "visualization_msgs/msg/MarkerArray": "visualization_msgs/Marker[] markers",
    "f3t_msgs/msg/CanFrame": """\
int64 stamp_ns     # of the transport, since 1970
uint32 id          # as SocketCAN has it: bit 31 29-bit identifier, 30 remote, 29 error frame
uint8 length       # bytes of data that count
uint8 flags        # bit 0 bit-rate switch, 1 error state, 2 CAN FD
uint8 origin       # bit 0: this host sent it
uint8 bus          # index of the buses of the topology
uint8[64] data     # what stands beyond the length means nothing""",
    "f3t_msgs/msg/CanFrames": """\
# What the skin was given at once, in its order; a cycle was closed where frames are none
uint8 FED=0        # frames were taken, from all buses
uint8 EXPIRED=1    # the deadline closed a cycle, elapsed_ns after it had begun
uint8 SILENT=2     # no SYNC came for elapsed_ns, and a cycle without data was shown
uint8 FLUSHED=3    # what was open was closed
std_msgs/Header header
uint8 event
bool more          # the next message has further frames of the same batch
int64 elapsed_ns
uint64 lost_cycles # that were left out of this recording until then, as it was behind
uint64 lost_frames
f3t_msgs/CanFrame[] frames""",
    "f3t_msgs/msg/Contact": "\n".join(map(_line_of, QUANTITIES)),
    "f3t_msgs/msg/SkinState": f"""\
uint8 VERSION={STATE_VERSION}           # of this definition and that of Contact
std_msgs/Header header    # stamp of the SYNC
uint8 version             # VERSION of who wrote it
uint64 cycle
float32[] force           # 3 n: Fx of all units, Fy, Fz; N, unit frames; NaN where invalid
float32[] force_sigma     # 3 n; NaN where invalid
float32[] temperature     # n, degree Celsius; NaN where invalid
float32[] test_ratio      # n, field against its model, 1 is the limit; NaN where not checked
uint16[] status           # n, flags; 0 is a good reading
int32[] contact           # n, index of the contacts, -1 for none
bool whole                # all units that may touch are heard; false if nothing is summed
f3t_msgs/Contact[] contacts""",
    "f3t_msgs/msg/SkinLayout": """\
std_msgs/Header header
string topology
string[] names            # n
string[] patches
int32[] patch             # n, index of the patches
float64[] position        # 3 n: x of all units, y, z; m, skin frame
float64[] rotation        # 9 n, row by row, columns are the axes of the units""",
    "f3t_msgs/msg/SkinPoses": """\
# Poses of the units from the next cycle on
std_msgs/Header header
float64[] position        # 3 n, as of the layout
float64[] rotation        # 9 n""",
}
"""Fields of each message, one a line; those of other messages by package and name."""

_USED = re.compile(r"^(\w+)/(\w+)(?:\[\d*\])? ", re.MULTILINE)
_LINE = re.compile(r"(?P<kind>[\w/]+)(?P<array>\[(?P<size>\d*)\])? (?P<name>\w+)\s*(?:#.*)?")
"""A line that is a field: not a constant, which has a value, nor a comment."""
_RULE = "=" * 80
_PART = f"\n{_RULE}\nMSG: "


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
    return _fields(FIELDS[message])


def _fields(text: str) -> tuple[Field, ...]:
    """The fields of a definition."""
    found = []
    for parts in filter(None, map(_LINE.fullmatch, text.splitlines())):
        kind = parts["kind"].replace("/", "/msg/", 1)
        found.append(Field(parts["name"], kind, parts["array"] is not None,
                           int(parts["size"] or 0)))  # fmt: skip
    return tuple(found)


def schema(name: str) -> str:
    """The definition of a message as files contain it: its fields, then those of its parts.

    Examples
    --------
    >>> print(schema("std_msgs/msg/Header"))
    builtin_interfaces/Time stamp
    string frame_id
    ================================================================================
    MSG: builtin_interfaces/Time
    int32 sec
    uint32 nanosec
    """
    parts, seen, waiting = [FIELDS[name]], {name}, [name]
    while waiting:
        for package, kind in _USED.findall(FIELDS[waiting.pop(0)]):
            inner = f"{package}/msg/{kind}"
            if inner not in seen:
                seen.add(inner)
                waiting.append(inner)
                parts.append(f"{package}/{kind}\n{FIELDS[inner]}")
    return _PART.join(parts)


def definitions(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """The fields of a message and of its parts, from the definition in a file: those of the version
    that wrote it.

    Examples
    --------
    >>> definitions("std_msgs/msg/Header", schema("std_msgs/msg/Header"))["std_msgs/msg/Header"]
    (Field(name='stamp', kind='builtin_interfaces/msg/Time', is_array=False, size=0), \
Field(name='frame_id', kind='string', is_array=False, size=0))
    """
    own, *others = text.split(_PART)
    found = {name: _fields(own)}
    for other in others:
        inner, _, lines = other.partition("\n")
        found[inner.strip().replace("/", "/msg/", 1)] = _fields(lines)
    return found
