"""MJCF to a `RobotModel`, read and compiled by MuJoCo; the only file that imports it.

Bodies are links. A body with several joints has unnamed links, one for each joint but the last. A
free joint stays at its place in the model, and a ball joint is refused. Joints coupled by a linear
equality are mimic joints.
"""

from __future__ import annotations

import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from topology.errors import Report
from topology.pose import from_quaternion
from topology.robot.model import Geom, Link, RobotModel, common_limits, factors, motion_terms

__all__ = ["MissingMujocoError", "mujoco_library", "read_mjcf"]

SHAPES = {
    "PLANE": ("plane", 2),
    "SPHERE": ("sphere", 1),
    "CAPSULE": ("capsule", 2),
    "ELLIPSOID": ("ellipsoid", 3),
    "CYLINDER": ("cylinder", 2),
    "BOX": ("box", 3),
}
"""Our name for MuJoCo's shapes, and their numbers of sizes."""


class MissingMujocoError(ImportError):
    """MuJoCo is not installed."""


def mujoco_library() -> Any:
    """The module of MuJoCo.

    Raises
    ------
    MissingMujocoError
        It is not installed; the message names the extra that brings it.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise MissingMujocoError(
            f"mujoco: must be installed (pip install 'f3t-skin[mujoco]'); got: {error}"
        ) from None


def read_mjcf(text: bytes, path: Path, shown: str, report: Report) -> RobotModel | None:
    """The model of an MJCF file, or None where it is wrong, and reported.

    Parameters
    ----------
    text : bytes
        Of the file, where lines are looked up; MuJoCo reads the file itself, and what it includes.
    path : Path
    shown : str
        Its name in messages.
    report : Report
    """
    try:
        mujoco = mujoco_library()
    except MissingMujocoError as error:
        expected = "read by the library of the extra 'mujoco' (pip install 'f3t-skin[mujoco]')"
        report.about_file(shown, expected, str(error).partition("; got: ")[2])
        return None
    try:
        model = mujoco.MjModel.from_xml_path(os.fspath(path))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        found = re.search(r"[Ll]ine(?: number=)? ?(\d+)", reason)
        report.about_file(shown, "MJCF", reason, line=int(found[1]) if found else 0)
        return None
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL):
        name = model.joint(joint).name or f"joint{joint}"
        where, kinds = f"joint {name!r}", "fixed, hinge or slide"
        report.about_file(shown, kinds, "'ball'", line=_line(text, "joint", name), where=where)
    if (model.jnt_type == mujoco.mjtJoint.mjJNT_BALL).any():
        return None
    return _Reader(mujoco, model, text, path).model(shown, report)


def _line(text: bytes, tag: str, name: str) -> int:
    """Line of the element of that name; 0 where it is in an included file."""
    pattern = rf"<{tag}\b[^<>]*?\bname=[\"']{re.escape(name)}[\"']".encode()
    found = re.search(pattern, text)
    return 0 if found is None else text.count(b"\n", 0, found.start()) + 1


class _Reader:
    """Links from a compiled model, body by body."""

    def __init__(self, mujoco: Any, model: Any, text: bytes, path: Path) -> None:
        self.mujoco, self.m, self.text, self.path = mujoco, model, text, path
        self.links: list[Link] = []
        self.of_body: list[int] = []
        """Link of each body."""
        kinds = mujoco.mjtJoint
        self.hinge, self.slide = int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)
        self.moving = [
            j for j in range(model.njnt) if model.jnt_type[j] in (self.hinge, self.slide)
        ]
        self.follows = self._couplings()
        self.free = [j for j in self.moving if j not in self.follows]

    def model(self, shown: str, report: Report) -> RobotModel | None:
        m, free = self.m, self.free
        for body in range(m.nbody):
            self._body(body)
        joints = tuple(self._joint(j) for j in free)
        lower, upper, beyond = common_limits(self.links, joints)
        for link, expected in beyond:
            where, got = f"joint {link.joint!r} range", f"{link.lower:g} to {link.upper:g}"
            line = _line(self.text, "joint", link.joint)
            report.about_file(shown, expected, got, line=line, where=where)
        if beyond:
            return None
        home = np.fmin(np.fmax(m.qpos0[m.jnt_qposadr[free]], lower), upper)
        name = m.names[: m.names.index(b"\0")].decode() or self.path.stem
        geoms = tuple(self._geom(g) for g in range(m.ngeom) if self._known(g))
        return RobotModel(name, self.path, tuple(self.links), joints, lower, upper, home, geoms)

    def _joint(self, joint: Any) -> str:
        return self.m.joint(joint).name or f"joint{joint}"

    def _couplings(self) -> dict[int, tuple[int, float, float]]:
        """Joints that an equality couples linearly to another, or fixes (-1)."""
        m, found = self.m, {}
        tied = int(self.mujoco.mjtEq.mjEQ_JOINT)
        for e in range(m.neq):
            if m.eq_type[e] != tied or not m.eq_active0[e]:
                continue
            joint, other, (a, b, *curved) = (
                int(m.eq_obj1id[e]),
                int(m.eq_obj2id[e]),
                m.eq_data[e, :5],
            )
            drivers = {driver for driver, _, _ in found.values()}
            if joint not in self.moving or joint in found or joint in drivers or other in found:
                continue  # a chain has no single driver
            rest = m.qpos0[m.jnt_qposadr[joint]]
            if other < 0:
                found[joint] = (-1, 0.0, float(rest + a))
            elif other in self.moving and not any(curved):
                start = m.qpos0[m.jnt_qposadr[other]]
                found[joint] = (other, float(b), float(rest + a - b * start))
        return found

    def _body(self, body: int) -> None:
        m = self.m
        parent = -1 if body == 0 else self.of_body[m.body_parentid[body]]
        first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
        joints = [j for j in range(first, first + count) if j in self.moving]
        xyz, rotation = m.body_pos[body].copy(), from_quaternion(*m.body_quat[body])
        for joint in joints[:-1]:
            self.links.append(self._link(Link("", parent, xyz=xyz, rotation=rotation), joint))
            parent, xyz, rotation = len(self.links) - 1, np.zeros(3), np.eye(3)
        name = m.body(body).name or f"body{body}"
        link = Link(name, parent, xyz=xyz, rotation=rotation, line=_line(self.text, "body", name))
        link.mass = None if body == 0 else float(m.body_mass[body])
        self.links.append(self._link(link, joints[-1]) if joints else link)
        self.of_body.append(len(self.links) - 1)

    def _link(self, link: Link, joint: int) -> Link:
        """The link with its joint and the coordinate that it follows; MuJoCo measures them from
        `qpos0`."""
        m = self.m
        turns, limited = m.jnt_type[joint] == self.hinge, bool(m.jnt_limited[joint])
        link.joint = self._joint(joint)
        link.kind = ("revolute" if limited else "continuous") if turns else "prismatic"
        link.axis, link.anchor = m.jnt_axis[joint].copy(), m.jnt_pos[joint].copy()
        link.rest = rest = float(m.qpos0[m.jnt_qposadr[joint]])
        other, multiplier, offset = self.follows.get(joint, (joint, 1.0, 0.0))
        if other >= 0:
            link.driver, link.multiplier = self.free.index(other), multiplier
            link.offset = offset
            if limited:
                link.limits = m.jnt_range[joint].copy()
            return link
        # an equality holds the joint: it is part of the link's pose
        terms = motion_terms(link.kind, link.axis, link.anchor)
        share = factors(np.array([not turns]), np.array([offset - rest]))
        held = np.eye(4) + np.sum(np.concatenate(share) * terms, axis=0)
        link.xyz = link.xyz + link.rotation @ held[:3, 3]
        link.rotation = link.rotation @ held[:3, :3]
        link.kind = "fixed"
        return link

    def _known(self, geom: int) -> bool:
        kinds = self.mujoco.mjtGeom
        kind = kinds(int(self.m.geom_type[geom])).name.removeprefix("mjGEOM_")
        return kind in SHAPES or (
            kind == "MESH" and self.m.mesh_pathadr[self.m.geom_dataid[geom]] >= 0
        )

    def _geom(self, geom: int) -> Geom:
        m = self.m
        kind = self.mujoco.mjtGeom(int(m.geom_type[geom])).name.removeprefix("mjGEOM_")
        rotation, xyz = from_quaternion(*m.geom_quat[geom]), m.geom_pos[geom].copy()
        link = self.of_body[m.geom_bodyid[geom]]
        visual = not (m.geom_contype[geom] or m.geom_conaffinity[geom])
        mesh, scale = None, (1.0, 1.0, 1.0)
        shape, count = SHAPES.get(kind, ("mesh", 0))
        if kind == "MESH":  # MuJoCo has moved it into its axes of inertia
            index = int(m.geom_dataid[geom])
            turned = from_quaternion(*m.mesh_quat[index])
            rotation = rotation @ turned.T
            xyz = xyz - rotation @ m.mesh_pos[index]
            at = int(m.mesh_pathadr[index])
            mesh = m.paths[at : m.paths.index(b"\0", at)].decode()
            mesh = os.fspath(self.path.parent / mesh)
            scale = tuple(m.mesh_scale[index].tolist())
        size = tuple(m.geom_size[geom, :count].tolist())
        return Geom(link, shape, size, tuple(xyz.tolist()), tuple(rotation.ravel().tolist()),
                    visual, mesh, scale)  # fmt: skip
