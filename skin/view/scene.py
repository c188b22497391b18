"""The skin in three dimensions, on a server of viser."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skin.view.colour import QUANTITIES, Range, valid
from skin.view.drawing import (
    Frame,
    camera,
    contact_arrows,
    contact_labels,
    cross,
    disc,
    frame_of,
    quaternions,
    radii,
    unit_arrows,
)
from skin.view.history import Moment, Pose
from skin.view.snapshot import CONTACTS
from skin.view.tone import AMBIENT, DIRECTED, given, given_colours

__all__ = ["BACKGROUND", "Scales", "Scene", "Shown"]

BACKGROUND = (66, 72, 80)
FORCE_COLOUR = np.array([240, 242, 245], np.uint8)
NORMAL_COLOUR = np.array([150, 160, 172], np.uint8)
CROSS_COLOUR = (1, 1, 1)
BLANK = "contact 0   0.00 N   stick   margin 00 %"
"""Text of a label before there is a contact: the client measures its box by the first one."""
LIFT = 0.03
"""Of a label above its arrow."""
NOWHERE = np.float32(1e-6)
"""Size of what is not to be seen: an instance cannot be left out."""
STAYS = 0.001
"""By how much a label may be off its place: less than a pixel of most pictures [assumed]."""


class Shown(NamedTuple):
    """What a person chose to see."""

    quantity: str = "load"
    forces: bool = True
    contacts: bool = True


class Scales:
    """Scales of all quantities and of both kinds of arrows, which grow with what is shown."""

    def __init__(self) -> None:
        self.of = {label: Range(quantity) for label, quantity in QUANTITIES.items()}
        self.unit = Range(QUANTITIES["load"])
        self.contact = Range(QUANTITIES["load"])

    def widen(self, moment: Moment, quantity: str) -> bool:
        """Take in what a moment has; True where the scale of the quantity changed."""
        record = moment.record
        heard, count = valid(record), int(record["contacts"])
        self.unit.widen(_lengths(record["force"])[heard])
        self.contact.widen(_lengths(record["contact_wrench"][:count, :3].T))
        return self.of[quantity].widen(QUANTITIES[quantity].values(record)[heard])

    def ends(self, quantity: str) -> tuple[object, ...]:
        """All that a legend tells of a quantity and of the arrows."""
        scale = self.of[quantity]
        return quantity, scale.low, scale.high, self.unit.high, self.contact.high

    def reset(self) -> None:
        """Forget all that was shown."""
        for scale in (*self.of.values(), self.unit, self.contact):
            scale.reset()


class Scene:
    """Everything in the picture; made from the first moment, which has the poses.

    Parameters
    ----------
    server : viser.ViserServer
    area : ndarray, shape (n,)
        Square metre.
    first : Moment
    """

    def __init__(self, server: Any, area: np.ndarray, first: Moment) -> None:
        self._server, self._scene = server, server.scene
        self._pose: Pose = first.pose
        radius = radii(first.pose.position, area)
        self.frame: Frame = frame_of(first.pose, radius)
        self._radius = (radius * self.frame.scale).astype(np.float32)
        self._n = area.size
        self._set_up()
        points, turns = self.frame.points(first.pose.position), quaternions(first.pose.rotation)
        size = np.repeat(self._radius[:, np.newaxis], 3, axis=1)
        self._discs = self._scene.add_batched_meshes_simple(
            "/units", *disc(), turns, points, batched_scales=size, lod="off", side="double",
            batched_colors=np.full((self._n, 3), 90, np.uint8), cast_shadow=False,
            receive_shadow=False, flat_shading=True,
        )  # fmt: skip
        self._crosses = self._scene.add_batched_meshes_simple(
            "/flags", *cross(), turns, points, batched_scales=NOWHERE * size, lod="off",
            side="double", batched_colors=CROSS_COLOUR, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        none = np.zeros((0, 2, 3), np.float32)
        shaft = min(0.006, 0.16 * float(self._radius.mean()))
        self._forces = self._arrows("/forces", none, FORCE_COLOUR, shaft)
        self._normals = self._arrows("/normals", none, NORMAL_COLOUR, 0.004)
        self._wrenches = self._arrows("/wrenches", none, np.zeros((0, 3), np.uint8), 0.011)
        self._hues, self._heard = np.zeros((0, 3), np.uint8), np.ones(self._n, bool)
        self._sent: dict[tuple[int, str], np.ndarray] = {}
        self._texts: list[str] = [""] * CONTACTS
        self._tails = np.full((CONTACTS, 3), np.nan, np.float32)
        self._labels = [
            self._scene.add_label(f"/contacts/{k}", BLANK, visible=False, anchor="bottom-center")
            for k in range(CONTACTS)
        ]

    def draw(self, moment: Moment, shown: Shown, scales: Scales, *, words: bool = True) -> None:
        """Show a moment; without `words`, labels that are there already keep their texts."""
        record = moment.record
        if moment.pose is not self._pose:
            self._move(moment.pose)
        heard, scale = valid(record), scales.of[shown.quantity]
        values = QUANTITIES[shown.quantity].values(record)
        seen = given_colours(values, heard, scale.low, scale.high)
        self._assign(self._discs, "batched_colors", seen)
        if not np.array_equal(heard, self._heard):
            self._heard = heard
            size = np.where(heard, NOWHERE, self._radius)
            self._crosses.batched_scales = np.repeat(size[:, np.newaxis], 3, axis=1)
        if shown.forces:
            arrows = unit_arrows(record, moment.pose, self.frame, scales.unit.high)
        else:
            arrows = np.zeros((0, 2, 3), np.float32)
        self._put(self._forces, arrows)
        forces, normals, hues, known = contact_arrows(record, self.frame, scales.contact.high)
        if not shown.contacts:
            forces, normals, hues, known = forces[:0], normals[:0], hues[:0], known[:0]
        self._put(self._normals, normals)
        self._put(self._wrenches, forces, hues)
        self._tell(record, dict(zip(known.tolist(), forces[:, 0], strict=True)), words)

    def _tell(self, record: np.void, tails: dict[int, np.ndarray], words: bool) -> None:
        """Put labels to the tails of arrows; what stays is not touched, which costs as much as a
        change."""
        texts = contact_labels(record) if words or any(not self._texts[k] for k in tails) else []
        for k, label in enumerate(self._labels):
            if k not in tails:
                if self._texts[k]:
                    self._texts[k], label.visible = "", False
                continue
            if (words or not self._texts[k]) and self._texts[k] != texts[k]:
                self._texts[k] = label.text = texts[k]
                label.visible = True
            if not (np.abs(tails[k] - self._tails[k]) < STAYS).all():  # a NaN is not
                self._tails[k] = tails[k]
                label.position = tails[k] + LIFT * self._up

    def _move(self, pose: Pose) -> None:
        self._pose = pose
        points, turns = self.frame.points(pose.position), quaternions(pose.rotation)
        for meshes in (self._discs, self._crosses):
            meshes.batched_positions, meshes.batched_wxyzs = points, turns

    def _arrows(self, name: str, points: np.ndarray, hues: Any, shaft: float) -> Any:
        return self._scene.add_arrows(
            name, points, given(hues), shaft_radius=shaft, head_radius=2.1 * shaft,
            head_length=4.2 * shaft, visible=False,
        )  # fmt: skip

    def _put(self, arrows: Any, points: np.ndarray, hues: np.ndarray | None = None) -> None:
        """Give other points to arrows; none of them is no arrow, not one without length."""
        arrows.visible = len(points) > 0
        if len(points):
            self._assign(arrows, "points", points)
            if hues is not None and not np.array_equal(hues, self._hues):
                self._hues, arrows.colors = hues, given(hues)

    def _assign(self, node: Any, name: str, values: np.ndarray) -> None:
        """Give other values to a node: an array of the right type, which stays as it is.

        An assignment would look up the types of all properties, compare, and copy twice, which
        takes longer than the message; 30 times a second only the message is made.
        """
        before = self._sent.get((id(node), name))
        if before is not None and np.array_equal(before, values):
            return
        self._sent[id(node), name] = values
        send = getattr(node, "_queue_update", None)  # of viser 1.1
        if send is None:
            setattr(node, name, values)
        else:
            send(name, values)

    def _set_up(self) -> None:
        """Light that does not bleach the colours, and where to look from."""
        scene = self._scene
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light/everywhere", intensity=AMBIENT)
        scene.add_light_directional("/light/above", intensity=DIRECTED, position=(1.0, -1.0, 2.0))
        scene.world_axes.visible = False
        scene.set_background_image(np.full((2, 2, 3), BACKGROUND, np.uint8), format="png")
        place, look, up = camera(self._pose)
        self._up = up.astype(np.float32)
        scene.set_up_direction(up)
        view = self._server.initial_camera
        view.position, view.look_at, view.up = place, look, up
        view.near, view.far = 0.01, 50.0


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors, shape (3, m)."""
    return np.sqrt(np.einsum("am,am->m", vectors, vectors))
