"""RobotModel: the tree of links of a robot as arrays, from any file format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

__all__ = ["Geom", "JointKind", "Link", "RobotModel", "common_limits", "factors", "motion_terms"]

JointKind = Literal["fixed", "revolute", "continuous", "prismatic"]
ROUNDING = 1e-6
"""Rad or m by which a joint that follows may be beyond its limits [assumed: digits of a file]."""


@dataclass(frozen=True)
class Geom:
    """A shape of a link.

    Attributes
    ----------
    link : int
        Index of the link that carries it.
    kind : str
        "box" (half lengths), "sphere" (radius), "capsule" and "cylinder" (radius, half length along
        z, of the straight part), "ellipsoid" (half axes), "plane" or "mesh".
    size : tuple of float
        Metre; empty for a mesh.
    xyz, rotation : tuple of float
        T_link_geom: metre, and nine numbers row by row.
    visual : bool
        Visual only, without contacts.
    mesh : str or None
        File of a mesh; it need not exist.
    scale : tuple of float
        Of the mesh's vertices.
    line : int
        Line in the model; 0 where unknown.
    """

    link: int
    kind: str
    size: tuple[float, ...] = ()
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    visual: bool = False
    mesh: str | None = None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    line: int = 0


@dataclass(eq=False)
class Link:
    """A link, with the joint that connects it to its parent.

    Attributes
    ----------
    name : str
        "" for links between the joints of a body of MJCF, which are massless.
    parent : int
        Index of the link that it hangs on; -1 for the root.
    joint : str
        Name of the joint; "" without one.
    kind : str
        Kind of the joint.
    xyz, rotation : ndarray, shape (3,) and (3, 3), float64
        T_parent_link for the coordinate `rest`, metre.
    axis : ndarray, shape (3,), float64
        Unit vector in the link's frame.
    anchor : ndarray, shape (3,), float64
        A point of the axis in the link's frame, metre; 0 in URDF.
    driver : int
        Index of the independent joint whose coordinate it follows; -1 if fixed.
    multiplier, offset : float
        Coordinate of the joint: multiplier * q[driver] + offset, rad or m.
    rest : float
        The coordinate at which the link is at `xyz` and `rotation`; 0 in URDF.
    limits : ndarray, shape (2,), float64
        Of the coordinate; NaN without limits.
    mass : float or None
        kg; None where the model has none.
    line : int
        Line in the file; 0 where unknown.
    """

    name: str
    parent: int = -1
    joint: str = ""
    kind: JointKind = "fixed"
    xyz: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    axis: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))
    driver: int = -1
    multiplier: float = 0.0
    offset: float = 0.0
    rest: float = 0.0
    limits: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    mass: float | None = None
    line: int = 0

    @property
    def lower(self) -> float:
        """First of the limits."""
        return float(self.limits[0])

    @property
    def upper(self) -> float:
        """Second of the limits."""
        return float(self.limits[1])


@dataclass(frozen=True, eq=False)
class RobotModel:
    """L links in a tree, each connected to its parent by one joint; J independent joints.

    Attributes
    ----------
    name : str
    path : Path
        The source file.
    links : tuple of Link, length L
        Parents first.
    joint_names : tuple of str, length J
        Independent joints, in the model's order; others are mimic joints.
    lower, upper : ndarray, shape (J,), float64
        Limits, rad or m, of the joint and of those that follow it; NaN without limits.
    home : ndarray, shape (J,), float64
        Coordinates of the poses in a topology: those nearest to the model's own within the limits.
    geoms : tuple of Geom
    base : int
        Link whose frame is the skin frame.
    """

    name: str
    path: Path
    links: tuple[Link, ...]
    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    home: np.ndarray
    geoms: tuple[Geom, ...]
    base: int = 0

    def __repr__(self) -> str:
        """The model in a line."""
        named = sum(map(bool, self.link_names))
        return f"<RobotModel {self.name!r}: {named} links, {len(self.joint_names)} joints>"

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of all links; "" for those without."""
        return tuple(link.name for link in self.links)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the links that have one, in order."""
        return tuple(filter(None, self.link_names))

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Poses of all links: ``T_base_link = T_base_parent T_parent_link motion``.

        Parameters
        ----------
        q : ndarray, shape (J,)
            Radian or metre, in the order of `joint_names`.

        Returns
        -------
        ndarray, shape (L, 4, 4), float64
            T_base_link.
        """
        driven, (drivers, slides, multiplier, offset), rest, first, second = self._terms
        sine, rest_of_cosine = factors(slides, multiplier * q[drivers] + offset)
        poses = rest.copy()
        poses[driven] += sine * first + rest_of_cosine * second
        for index, link in enumerate(self.links):
            if link.parent >= 0:
                poses[index] = poses[link.parent].dot(poses[index])
        base = poses[self.base]
        turn = base[:3, :3].T
        return _transform(turn, -turn @ base[:3, 3]) @ poses

    def refused(self, joint: int, value: float) -> tuple[str, str]:
        """What must be, and what came, where a coordinate is beyond the limits of a joint."""
        name, at = self.joint_names[joint], {}
        for link in self.links:
            if link.driver == joint:
                at[link] = link.multiplier * value + link.offset
        own = next(link for link in at if link.joint == name)
        worst = max(at, key=lambda one: max(-math.inf, one.lower - at[one], at[one] - one.upper))
        if value < own.lower or value > own.upper or worst is own:
            return f"within the joint's limits, {own.lower:g} to {own.upper:g}", f"{value:.10g}"
        return (
            f"such that {worst.joint!r}, which follows {name!r}, is within its limits, "
            f"{worst.lower:g} to {worst.upper:g}", f"{value:.10g}, which takes it to {at[worst]:g}",
        )  # fmt: skip

    @cached_property
    def _terms(self) -> tuple[Any, ...]:
        """Links that move with what they follow, whether they slide, and how far, each of shape
        (m,); T_parent_link for coordinates of 0, shape (L, 4, 4); and its products with the terms
        of the joints, shape (m, 4, 4)."""
        rest = np.stack([_transform(link.rotation, link.xyz) for link in self.links])
        driven = [index for index, link in enumerate(self.links) if link.driver >= 0]
        moving = [self.links[index] for index in driven]
        follows = (
            np.array([link.driver for link in moving], int),
            np.array([link.kind == "prismatic" for link in moving], bool),
            np.array([link.multiplier for link in moving]),
            np.array([link.offset - link.rest for link in moving]),
        )
        terms = [motion_terms(link.kind, link.axis, link.anchor) for link in moving]
        first, second = rest[driven] @ np.reshape(terms, (-1, 2, 4, 4)).swapaxes(0, 1)
        return driven, follows, rest, first, second


