"""What is drawn of a snapshot, as plain arrays: discs, arrows, labels.

Lengths are those of the picture, in which every skin is as large as 1; the origin is the middle of
the units. Arrows end where the force acts: a press comes from outside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.contact.record import Flag, SlipState
from skin.view.colour import valid
from skin.view.history import Pose

__all__ = [
    "SLIP_COLOURS",
    "Frame",
    "camera",
    "contact_arrows",
    "contact_labels",
    "cross",
    "disc",
    "frame_of",
    "quaternions",
    "unit_arrows",
]

SIGMAS = 3.0
"""A force is drawn if it exceeds this many of its sigmas [assumed] …"""
VISIBLE = 0.02
"""… and this share of the longest arrow."""
UNIT_LENGTH, CONTACT_LENGTH, NORMAL_LENGTH = 0.2, 0.4, 0.16
"""Of an arrow at the end of its scale, and of every normal."""
SLIP_COLOURS = {
    SlipState.NONE: (235, 238, 242), SlipState.STICK: (235, 238, 242),
    SlipState.INCIPIENT: (230, 159, 0), SlipState.GROSS: (213, 94, 0),
}  # fmt: skip
"""Of contacts, by what they do; the label says it, too. Okabe and Ito."""
HUES = np.array([SLIP_COLOURS[state] for state in SlipState], np.uint8)
"""The same by the number of what they do."""


class Frame(NamedTuple):
    """From the skin frame to the picture."""

    middle: np.ndarray
    """Metre, shape (3,)."""
    scale: float
    """Of the picture, per metre."""

    def points(self, position: np.ndarray) -> np.ndarray:
        """Points of the picture, shape (m, 3), of positions, shape (3, m), metre."""
        return ((position.T - self.middle) * self.scale).astype(np.float32)


def frame_of(pose: Pose, radius_m: np.ndarray) -> Frame:
    """A frame in which all units lie within 1."""
    low = (pose.position - radius_m).min(axis=1)
    high = (pose.position + radius_m).max(axis=1)
    return Frame(0.5 * (low + high), 1.0 / float((high - low).max()))


def radii(position: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Radius of the disc of each unit, metre, shape (n,): that of its area, or less where units
    would touch."""
    radius = np.sqrt(area / np.pi)
    if position.shape[1] < 2:
        return radius
    from scipy.spatial import KDTree

    nearest = KDTree(position.T).query(position.T, k=2)[0][:, 1]
    return np.minimum(radius, 0.46 * nearest)


