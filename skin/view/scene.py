"""The skin in three dimensions, on a viser server."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skin.io.messages.record import contacts_of
from skin.view.colour import (
    AMBIENT,
    DIRECTED,
    OFF_COLOUR,
    QUANTITIES,
    Range,
    colours,
    is_on,
    rendered,
    valid,
)  # fmt: skip
from skin.view.drawing import (
    Frame,
    Pose,
    camera,
    contact_arrows,
    contact_labels,
    cross,
    directions,
    disc,
    frame_of,
    picked,
    quaternions,
    radii,
    rim,
    tag_places,
    unit_arrows,
)  # fmt: skip
from skin.view.layout import Layout
from skin.view.links import Links

__all__ = ["BACKGROUND", "Scales", "Scene", "Shown", "described_force"]

BACKGROUND = (66, 72, 80)
FORCE_COLOUR = np.array([240, 242, 245], np.uint8)
NORMAL_COLOUR = np.array([150, 160, 172], np.uint8)
CROSS_COLOUR = (1, 1, 1)
RIM_COLOUR = np.array([186, 194, 204], np.uint8)
"""Of the rim of a unit: 3 to 1 and more against the background (WCAG 2.2, 1.4.11), which an idle
unit, dark blue, does not have."""
CHOSEN_COLOUR = np.array([255, 92, 205], np.uint8)
"""Of the chosen unit: not on the scale, nor a colour of a contact."""
CHOSEN_SIZE = 1.16
AXES = 0.07
"""Length of the axes at the corner of the skin."""
BLANK = "contact 0   0.00 N   stick   margin 00 %"
"""Text of a label without a contact: the client sizes its box by the first text."""
LIFT = 0.03
"""Height of a label above its arrow."""
NOWHERE = np.float32(1e-6)
"""Size of a hidden instance: instances cannot be removed."""
STAYS = 0.001
"""Tolerance of the place of a label: less than a pixel of most pictures [assumed]."""


class Shown(NamedTuple):
    """Display options chosen by a person."""

    quantity: str = "load"
    forces: bool = True
    contacts: bool = True
    links: bool = True
    names: bool = True
    unit: int | None = None
    """The chosen one."""


class Scales:
    """Scales of all quantities and of both kinds of arrows, which grow with the values shown."""

    def __init__(self) -> None:
        self.of = {label: Range(quantity) for label, quantity in QUANTITIES.items()}
        self.unit = Range(QUANTITIES["load"])
        self.contact = Range(QUANTITIES["load"])

    def widen(self, record: np.void, quantity: str) -> bool:
        """Include the values of a snapshot; True where the scale of the quantity changed."""
        heard = valid(record)
        self.unit.widen(_lengths(record["force"])[heard])
        self.contact.widen(_lengths(contacts_of(record)["wrench"][:, :3].T))
        return self.of[quantity].widen(QUANTITIES[quantity].values(record)[heard])

    def ends(self, quantity: str) -> tuple[object, ...]:
        """The contents of the legend of a quantity and of the arrows."""
        scale = self.of[quantity]
        return quantity, scale.low, scale.high, self.unit.high, self.contact.high

    def reset(self) -> None:
        """Reset all scales."""
        for scale in (*self.of.values(), self.unit, self.contact):
            scale.reset()


class Scene:
    """All objects of the picture.

    Parameters
    ----------
    server : viser.ViserServer
    layout : Layout
    pose : Pose
        Of the first picture.
    """

    def __init__(self, server: Any, layout: Layout, pose: Pose) -> None:
        self._server, self._scene, self._layout = server, server.scene, layout
        self._pose = pose
        radius = radii(pose.position, layout.area)
        self.frame: Frame = frame_of(pose, radius)
        self._radius = (radius * self.frame.scale).astype(np.float32)
        self._n = layout.area.size
        self._set_up()
        self._links = None if layout.links is None else Links(self._scene, layout.links, self.frame)
        if self._links is not None:
            self._links.move(pose.q)
        points, turns = self.frame.points(pose.position), quaternions(pose.rotation)
        size = np.repeat(self._radius[:, np.newaxis], 3, axis=1)
        self._discs = self._scene.add_batched_meshes_simple(
            "/units", *disc(), turns, points, batched_scales=size, lod="off", side="double",
            batched_colors=np.full((self._n, 3), 90, np.uint8), cast_shadow=False,
            receive_shadow=False, flat_shading=True,
        )  # fmt: skip
        self._rims = self._scene.add_batched_meshes_simple(
            "/rims", *rim(), turns, points, batched_scales=size, lod="off", side="double",
            batched_colors=self._rim_colours(None), cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._chosen: int | None = None
        self._crosses = self._scene.add_batched_meshes_simple(
            "/flags", *cross(), turns, points, batched_scales=NOWHERE * size, lod="off",
            side="double", batched_colors=CROSS_COLOUR, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        none = np.zeros((0, 2, 3), np.float32)
        shaft = min(0.006, 0.16 * float(self._radius.mean()))
        self._forces = self._arrows("/forces", none, FORCE_COLOUR, shaft)
        self._normals = self._arrows("/normals", none, NORMAL_COLOUR, 0.004)
        self._wrenches = self._arrows("/wrenches", none, np.zeros((0, 3), np.uint8), 0.008)
        self._hues, self._heard = np.zeros((0, 3), np.uint8), np.ones(self._n, bool)
        self._sent = np.zeros((0, 3), np.uint8)
        self._texts: list[str] = []
        self._tails: list[np.ndarray] = []
        self._labels: list[Any] = []
        self._unit_label = self._scene.add_label(
            "/chosen", "", visible=False, anchor="bottom-left", font_screen_scale=0.9
        )
        self._unit_text = ""
        self._add_names(points)
        view = server.initial_camera
        view.position, view.look_at, view.up = self._view()
        view.near, view.far = 0.01, 50.0

    @property
    def points(self) -> np.ndarray:
        """Corners of what is drawn: units and links, picture units, shape (m, 3)."""
        points = self.frame.points(self._pose.position)
        return points if self._links is None else np.concatenate([points, self._links.extent])

    def pick(self, origin: Any, direction: Any) -> int | None:
        """The unit that a ray meets first; see `skin.view.drawing.picked`."""
        pose = self._pose
        return picked(
            np.array(origin), np.array(direction), self.frame.points(pose.position),
            pose.rotation[:, 2], self._radius,
        )  # fmt: skip

    def draw(
        self, record: np.void, pose: Pose, shown: Shown, scales: Scales, *, words: bool = True
    ) -> None:
        """Draw a snapshot; without `words`, existing labels keep their texts."""
        if self._links is not None:
            self._links.show(shown.links)
        if pose is not self._pose:
            self._move(pose)
        for node in self._named:
            if node.visible is not shown.names:
                node.visible = shown.names
        self._colour(record, shown.quantity, scales)
        arrows = np.zeros((0, 2, 3), np.float32)
        if shown.forces:
            arrows = unit_arrows(record, pose, self.frame, self._radius, scales.unit.high)
        self._put(self._forces, arrows)
        forces, normals, hues, known = contact_arrows(record, self.frame, scales.contact.high)
        if not shown.contacts:
            forces, normals, hues, known = forces[:0], normals[:0], hues[:0], known[:0]
        self._put(self._normals, normals)
        self._put(self._wrenches, forces, hues)
        self._label(record, dict(zip(known.tolist(), forces[:, 0], strict=True)), words)
        self._choose(record, shown.unit, words)

    def _colour(self, record: np.void, quantity: str, scales: Scales) -> None:
        """Colour the discs, and cross out units that are not valid."""
        heard, on, scale = valid(record), is_on(record["status"]), scales.of[quantity]
        seen = colours(QUANTITIES[quantity].values(record), heard, scale.low, scale.high)
        seen[~on] = OFF_COLOUR
        if not np.array_equal(seen, self._sent):
            self._sent = seen
            self._discs.batched_colors = rendered(seen)
        if not np.array_equal(heard | ~on, self._heard):
            self._heard = heard | ~on
            size = np.where(self._heard, NOWHERE, self._radius)
            self._crosses.batched_scales = np.repeat(size[:, np.newaxis], 3, axis=1)

    def _choose(self, record: np.void, unit: int | None, words: bool) -> None:
        """Mark the chosen unit by its rim and a label."""
        if unit != self._chosen:
            self._chosen, self._unit_text = unit, ""
            size = self._radius.copy()
            if unit is not None:
                size[unit] *= CHOSEN_SIZE
            self._rims.batched_scales = np.repeat(size[:, np.newaxis], 3, axis=1)
            self._rims.batched_colors = self._rim_colours(unit)
            self._unit_label.visible = unit is not None
            if unit is not None:
                self._place_unit_label()
        if unit is not None and (words or not self._unit_text):
            text = f"{self._layout.names[unit]}  {described_force(record, unit)}"
            if text != self._unit_text:
                self._unit_text = self._unit_label.text = text

    def _place_unit_label(self) -> None:
        assert self._chosen is not None
        point = self.frame.points(self._pose.position[:, [self._chosen]])[0]
        outward = -self._pose.rotation[:, 2, self._chosen]
        self._unit_label.position = point + 1.5 * self._radius[self._chosen] * outward

    def _rim_colours(self, unit: int | None) -> np.ndarray:
        colours = np.repeat(RIM_COLOUR[np.newaxis], self._n, axis=0)
        if unit is not None:
            colours[unit] = CHOSEN_COLOUR
        return rendered(colours)

    def _place_axes(self) -> None:
        """Place the axes next to the lowest corner of all that is drawn, as high as it."""
        away = np.full(3, float(self._radius.max()) + 0.5 * AXES)
        away[np.abs(directions(self._pose)[0]).argmax()] = 0.0
        self._axes.position = self.points.min(axis=0) - away

    def reset_camera(self, camera: Any) -> None:
        """Let a camera of a browser see all that is drawn, from the side that most units face."""
        camera.position, camera.look_at, camera.up_direction = self._view()

    def _view(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, target and up direction of a camera that sees units and links."""
        points = self.points
        low, high = points.min(axis=0), points.max(axis=0)
        place, look, up = camera(self._pose)
        size, middle = max(1.0, float((high - low).max())), 0.5 * (low + high)
        return middle + size * place, middle + size * look, up

    def _add_names(self, points: np.ndarray) -> None:
        """Names of patches next to them, and the axes of the skin frame at a corner."""
        scene, layout = self._scene, self._layout
        places = tag_places(points, self._pose, layout.patch, len(layout.patch_names))
        self._tags = {
            at: scene.add_label(
                f"/patches/{at}", name, position=place, anchor="center-center",
                font_screen_scale=0.85,
            )
            for at, (name, place) in enumerate(zip(layout.patch_names, places, strict=True))
            if np.isfinite(place).all()
        }  # fmt: skip
        self._axes = scene.add_frame(
            "/axes", axes_length=AXES, axes_radius=0.035 * AXES, origin_radius=0.0
        )
        self._place_axes()
        tips = [
            scene.add_label(
                f"/axes/{name}", name, position=1.25 * AXES * np.eye(3)[at],
                anchor="center-center", font_screen_scale=0.8,
            )
            for at, name in enumerate("xyz")
        ]  # fmt: skip
        self._named = (self._axes, *tips, *self._tags.values())

    def _label(self, record: np.void, tails: dict[int, np.ndarray], words: bool) -> None:
        """Place labels at the tails of arrows; unchanged ones are skipped, since setting them costs
        as much as a change."""
        while len(self._labels) <= max(tails, default=-1):
            self._add_label()
        texts = contact_labels(record) if words or any(not self._texts[k] for k in tails) else []
        for k, label in enumerate(self._labels):
            if k not in tails:
                if self._texts[k]:
                    self._texts[k], label.visible = "", False
                continue
            if (words or not self._texts[k]) and self._texts[k] != texts[k]:
                self._texts[k] = label.text = texts[k]
                label.visible = True
            if not (np.abs(tails[k] - self._tails[k]) < STAYS).all():  # True for NaN
                self._tails[k] = tails[k]
                label.position = tails[k] + LIFT * self._up

    def _add_label(self) -> None:
        """A label for one more contact than there has been at once."""
        name = f"/contacts/{len(self._labels)}"
        self._labels.append(
            self._scene.add_label(name, BLANK, visible=False, anchor="bottom-center")
        )
        self._texts.append("")
        self._tails.append(np.full(3, np.nan, np.float32))

    def _move(self, pose: Pose) -> None:
        self._pose = pose
        if self._links is not None:
            self._links.move(pose.q)
        points, turns = self.frame.points(pose.position), quaternions(pose.rotation)
        for meshes in (self._discs, self._rims, self._crosses):
            meshes.batched_positions, meshes.batched_wxyzs = points, turns
        layout = self._layout
        places = tag_places(points, self._pose, layout.patch, len(layout.patch_names))
        for at, tag in self._tags.items():
            tag.position = places[at]
        if self._chosen is not None:
            self._place_unit_label()

    def _arrows(self, name: str, points: np.ndarray, hues: Any, shaft: float) -> Any:
        return self._scene.add_arrows(
            name, points, rendered(hues), shaft_radius=shaft, head_radius=2.1 * shaft,
            head_length=4.2 * shaft, visible=False,
        )  # fmt: skip

    def _put(self, arrows: Any, points: np.ndarray, hues: np.ndarray | None = None) -> None:
        """Set the points of arrows; with none of them, an invisible arrow."""
        arrows.visible = len(points) > 0
        if len(points):
            arrows.points = points
            if hues is not None and not np.array_equal(hues, self._hues):
                self._hues, arrows.colors = hues, rendered(hues)

    def _set_up(self) -> None:
        """Lights that keep the colours, and the direction that is up."""
        scene = self._scene
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light/everywhere", intensity=AMBIENT)
        scene.add_light_directional("/light/above", intensity=DIRECTED, position=(1.0, -1.0, 2.0))
        scene.world_axes.visible = False
        scene.set_background_image(np.full((2, 2, 3), BACKGROUND, np.uint8), format="png")
        up = camera(self._pose)[2]
        self._up = up.astype(np.float32)
        scene.set_up_direction(up)


def described_force(record: np.void, unit: int) -> str:
    """Size of the force on a unit, with its sigma along the force."""
    force, sigma = record["force"][:, unit].astype(float), record["force_sigma"][:, unit]
    size = float(np.sqrt(force @ force))
    if not np.isfinite(size):
        return "no force"
    along = force / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    error = float(np.sqrt(np.sum((along * sigma) ** 2)))
    return f"{size:.2f} N" if np.isnan(error) else f"{size:.2f} ± {error:.2f} N"


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors, shape (3, m)."""
    return np.sqrt(np.einsum("am,am->m", vectors, vectors))
