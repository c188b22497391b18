"""Messages for display: layout of the skin, points, markers, frames of patches.

RViz, Foxglove and rerun draw PointCloud2. RViz and Foxglove draw MarkerArray as well, rerun has no
message of ROS for lines and arrows of its own length; only Foxglove reads its own SceneUpdate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from bus.status import INVALID
from skin.cividis import cividis
from skin.contact.record import Flag
from skin.io.messages.cdr import Cdr, seconds
from skin.io.messages.record import contacts_of

__all__ = ["Layout", "quaternion"]

ARROW, LINE_LIST, TEXT = 0, 5, 9
"""Kinds of visualization_msgs/Marker."""
POINT = np.dtype([
    ("x", "<f4"), ("y", "<f4"), ("z", "<f4"),  # m
    ("load", "<f4"),  # N; NaN where invalid
    ("rgb", "<u4"),  # 0x00RRGGBB, read by RViz and Foxglove
    ("colors", "<u4"), ("radii", "<f4"),  # 0xRRGGBBAA and m: components of rerun's Points3D
])  # fmt: skip
"""A point of a cloud. rerun takes the fields of a cloud as components of its points by name."""
POINT_FIELD = {"f4": 7, "u4": 6}
"""Numbers of types in sensor_msgs/PointField."""
UNIT_M, TIP_M = 0.0025, 0.0002
"""Radii of the point that marks a unit, and of the ends of a row of points that shows a force."""
IN_ROW = 17
"""Points that show the force of a contact."""
METRE_PER_NEWTON = 0.005
LIFETIME_NS = 300_000_000
"""Lifetime of the marker of a contact."""
FULL_SCALE_N = 6.0
"""Load at the end of the colour scale."""
WRONG = (0.85, 0.1, 0.55, 1.0)
"""Colour of a unit that is not valid; not on the scale."""
FORCES = (1.0, 1.0, 1.0, 0.9)
TOUCH = {0: (0.6, 0.6, 0.6, 1.0), 1: (0.2, 0.5, 1.0, 1.0), 2: (1.0, 0.6, 0.0, 1.0),
         3: (1.0, 0.2, 0.1, 1.0)}  # fmt: skip
"""Colour of a contact by its slip."""
NONE = np.zeros((0, 4), "<f4")
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Layout:
    """Current poses of the units and patches.

    Parameters
    ----------
    skin : mapping
        As of `skin.io.messages.record.described`.
    frame : str
        Name of the skin frame.
    patch_frames : sequence of str
        Names of the frames of patches.
    """

    def __init__(self, skin: Mapping[str, Any], frame: str, patch_frames: Sequence[str]) -> None:
        self._skin, self._frame = skin, frame
        self._patch = patch = np.array(skin["patch"], "<i4")
        self.position = np.array(skin["position"], float).reshape(3, -1)
        self.rotation = np.array(skin["rotation"], float).reshape(3, 3, -1)
        self._carriers = [
            (name, _middle(self.position, np.flatnonzero(patch == i)))
            for i, name in enumerate(patch_frames)
            if (patch == i).any()
        ]

    def move(self, pose: np.ndarray) -> None:
        """Set new poses, shape (12, n): position and rotation."""
        self.position, self.rotation = pose[:3].copy(), pose[3:].reshape(3, 3, -1).copy()

    def message(self, stamp_ns: int) -> bytes:
        """As ``f3t_msgs/msg/SkinLayout``."""
        message = Cdr()
        message.header(stamp_ns, self._frame)
        message.text(self._skin["topology"])
        message.texts(self._skin["names"])
        message.texts(self._skin["patches"])
        message.array(self._patch)
        self._poses(message)
        return bytes(message.raw)

    def poses(self, stamp_ns: int) -> bytes:
        """As ``f3t_msgs/msg/SkinPoses``."""
        message = Cdr()
        message.header(stamp_ns, self._frame)
        self._poses(message)
        return bytes(message.raw)

    def _poses(self, message: Cdr) -> None:
        message.array(self.position.astype("<f8"))
        message.array(self.rotation.astype("<f8"))

    def transforms(self, stamp_ns: int) -> bytes:
        """Frames of the patches as ``tf2_msgs/msg/TFMessage``: the pose of each patch's middle
        unit."""
        message = Cdr()
        message.number("I", len(self._carriers))
        for name, unit in self._carriers:
            message.header(stamp_ns, self._frame)
            message.text(name)
            message.number("d", *self.position[:, unit], *quaternion(self.rotation[:, :, unit]))
        return bytes(message.raw)

    def points(self, record: np.ndarray) -> bytes:
        """The units in a cycle as ``sensor_msgs/msg/PointCloud2``, coloured by load."""
        load = record["force"][2].astype(float)
        wrong = record["status"] & int(INVALID) != 0
        wrong |= np.isnan(record["force"]).any(axis=0)
        load[wrong] = np.nan
        colours = cividis(np.nan_to_num(load) / FULL_SCALE_N)
        colours[wrong] = 255.0 * np.array(WRONG[:3])
        return self._cloud(record, self.position.T, load, colours, UNIT_M)

    def forces(self, record: np.ndarray) -> bytes:
        """The forces of contacts in a cycle as ``sensor_msgs/msg/PointCloud2``: a row of points for
        each, from its centroid, thinner towards the tip; coloured by slip, as its arrow in the
        scene."""
        contacts, share = contacts_of(record), np.linspace(0.0, 1.0, IN_ROW)
        start, tip = self._ends(record)
        at = start[:, np.newaxis] + share[:, np.newaxis] * (tip - start)[:, np.newaxis]
        load = np.repeat(contacts["load"].astype(float), IN_ROW)
        touch = [TOUCH[slip & 3][:3] for slip in contacts["slip"].tolist()]
        colours = np.repeat(255.0 * np.reshape(touch, (-1, 3)), IN_ROW, axis=0)
        radii = np.tile(UNIT_M / 2.0 + share * (TIP_M - UNIT_M / 2.0), contacts.size)
        return self._cloud(record, at.reshape(-1, 3), load, colours, radii)

    def _cloud(
        self, record: np.ndarray, at: np.ndarray, load: np.ndarray, colours: np.ndarray,
        radii: np.ndarray | float,
    ) -> bytes:  # fmt: skip
        """Points with their loads, colours from 0 to 255, shape (m, 3), and radii."""
        points = np.empty(len(at), POINT)
        points["x"], points["y"], points["z"] = at.T
        points["load"], points["radii"] = load, radii
        points["rgb"] = np.rint(colours).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], "u4")
        points["colors"] = points["rgb"] << 8 | 0xFF
        message = Cdr()
        message.header(int(record["stamp_ns"]), self._frame)
        message.number("I", 1, len(points), len(POINT.names or ()))
        for name, (kind, offset, *_) in (POINT.fields or {}).items():
            message.text(name).number("I", offset)
            message.number("B", POINT_FIELD[kind.str[1:]])
            message.number("I", 1)
        message.number("B", 0)  # little endian
        message.number("I", POINT.itemsize, points.nbytes)
        message.array(points.view("u1"))
        message.number("B", not np.isnan(points["load"]).any())
        return bytes(message.raw)

    def scene(self, record: np.ndarray) -> bytes:
        """A cycle as ``visualization_msgs/msg/MarkerArray``: forces of units as lines; contacts as
        arrows with their names."""
        message, stamp_ns = Cdr(), int(record["stamp_ns"])
        contacts = contacts_of(record)
        message.number("I", 1 + 2 * contacts.size)
        wrong = record["status"] & int(INVALID) != 0
        wrong |= np.isnan(record["force"]).any(axis=0)
        force = np.where(wrong, 0.0, record["force"].astype(float))
        at = self.position.T
        ends = at + METRE_PER_NEWTON * np.einsum("abn,bn->na", self.rotation, force)
        lines = np.stack([at, ends], axis=1).reshape(-1, 3)
        for marker in (
            Marker("forces", 0, LINE_LIST, (0.001, 0.0, 0.0), FORCES, lines),
            *(one for contact, start, tip in zip(contacts, *self._ends(record), strict=True)
              for one in _contact(contact, start, tip)),
        ):  # fmt: skip
            marker.write(message, stamp_ns, self._frame)
        return bytes(message.raw)

    def _ends(self, record: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Begins and tips of the arrows of contacts, shape (k, 3), in metre. A contact whose
        centroid is not known begins at the mean of its units."""
        contacts = contacts_of(record)
        start = np.array(contacts["centroid"], float)
        for k in np.flatnonzero(np.isnan(start).any(axis=1)):
            start[k] = self.position[:, record["contact"] == k].mean(axis=1)
        return start, start + METRE_PER_NEWTON * contacts["wrench"][:, :3]


class Marker(NamedTuple):
    """A visualization_msgs/Marker."""

    group: str
    number: int
    kind: int
    scale: Sequence[float]
    colour: Sequence[float]
    points: np.ndarray = NONE
    """Shape (m, 3)."""
    colours: np.ndarray = NONE
    """Shape (m, 4), or none."""
    lifetime_ns: int = 0
    place: Sequence[float] = (0.0, 0.0, 0.0)
    text: str = ""

    def write(self, message: Cdr, stamp_ns: int, frame: str) -> None:
        """Append it to a message."""
        message.header(stamp_ns, frame)
        message.text(self.group)
        message.number("i", self.number, self.kind, 0)
        message.number("d", *self.place, *UPRIGHT, *self.scale)
        message.number("f", *self.colour)
        message.number("i", *seconds(self.lifetime_ns))
        message.number("B", 0)
        _list(message, self.points.astype("<f8"))
        _list(message, self.colours)
        message.text("")  # texture_resource
        message.header(0, "")
        message.text("").number("I", 0)  # its format and data
        message.number("I", 0)  # uv_coordinates
        message.text(self.text).text("").text("")  # mesh_resource, name of mesh_file
        message.number("I", 0)  # its data
        message.number("B", 0)


def _contact(contact: np.void, start: np.ndarray, tip: np.ndarray) -> tuple[Marker, Marker]:
    """Arrow and name of a contact."""
    part = " (not whole)" if contact["flags"] & Flag.UNSEEN else ""
    number, colour = int(contact["id"]) & 0x7FFF_FFFF, TOUCH[int(contact["slip"]) & 3]
    arrow = Marker(
        "contacts", number, ARROW, (0.001, 0.002, 0.003), colour, np.stack([start, tip]),
        lifetime_ns=LIFETIME_NS,
    )  # fmt: skip
    name = Marker(
        "names", number, TEXT, (0.0, 0.0, 0.004), colour, lifetime_ns=LIFETIME_NS,
        place=tip.tolist(), text=f"{number}: {contact['load']:.2f} N" + part,
    )  # fmt: skip
    return arrow, name


def _list(message: Cdr, rows: np.ndarray) -> None:
    """A list of messages, each of numbers of one kind, shape (m, fields)."""
    message.number("I", len(rows))
    if len(rows):
        message.align(rows.itemsize)
        message.raw += rows.tobytes()


def _middle(position: np.ndarray, units: np.ndarray) -> int:
    """The unit that is nearest to the mean position of some units."""
    own = position[:, units]
    away = np.linalg.norm(own - own.mean(axis=1, keepdims=True), axis=0)
    return int(units[np.argmin(away)])


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix, shape (3, 3); w is not negative.

    Examples
    --------
    >>> quaternion(np.eye(3))
    (0.0, 0.0, 0.0, 1.0)
    """
    x, y, z, w = Rotation.from_matrix(np.array(rotation)).as_quat(canonical=True).tolist()
    return x + 0.0, y + 0.0, z + 0.0, w
