"""The links of the robot that carries a skin: their shapes, and how they move with the joints."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.robot.mesh import link_geoms, shape_triangles
from skin.view.drawing import Frame, quaternions
from topology.robot.model import Geom, RobotModel

__all__ = ["Links"]

LINK_COLOUR = (110, 117, 126)
OPACITY = 0.55
"""Of links: units and arrows behind them stay visible [assumed]."""
AXES_M = 0.012
"""Length of the axes of a link without a shape [assumed: about a unit]."""


class Links:
    """The links in a scene; those without a shape are axes.

    Where the joints are unknown (`skin.Skin.move` with poses alone), links would stand in a wrong
    place and are hidden.

    Parameters
    ----------
    scene : viser.SceneApi
    robot : RobotModel
    frame : Frame

    Attributes
    ----------
    problems : list of (str, str)
        Link and fault of each shape that could not be read: the link is drawn without it.
    """

    def __init__(self, scene: Any, robot: RobotModel, frame: Frame) -> None:
        self._frame, self._robot = frame, robot
        self.problems: list[tuple[str, str]] = []
        self._nodes: dict[int, Any] = {}
        self._vertices: dict[int, np.ndarray] = {}
        self._poses = robot.forward(robot.home)
        for link, name in enumerate(robot.link_names):
            if not name:
                continue
            shown = link_geoms(robot, link, visual=True)
            parts = [part for geom in shown if len(part := self._triangles(geom, name))]
            if not parts:
                length = AXES_M * frame.scale
                self._vertices[link] = np.zeros((1, 3))
                self._nodes[link] = scene.add_frame(
                    f"/links/{link}", axes_length=length, axes_radius=0.06 * length,
                    origin_radius=0.0,
                )  # fmt: skip
                continue
            corners = np.concatenate(parts).reshape(-1, 3).astype(np.float32)
            vertices, at = np.unique(corners, axis=0, return_inverse=True)
            self._vertices[link] = vertices
            self._nodes[link] = scene.add_mesh_simple(
                f"/links/{link}", vertices * np.float32(frame.scale),
                at.reshape(-1, 3).astype(np.uint32), color=LINK_COLOUR, opacity=OPACITY,
                flat_shading=True, side="double", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip

    def _triangles(self, geom: Geom, name: str) -> np.ndarray:
        """Triangles of a shape in the frame of its link, shape (f, 3, 3); none of a faulty one."""
        try:
            return shape_triangles(geom)
        except (SkinError, ImportError) as error:
            self.problems.append((name, str(error)))
            sys.stderr.write(f"view: link {name!r}: {error}; drawn without it\n")
            return np.zeros((0, 3, 3))

    def move(self, q: np.ndarray) -> None:
        """Place the links by the joints, shape (J,), rad or m; NaN where unknown."""
        known = bool(q.size == self._robot.home.size and np.isfinite(q).all())
        for node in self._nodes.values():
            node.visible = known
        if not known:
            return
        self._poses = poses = self._robot.forward(q)
        points = self._frame.points(poses[:, :3, 3].T)
        turns = quaternions(np.moveaxis(poses[:, :3, :3], 0, 2))
        for link, node in self._nodes.items():
            node.position, node.wxyz = points[link], turns[link]

    def points(self) -> np.ndarray:
        """Vertices of the shapes as placed last, picture units, shape (m, 3)."""
        poses = self._poses
        return np.concatenate([
            self._frame.points((vertices @ poses[link, :3, :3].T + poses[link, :3, 3]).T)
            for link, vertices in self._vertices.items()
        ])  # fmt: skip
