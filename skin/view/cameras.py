"""Camera presets of a browser: directions of view that fit the skin next to the panel."""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.view.drawing import directions
from skin.view.history import Pose

__all__ = ["FIT", "VIEWS", "fitted", "set_camera"]

FIT = "fit"
VIEWS = (FIT, "front", "left", "right", "top")
"""`FIT` keeps the direction of view."""
PANEL_PX = 390.0
"""Width of the panel [viser 1.1: "large", with its margin]."""
MARGIN = 0.05
"""Free share of the picture on each side of what is fitted [assumed]."""
NEAREST = 0.1
"""Least distance of the camera from what is fitted: a tenth of the skin [assumed]."""


def direction_of(name: str, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """From the skin to the camera, and up, of a preset other than `FIT`: axes of the skin frame,
    the front being the one that most units face."""
    outward, up, _ = directions(pose)
    front = np.zeros(3)
    front[np.abs(outward).argmax()] = np.sign(outward[np.abs(outward).argmax()])
    rest = up - (up @ front) * front
    above = np.zeros(3)
    above[np.abs(rest).argmax()] = np.sign(rest[np.abs(rest).argmax()])
    side = np.cross(above, front)
    return {
        "front": (front, above), "left": (-side, above), "right": (side, above),
        "top": (above, -front),
    }[name]  # fmt: skip


def fitted(
    points: np.ndarray, toward: np.ndarray, up: np.ndarray, fov: float, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Position and target of a camera that has all points in the picture, left of the panel.

    Parameters
    ----------
    points : ndarray, shape (m, 3)
    toward, up : ndarray, shape (3,)
        From the target to the camera, and up; unit vectors.
    fov : float
        Vertical field of view, rad.
    size : (int, int)
        Width and height of the picture, pixels.
    """
    width, height = max(size[0], 1), max(size[1], 1)
    free = width - PANEL_PX if width > 2.0 * PANEL_PX else float(width)
    up = up - (up @ toward) * toward
    up = up / np.linalg.norm(up)
    axes = np.stack([np.cross(up, toward), up, toward], axis=1)
    across, along, near = (points @ axes).T
    focal = 0.5 * height / np.tan(0.5 * fov)
    # a camera at a, d sees x, z at focal (x - a) / (d - z) pixels from the middle: bounds of these
    # are lines in a and d, which leave room for a from the d on at which they meet
    left, right = (
        (0.5 * width - MARGIN * free) / focal,
        (free - MARGIN * free - 0.5 * width) / focal,
    )
    half = (0.5 - MARGIN) * height / focal
    distance = max(
        float(np.max(across + right * near) - np.min(across - left * near)) / (left + right),
        float(np.max(along + half * near) - np.min(along - half * near)) / (2.0 * half),
        float(near.max()) + NEAREST,
    )
    away = distance - near
    place = np.array([
        0.5 * (np.max(across - right * away) + np.min(across + left * away)),
        0.5 * (np.max(along - half * away) + np.min(along + half * away)), distance,
    ])  # fmt: skip
    target = place * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.5 * (near.min() + near.max())]
    return axes @ place, axes @ target


def set_camera(camera: Any, name: str, points: np.ndarray, pose: Pose) -> None:
    """Set the camera of a browser to one of `VIEWS`."""
    if name == FIT:
        toward, up = camera.position - camera.look_at, camera.up_direction
        toward = toward / np.linalg.norm(toward)
        if abs(up @ toward) > 0.999 * np.linalg.norm(up):
            toward, up = direction_of("front", pose)
    else:
        toward, up = direction_of(name, pose)
    size = camera.image_width, camera.image_height
    position, target = fitted(points, toward, up, camera.fov, size)
    camera.up_direction = up
    camera.position = position
    camera.look_at = target
