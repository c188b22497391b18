"""Messages that people look at: what hangs where, units and contacts in 3-D, frames of patches.

Markers are those of RViz, which Foxglove and every tool for ROS bags read as well; the SceneUpdate
of Foxglove is read by Foxglove alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bus.status import INVALID
from skin.contact.record import Flag
from skin.messages.cdr import Cdr, seconds
from skin.messages.record import contacts_of

__all__ = ["Layout", "quaternion"]

ARROW, LINE_LIST, CUBE_LIST, TEXT = 0, 5, 6, 9
"""Kinds of visualization_msgs/Marker."""
SIDE_M = 0.005
"""Of the square that a unit is drawn as."""
METRE_PER_NEWTON = 0.005
LIFETIME_NS = 300_000_000
"""After which a contact is gone that is not drawn anew."""
FULL_SCALE_N = 6.0
"""Load of the last colour."""
RAMP = np.array([(0.0, 0.135, 0.305), (0.488, 0.485, 0.471), (0.995, 0.909, 0.217)])
"""From no load to full load: the ends and the middle of cividis, which the colour-blind read."""
WRONG = (0.85, 0.1, 0.55, 1.0)
"""Of a unit that is not valid: no colour of the ramp."""
FORCES = (1.0, 1.0, 1.0, 0.9)
TOUCH = {0: (0.6, 0.6, 0.6, 1.0), 1: (0.2, 0.5, 1.0, 1.0), 2: (1.0, 0.6, 0.0, 1.0),
         3: (1.0, 0.2, 0.1, 1.0)}  # fmt: skip
"""Colour of a contact by its slip."""
NONE = np.zeros((0, 4), "<f4")
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Layout:
    """What hangs where, now.

    Parameters
    ----------
    skin : mapping
        As of `skin.messages.record.described`.
    frame : str
        Of the skin.
    patch_frames : sequence of str
        Of the patches.
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
        """Take new poses, shape (12, n): position and rotation."""
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
        """Frames of the patches as ``tf2_msgs/msg/TFMessage``: each is that of its middle unit."""
        message = Cdr()
        message.number("I", len(self._carriers))
        for name, unit in self._carriers:
            message.header(stamp_ns, self._frame)
            message.text(name)
            message.number("d", *self.position[:, unit], *quaternion(self.rotation[:, :, unit]))
        return bytes(message.raw)

    def scene(self, record: np.ndarray) -> bytes:
        """A cycle as ``visualization_msgs/msg/MarkerArray``: a square for each unit, by load;
        forces as lines; contacts as arrows with their names."""
        message, stamp_ns = Cdr(), int(record["stamp_ns"])
        contacts = contacts_of(record)
        message.number("I", 2 + 2 * contacts.size)
        wrong = record["status"] & int(INVALID) != 0
        wrong |= np.isnan(record["force"]).any(axis=0)
        force = np.where(wrong, 0.0, record["force"].astype(float))
        colours = np.where(wrong[:, np.newaxis], WRONG, _colours(force[2])).astype("<f4")
        at = self.position.T
        units = Marker("units", 0, CUBE_LIST, (SIDE_M,) * 3, WRONG, at, colours)
        ends = at + METRE_PER_NEWTON * np.einsum("abn,bn->na", self.rotation, force)
        lines = np.stack([at, ends], axis=1).reshape(-1, 3)
        for marker in (
            units, Marker("forces", 0, LINE_LIST, (0.001, 0.0, 0.0), FORCES, lines),
            *(one for contact in contacts for one in _contact(contact)),
        ):  # fmt: skip
            marker.write(message, stamp_ns, self._frame)
        return bytes(message.raw)


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


def _contact(contact: np.void) -> tuple[Marker, Marker]:
    """Arrow and name of a contact."""
    part = " (not whole)" if contact["flags"] & Flag.UNSEEN else ""
    number, colour = int(contact["id"]) & 0x7FFF_FFFF, TOUCH[int(contact["slip"]) & 3]
    centre = np.nan_to_num(contact["centroid"])
    tip = centre + METRE_PER_NEWTON * contact["wrench"][:3]
    arrow = Marker(
        "contacts", number, ARROW, (0.001, 0.002, 0.003), colour, np.stack([centre, tip]),
        lifetime_ns=LIFETIME_NS,
    )  # fmt: skip
    name = Marker(
        "names", number, TEXT, (0.0, 0.0, 0.004), colour, lifetime_ns=LIFETIME_NS,
        place=tip.tolist(), text=f"{number}: {contact['load']:.2f} N" + part,
    )  # fmt: skip
    return arrow, name


def _list(message: Cdr, rows: np.ndarray) -> None:
    """A list of messages of numbers of one kind, shape (m, fields)."""
    message.number("I", len(rows))
    if len(rows):
        message.align(rows.itemsize)
        message.raw += rows.tobytes()


def _colours(load: np.ndarray) -> np.ndarray:
    """Red, green, blue and alpha of loads in newton, shape (n, 4)."""
    level = (len(RAMP) - 1) * np.clip(load / FULL_SCALE_N, 0.0, 1.0)
    mixed = [np.interp(level, range(len(RAMP)), RAMP[:, i]) for i in range(3)]
    return np.stack([*mixed, np.ones_like(load)], axis=1)


def _middle(position: np.ndarray, units: np.ndarray) -> int:
    """Of some units, the one nearest to their middle."""
    own = position[:, units]
    away = np.linalg.norm(own - own.mean(axis=1, keepdims=True), axis=0)
    return int(units[np.argmin(away)])


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix, shape (3, 3).

    The eigenvector of the largest eigenvalue of a symmetric matrix: Bar-Itzhack, Journal of
    Guidance, Control, and Dynamics 23 (2000), 1085.

    Examples
    --------
    >>> quaternion(np.eye(3))
    (0.0, 0.0, 0.0, 1.0)
    """
    m = rotation
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m.trace()],
        ]
    )
    x, y, z, w = np.linalg.eigh(k)[1][:, -1].tolist()
    sign = -1.0 if w < 0.0 else 1.0
    return sign * x + 0.0, sign * y + 0.0, sign * z + 0.0, sign * w
