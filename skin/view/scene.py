"""The skin in three dimensions, on a viser server, which sends only what has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from skin.io.messages.record import contacts_of
from skin.view import drawing
from skin.view.colour import (
    OFF_COLOUR,
    OFF_SIZE,
    QUANTITIES,
    Scale,
    colours,
    is_on,
    rendered,
    valid,
)
from skin.view.drawing import Frame, Pose
from skin.view.links import Links
from topology import Topology

__all__ = ["BACKGROUND", "Scales", "Scene"]

AMBIENT, DIRECTED = 4.3, 0.7
"""Lights, which `rendered` is fitted to: an even one, and one from above, for edges."""
BACKGROUND = (66, 72, 80)
FORCE_COLOUR = np.array([240, 242, 245], np.uint8)
NORMAL_COLOUR = np.array([150, 160, 172], np.uint8)
CROSS_COLOUR = (1, 1, 1)
RIM_COLOUR = np.array([186, 194, 204], np.uint8)
"""Of the rim of a unit: 3 to 1 and more against the background (WCAG 2.2, 1.4.11), which an idle
unit, dark blue, does not have."""
CHOSEN_COLOUR = np.array([255, 92, 205], np.uint8)
"""Of the rim of the chosen unit: not on the scale, nor a colour of a contact."""
RIM, CHOSEN_RIM, BELOW = 1.06, 1.25, 0.02
"""Radius of rims, and their depth below the disc, over its radius."""
AXES = 0.07
"""Length of the axes (x red, y green, z blue)."""
BLANK = "contact 0   0.00 N   stick   margin 00 %"
"""Text of a label without a contact: the client sizes its box by the first text."""
LIFT = 0.03
"""Height of a label above its arrow."""
NOWHERE = np.float32(1e-6)
"""Size of a hidden instance: instances cannot be removed."""


class Scales:
    """Scales of all quantities and of both kinds of arrows, which grow with the values shown."""

    def __init__(self) -> None:
        self.of = {name: Scale(one.least, one.from_zero) for name, one in QUANTITIES.items()}
        self.unit, self.contact = Scale(1.0), Scale(1.0)

    def widen(self, record: np.void, quantity: str) -> None:
        """Include the values of a snapshot."""
        heard = valid(record)
        self.unit.widen(np.linalg.norm(record["force"], axis=0)[heard])
        self.contact.widen(np.linalg.norm(contacts_of(record)["wrench"][:, :3], axis=1))
        self.of[quantity].widen(QUANTITIES[quantity].values(record)[heard])

    def reset(self) -> None:
        """Reset all scales."""
        for scale in (*self.of.values(), self.unit, self.contact):
            scale.reset()


class Scene:
    """All objects of the picture.

    Parameters
    ----------
    server : viser.ViserServer
    topology : Topology
    pose : Pose
        Of the first picture.
    choose : callable
        Called with the index of a unit that is clicked on, in a thread of the server.

    Attributes
    ----------
    links : Links or None
    """

    def __init__(
        self, server: Any, topology: Topology, pose: Pose, choose: Callable[[int], None]
    ) -> None:
        self._scene, self._topology, self._pose = server.scene, topology, pose
        radius = drawing.radii(pose.position, topology.area)
        self.frame: Frame = drawing.frame_of(pose, radius)
        self._radius = (radius * self.frame.scale).astype(np.float32)
        self._up = drawing.camera(pose)[2].astype(np.float32)
        self._set_up()
        self.links = None
        if topology.robot is not None:
            self.links = Links(self._scene, topology.robot, self.frame)
        colours = self._rim_colours(None)
        self._rims = self._batch("/rims", drawing.disc(), RIM * self._radius, colours)
        self._discs = self._batch("/units", drawing.disc(), self._radius, colours)
        self._discs.on_click(lambda event: choose(event.instance_index))
        hidden = np.full_like(radius, NOWHERE)
        self._crosses = self._batch("/flags", drawing.cross(), hidden, CROSS_COLOUR)
        shaft = min(0.006, 0.16 * float(self._radius.mean()))
        self._forces = self._arrows("/forces", FORCE_COLOUR, shaft)
        self._normals = self._arrows("/contacts/normals", NORMAL_COLOUR, 0.004)
        self._wrenches = self._arrows("/contacts/forces", np.zeros((0, 3), np.uint8), 0.008)
        self._labels: list[Any] = []
        self._chosen: int | None = None
        self._tags = {
            at: self._scene.add_label(
                f"/patches/{at}", topology.patch_names[at], anchor="center-center",
                font_screen_scale=0.85,
            )
            for at in np.unique(topology.patch).tolist()
        }  # fmt: skip
        self._place(pose)
        # of the skin frame, at the lowest corner of all that is drawn
        self._scene.add_frame(
            "/axes", axes_length=AXES, axes_radius=0.035 * AXES, origin_radius=0.0,
            position=self.points.min(axis=0) - self._radius.max() - 0.5 * AXES,
        )  # fmt: skip
        self._look(server.initial_camera, pose)

    def _look(self, view: Any, pose: Pose) -> None:
        """Let a camera see units and links, from the side that most units face."""
        points = self.points
        low, high = points.min(axis=0), points.max(axis=0)
        place, look, up = drawing.camera(pose)
        size, middle = max(1.0, float((high - low).max())), 0.5 * (low + high)
        view.position, view.look_at, view.up = middle + size * place, middle + size * look, up
        view.near, view.far = 0.01, 50.0

    def look_from_top(self, camera: Any) -> None:
        """Turn the camera of a browser onto the face of the largest patch."""
        middle, outward, up = drawing.top(self._pose, self._topology.patch)
        at = self.frame.points(middle[:, np.newaxis])[0]
        camera.position, camera.look_at, camera.up_direction = at + 1.2 * outward, at, up

    @property
    def points(self) -> np.ndarray:
        """Corners of what is drawn: units and links, picture units, shape (m, 3)."""
        points = self.frame.points(self._pose.position)
        return points if self.links is None else np.concatenate([points, self.links.points()])

    def draw(
        self,
        record: np.void,
        pose: Pose,
        scales: Scales,
        quantity: str = "load",
        unit: int | None = None,
        *,
        words: bool = True,
    ) -> None:
        """Draw a snapshot, coloured by a quantity, with the chosen unit marked; without `words`,
        labels of contacts keep their texts."""
        if pose is not self._pose:
            self._place(pose)
        self._colour(record, quantity, scales)
        if unit != self._chosen:
            self._chosen = unit
            size = np.full_like(self._radius, RIM)
            if unit is not None:
                size[unit] = CHOSEN_RIM
            self._rims.batched_scales = _cubes(size * self._radius)
            self._rims.batched_colors = self._rim_colours(unit)
        self._put(
            self._forces,
            drawing.unit_arrows(record, pose, self.frame, self._radius, scales.unit.high),
        )
        forces, normals, hues, known = drawing.contact_arrows(
            record, self.frame, scales.contact.high
        )
        self._put(self._normals, normals)
        self._put(self._wrenches, forces, rendered(hues))
        self._label(record, dict(zip(known.tolist(), forces[:, 0], strict=True)), words)

    def _colour(self, record: np.void, quantity: str, scales: Scales) -> None:
        """Colour the discs, and cross out units that are not valid."""
        heard, on, scale = valid(record), is_on(record["status"]), scales.of[quantity]
        seen = colours(QUANTITIES[quantity].values(record), heard, scale.low, scale.high)
        seen[~on] = OFF_COLOUR
        self._discs.batched_colors = rendered(seen)
        self._discs.batched_scales = _cubes(np.where(on, 1.0, OFF_SIZE) * self._radius)
        self._crosses.batched_scales = _cubes(np.where(heard | ~on, NOWHERE, self._radius))

    def _rim_colours(self, unit: int | None) -> np.ndarray:
        colours = np.repeat(RIM_COLOUR[np.newaxis], self._radius.size, axis=0)
        if unit is not None:
            colours[unit] = CHOSEN_COLOUR
        return rendered(colours)

    def _label(self, record: np.void, tails: dict[int, np.ndarray], words: bool) -> None:
        """Place labels at the tails of arrows, as many as there have been contacts at once."""
        while len(self._labels) <= max(tails, default=-1):
            name = f"/contacts/{len(self._labels)}"
            self._labels.append(
                self._scene.add_label(name, BLANK, visible=False, anchor="bottom-center")
            )
        texts = [drawing.contact_label(one) for one in contacts_of(record)] if words else []
        for k, label in enumerate(self._labels):
            if words:
                label.visible = k in tails
            if k in tails and words:
                label.text = texts[k]
            if k in tails and label.visible:  # to a pixel: viser sends what has changed
                label.position = np.round(tails[k] + LIFT * self._up, 3)

    def _place(self, pose: Pose) -> None:
        """Move all that moves with the joints."""
        self._pose = pose
        if self.links is not None:
            self.links.move(pose.q)
        points, turns = self.frame.points(pose.position), drawing.quaternions(pose.rotation)
        below = pose.rotation[:, 2].T * (BELOW * self._radius[:, np.newaxis])
        for batch, shift in ((self._discs, 0.0), (self._crosses, 0.0), (self._rims, below)):
            batch.batched_positions = (points + shift).astype(np.float32)
            batch.batched_wxyzs = turns
        places = drawing.tag_places(
            points, pose, self._topology.patch, len(self._topology.patch_names)
        )
        for at, tag in self._tags.items():
            tag.position = places[at]

    def _batch(
        self, name: str, mesh: tuple[np.ndarray, np.ndarray], size: np.ndarray, colours: Any
    ) -> Any:
        """A mesh for each unit, of sizes, shape (n,)."""
        n = size.size
        return self._scene.add_batched_meshes_simple(
            name, *mesh, np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (n, 1)),
            np.zeros((n, 3), np.float32), batched_scales=_cubes(size), lod="off", side="double",
            batched_colors=colours, cast_shadow=False,
            receive_shadow=False, flat_shading=True,
        )  # fmt: skip

    def _arrows(self, name: str, hues: np.ndarray, shaft: float) -> Any:
        return self._scene.add_arrows(
            name, np.zeros((0, 2, 3), np.float32), rendered(hues), shaft_radius=shaft,
            head_radius=2.1 * shaft, head_length=4.2 * shaft, visible=False,
        )  # fmt: skip

    def _put(self, arrows: Any, points: np.ndarray, hues: np.ndarray | None = None) -> None:
        """Set arrows; none of them are one that is not visible."""
        arrows.visible = len(points) > 0
        if len(points):
            arrows.points = points
            if hues is not None:
                arrows.colors = hues

    def _set_up(self) -> None:
        """Lights that keep the colours, and the direction that is up."""
        scene = self._scene
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light/everywhere", intensity=AMBIENT)
        scene.add_light_directional("/light/above", intensity=DIRECTED, position=(1.0, -1.0, 2.0))
        scene.world_axes.visible = False
        scene.set_background_image(np.full((2, 2, 3), BACKGROUND, np.uint8), format="png")
        scene.set_up_direction(self._up)


def _cubes(size: np.ndarray) -> np.ndarray:
    """Sizes along all three axes, shape (n, 3)."""
    return np.repeat(size[:, np.newaxis], 3, axis=1).astype(np.float32)
