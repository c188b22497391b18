"""The links of the robot that carries a skin: their shapes, and how they move."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.robot.coordinates import coordinates
from skin.robot.mesh import primitive_mesh, read_mesh
from skin.view.drawing import Frame, quaternions
from skin.view.history import Pose
from skin.view.tone import given_to_mesh
from topology.robot.model import Geom, RobotModel

__all__ = ["LinkShapes", "Links"]

LINK_COLOUR = (150, 158, 168)
OPACITY = 0.55
"""Of links: units and arrows behind them stay visible [assumed]."""
AXES_M = 0.012
"""Length of the axes of a link without a shape [assumed: about a unit]."""


class LinkShapes:
    """Shapes of links, read once by a thread, and the coordinates of poses.

    Parameters
    ----------
    robot : RobotModel
    carriers : sequence of tuple
        Link, unit on it, and T_link_unit as a position in metre and a rotation, for each link that
        carries units.

    Attributes
    ----------
    problems : list of (str, str)
        Link and fault of each shape that could not be read: the link is drawn without it.
    """

    def __init__(self, robot: RobotModel, carriers: Sequence[Any]) -> None:
        self.robot = robot
        self.problems: list[tuple[str, str]] = []
        self._on_link: dict[int, tuple[int, np.ndarray]] = {}
        for link, unit, position, rotation in carriers:
            inverse = np.linalg.inv(_transform(np.array(rotation), np.array(position)))
            self._on_link[link] = unit, inverse
        self._q = np.array(robot.home)
        self._read: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._reader = Thread(target=self._read_all, daemon=True, name="meshes of links")
        self._reader.start()

    def wait(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Vertices, shape (v, 3), metre, link frame, and faces, shape (f, 3), of each link that has
        a shape; waits for the reader."""
        self._reader.join()
        return self._read

    @property
    def is_ready(self) -> bool:
        """Whether all shapes were read."""
        return not self._reader.is_alive()

    def poses(self, pose: Pose) -> np.ndarray:
        """T_skin_link of all links, shape (L, 4, 4), by the joints of a pose, or, where these are
        unknown, by those that fit its units."""
        if pose.q.size == self.robot.home.size and np.isfinite(pose.q).all():
            self._q = pose.q
        else:
            carried = {
                link: _transform(pose.rotation[:, :, unit], pose.position[:, unit]) @ inverse
                for link, (unit, inverse) in self._on_link.items()
            }
            self._q = coordinates(self.robot, carried, self._q)
        return self.robot.forward(self._q)

    def _read_all(self) -> None:
        for link, name in enumerate(self.robot.link_names):
            own = [geom for geom in self.robot.geoms if geom.link == link]
            shown = [geom for geom in own if geom.visual] or own
            parts = [part for geom in shown if len(part := self._triangles(geom, name))]
            if parts:
                corners = np.concatenate(parts).reshape(-1, 3).astype(np.float32)
                vertices, at = np.unique(corners, axis=0, return_inverse=True)
                self._read[link] = vertices, at.reshape(-1, 3).astype(np.uint32)

    def _triangles(self, geom: Geom, name: str) -> np.ndarray:
        """Triangles of a shape in the frame of its link, shape (f, 3, 3); none of a faulty one."""
        try:
            if geom.mesh is None:
                own = primitive_mesh(geom.kind, geom.size)
            else:
                own = read_mesh(Path(geom.mesh)) * np.array(geom.scale)
        except (SkinError, ImportError) as error:
            self.problems.append((name, str(error)))
            sys.stderr.write(f"view: link {name!r}: {error}; drawn without it\n")
            return np.zeros((0, 3, 3))
        return own @ np.array(geom.rotation).reshape(3, 3).T + np.array(geom.xyz)


class Links:
    """The links in a scene; those without a shape are axes.

    Parameters
    ----------
    scene : viser.SceneApi
    shapes : LinkShapes
    frame : Frame
    """

    def __init__(self, scene: Any, shapes: LinkShapes, frame: Frame) -> None:
        self._frame, self._shapes = frame, shapes
        self._nodes: dict[int, Any] = {}
        self.extent = np.zeros((0, 3))
        """Corners of the shapes in their links, picture units, shape (m, 3) after `move`."""
        self._corners: dict[int, np.ndarray] = {}
        read = shapes.wait()
        for link, name in enumerate(shapes.robot.link_names):
            if not name:
                continue
            if link not in read:
                length = AXES_M * frame.scale
                self._nodes[link] = scene.add_frame(
                    f"/links/{link}", axes_length=length, axes_radius=0.06 * length,
                    origin_radius=0.0,
                )  # fmt: skip
                self._corners[link] = np.zeros((1, 3))
                continue
            vertices, faces = read[link]
            self._nodes[link] = scene.add_mesh_simple(
                f"/links/{link}", vertices * np.float32(frame.scale), faces,
                color=given_to_mesh(LINK_COLOUR), opacity=OPACITY, flat_shading=True,
                side="double", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            grid = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1)
            self._corners[link] = grid.reshape(-1, 3)

    def move(self, pose: Pose) -> None:
        """Place the links as the units are."""
        poses = self._shapes.poses(pose)
        points = self._frame.points(poses[:, :3, 3].T)
        turns = quaternions(np.moveaxis(poses[:, :3, :3], 0, 2))
        for link, node in self._nodes.items():
            node.position, node.wxyz = points[link], turns[link]
        self.extent = np.concatenate([
            self._frame.points((corners @ poses[link, :3, :3].T + poses[link, :3, 3]).T)
            for link, corners in self._corners.items()
        ])  # fmt: skip

    @property
    def visible(self) -> bool:
        """Whether they are shown."""
        return all(node.visible for node in self._nodes.values())

    @visible.setter
    def visible(self, on: bool) -> None:
        for node in self._nodes.values():
            node.visible = on


def _transform(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose
