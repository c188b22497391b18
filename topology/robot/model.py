"""RobotModel: the tree of links of a robot as arrays, from any file format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

__all__ = ["Geom", "JointKind", "Link", "RobotModel", "assembled", "factors", "motion_terms"]

JointKind = Literal["fixed", "revolute", "continuous", "prismatic"]


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


@dataclass
class Link:
    """A link as it is read, with the joint that carries it; see `RobotModel`."""

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
    mass: float = float("nan")
    line: int = 0


@dataclass(frozen=True, eq=False)
class RobotModel:
    """L links in a tree, each connected to its parent by one joint; J independent joints.

    A body of MJCF with several joints has massless links without name, one for each joint but the
    last.

    Attributes
    ----------
    name : str
    path : Path
        The source file.
    link_names : tuple of str, length L
        Parents first; "" for links between the joints of a body.
    parent : tuple of int, length L
        -1 for the root.
    joints : tuple of str, length L
        Name of the joint of each link; "" without one.
    kinds : tuple of str, length L
        Kind of that joint: `JointKind`.
    driver : tuple of int, length L
        Index of the joint whose coordinate it follows; -1 if fixed.
    multiplier, offset : ndarray, shape (L,), float64
        Coordinate of the joint: multiplier * q[driver] + offset, rad or m.
    axis : ndarray, shape (3, L), float64
        Unit vector in the link's frame.
    anchor : ndarray, shape (3, L), float64
        A point of the axis in the link's frame, metre; 0 in URDF.
    xyz : ndarray, shape (3, L), float64
    rotation : ndarray, shape (3, 3, L), float64
        T_parent_link for a coordinate of 0, metre.
    joint_names : tuple of str, length J
        Independent joints, in the model's order; others are mimic joints.
    lower, upper : ndarray, shape (J,), float64
        Limits, rad or m; NaN without limits.
    mass : ndarray, shape (L,), float64
        kg; NaN where the model has none.
    geoms : tuple of Geom
    lines : tuple of int, length L
        Line of each link in the file; 0 where unknown.
    base : int
        Link whose frame is the skin frame.
    home : ndarray, shape (J,), float64
        Coordinates of the poses in a topology.
    """

    name: str
    path: Path
    link_names: tuple[str, ...]
    parent: tuple[int, ...]
    joints: tuple[str, ...]
    kinds: tuple[str, ...]
    driver: tuple[int, ...]
    multiplier: np.ndarray
    offset: np.ndarray
    axis: np.ndarray
    anchor: np.ndarray
    xyz: np.ndarray
    rotation: np.ndarray
    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    mass: np.ndarray
    geoms: tuple[Geom, ...]
    lines: tuple[int, ...]
    base: int
    home: np.ndarray

    def __repr__(self) -> str:
        """The model in a line."""
        named = sum(map(bool, self.link_names))
        return f"<RobotModel {self.name!r}: {named} links, {len(self.joint_names)} joints>"

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
        (driven, drivers, slides), rest, first, second = self._terms
        at = self.multiplier[driven] * q[drivers] + self.offset[driven]
        sine, rest_of_cosine = factors(slides, at)
        poses = rest.copy()
        poses[driven] += sine * first + rest_of_cosine * second
        for link, parent in enumerate(self.parent):
            if parent >= 0:
                poses[link] = poses[parent].dot(poses[link])
        base = poses[self.base]
        turn = base[:3, :3].T
        return _transform(turn, -turn @ base[:3, 3]) @ poses

    @cached_property
    def _terms(self) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray, np.ndarray]:
        """Links that move with what they follow and whether they slide, shape (m,); T_parent_link
        for coordinates of 0, shape (L, 4, 4); and its products with the terms of the joints, shape
        (m, 4, 4)."""
        rest = np.stack([
            _transform(self.rotation[:, :, link], self.xyz[:, link])
            for link in range(len(self.parent))
        ])  # fmt: skip
        drivers = np.array(self.driver, int)
        driven = np.flatnonzero(drivers >= 0)
        slides = np.array([self.kinds[link] == "prismatic" for link in driven], bool)
        terms = np.zeros((2, driven.size, 4, 4))
        for k, link in enumerate(driven):
            terms[:, k] = motion_terms(
                self.kinds[link], self.axis[:, link], self.anchor[:, link]
            )  # fmt: skip
        first, second = rest[driven] @ terms
        return (driven, drivers[driven], slides), rest, first, second


def assembled(
    name: str,
    path: Path,
    links: Sequence[Link],
    joint_names: Sequence[str],
    limits: np.ndarray,
    home: np.ndarray,
    geoms: Sequence[Geom],
) -> RobotModel:
    """A model of links in order, parents first; `limits` is of shape (J, 2). The joints are at
    home where they are nearest to `home` within their limits."""

    def stacked(what: str) -> np.ndarray:
        return np.stack([getattr(link, what) for link in links], axis=-1)

    model = RobotModel(
        name=name,
        path=path,
        link_names=tuple(link.name for link in links),
        parent=tuple(link.parent for link in links),
        joints=tuple(link.joint for link in links),
        kinds=tuple(link.kind for link in links),
        driver=tuple(link.driver for link in links),
        multiplier=stacked("multiplier"),
        offset=stacked("offset"),
        axis=stacked("axis"),
        anchor=stacked("anchor"),
        xyz=stacked("xyz"),
        rotation=stacked("rotation"),
        joint_names=tuple(joint_names),
        lower=limits[:, 0].copy(),
        upper=limits[:, 1].copy(),
        mass=stacked("mass"),
        geoms=tuple(geoms),
        lines=tuple(link.line for link in links),
        base=0,
        home=np.fmin(np.fmax(home, limits[:, 0]), limits[:, 1]),
    )
    for array in vars(model).values():
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return model


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
