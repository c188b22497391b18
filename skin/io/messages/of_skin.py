"""All messages of a skin: of its layout and poses, and of each cycle from its record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from skin.contact.record import QUANTITIES
from skin.io.messages import clouds
from skin.io.messages.definitions import (
    CONTACT,
    DIAGNOSTICS,
    FORCES,
    LAYOUT,
    POINTS,
    POSES,
    STATE,
    TF,
    WRENCH,
    encode,
    header,
    make,
)
from skin.io.messages.diagnostics import Diagnostics
from skin.io.messages.record import contacts_of

__all__ = ["SkinMessages", "state_message"]

CLOUDS_NS, DIAGNOSTICS_NS = 50_000_000, 1_000_000_000
"""Intervals of clouds and of frames of patches, and of diagnostics, which ROS tools expect."""
NOTHING = np.zeros(6)
NEVER_NS = -(1 << 62)


class SkinMessages:
    """Messages of a skin.

    Parameters
    ----------
    skin : mapping
        As of `skin.io.messages.record.described`.
    into : str
        Output that drops cycles, as diagnostics name it: "recording" or "publishing".
    name : str
        Of the skin in diagnostics.
    frame : str
        Name of the skin frame; those of patches are ``<frame>/<patch>``.

    Attributes
    ----------
    diagnostics : Diagnostics
    """

    def __init__(
        self,
        skin: Mapping[str, Any],
        into: str,
        *,
        name: str = "skin",
        frame: str = "skin",
    ) -> None:
        self.diagnostics = Diagnostics(skin, into, name)
        self._skin, self._frame = skin, frame
        self._position = np.array(skin["position"], float).reshape(3, -1)
        self._rotation = np.array(skin["rotation"], float).reshape(9, -1)
        self._patch = patch = np.array(skin["patch"], np.int32)
        self._carriers = [
            (f"{frame}/{name}", _middle(self._position, np.flatnonzero(patch == i)))
            for i, name in enumerate(skin["patches"])
            if (patch == i).any()
        ]
        self._slots: dict[int, int] = {}
        self._moved = 0
        self._clouds_ns = self._diagnostics_ns = NEVER_NS

    def layout(self, stamp_ns: int) -> Iterator[tuple[str, bytes]]:
        """Topics and messages of the layout, and the first frames of the patches."""
        skin = self._skin
        yield LAYOUT, encode(LAYOUT, make(
            "f3t_msgs/msg/SkinLayout", header(stamp_ns, self._frame), skin["topology"],
            [*skin["names"]], [*skin["patches"]], self._patch, self._position.ravel(),
            self._rotation.ravel(),
        ))  # fmt: skip
        yield TF, self.transforms(stamp_ns)

    def moves(self, record: np.ndarray, stamp_ns: int) -> Iterator[tuple[str, bytes]]:
        """The topic and message of the poses, where they have changed since the last record."""
        if record["moved"] != self._moved:
            self._moved = int(record["moved"])
            self._position, self._rotation = record["pose"][:3].copy(), record["pose"][3:].copy()
            yield POSES, encode(POSES, make(
                "f3t_msgs/msg/SkinPoses", header(stamp_ns, self._frame), self._position.ravel(),
                self._rotation.ravel(), record["q"],
            ))  # fmt: skip

    def transforms(self, stamp_ns: int) -> bytes:
        """Frames of the patches as ``tf2_msgs/msg/TFMessage``: the pose of each patch's middle
        unit."""
        head, found = header(stamp_ns, self._frame), []
        for child, unit in self._carriers:
            turn = Rotation.from_matrix(self._rotation[:, unit].reshape(3, 3))
            place = make("geometry_msgs/msg/Vector3", *self._position[:, unit].tolist())
            x, y, z, w = turn.as_quat(canonical=True).tolist()
            turned = make("geometry_msgs/msg/Quaternion", x, y, z, w)
            to = make("geometry_msgs/msg/Transform", place, turned)
            found.append(make("geometry_msgs/msg/TransformStamped", head, child, to))
        return encode(TF, make("tf2_msgs/msg/TFMessage", found))

    def of_state(self, record: np.ndarray) -> Iterator[tuple[str, bytes]]:
        """Topics and messages of the state in a record: state and wrenches; clouds, frames of
        patches and diagnostics if they are due. An ended contact has one more wrench, of zeros."""
        stamp_ns = max(0, int(record["stamp_ns"]))
        head = header(stamp_ns, self._frame)
        yield STATE, encode(STATE, state_message(head, record))
        if not np.isnan(record["wrench"][0]):
            yield WRENCH, _stamped(head, record["wrench"])
        for slot, wrench in self._contacts(contacts_of(record)):
            yield f"{CONTACT}/{slot}", _stamped(head, wrench)
        if abs(stamp_ns - self._clouds_ns) >= CLOUDS_NS:
            self._clouds_ns = stamp_ns
            yield POINTS, encode(POINTS, clouds.units(head, self._position, record))
            yield FORCES, encode(FORCES, clouds.forces(head, self._position, record))
            yield TF, self.transforms(stamp_ns)
        if abs(stamp_ns - self._diagnostics_ns) >= DIAGNOSTICS_NS:
            self._diagnostics_ns = stamp_ns
            yield DIAGNOSTICS, self.diagnostics.message(record)

    def _contacts(self, contacts: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Wrenches of contacts, each with its number: the lowest free one at its begin, kept until
        its end."""
        present = contacts["id"].tolist()
        ended = [self._slots.pop(one) for one in list(self._slots) if one not in present]
        taken = set(self._slots.values())
        for identity, contact in zip(present, contacts, strict=True):
            if identity not in self._slots:
                slot = next(number for number in range(len(taken) + 1) if number not in taken)
                taken.add(slot)
                self._slots[identity] = slot
            yield self._slots[identity], contact["wrench"]
        for slot in ended:
            if slot not in taken:
                yield slot, NOTHING