def disc(sides: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """A low cylinder of radius 1 about the z axis: vertices, shape (v, 3), and faces, shape (f, 3).

    Its top, at z = 0, faces -z, away from the skin.
    """
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([rim, rim + np.array([0.0, 0.0, 0.25]), np.zeros((1, 3))])
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    top = np.stack([np.full(sides, 2 * sides), there, here], axis=1)
    side = np.concatenate([
        np.stack([here, there, there + sides], axis=1),
        np.stack([here, there + sides, here + sides], axis=1),
    ])  # fmt: skip
    return vertices.astype(np.float32), np.concatenate([top, side]).astype(np.uint32)


def cross() -> tuple[np.ndarray, np.ndarray]:
    """Two bars across each other above the disc, vertices and faces alike."""
    half, length = 0.13, 0.78
    bar = np.array([(-length, -half), (length, -half), (length, half), (-length, half)])
    turn = np.sqrt(0.5) * np.array([(1.0, -1.0), (1.0, 1.0)])
    flat = np.concatenate([bar @ turn.T, bar @ turn])
    vertices = np.column_stack([flat, np.full(8, -0.04)])
    faces = [(0, 2, 1), (0, 3, 2), (4, 6, 5), (4, 7, 6)]
    return vertices.astype(np.float32), np.array(faces, np.uint32)


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions (w, x, y, z), shape (n, 4), of rotations, shape (3, 3, n)."""
    from scipy.spatial.transform import Rotation

    # a copy: scipy 1.13 takes no array that is read-only
    xyzw = Rotation.from_matrix(np.moveaxis(rotation, 2, 0).copy()).as_quat()
    return np.roll(xyzw, 1, axis=1).astype(np.float32)


def unit_arrows(record: np.void, pose: Pose, frame: Frame, full_n: float) -> np.ndarray:
    """Arrows of the forces on units, shape (m, 2, 3): tail and head.

    Of units that may be trusted and whose force exceeds its noise; `full_n` newton are
    `UNIT_LENGTH` long.
    """
    force = record["force"]
    size = np.sqrt(np.einsum("an,an->n", force, force))
    least = np.fmax(SIGMAS * record["sigma"], VISIBLE * full_n)  # the latter of an unknown sigma
    shown = np.flatnonzero(valid(record) & (size > least))  # a NaN is not
    turned = np.einsum("abm,bm->ma", pose.rotation[:, :, shown], force[:, shown])
    arrows = np.empty((shown.size, 2, 3), np.float32)
    arrows[:, 1] = frame.points(pose.position[:, shown])
    arrows[:, 0] = arrows[:, 1] - turned * (UNIT_LENGTH / full_n)
    return arrows


def contact_arrows(record: np.void, frame: Frame, full_n: float) -> tuple[np.ndarray, ...]:
    """Arrows of contacts, whose centre is known: forces and normals, both shape (k, 2, 3), the
    colours of the forces, shape (k, 3), and which contacts they are, shape (k,)."""
    count = int(record["contacts"])
    centre = record["contact_centroid"][:count]
    known = np.flatnonzero(np.isfinite(centre).all(axis=1))
    forces, normals = np.empty((2, known.size, 2, 3), np.float32)
    forces[:, 1] = normals[:, 0] = head = frame.points(centre[known].T)
    forces[:, 0] = head - record["contact_wrench"][known, :3] * (CONTACT_LENGTH / full_n)
    normal = record["contact_normal"][known]
    normals[:, 1] = head + NORMAL_LENGTH * np.where(np.isnan(normal), 0.0, normal)
    return forces, normals, HUES[record["contact_slip"][known]], known


def contact_labels(record: np.void) -> list[str]:
    """What is shown of each contact: identity, load, what it does, margin, whether a unit that
    touches it is silent."""
    texts = []
    for k in range(int(record["contacts"])):
        text = f"contact {record['contact_id'][k]}   {record['contact_load'][k]:.2f} N"
        slip = SlipState(int(record["contact_slip"][k]))
        if slip:
            text += f"   {slip.name.lower()}" + (" slip" if slip > SlipState.STICK else "")
        margin = float(record["contact_margin"][k])
        if np.isfinite(margin):
            text += f"   margin {100 * margin:.0f} %"
        if record["contact_flags"][k] & Flag.UNSEEN:
            text += "   not whole"
        texts.append(text)
    return texts


def camera(pose: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where to look from, where to, and what is up there: over the side that most units face. The
    skin stands left of the middle, beside the panel."""
    outward = -pose.rotation[:, 2].mean(axis=1)
    length = float(np.linalg.norm(outward))
    faces_up = length < 0.3 or abs(outward[2]) > 0.7 * length
    if length < 0.3:  # all around
        return np.array([0.7, -0.95, 0.55]), np.array([0.14, 0.1, 0.0]), np.array([0.0, 0.0, 1.0])
    outward /= length
    up = np.array([0.0, 1.0, 0.0]) if faces_up else np.array([0.0, 0.0, 1.0])
    up -= (up @ outward) * outward
    up /= np.linalg.norm(up)
    side = np.cross(up, outward)
    return (
        0.84 * outward - 0.6 * up + 0.25 * side,
        0.16 * side - 0.05 * up,
        outward if faces_up else up,
    )
