"""What bodies do to a skin: an elastic foundation under spheres, punches, cylinders and edges.

Each unit is a foundation of its own. A body goes in along a direction; how deep it is in a unit is
the mean over the face of how far it is below its points, along the normal of the unit. Dragged, it
takes the faces along as far as friction lets it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.fixtures.plant import Plant, Touch

__all__ = ["Body", "Pressed", "pressed", "ramp"]

FACE_MM = 6.0
"""Radius of a face, on which a body is felt."""
RINGS = 5
"""Of points around the middle one, 6 more in each: equal areas, a tenth of a face wide."""
HALVES = 50
FACING = 0.3
"""Cosine between the way in and the normal of a unit, below which the body does not touch it."""


@dataclass(frozen=True)
class Body:
    """A kind, "sphere", "punch", "cylinder" or "edge", and its radius, mm; of an edge its slope."""

    kind: str
    size: float

    def height(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Of its surface over its lowest point, mm, at places across its way in."""
        if self.kind == "edge":
            return self.size * np.abs(a)
        if self.kind == "punch":
            return np.where(np.hypot(a, b) <= self.size, 0.0, np.inf)
        away = np.abs(a) if self.kind == "cylinder" else np.hypot(a, b)
        rest = self.size**2 - np.minimum(away, self.size) ** 2
        return np.where(away < self.size, self.size - np.sqrt(rest), np.inf)


@dataclass(frozen=True, eq=False)
class Pressed:
    """A body at rest in a skin.

    Attributes
    ----------
    depth_mm : ndarray, shape (n,)
    centre : ndarray, shape (3,)
        Centre of pressure, metre: each point of a face carries its share of the unit's force.
    load_n : float
        Sum of the normal forces.
    """

    depth_mm: np.ndarray
    centre: np.ndarray
    load_n: float


def pressed(
    plant: Plant, body: Body, unit: int, aside_mm: np.ndarray, turn: float, load_n: float
) -> Pressed:
    """Press a body until the normal forces of the units add up to a load.

    Parameters
    ----------
    plant : Plant
    body : Body
    unit : int
        Along whose normal it goes in.
    aside_mm : ndarray, shape (2,)
        From the middle of that unit, in its frame.
    turn : float
        Of the body about its way, rad.
    load_n : float
    """
    rotation, place = plant.topology.rotation, 1e3 * plant.topology.position
    points = place[:, :, np.newaxis] + np.einsum("abn,bp->anp", rotation[:, :2], _face())
    u, v, w = rotation[:, :, unit].T
    here = np.tensordot(np.stack([u, v, w]), points - place[:, unit, np.newaxis, np.newaxis], 1)
    a, b = here[0] - aside_mm[0], here[1] - aside_mm[1]
    a, b = a * np.cos(turn) + b * np.sin(turn), b * np.cos(turn) - a * np.sin(turn)
    below = here[2] + body.height(a, b)
    along = np.einsum("a,an->n", w, rotation[:, 2])
    facing = along > FACING
    along = np.where(facing, along, 0.0)
    first = below[facing].min()

    def deep(way_mm: float) -> np.ndarray:
        return along[:, np.newaxis] * np.maximum(first + way_mm - below, 0.0)

    low, high = 0.0, 30.0
    for _ in range(HALVES):
        way = 0.5 * (low + high)
        heavy = plant.normal_n(deep(way).mean(axis=1)).sum() > load_n
        low, high = (low, way) if heavy else (way, high)
    points_deep = deep(high)
    depth = points_deep.mean(axis=1)
    force = plant.normal_n(depth)
    share = points_deep / np.maximum(points_deep.sum(axis=1), 1e-12)[:, np.newaxis]
    centre = 1e-3 * np.einsum("anp,np,n->a", points, share, force) / force.sum()
    return Pressed(depth, centre, float(force.sum()))


def dragged(plant: Plant, depth_mm: np.ndarray, way: np.ndarray, friction: float) -> np.ndarray:
    """Displacements of the faces, (2, n), under a body that has moved by `way`, mm, skin frame."""
    moved = np.einsum("abn,a->bn", plant.topology.rotation[:, :2], way)
    length = np.hypot(*moved)
    most = plant.length_at(friction * plant.normal_n(depth_mm))
    return moved * np.minimum(1.0, most / np.maximum(length, 1e-12))


def held(depth_mm: np.ndarray, moved_mm: np.ndarray, share: np.ndarray, late: np.ndarray) -> Touch:
    """A touch that comes as `share`, (t,), of its depth, and shears as `late`."""
    return Touch(share[:, np.newaxis] * depth_mm, late[:, np.newaxis, np.newaxis] * moved_mm)


def ramp(cycles: int, rate_hz: float, start_s: float, length_s: float) -> np.ndarray:
    """From 0 to 1, smooth, within `length_s` from `start_s` on; shape (t,)."""
    share = np.clip((np.arange(cycles) / rate_hz - start_s) / length_s, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * share)


def _face() -> np.ndarray:
    """Points of a face, mm, shape (2, p)."""
    counts = np.array([1, *(6 * ring for ring in range(1, RINGS + 1))])
    within = np.cumsum(counts) / counts.sum()
    radii = FACE_MM * np.sqrt(within - 0.5 * counts / counts.sum())
    radii[0] = 0.0
    points = [
        radius * np.array([np.cos(angle), np.sin(angle)])
        for radius, count in zip(radii, counts, strict=True)
        for angle in 2.0 * np.pi * np.arange(count) / count
    ]
    return np.array(points).T