def state_message(head: Any, record: np.ndarray) -> Any:
    """The state in a record as ``f3t_msgs/msg/SkinState``; NaN where a unit is invalid."""
    wrong = clouds.invalid(record)
    force, sigma, warm = (
        np.where(wrong, np.float32(np.nan), record[name])
        for name in ("force", "force_sigma", "temperature")
    )
    return make(
        "f3t_msgs/msg/SkinState", head, max(0, int(record["cycle"])), force.ravel(),
        sigma.ravel(), warm, record["test_ratio"], record["status"], record["contact"],
        bool(record["whole"]), _contact_messages(contacts_of(record)),
    )  # fmt: skip


def _contact_messages(contacts: np.ndarray) -> list[Any]:
    """Each contact as ``f3t_msgs/msg/Contact``."""
    if not contacts.size:
        return []
    found = []
    for one in QUANTITIES:
        values = one.values(contacts)
        if one.message in PARTS:
            found.append([PARTS[one.message](row) for row in values])
        else:
            found.append([*values] if values.ndim > 1 else values.tolist())
    return [make("f3t_msgs/msg/Contact", *row) for row in zip(*found, strict=True)]


def _wrench(six: np.ndarray) -> Any:
    x, y, z, *torque = six.tolist()
    force = make("geometry_msgs/msg/Vector3", x, y, z)
    return make("geometry_msgs/msg/Wrench", force, make("geometry_msgs/msg/Vector3", *torque))


PARTS = {
    "geometry_msgs/Wrench": _wrench,
    "geometry_msgs/Point": lambda row: make("geometry_msgs/msg/Point", *row.tolist()),
    "geometry_msgs/Vector3": lambda row: make("geometry_msgs/msg/Vector3", *row.tolist()),
}
"""Fields of a contact that are messages themselves, from their numbers."""


def _stamped(head: Any, wrench: np.ndarray) -> bytes:
    return encode(WRENCH, make("geometry_msgs/msg/WrenchStamped", head, _wrench(wrench)))


def _middle(position: np.ndarray, units: np.ndarray) -> int:
    """The unit that is nearest to the mean position of some units."""
    own = position[:, units]
    away = np.linalg.norm(own - own.mean(axis=1, keepdims=True), axis=0)
    return int(units[np.argmin(away)])
