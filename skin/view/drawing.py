"""Geometry of a snapshot as plain arrays: discs, arrows, labels.

Lengths are relative to the picture, in which every skin has size 1; the origin is the middle of the
units. Arrows end where the force acts: a press comes from outside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.contact.record import Flag, SlipState
from skin.io.messages.record import contacts_of
from skin.view.colour import valid

__all__ = [
    "SLIP_COLOURS", "Frame", "Pose", "camera", "contact_arrows", "contact_label", "cross", "disc",
    "frame_of", "margin_text", "quaternions", "radii", "tag_places", "top", "unit_arrows",
]  # fmt: skip

LEAST_MISFIT = 30.7
"""Squared force over sigma, summed over its axes, that a force must exceed to be drawn [derived:
noise does once in a million units and pictures, by chi-squared of three axes] …"""
VISIBLE = 0.02
"""… and its smallest fraction of the longest arrow."""
BESIDE = 1.25
"""Distance of an arrow from the middle of its unit, in radii of the disc, along the diagonal of
the unit's x and y: between the discs of a grid [derived: half its diagonal is 1.41 / 0.92]."""
ALL_AROUND = 0.3
"""Length of the mean normal below which a skin faces all around [assumed]."""
TAG_GAP = 0.05
"""Distance of the name of a patch from its units."""
UNIT_LENGTH, CONTACT_LENGTH, NORMAL_LENGTH = 0.2, 0.4, 0.16
"""Length of an arrow at the end of its scale, and of every normal."""
SLIP_COLOURS = {
    SlipState.UNKNOWN: (235, 238, 242), SlipState.STICK: (235, 238, 242),
    SlipState.INCIPIENT: (230, 159, 0), SlipState.GROSS: (213, 94, 0),
}  # fmt: skip
"""Colours of contacts by slip state, which labels state as well. Okabe and Ito."""
HUES = np.array([SLIP_COLOURS[state] for state in SlipState], np.uint8)
"""The same by the number of the state."""


class Pose(NamedTuple):
    """Pose of the units: position, shape (3, n), metre; rotation, shape (3, 3, n); and the joints
    that it is of, shape (J,), rad or m, NaN where unknown."""

    position: np.ndarray
    rotation: np.ndarray
    q: np.ndarray = np.zeros(0)


class Frame(NamedTuple):
    """Transform from the skin frame to the picture."""

    middle: np.ndarray
    """Metre, shape (3,)."""
    scale: float
    """Picture units per metre."""

    def points(self, position: np.ndarray) -> np.ndarray:
        """Points of the picture, shape (m, 3), for positions, shape (3, m), metre."""
        return ((position.T - self.middle) * self.scale).astype(np.float32)


def frame_of(pose: Pose, radius_m: np.ndarray) -> Frame:
    """A frame in which all units lie within 1."""
    low = (pose.position - radius_m).min(axis=1)
    high = (pose.position + radius_m).max(axis=1)
    return Frame(0.5 * (low + high), 1.0 / float((high - low).max()))


