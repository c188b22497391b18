"""What a view knows of a skin apart from its snapshots: names, patches, the robot that carries it.

The skin's process describes it as JSON (`described_layout`), the view's reads it (`layout_of`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skin.view.links import LinkShapes
from topology import Topology
from topology.packed import robot_of, robot_text

__all__ = ["Layout", "described_layout", "layout_of"]


class Layout(NamedTuple):
    """Constant properties of a skin of n units in p patches."""

    title: str
    area: np.ndarray
    """Square metre, shape (n,)."""
    names: tuple[str, ...]
    """Of the units."""
    patch: np.ndarray
    """Index of the patch of each unit, shape (n,), int."""
    patch_names: tuple[str, ...]
    links: LinkShapes | None
    """None without a robot."""


def described_layout(topology: Topology) -> dict[str, Any]:
    """The layout of a topology, as JSON."""
    return {
        "title": topology.name,
        "area": topology.area.tolist(),
        "names": list(topology.unit_names),
        "patch": topology.patch.tolist(),
        "patch_names": list(topology.patch_names),
        "robot": None if topology.robot is None else robot_text(topology.robot),
    }


def layout_of(described: dict[str, Any]) -> Layout:
    """The layout that was described, with the meshes of the links."""
    robot = described["robot"]
    return Layout(
        described["title"], np.array(described["area"]), tuple(described["names"]),
        np.array(described["patch"], np.int64), tuple(described["patch_names"]),
        None if robot is None else LinkShapes(robot_of(robot)),
    )  # fmt: skip
