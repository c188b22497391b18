"""Units and contacts as point clouds, which RViz, Foxglove and rerun all draw."""

from __future__ import annotations

from typing import Any

import numpy as np

from bus.status import INVALID
from skin.cividis import cividis
from skin.io.messages.definitions import make
from skin.io.messages.record import contacts_of

__all__ = ["forces", "invalid", "units"]

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
FULL_SCALE_N = 6.0
"""Load at the end of the colour scale."""
WRONG = (217.0, 26.0, 140.0)
"""Colour of a unit that is not valid; not on the scale."""
TOUCH = np.array([(153, 153, 153), (51, 128, 255), (255, 153, 0), (255, 51, 26)], float)
"""Colour of a contact by its slip."""


def invalid(record: np.ndarray) -> np.ndarray:
    """Units whose numbers may not be used, shape (n,), bool."""
    return record["status"] & int(INVALID) != 0


def units(head: Any, position: np.ndarray, record: np.ndarray) -> Any:
    """The units in a cycle as ``sensor_msgs/msg/PointCloud2``, coloured by load.

    Parameters
    ----------
    head : std_msgs/Header
    position : ndarray, shape (3, n)
    record : void
        Of a cycle; see `skin.io.messages.record.record_dtype`.
    """
    load = record["force"][2].astype(float)
    wrong = invalid(record) | np.isnan(record["force"]).any(axis=0)
    load[wrong] = np.nan
    colours = cividis(np.nan_to_num(load) / FULL_SCALE_N)
    colours[wrong] = WRONG
    return _cloud(head, position.T, load, colours, UNIT_M)


def forces(head: Any, position: np.ndarray, record: np.ndarray) -> Any:
    """The forces of contacts in a cycle as ``sensor_msgs/msg/PointCloud2``: a row of points for
    each, from its centroid, thinner towards the tip; coloured by slip. A contact whose centroid is
    not known begins at the mean of its units. Parameters are those of `units`."""
    contacts, share = contacts_of(record), np.linspace(0.0, 1.0, IN_ROW)
    start = np.array(contacts["centroid"], float)
    for k in np.flatnonzero(np.isnan(start).any(axis=1)):
        start[k] = position[:, record["contact"] == k].mean(axis=1)
    force = METRE_PER_NEWTON * contacts["wrench"][:, :3]
    at = start[:, np.newaxis] + share[:, np.newaxis] * force[:, np.newaxis]
    load = np.repeat(contacts["load"].astype(float), IN_ROW)
    colours = np.repeat(TOUCH[contacts["slip"] & 3], IN_ROW, axis=0)
    radii = np.tile(UNIT_M / 2.0 + share * (TIP_M - UNIT_M / 2.0), contacts.size)
    return _cloud(head, at.reshape(-1, 3), load, colours, radii)


def _cloud(
    head: Any, at: np.ndarray, load: np.ndarray, colours: np.ndarray, radii: np.ndarray | float
) -> Any:
    """Points with their loads, colours from 0 to 255, shape (m, 3), and radii."""
    points = np.empty(len(at), POINT)
    points["x"], points["y"], points["z"] = at.T
    points["load"], points["radii"] = load, radii
    points["rgb"] = np.rint(colours).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], "u4")
    points["colors"] = points["rgb"] << 8 | 0xFF
    fields = [
        make("sensor_msgs/msg/PointField", name, offset, POINT_FIELD[kind.str[1:]], 1)
        for name, (kind, offset, *_) in (POINT.fields or {}).items()
    ]
    return make(
        "sensor_msgs/msg/PointCloud2", head, 1, len(points), fields, False, POINT.itemsize,
        points.nbytes, points.view("u1"), not np.isnan(points["load"]).any(),
    )  # fmt: skip