def radii(position: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Radius of the disc of each unit, metre, shape (n,): that of its area, or less where discs
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
    edge = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([edge, edge + np.array([0.0, 0.0, 0.25]), np.zeros((1, 3))])
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate([
        np.stack([np.full(sides, 2 * sides), there, here], axis=1),
        np.stack([here, there, there + sides], axis=1),
        np.stack([here, there + sides, here + sides], axis=1),
    ])  # fmt: skip
    return vertices.astype(np.float32), faces.astype(np.uint32)


def cross() -> tuple[np.ndarray, np.ndarray]:
    """Two bars across each other above the disc, vertices and faces alike."""
    half, length = 0.13, 0.78
    bar = np.array([(-length, -half), (length, -half), (length, half), (-length, half)])
    turn = np.sqrt(0.5) * np.array([(1.0, -1.0), (1.0, 1.0)])
    flat = np.concatenate([bar @ turn.T, bar @ turn])
    vertices = np.column_stack([flat, np.full(8, -0.04)])
    faces = [(0, 2, 1), (0, 3, 2), (4, 6, 5), (4, 7, 6)]
    return vertices.astype(np.float32), np.array(faces, np.uint32)


def tag_places(points: np.ndarray, pose: Pose, patch: np.ndarray, count: int) -> np.ndarray:
    """Places for the names of patches, shape (p, 3): beyond the units of a patch, away from the
    middle of the skin, or below a patch in the middle; NaN for a patch without units.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    pose : Pose
    patch : ndarray, shape (n,), int
    count : int
        Number of patches, p.
    """
    whole = 0.5 * (points.min(axis=0) + points.max(axis=0))
    _, up = directions(pose)
    places = np.full((count, 3), np.nan, np.float32)
    for at in np.unique(patch).tolist():
        own = points[patch == at]
        middle = own.mean(axis=0)
        away = middle - whole
        if np.linalg.norm(away) < TAG_GAP:
            away = -up
        away /= np.linalg.norm(away)
        places[at] = middle + away * (((own - middle) @ away).max() + TAG_GAP)
    return places


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions (w, x, y, z), shape (n, 4), of rotations, shape (3, 3, n)."""
    from scipy.spatial.transform import Rotation

    # a copy: scipy 1.13 takes no array that is read-only
    xyzw = Rotation.from_matrix(np.moveaxis(rotation, 2, 0).copy()).as_quat()
    return np.roll(xyzw, 1, axis=1).astype(np.float32)


def unit_arrows(
    record: np.void, pose: Pose, frame: Frame, radius: np.ndarray, full_n: float
) -> np.ndarray:
    """Arrows of the forces on units, shape (m, 2, 3): tail and head, next to the discs.

    For valid units whose force exceeds its noise; `full_n` newton are `UNIT_LENGTH` long. `radius`
    is that of the discs in the picture, shape (n,).
    """
    force, sigma = record["force"], record["force_sigma"]
    squared = np.einsum("an,an->n", force, force)
    with np.errstate(divide="ignore", invalid="ignore"):
        misfit = np.einsum("an,an->n", force / sigma, force / sigma)
    is_noise = misfit <= LEAST_MISFIT  # False where sigma is unknown
    large = squared > (VISIBLE * full_n) ** 2  # a NaN is not shown
    shown = np.flatnonzero(valid(record) & large & ~is_noise)
    turn = pose.rotation[:, :, shown]
    turned = np.einsum("abm,bm->ma", turn, force[:, shown])
    diagonal = (turn[:, 0] + turn[:, 1]) * (np.sqrt(0.5) * BESIDE * radius[shown])
    arrows = np.empty((shown.size, 2, 3), np.float32)
    arrows[:, 1] = frame.points(pose.position[:, shown]) + diagonal.T
    arrows[:, 0] = arrows[:, 1] - turned * (UNIT_LENGTH / full_n)
    return arrows


def contact_arrows(record: np.void, frame: Frame, full_n: float) -> tuple[np.ndarray, ...]:
    """Arrows of contacts with a known centre: forces and normals, both shape (k, 2, 3), the colours
    of the forces, shape (k, 3), and the indices of these contacts, shape (k,)."""
    contacts = contacts_of(record)
    centre = contacts["centroid"]
    known = np.flatnonzero(np.isfinite(centre).all(axis=1))
    forces, normals = np.empty((2, known.size, 2, 3), np.float32)
    forces[:, 1] = normals[:, 0] = head = frame.points(centre[known].T)
    forces[:, 0] = head - contacts["wrench"][known, :3] * (CONTACT_LENGTH / full_n)
    normal = contacts["normal"][known]
    normals[:, 1] = head + NORMAL_LENGTH * np.where(np.isnan(normal), 0.0, normal)
    return forces, normals, HUES[contacts["slip"][known]], known


def contact_label(contact: np.void) -> str:
    """A CONTACT record as text: identity, load, slip state, margin, and whether one of its units is
    silent."""
    text = f"contact {contact['id']}   {contact['load']:.2f} N"
    if slip := SlipState(int(contact["slip"])):
        text += f"   {slip.name.lower()}" + (" slip" if slip > SlipState.STICK else "")
    if margin := margin_text(contact):
        text += f"   {margin}"
    return text + "   not whole" * bool(contact["flags"] & Flag.UNSEEN)


def margin_text(contact: np.void) -> str:
    """The margin of a CONTACT record, a bound while friction is not known; nothing if it is not."""
    if not np.isfinite(margin := float(contact["margin_at_least"])):
        return ""
    least = "" if np.isfinite(contact["friction"]) else "≥ "
    return f"margin {least}{100 * margin:.0f} %"


def directions(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Where most units face, and up in the picture, seen from there: unit vectors. A skin that
    faces all around is seen from -y."""
    outward = -pose.rotation[:, 2].mean(axis=1)
    if np.linalg.norm(outward) < ALL_AROUND:
        outward = np.array([0.0, -1.0, 0.0])
    outward /= np.linalg.norm(outward)
    up = np.array([0.0, 1.0, 0.0]) if abs(outward[2]) > 0.7 else np.array([0.0, 0.0, 1.0])
    up -= (up @ outward) * outward
    return outward, up / np.linalg.norm(up)


def top(pose: Pose, patch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the largest patch, by units: their mean position, metre, where they face, and up in the
    picture; `patch` is that of each unit, shape (n,)."""
    own = patch == np.argmax(np.bincount(patch))
    part = Pose(pose.position[:, own], pose.rotation[:, :, own])
    return part.position.mean(axis=1), *directions(part)


def camera(pose: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Camera position, target and up direction: a view onto the side that most units face, from
    below and the right. The skin is left of the middle, next to the panel."""
    outward, up = directions(pose)
    right = np.cross(up, outward)
    place = 0.84 * outward - 0.6 * up + 0.25 * right
    if abs(outward[2]) > 0.7:  # it lies: what is up in the picture is far from the camera
        return place, 0.16 * right - 0.05 * up, outward
    return place + 1.1 * up, 0.16 * right - 0.05 * up, up
