"""URDF to a `RobotModel`: links and joints by the standard library's XML parser.

Conventions are those of the format: a child's frame is at the joint's `origin`, rotates about or
moves along `axis`, angles are radians, `rpy` is about the parent's fixed axes.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from topology.errors import Report, nearest
from topology.pose import from_rpy
from topology.robot.model import Geom, JointKind, Link, RobotModel, common_limits

__all__ = ["read_urdf"]

LINE = " line"
"""Attribute with the line of an element; XML has no such name."""
KINDS: tuple[JointKind, ...] = ("fixed", "revolute", "continuous", "prismatic")
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
    """A joint of the file, and the link that it carries."""

    link: Link
    above: str
    """Name of the link that it hangs on."""
    element: Element
    follows: str | None = None
    """The joint whose coordinate it has, times `multiplier`, plus `offset` of the link."""


def read_urdf(text: bytes, path: Path, shown: str, report: Report) -> RobotModel | None:
    """The model of a URDF, or None where it is wrong, and reported.

    Parameters
    ----------
    text : bytes
    path : Path
        Its file, from which meshes are located.
    shown : str
        Its name in messages.
    report : Report
    """
    root = _parsed(text, shown, report)
    if root is None:
        return None
    if root.tag != "robot":
        expected, where = "a <robot> as URDF has it", "root element"
        report.about_file(shown, expected, repr(root.tag), line=_line(root), where=where)
        return None
    return _Reader(root, path, shown, report).model()


def _parsed(text: bytes, shown: str, report: Report) -> Element | None:
    """The root element of a text; None where it is no XML, or has a document type, so that no
    entities are read, and reported."""
    parser, builder = expat.ParserCreate(), TreeBuilder()

    def start(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, attributes | {LINE: str(parser.CurrentLineNumber)})

    def refuse(*_: object) -> None:
        raise ValueError("a document type, whose entities are not read")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        report.about_file(shown, "XML", expat.ErrorString(error.code), line=error.lineno)
    except ValueError as error:
        report.about_file(shown, "XML", error, line=parser.CurrentLineNumber)
    else:
        return builder.close()
    return None


def _line(element: Element) -> int:
    return int(element.attrib[LINE])


class _Reader:
    def __init__(self, root: Element, path: Path, shown: str, report: Report) -> None:
        self.root, self.path, self.shown, self.report = root, path, shown, report
        self.before = len(report.issues)
        self.links = self._named("link")
        self.elements = self._named("joint")

    @property
    def wrong(self) -> bool:
        """Whether a fault has been found."""
        return len(self.report.issues) > self.before

    def model(self) -> RobotModel | None:
        if any(element.tag.startswith("xacro:") for element in self.root.iter()):
            self._fault("URDF; let `xacro` write it out first", "xacro", self.root, "robot")
            return None
        joints = [found for e in self.elements.values() if (found := self._joint(e)) is not None]
        links = [] if self.wrong else self._tree(joints)
        if self.wrong:
            return None
        free = [j for j in joints if j.link.kind != "fixed" and j.follows is None]
        names = tuple(joint.link.joint for joint in free)
        self._drive(joints, {name: index for index, name in enumerate(names)})
        geoms = tuple(self._geoms(links))
        for link in links:
            link.mass, link.line = self._mass(link.name), _line(self.links[link.name])
        lower, upper, beyond = common_limits(links, names)
        for link, expected in beyond:
            got, element = f"{link.lower:g} to {link.upper:g}", self.elements[link.joint]
            self._fault(expected, got, element, f"joint {link.joint!r} limit")
        if self.wrong:
            return None
        home = np.fmin(np.fmax(np.zeros(len(free)), lower), upper)
        name = self.root.get("name") or self.path.stem
        return RobotModel(name, self.path, tuple(links), names, lower, upper, home, geoms)

    def _fault(
        self, expected: str, got: str | None, element: Element, where: str, hint: str = ""
    ) -> None:
        shown = "none" if got is None else repr(got if len(got) <= 60 else got[:57] + "...")
        self.report.about_file(
            self.shown, expected, shown, line=_line(element), where=where, hint=hint
        )

    def _named(self, tag: str) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self.root.findall(tag):
            name = element.get("name")
            if not name:
                self._fault("a name", name, element, tag)
            elif (first := found.setdefault(name, element)) is not element:
                also = f", also at line {_line(first)}"
                self._fault("a name used once", name, element, tag, also)
        return found

    def _numbers(
        self, element: Element | None, name: str, count: int, default: str, where: str
    ) -> Any:
        """Numbers of an attribute, or a single one; the default where it is absent, zeros where it
        is invalid."""
        given = None if element is None else element.get(name)
        try:
            values = np.array([float(word) for word in (given or default).split()])
        except ValueError:
            values = np.empty(0)
        if values.size != count or not np.isfinite(values).all():
            expected = "a finite number" if count == 1 else f"{count} finite numbers"
            at = self.root if element is None else element
            self._fault(expected, given, at, f"{where} {name}")
            values = np.zeros(count)
        return values if count > 1 else float(values[0])

    def _origin(self, element: Element, where: str) -> tuple[np.ndarray, np.ndarray]:
        origin = element.find("origin")
        xyz = self._numbers(origin, "xyz", 3, "0 0 0", f"{where} origin")
        rpy = self._numbers(origin, "rpy", 3, "0 0 0", f"{where} origin")
        return xyz, from_rpy(*rpy.tolist())

    def _joint(self, element: Element) -> _Joint | None:
        name, given = str(element.get("name")), element.get("type")
        where = f"joint {name!r}"
        kind: JointKind | None = next((known for known in KINDS if known == given), None)
        if kind is None:
            expected = "fixed, revolute, continuous or prismatic"
            self._fault(expected, given, element, f"{where} type")
            return None
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            link = None if end is None else end.get("link")
            if end is None or link is None:
                self._fault("a link", link, element if end is None else end, f"{where} {tag}")
                return None
            if link not in self.links:
                hint = nearest(link, self.links)
                self._fault("the name of a link", link, end, f"{where} {tag}", hint)
            ends.append(link)
        link = Link(ends[1], joint=name, kind=kind)
        joint = _Joint(link, above=ends[0], element=element)
        link.xyz, link.rotation = self._origin(element, where)
        axis = self._numbers(element.find("axis"), "xyz", 3, "1 0 0", f"{where} axis")
        length = float(np.linalg.norm(axis))
        if kind != "fixed" and length < 1e-9 and not self.wrong:
            self._fault("a direction", "0 0 0", element, f"{where} axis")
        link.axis = axis / (length or 1.0)
        limit, mimic = element.find("limit"), element.find("mimic")
        if kind in ("revolute", "prismatic"):
            self._limit(link, limit, mimic is not None, element)
        if kind != "fixed" and mimic is not None:
            joint.follows = mimic.get("joint") or ""
            link.multiplier = self._numbers(mimic, "multiplier", 1, "1", f"{where} mimic")
            link.offset = self._numbers(mimic, "offset", 1, "0", f"{where} mimic")
        return joint

    def _limit(self, link: Link, limit: Element | None, follows: bool, element: Element) -> None:
        """Give a joint its limits; only one that follows another may be without."""
        where = f"joint {link.joint!r} limit"
        if limit is None or not {"lower", "upper"}.intersection(limit.keys()):
            if not follows:
                turns = link.kind == "revolute"
                hint = " (type 'continuous' has none)" if turns else ""
                unit = "rad" if turns else "m"
                self._fault(f"lower and upper, {unit}", None, element, where, hint)
            return
        ends = (self._numbers(limit, end, 1, "0", where) for end in ("lower", "upper"))
        link.limits = np.array([*ends])
        if link.upper < link.lower:
            expected, got = f"at least lower, {link.lower:g}", limit.get("upper")
            self._fault(expected, got, limit, f"{where} upper")

    def _tree(self, joints: list[_Joint]) -> list[Link]:
        """Links, parents first."""
        carrier: dict[str, Link] = {}
        for joint in joints:
            link = joint.link
            first = carrier.setdefault(link.name, link)
            if first is not link:
                expected = f"a link without a parent, as {first.joint!r} carries it already"
                self._fault(expected, link.name, joint.element, f"joint {link.joint!r} child")
        roots = [name for name in self.links if name not in carrier]
        if len(roots) != 1 and not self.wrong:
            got = "none" if not roots else ", ".join(roots)
            self._fault("one link that hangs on no other", got, self.root, "robot")
        if self.wrong:
            return []
        links: list[Link] = [Link(roots[0])]
        below: dict[str, list[Link]] = {}
        for joint in joints:
            below.setdefault(joint.above, []).append(joint.link)
        for index, parent in enumerate(links):
            for link in below.get(parent.name, ()):
                link.parent = index
                links.append(link)
        left = self.links.keys() - {link.name for link in links}
        if left:
            got = ", ".join(name for name in self.links if name in left)
            self._fault("links in a tree, not in a ring", got, self.root, "robot")
        return links

    def _drive(self, joints: list[_Joint], free: dict[str, int]) -> None:
        """Give each joint that moves its driver, through all joints that it follows in turn."""
        movable = {joint.link.joint: joint for joint in joints if joint.link.kind != "fixed"}
        found: dict[str, tuple[int, float, float]] = {}
        for name, joint in movable.items():
            at, multiplier, offset, seen = joint, 1.0, 0.0, {name}
            while at.follows is not None:
                if at.follows not in movable or at.follows in seen:
                    expected = "the name of a joint that moves and follows no other in a ring"
                    where, hint = f"joint {at.link.joint!r} mimic", nearest(at.follows, free)
                    self._fault(expected, at.follows, at.element, where, hint)
                    break
                offset += multiplier * at.link.offset
                multiplier *= at.link.multiplier
                at = movable[at.follows]
                seen.add(at.link.joint)
            found[name] = (free.get(at.link.joint, -1), multiplier, offset)
        for name, values in found.items():
            link = movable[name].link
            link.driver, link.multiplier, link.offset = values

    def _geoms(self, links: list[Link]) -> list[Geom]:
        found = [
            self._geom(index, element, tag == "visual", f"link {link.name!r} {tag}")
            for index, link in enumerate(links)
            for tag in ("collision", "visual")
            for element in self.links[link.name].findall(tag)
        ]
        return [geom for geom in found if geom is not None]

    def _geom(self, link: int, element: Element, visual: bool, where: str) -> Geom | None:
        geometry = element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None or shape.tag not in (*SHAPES, "mesh"):
            expected = "a geometry: " + ", ".join((*SHAPES, "mesh"))
            self._fault(expected, None if shape is None else shape.tag, element, where)
            return None
        xyz, turn = self._origin(element, where)
        at = {"xyz": tuple(xyz.tolist()), "rotation": tuple(turn.ravel().tolist()),
              "visual": visual, "line": _line(shape)}  # fmt: skip
        if shape.tag == "mesh":
            scale = self._numbers(shape, "scale", 3, "1 1 1", f"{where} mesh")
            mesh = str(resolve_mesh(shape.get("filename") or "", self.path))
            return Geom(link, "mesh", mesh=mesh, scale=tuple(scale.tolist()), **at)
        attribute, count = SHAPES[shape.tag]
        size = self._numbers(shape, attribute, count, "", f"{where} {shape.tag}")
        if shape.tag == "box":
            return Geom(link, shape.tag, tuple((size / 2).tolist()), **at)
        if shape.tag == "sphere":
            return Geom(link, shape.tag, (size,), **at)
        length = self._numbers(shape, "length", 1, "", f"{where} {shape.tag}")
        return Geom(link, shape.tag, (size, length / 2), **at)

    def _mass(self, link: str) -> float | None:
        """Mass of a link, kg; None where the file has none."""
        mass = self.links[link].find("inertial/mass")
        if mass is None:
            return None
        return self._numbers(mass, "value", 1, "", f"link {link!r} mass")


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
