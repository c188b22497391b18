"""Strokes of a sphere: where it is put down, where it slides, when it lifts."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skin.sim.sphere import reach
from topology import Topology

__all__ = ["Stroke", "strokes"]

KEYS = (
    # time s, share of the way, height: 1 clear of the skin, 0 touching, -1 fully pressed
    (0.0, 0.0, 1.0),
    (0.6, 0.0, 0.0),
    (1.5, 0.0, -1.0),
    (2.1, 0.0, -1.0),
    (4.5, 1.0, -1.0),
    (4.8, 1.0, -1.0),
    (5.5, 1.0, 1.0),
    (7.0, 1.0, 1.0),
)
"""Approach, press, hold, slide, rest, lift, pause."""

CLEARANCE_M = 0.003
"""Height of the sphere over the skin before and after a stroke."""

SAG_M = 0.00072
"""How much less than the nearest unit its neighbours are pressed, by the default radius."""

ROUNDS = 6
"""Strokes on each patch before they repeat."""

STROKE_PITCHES = 3.0
"""Wanted length of the way, in distances of neighbours."""

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Successive directions that never come near to repeating."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """One press, slide and lift.

    Attributes
    ----------
    start, end : ndarray, shape (3,)
        Points of the skin's surface, metre, skin frame.
    start_normal, end_normal : ndarray, shape (3,)
        Outward unit normals there.
    radius_m, depth_m : float
        Radius of the sphere, and how far it is pushed below the points of the way.
    patch : int
        The patch that it touches; the others are held out of its way.
    """

    start: np.ndarray
    end: np.ndarray
    start_normal: np.ndarray
    end_normal: np.ndarray
    radius_m: float
    depth_m: float
    patch: int

    @property
    def duration_s(self) -> float:
        """From one approach to the next."""
        return KEYS[-1][0]

    def centre(self, time_s: float) -> np.ndarray:
        """Centre of the sphere `time_s` into the stroke, metre, skin frame, shape (3,)."""
        i = bisect_right(KEYS, time_s, hi=len(KEYS) - 1, key=lambda key: key[0])
        (before, share_0, height_0), (after, share_1, height_1) = KEYS[i - 1], KEYS[i]
        eased = _minimum_jerk((time_s - before) / (after - before))
        low, high = self._height(height_0), self._height(height_1)
        return self.over(share_0 + (share_1 - share_0) * eased, low + (high - low) * eased)

    def _height(self, key: float) -> float:
        return key * (CLEARANCE_M if key > 0.0 else self.depth_m)

    def over(self, share: float, height_m: float) -> np.ndarray:
        """Centre of a sphere whose lowest point is `height_m` over a point of the way."""
        point, normal = self._point(share)
        return point + (self.radius_m + height_m) * normal

    def _point(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Point of the way and outward normal there."""
        leave, arrive = self._tangents
        s, t = share, 1.0 - share
        point = (
            (1.0 + 2.0 * s) * t * t * self.start + s * t * t * leave
            + s * s * (3.0 - 2.0 * s) * self.end - s * s * t * arrive
        )  # fmt: skip
        normal = t * self.start_normal + s * self.end_normal
        return point, normal / math.sqrt(normal @ normal)

    @cached_property
    def _tangents(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities at both ends of the way, along the surface, and such that the way is an arc
        of a circle where the surface is a cylinder or a sphere."""
        chord = self.end - self.start
        angle = math.acos(min(1.0, max(-1.0, float(self.start_normal @ self.end_normal))))
        speed = math.sqrt(chord @ chord) / math.cos(angle / 4.0) ** 2
        return _along(chord, self.start_normal) * speed, _along(chord, self.end_normal) * speed


def strokes(topology: Topology, *, depth_m: float, radius_m: float | None) -> tuple[Stroke, ...]:
    """Strokes over every patch in turn, each from another place in another direction.

    Parameters
    ----------
    topology : Topology
    depth_m : float
        Deepest press of any unit: a stroke that would press another unit deeper is raised.
    radius_m : float or None
        Radius of the sphere; None fits it to the distance of the units of each patch.
    """
    found = []
    for turn in range(ROUNDS):
        for patch in range(len(topology.patch_names)):
            units = np.flatnonzero(topology.patch == patch)
            found.append(_stroke(topology, units, turn, depth_m, radius_m))
    return tuple(found)


def _stroke(
    topology: Topology, units: np.ndarray, turn: int, depth_m: float, radius_m: float | None
) -> Stroke:
    position, outward = topology.position[:, units], -topology.rotation[:, 2, units]
    pitch = _pitch(position, 2.0 * float(topology.parameters["radius_m"][units[0]]))
    first = _start(position, turn)
    heading = turn * GOLDEN_ANGLE
    x, y = topology.rotation[:, 0, units[first]], topology.rotation[:, 1, units[first]]
    direction = math.cos(heading) * x + math.sin(heading) * y
    last = _end(position, outward, first, direction, STROKE_PITCHES * pitch)
    start, normal = position[:, first], outward[:, first]
    stroke = Stroke(
        start=start,
        end=start + 0.25 * pitch * direction if last is None else position[:, last],
        start_normal=normal,
        end_normal=normal if last is None else outward[:, last],
        radius_m=pitch**2 / (2.0 * SAG_M) if radius_m is None else radius_m,
        depth_m=depth_m,
        patch=int(topology.patch[units[0]]),
    )
    return _raised(stroke, position, -outward)


def _pitch(position: np.ndarray, alone: float) -> float:
    """Median distance of nearest neighbours; `alone` for a single unit."""
    if position.shape[1] == 1:
        return alone
    distance = np.linalg.norm(position[:, :, np.newaxis] - position[:, np.newaxis, :], axis=0)
    np.fill_diagonal(distance, np.inf)
    return float(np.median(distance.min(axis=0)))


def _start(position: np.ndarray, turn: int) -> int:
    """A unit of the inner half of a patch, another one every turn."""
    n = position.shape[1]
    from_middle = np.linalg.norm(position - position.mean(axis=1, keepdims=True), axis=0)
    inner = np.argsort(from_middle, kind="stable")[: (n + 1) // 2]
    return int(inner[int(turn * GOLDEN_ANGLE / math.tau * inner.size) % inner.size])


def _end(
    position: np.ndarray, outward: np.ndarray, first: int, direction: np.ndarray, length: float
) -> int | None:
    """The unit that is best reached in a direction at a distance, None if no other is in reach."""
    chord = position - position[:, first : first + 1]
    distance = np.linalg.norm(chord, axis=0)
    in_reach = outward[:, first] @ outward > 0.5
    for normal in (outward[:, first : first + 1], outward):
        in_reach &= np.abs((normal * chord).sum(axis=0)) < 0.9 * distance
    if not in_reach.any():
        return None
    cosine = direction @ chord / np.where(distance > 0.0, distance, 1.0)
    merit = cosine - np.abs(distance / length - 1.0)
    return int(np.argmax(np.where(in_reach, merit, -np.inf)))


def _raised(stroke: Stroke, position: np.ndarray, axis: np.ndarray) -> Stroke:
    """The stroke, as deep as leaves no unit pressed deeper than it was meant to be."""
    wanted = stroke.depth_m
    for _ in range(100):
        deepest = max(
            reach(stroke.over(share, -stroke.depth_m), stroke.radius_m, position, axis)[1].max()
            for share in np.linspace(0.0, 1.0, 49)
        )
        if deepest <= wanted + 1e-9:
            break
        stroke = replace(stroke, depth_m=stroke.depth_m - (deepest - wanted))
    return stroke


def _along(chord: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Direction of a chord in the tangent plane of a normal."""
    tangent = chord - (chord @ normal) * normal
    return tangent / math.sqrt(tangent @ tangent)


def _minimum_jerk(share: float) -> float:
    """From 0 to 1 with no speed and no acceleration at either end."""
    return share**3 * (10.0 + share * (6.0 * share - 15.0))
