"""URDF to a `RobotModel`: links and joints by the standard library's XML parser.

Conventions are those of the format: a child's frame is at the joint's `origin`, rotates about or
moves along `axis`, angles are radians, `rpy` is about the parent's fixed axes.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from topology.pose import from_rpy
from topology.robot.model import Geom, RobotModel
from topology.robot.report import ModelReport
from topology.robot.xml import Element, XmlError, parse

__all__ = ["read_urdf"]

KINDS = ("fixed", "revolute", "continuous", "prismatic")
NEAR = 5
"""Folders around a model in which other folders are looked into for a package.xml [assumed]."""
SHAPES = {
    "box": ("size", 3),
    "sphere": ("radius", 1),
    "cylinder": ("radius", 1),
    "capsule": ("radius", 1),
}


@dataclass
class _Joint:
    """A joint of the file; an independent one is its own driver."""

    name: str
    kind: str
    element: Element
    parent: str
    child: str
    xyz: np.ndarray
    rotation: np.ndarray
    axis: np.ndarray
    lower: float = math.nan
    upper: float = math.nan
    follows: str | None = None
    multiplier: float = 1.0
    offset: float = 0.0


def read_urdf(text: bytes, path: Path, report: ModelReport) -> RobotModel | None:
    """The model of a URDF, or None where it is wrong, and reported.

    Parameters
    ----------
    text : bytes
    path : Path
        Its file, from which meshes are located.
    report : ModelReport
    """
    try:
        root = parse(text)
    except XmlError as error:
        report.add("model-syntax", error.line, kind="XML", reason=str(error))
        return None
    if root.tag != "robot":
        report.value("a <robot> as URDF has it", root.tag, root.line, "root element")
        return None
    return _Reader(root, path, report).model()


class _Reader:
    def __init__(self, root: Element, path: Path, report: ModelReport) -> None:
        self.root, self.path, self.report = root, path, report
        self.wrong = False
        self.links = self._named("link")
        self.elements = self._named("joint")

    def model(self) -> RobotModel | None:
        if any(element.tag.startswith("xacro:") for element in self.root.walk()):
            self._value("URDF; let `xacro` write it out first", "xacro", self.root, "robot")
            return None
        joints = [found for e in self.elements.values() if (found := self._joint(e)) is not None]
        order = None if self.wrong else self._tree(joints)
        drivers = None if self.wrong else self._drivers({joint.name: joint for joint in joints})
        geoms = [] if order is None else self._geoms(order)
        mass = [] if order is None else [self._mass(name) for name, _ in order]
        if order is None or drivers is None or self.wrong:
            return None
        return _arrays(self.root, self.path, order, joints, drivers, geoms, mass, self.links)

    def _value(self, expected: str, got: str | None, element: Element, where: str) -> None:
        self.wrong = True
        self.report.value(expected, got, element.line, where)

    def _named(self, tag: str) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self.root.all(tag):
            name = element.get("name")
            if not name:
                self._value("a name", name, element, tag)
            elif name in found:
                self.wrong = True
                self.report.add("model-twice", element.line, tag, name=repr(name),
                                first=found[name].line)  # fmt: skip
            else:
                found[name] = element
        return found

    def _numbers(self, element: Element | None, name: str, count: int, default: str, where: str):
        """Numbers of an attribute; the default where it is absent, zeros where it is invalid."""
        given = None if element is None else element.get(name)
        try:
            values = np.array([float(word) for word in (given or default).split()])
            if values.size == count and np.isfinite(values).all():
                return values
        except ValueError:
            pass
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        self._value(expected, given, element or self.root, f"{where} {name}")
        return np.zeros(count)

    def _origin(self, element: Element, where: str) -> tuple[np.ndarray, np.ndarray]:
        origin = element.first("origin")
        xyz = self._numbers(origin, "xyz", 3, "0 0 0", f"{where} origin")
        rpy = self._numbers(origin, "rpy", 3, "0 0 0", f"{where} origin")
        return xyz, from_rpy(*rpy.tolist())

    def _joint(self, element: Element) -> _Joint | None:
        name, kind = str(element.get("name")), str(element.get("type"))
        where = f"joint {name!r}"
        if kind not in KINDS:
            self.wrong = True
            self.report.add("model-joint", element.line, f"{where} type", got=repr(kind))
            return None
        ends = []
        for tag in ("parent", "child"):
            end = element.first(tag)
            link = None if end is None else end.get("link")
            if end is None or link is None:
                self._value("a link", link, end or element, f"{where} {tag}")
                return None
            if link not in self.links:
                self.wrong = True
                self.report.unknown("a link", link, self.links, end.line, f"{where} {tag}")
            ends.append(link)
        xyz, rotation = self._origin(element, where)
        axis = self._numbers(element.first("axis"), "xyz", 3, "1 0 0", f"{where} axis")
        length = float(np.linalg.norm(axis))
        if kind != "fixed" and not length > 1e-9 and not self.wrong:
            self._value("a direction", "0 0 0", element, f"{where} axis")
            return None
        joint = _Joint(name, kind, element, ends[0], ends[1], xyz, rotation, axis / (length or 1.0))
        self._limits(joint, where)
        self._mimic(joint, where)
        return joint

    def _limits(self, joint: _Joint, where: str) -> None:
        limit = joint.element.first("limit")
        if joint.kind not in ("revolute", "prismatic") or limit is None:
            return
        joint.lower = float(self._numbers(limit, "lower", 1, "0", f"{where} limit")[0])
        joint.upper = float(self._numbers(limit, "upper", 1, "0", f"{where} limit")[0])
        if joint.upper < joint.lower:
            self._value(f"at least lower, {joint.lower:g}", limit.get("upper"), limit,
                        f"{where} limit upper")  # fmt: skip

    def _mimic(self, joint: _Joint, where: str) -> None:
        mimic = joint.element.first("mimic")
        if mimic is None or joint.kind == "fixed":
            return
        joint.follows = mimic.get("joint") or ""
        joint.multiplier = float(self._numbers(mimic, "multiplier", 1, "1", f"{where} mimic")[0])
        joint.offset = float(self._numbers(mimic, "offset", 1, "0", f"{where} mimic")[0])

    def _tree(self, joints: list[_Joint]) -> list[tuple[str, _Joint | None]] | None:
        """Links with their joints, parents first."""
        carrier: dict[str, _Joint] = {}
        for joint in joints:
            first = carrier.setdefault(joint.child, joint)
            if first is not joint:
                self._value(f"a link without a parent, as {first.name!r} carries it already",
                            joint.child, joint.element, f"joint {joint.name!r} child")  # fmt: skip
        roots = [name for name in self.links if name not in carrier]
        if len(roots) != 1 and not self.wrong:
            got = "none" if not roots else ", ".join(roots)
            self._value("one link that hangs on no other", got, self.root, "robot")
        if self.wrong:
            return None
        children: dict[str, list[_Joint]] = {}
        for joint in joints:
            children.setdefault(joint.parent, []).append(joint)
        order: list[tuple[str, _Joint | None]] = [(roots[0], None)]
        for name, _ in order:
            order += [(joint.child, joint) for joint in children.get(name, ())]
        if len(order) < len(self.links):
            reached = {name for name, _ in order}
            left = [name for name in self.links if name not in reached]
            self._value("links in a tree, not in a ring", ", ".join(left), self.root, "robot")
            return None
        return order

    def _drivers(self, joints: dict[str, _Joint]) -> dict[str, tuple[str, float, float]]:
        """Driver of each joint that moves: name, multiplier and offset."""
        found: dict[str, tuple[str, float, float]] = {}
        movable = {name: joint for name, joint in joints.items() if joint.kind != "fixed"}
        for name, joint in movable.items():
            at, multiplier, offset, seen = joint, 1.0, 0.0, {name}
            while at.follows is not None:
                if at.follows not in movable or at.follows in seen:
                    self.wrong = True
                    free = [other for other, j in movable.items() if j.follows is None]
                    self.report.unknown("a joint that moves and follows no other in a ring",
                                        at.follows, free, at.element.line,
                                        f"joint {at.name!r} mimic")  # fmt: skip
                    break
                offset += multiplier * at.offset
                multiplier *= at.multiplier
                at = movable[at.follows]
                seen.add(at.name)
            found[name] = (at.name, multiplier, offset)
        return found

    def _geoms(self, order: list[tuple[str, _Joint | None]]) -> list[Geom]:
        geoms = []
        for index, (name, _) in enumerate(order):
            for tag in ("collision", "visual"):
                for element in self.links[name].all(tag):
                    geom = self._geom(index, element, tag == "visual", f"link {name!r} {tag}")
                    geoms += [] if geom is None else [geom]
        return geoms

    def _geom(self, link: int, element: Element, visual: bool, where: str) -> Geom | None:
        geometry = element.first("geometry")
        shape = None if geometry is None else next(iter(geometry.children), None)
        if shape is None or shape.tag not in (*SHAPES, "mesh"):
            expected = "a geometry: " + ", ".join((*SHAPES, "mesh"))
            self._value(expected, shape and shape.tag, element, where)
            return None
        xyz, turn = self._origin(element, where)
        at = {"xyz": tuple(xyz.tolist()), "rotation": tuple(turn.ravel().tolist()),
              "visual": visual, "line": shape.line}  # fmt: skip
        if shape.tag == "mesh":
            scale = self._numbers(shape, "scale", 3, "1 1 1", f"{where} mesh")
            mesh = str(resolve_mesh(shape.get("filename") or "", self.path))
            return Geom(link, "mesh", mesh=mesh, scale=tuple(scale.tolist()), **at)
        attribute, count = SHAPES[shape.tag]
        size = self._numbers(shape, attribute, count, "", f"{where} {shape.tag}").tolist()
        if shape.tag == "box":
            size = [side / 2 for side in size]
        elif shape.tag != "sphere":
            length = self._numbers(shape, "length", 1, "", f"{where} {shape.tag}")
            size.append(float(length[0]) / 2)
        return Geom(link, shape.tag, tuple(size), **at)

    def _mass(self, link: str) -> float:
        """Mass of a link, kg; NaN where the file has none."""
        inertial = self.links[link].first("inertial")
        mass = None if inertial is None else inertial.first("mass")
        if mass is None:
            return math.nan
        return float(self._numbers(mass, "value", 1, "", f"link {link!r} mass")[0])


def resolve_mesh(name: str, model: Path) -> Path:
    """File of a mesh in a URDF: relative to it, or in a package.

    A package is a folder with that name, or with it in its package.xml: around the model, next to
    such a folder, or where ROS has it by the environment. For a missing file the first candidate
    is returned.
    """
    if name.startswith("file://"):
        return Path(name.removeprefix("file://"))
    if not name.startswith("package://"):
        return model.parent / name
    package, _, rest = name.removeprefix("package://").partition("/")
    around = model.absolute().parents
    ros = [Path(path, "share") for path in _paths("AMENT_PREFIX_PATH")] + _paths("ROS_PACKAGE_PATH")
    called = [folder for folder in around if folder.name == package]
    tried = [*called, *(folder / package for folder in (*around, *ros)), *around[:3]]
    manifests = (
        file for folder in (*around[:NEAR], *ros) for pattern in ("package.xml", "*/package.xml")
        for file in sorted(folder.glob(pattern))
    )  # fmt: skip
    named = (file.parent for file in manifests if _package(file) == package)
    found = (path for folder in chain(tried, named) if (path := folder / rest).is_file())
    return next(found, tried[0] / rest)


def _paths(variable: str) -> list[Path]:
    return [Path(path) for path in os.environ.get(variable, "").split(os.pathsep) if path]


def _package(manifest: Path) -> str:
    """Name of the package of a package.xml; empty where it cannot be read."""
    try:
        found = re.search(r"<name>\s*([^<]*?)\s*</name>", manifest.read_text("utf-8", "replace"))
    except OSError:
        return ""
    return found[1] if found else ""


def _arrays(
    root: Element,
    path: Path,
    order: list[tuple[str, _Joint | None]],
    joints: list[_Joint],
    drivers: dict[str, tuple[str, float, float]],
    geoms: list[Geom],
    mass: list[float],
    links: dict[str, Element],
) -> RobotModel:
    free = [joint for joint in joints if joint.kind != "fixed" and joint.follows is None]
    names = [joint.name for joint in free]
    index = {name: i for i, (name, _) in enumerate(order)}
    own = [joint and drivers.get(joint.name) for _, joint in order]
    lower, upper = (np.array([getattr(joint, end) for joint in free]) for end in ("lower", "upper"))
    carried = [joint for _, joint in order]

    def columns(name: str, none: np.ndarray) -> np.ndarray:
        return np.stack([none if j is None else getattr(j, name) for j in carried], axis=-1)

    return RobotModel(
        name=root.get("name") or path.stem,
        path=path,
        link_names=tuple(name for name, _ in order),
        parent=tuple(-1 if joint is None else index[joint.parent] for joint in carried),
        joints=tuple("" if joint is None else joint.name for joint in carried),
        kinds=tuple("fixed" if joint is None else joint.kind for joint in carried),
        driver=tuple(names.index(follows[0]) if follows else -1 for follows in own),
        multiplier=np.array([follows[1] if follows else 0.0 for follows in own]),
        offset=np.array([follows[2] if follows else 0.0 for follows in own]),
        axis=columns("axis", np.array([1.0, 0.0, 0.0])),
        anchor=np.zeros((3, len(order))),
        xyz=columns("xyz", np.zeros(3)),
        rotation=columns("rotation", np.eye(3)),
        joint_names=tuple(names),
        lower=lower,
        upper=upper,
        mass=np.array(mass),
        geoms=tuple(geoms),
        lines=tuple(links[name].line for name, _ in order),
        base=0,
        home=np.zeros(len(names)),
    )
