"""Writes the units of a skin into a copy of a robot's model: links of a URDF, sites of an MJCF.

The text of the model is unchanged; new elements are inserted.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from skin.errors import SkinError
from skin.robot.kinematics import tables
from topology import Topology
from topology.files import Kind, check_over, whole_file
from topology.robot.model import RobotModel
from topology.robot.read import read_model
from topology.robot.xml import Element, XmlError, parse

__all__ = ["unit_link_name", "write_mounted"]


def unit_link_name(unit: str) -> str:
    """Name of a unit in a model: "palm/r3c4" is "palm_r3c4", since ROS allows no slash."""
    return unit.replace("/", "_")


def write_mounted(topology: Topology, out: Path) -> None:
    """Write a copy of the model, with a link (URDF) or site (MJCF) for each unit.

    Its axes are the unit's: z into the skin. The file is written completely, read back, and then
    renamed.

    Raises
    ------
    SkinError
        There is no robot, `out` is the model itself or in another folder, a name is taken, or a
        body is in a file that the model includes.
    """
    robot = topology.robot
    if robot is None:
        raise SkinError(f"{topology.name}: must have a [robot]; got none")
    model = robot.path
    if out.resolve() == model.resolve():
        raise SkinError(f"{out}: must be another file than the model; got the model itself")
    if out.resolve().parent != model.resolve().parent or out.suffix != model.suffix:
        raise SkinError(
            f"{out}: must be a {model.suffix} file in the folder of the model, for its meshes; "
            f"got another than {model.parent}/NAME{model.suffix}"
        )
    text = model.read_bytes()
    try:
        root = parse(text)
    except XmlError as error:
        raise SkinError(f"{model}:{error.line}: must be XML; got: {error}") from None
    is_urdf = root.tag == "robot"
    _check_names(topology, robot, root)
    new = _urdf(topology, robot, root, text) if is_urdf else _mjcf(topology, robot, root, text)
    mark = f'name="{unit_link_name(topology.unit_names[0])}"'.encode()
    own = Kind("a copy of the model with this skin", lambda path: mark in path.read_bytes())
    check_over(out, own)
    draft = out.with_name(f".{out.stem}.check{out.suffix}")
    try:
        with whole_file(draft) as file:
            file.write(new)
        read_model(draft)
        draft.replace(out)
    finally:
        draft.unlink(missing_ok=True)


def _check_names(topology: Topology, robot: RobotModel, root: Element) -> None:
    tags = ("link", "joint") if root.tag == "robot" else ("site",)
    taken = {e.get("name") for e in root.walk() if e.tag in tags}
    for unit in topology.unit_names:
        name = unit_link_name(unit)
        if name in taken or f"{name}_joint" in taken:
            raise SkinError(
                f"{robot.path}: must have no {tags[0]} {name!r}, which is to be that of unit "
                f"{unit!r}; got one: rename the patch, or take the model without the skin"
            )


def _urdf(topology: Topology, robot: RobotModel, root: Element, text: bytes) -> bytes:
    """A massless link and a fixed joint for each unit, before the end of the robot."""
    _, mounted = tables(robot, topology)
    skin = topology.name.replace("--", "- -")  # no comment may have two
    lines = [f"\n  <!-- units of the skin {skin}: z into the skin -->"]
    for unit, name in enumerate(map(unit_link_name, topology.unit_names)):
        xyz = _numbers(mounted.position[:, unit])
        rpy = _numbers(_rpy(mounted.rotation[:, :, unit]))
        parent = quoteattr(robot.link_names[mounted.link[unit]])
        lines += [
            f'  <link name="{name}"/>',
            f'  <joint name="{name}_joint" type="fixed">',
            f"    <parent link={parent}/>",
            f'    <child link="{name}"/>',
            f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
            "  </joint>",
        ]
    return _inserted(text, {root: "\n".join(lines) + "\n"})


def _mjcf(topology: Topology, robot: RobotModel, root: Element, text: bytes) -> bytes:
    """A site for each unit, at the end of its body."""
    _, mounted = tables(robot, topology)
    bodies = {e.get("name"): e for e in root.walk() if e.tag == "body"}
    world = root.first("worldbody")
    bodies |= {"world": world} if world is not None else {}
    sites: dict[Element, str] = {}
    for unit, name in enumerate(map(unit_link_name, topology.unit_names)):
        link = robot.link_names[mounted.link[unit]]
        body = bodies.get(link)
        if body is None:
            raise SkinError(
                f"{robot.path}: must have body {link!r} in the file itself; got it from one that "
                "it includes: put them into one file first (MuJoCo's `mj_saveLastXML`)"
            )
        pos, quat = _numbers(mounted.position[:, unit]), mounted.rotation[:, :, unit]
        size = topology.parameters["radius_m"][unit]
        sites[body] = sites.get(body, "") + (
            f'\n<site name="{name}" type="cylinder" size="{size:g} 0.0005" pos="{pos}" '
            f'quat="{_numbers(_quaternion(quat))}" rgba="0.2 0.6 0.2 1"/>'
        )
    return _inserted(text, {body: text_ + "\n" for body, text_ in sites.items()})


def _inserted(text: bytes, new: dict[Element, str]) -> bytes:
    """A text with insertions at the end of some elements; ASCII, valid in any encoding of it."""
    for element, more in sorted(new.items(), key=lambda pair: -pair[0].end):
        at, added = element.end, more.encode("ascii", "xmlcharrefreplace")
        if text[at : at + 2] == b"</":
            text = text[:at] + added + text[at:]
            continue
        close = text.index(b"/>", at)  # written without an end tag
        end = f"</{element.tag}>".encode()
        text = text[:close] + b">" + added + end + text[close + 2 :]
    return text


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)


def _rpy(rotation: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw of a rotation, rad; yaw is 0 where pitch is ±90°."""
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:
        roll = math.atan2(-rotation[1, 2], rotation[1, 1])
        return np.array([roll, pitch, 0.0])
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])])


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (w, x, y, z)."""
    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
