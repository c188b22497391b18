"""Topics, types and CDR of the messages; the only file that imports rosbags.

Types of ROS are those of rosbags, the same in ROS 2 Humble and later. Those of ``f3t_msgs`` are our
own, and stand here.
"""

from __future__ import annotations

import functools
from importlib.util import find_spec
from typing import Any

from skin.contact.field import Quantity
from skin.contact.record import QUANTITIES
from skin.errors import LibraryError

__all__ = [
    "CONTACT",
    "DIAGNOSTICS",
    "FORCES",
    "FRAMES",
    "LAYOUT",
    "MESSAGES",
    "POINTS",
    "POSES",
    "STATE",
    "TF",
    "TOPICS",
    "WRENCH",
    "decode",
    "definition",
    "encode",
    "fields_of",
    "header",
    "make",
    "require",
    "type_of",
]

FRAMES, STATE, LAYOUT, POSES = "/skin/frames", "/skin/state", "/skin/layout", "/skin/poses"
WRENCH, CONTACT = "/skin/wrench", "/skin/contact"
POINTS, FORCES = "/skin/points", "/skin/forces"
TF, DIAGNOSTICS = "/tf", "/diagnostics"
TOPICS = {
    FRAMES: "f3t_msgs/msg/CanFrames",
    STATE: "f3t_msgs/msg/SkinState",
    LAYOUT: "f3t_msgs/msg/SkinLayout",
    POSES: "f3t_msgs/msg/SkinPoses",
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    POINTS: "sensor_msgs/msg/PointCloud2",
    FORCES: "sensor_msgs/msg/PointCloud2",
    TF: "tf2_msgs/msg/TFMessage",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    CONTACT: "geometry_msgs/msg/WrenchStamped",
}
"""Type of each topic; ``/skin/contact`` is followed by ``/<slot>``, a number that a contact keeps
while it lasts."""
LATEST_S = (1 << 31) - 1


def _line_of(one: Quantity) -> str:
    """The line that declares a field of a contact."""
    units = [one.unit] if isinstance(one.unit, str) else [*dict.fromkeys(one.unit)]
    words = [f"{number} {word}" for number, word in enumerate(one.words)]
    notes = [", ".join(filter(None, units)), ", ".join(words), one.doc]
    return f"{one.message} {one.name}  # {'; '.join(filter(None, notes))}"


MESSAGES = {
    "f3t_msgs/msg/CanFrames": """\
# What the skin was given until it showed a cycle: events, in order, each with a value
uint8 FED=0        # so many frames, from all buses, at once
uint8 EXPIRED=1    # the deadline closed a cycle of this age in ns
uint8 SILENT=2     # no SYNC came for so many ns, and a cycle without data was shown
uint8 FLUSHED=3    # what was open was closed
uint8 PART=4       # so many frames; the batch goes on with the next event
std_msgs/Header header
uint64 lost_cycles # that were left out of this recording until then, as it was behind
uint64 lost_frames
uint8[] events
int64[] values
uint8[] frames     # 80 bytes each, little endian: int64 stamp_ns of the transport, since 1970;
                   # uint32 id as SocketCAN has it (bit 31 29-bit identifier, 30 remote, 29 error
                   # frame); uint8 length, bytes of data that count; uint8 flags (bit 0 bit-rate
                   # switch, 1 error state, 2 CAN FD); uint8 origin (bit 0: this host sent it);
                   # uint8 bus, index of the buses of the topology; uint8[64] data""",
    "f3t_msgs/msg/Contact": "\n".join(map(_line_of, QUANTITIES)),
    "f3t_msgs/msg/SkinState": """\
std_msgs/Header header    # stamp of the SYNC
uint64 cycle
float32[] force           # 3 n: Fx of all units, Fy, Fz; N, unit frames; NaN where invalid
float32[] force_sigma     # 3 n; NaN where invalid
float32[] temperature     # n, degree Celsius; NaN where invalid
float32[] test_ratio      # n, field against its model, 1 is the limit; NaN where not checked
uint16[] status           # n, flags; 0 is a good reading
int32[] contact           # n, index of the contacts; -1 none, -2 beyond the capacity
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
float64[] rotation        # 9 n
float64[] q               # joints of the robot that these are of, rad or m; NaN where not known""",
}
"""Our own messages: the fields, one a line."""


def require(where: str, extra: str, *libraries: str) -> None:
    """Raise if one of the libraries of an extra is missing, without loading any.

    Raises
    ------
    LibraryError
        It is not installed.
    """
    for name in libraries:
        if find_spec(name) is None:
            raise LibraryError(
                f"{where}: must have {name}; not installed: pip install 'f3t-skin[{extra}]'"
            )


@functools.cache
def _store() -> Any:
    """All types: those of ROS, and our own."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store, own = get_typestore(Stores.LATEST), {}
    for name, text in MESSAGES.items():
        own.update(get_types_from_msg(text, name))
    store.register(own)
    return store


def type_of(topic: str) -> str:
    """The type of a topic.

    Examples
    --------
    >>> type_of("/skin/contact/2")
    'geometry_msgs/msg/WrenchStamped'
    """
    return TOPICS[CONTACT if topic.startswith(f"{CONTACT}/") else topic]


def make(name: str, *values: Any) -> Any:
    """A message of a type, of its fields in order; lists of numbers are arrays.

    Examples
    --------
    >>> make("geometry_msgs/msg/Point", 1.0, 2.0, 3.0).y
    2.0
    """
    return _store().types[name](*values)


def header(stamp_ns: int, frame: str) -> Any:
    """A std_msgs/Header; times before 1970 and after 2038 are the nearest that it has.

    Examples
    --------
    >>> header(1_500_000_000, "skin").stamp.nanosec
    500000000
    """
    whole, rest = divmod(max(0, stamp_ns), 1_000_000_000)
    time = make("builtin_interfaces/msg/Time", min(whole, LATEST_S), rest)
    return make("std_msgs/msg/Header", time, frame)


def encode(topic: str, message: Any) -> bytes:
    """A message of a topic as CDR."""
    return bytes(_store().serialize_cdr(message, type_of(topic), little_endian=True))


def decode(topic: str, data: bytes) -> Any:
    """A message of a topic from CDR.

    Raises
    ------
    ValueError
        The bytes are not such a message.
    """
    try:
        return _store().deserialize_cdr(data, type_of(topic))
    except Exception as error:  # rosbags raises several classes
        raise ValueError(f"{topic}: must be {type_of(topic)}; got {error}") from None


@functools.cache
def definition(name: str) -> str:
    """The definition of a message as files contain it: its fields, then those of its parts."""
    return _store().generate_msgdef(name, ros_version=2)[0]


def fields_of(message: str) -> dict[str, tuple[str, int | None]]:
    """The fields of a message in their order: the kind of each ("float64", "string", …, or the full
    name of a message), and its size if it is an array, 0 for any.

    Examples
    --------
    >>> fields_of("geometry_msgs/msg/Wrench")["force"]
    ('geometry_msgs/msg/Vector3', None)
    """
    found = {}
    for name, node in _store().fielddefs[message][1]:
        kind, of = node
        size = of[1] if kind.name in ("ARRAY", "SEQUENCE") else None
        inner, of = node if size is None else of[0]
        found[name] = of if inner.name == "NAME" else of[0], size
    return found
