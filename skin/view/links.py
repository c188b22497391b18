"""The links of the robot that carries a skin: their shapes, and how they move with the joints."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.robot.mesh import link_geoms, shape_triangles
from skin.view.colour import rendered_mesh
from skin.view.drawing import Frame, quaternions
from topology.robot.model import Geom, RobotModel

__all__ = ["LinkShapes", "Links"]

LINK_COLOUR = (150, 158, 168)
OPACITY = 0.55
"""Of links: units and arrows behind them stay visible [assumed]."""
AXES_M = 0.012
"""Length of the axes of a link without a shape [assumed: about a unit]."""


class LinkShapes:
    """Shapes of the links of a robot.

    Attributes
    ----------
    meshes : dict of int to (ndarray, ndarray)
        Vertices, shape (v, 3), metre, link frame, and faces, shape (f, 3), by link; links without a
        shape are absent.
    problems : list of (str, str)
        Link and fault of each shape that could not be read: the link is drawn without it.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot
        self.problems: list[tuple[str, str]] = []
        self.meshes: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for link, name in enumerate(robot.link_names):
            shown = link_geoms(robot, link, visual=True)
            parts = [part for geom in shown if len(part := self._triangles(geom, name))]
            if parts:
                corners = np.concatenate(parts).reshape(-1, 3).astype(np.float32)
                vertices, at = np.unique(corners, axis=0, return_inverse=True)
                self.meshes[link] = vertices, at.reshape(-1, 3).astype(np.uint32)

    def _triangles(self, geom: Geom, name: str) -> np.ndarray:
        """Triangles of a shape in the frame of its link, shape (f, 3, 3); none of a faulty one."""
        try:
            return shape_triangles(geom)
        except (SkinError, ImportError) as error:
            self.problems.append((name, str(error)))
            sys.stderr.write(f"view: link {name!r}: {error}; drawn without it\n")
            return np.zeros((0, 3, 3))


class Links:
    """The links in a scene; those without a shape are axes.

    Where the joints are unknown (`skin.Skin.move` with poses alone), links would stand in a wrong
    place and are hidden.

    Parameters
    ----------
    scene : viser.SceneApi
    shapes : LinkShapes
    frame : Frame

    Attributes
    ----------
    extent : ndarray, shape (m, 3)
        Corners of the shapes, picture units, after `move`.
    """

    def __init__(self, scene: Any, shapes: LinkShapes, frame: Frame) -> None:
        self._frame, self._robot = frame, shapes.robot
        self._nodes: dict[int, Any] = {}
        self._corners: dict[int, np.ndarray] = {}
        self._is_known, self._is_wanted = True, True
        self.extent = np.zeros((0, 3))
        for link, name in enumerate(shapes.robot.link_names):
            if not name:
                continue
            if link not in shapes.meshes:
                length = AXES_M * frame.scale
                self._nodes[link] = scene.add_frame(
                    f"/links/{link}", axes_length=length, axes_radius=0.06 * length,
                    origin_radius=0.0,
                )  # fmt: skip
                self._corners[link] = np.zeros((1, 3))
                continue
            vertices, faces = shapes.meshes[link]
            self._nodes[link] = scene.add_mesh_simple(
                f"/links/{link}", vertices * np.float32(frame.scale), faces,
                color=rendered_mesh(LINK_COLOUR), opacity=OPACITY, flat_shading=True,
                side="double", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            grid = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1)
            self._corners[link] = grid.reshape(-1, 3)

    def move(self, q: np.ndarray) -> None:
        """Place the links by the joints, shape (J,), rad or m; NaN where unknown."""
        self._is_known = bool(q.size == self._robot.home.size and np.isfinite(q).all())
        self.show(self._is_wanted)
        if not self._is_known:
            return
        poses = self._robot.forward(q)
        points = self._frame.points(poses[:, :3, 3].T)
        turns = quaternions(np.moveaxis(poses[:, :3, :3], 0, 2))
        for link, node in self._nodes.items():
            node.position, node.wxyz = points[link], turns[link]
        self.extent = np.concatenate([
            self._frame.points((corners @ poses[link, :3, :3].T + poses[link, :3, 3]).T)
            for link, corners in self._corners.items()
        ])  # fmt: skip

    def show(self, on: bool) -> None:
        """Show or hide them."""
        self._is_wanted = on
        for node in self._nodes.values():
            if node.visible is not (on and self._is_known):
                node.visible = on and self._is_known