def common_limits(
    links: Sequence[Link], names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, list[tuple[Link, str]]]:
    """Limits of independent joints by those of all joints that follow them.

    Returns
    -------
    lower, upper : ndarray, shape (J,)
        NaN without limits.
    faults : list
        Links whose joints are never within their limits, and what the limits must be.
    """
    lower, upper = np.full(len(names), np.nan), np.full(len(names), np.nan)
    faults = []
    for link in sorted(links, key=lambda one: one.joint not in names):
        if (j := link.driver) < 0 or math.isnan(link.lower):
            continue
        reach = sorted(link.multiplier * end + link.offset for end in (lower[j], upper[j]))
        if math.isnan(reach[0]):
            reach = [-math.inf, math.inf] if link.multiplier else [link.offset] * 2
        if reach[0] > link.upper + ROUNDING or reach[1] < link.lower - ROUNDING:
            faults.append((link, f"limits that hold a part of {reach[0]:g} to {reach[1]:g}, where "
                                 "the joint that it follows takes it"))  # fmt: skip
        elif link.multiplier:
            spare = 0.0 if math.isnan(lower[j]) else ROUNDING
            ends = sorted((end - link.offset) / link.multiplier
                          for end in (link.lower - spare, link.upper + spare))  # fmt: skip
            lower[j], upper[j] = np.fmax(lower[j], ends[0]), np.fmin(upper[j], ends[1])
    return lower, upper, faults


def motion_terms(kind: str, axis: np.ndarray, anchor: np.ndarray) -> np.ndarray:
    """S and C of the motion of a joint, shape (2, 4, 4): it is ``1 + x S`` where the joint slides
    by x, and ``1 + sin(x) S + (1 - cos(x)) C`` where it turns: Rodrigues' formula about its anchor.
    """
    terms = np.zeros((2, 4, 4))
    if kind == "prismatic":
        terms[0, :3, 3] = axis
        return terms
    cross = np.cross(np.eye(3), axis)
    terms[:, :3, :3] = cross, cross @ cross
    terms[:, :3, 3] = -terms[:, :3, :3] @ anchor
    return terms


def factors(slides: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of S and of C at coordinates of m joints, rad or m; each of shape (m, 1, 1)."""
    sine, rest_of_cosine = np.where(slides, at, np.sin(at)), np.where(slides, 0.0, 1.0 - np.cos(at))
    return sine[:, np.newaxis, np.newaxis], rest_of_cosine[:, np.newaxis, np.newaxis]


def _transform(rotation: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, xyz
    return pose
