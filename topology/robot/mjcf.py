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

from topology.pose import from_quaternion
from topology.robot.model import Geom, RobotModel, factors, motion_terms
from topology.robot.report import ModelReport

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


def read_mjcf(text: bytes, path: Path, report: ModelReport) -> RobotModel | None:
    """The model of an MJCF file, or None where it is wrong, and reported.

    Parameters
    ----------
    text : bytes
        Of the file, where lines are looked up; MuJoCo reads the file itself, and what it includes.
    path : Path
    report : ModelReport
    """
    try:
        mujoco = mujoco_library()
    except MissingMujocoError as error:
        report.add("library", extra="mujoco", reason=str(error).partition("; got: ")[2])
        return None
    try:
        model = mujoco.MjModel.from_xml_path(os.fspath(path))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        found = re.search(r"[Ll]ine(?: number=)? ?(\d+)", reason)
        report.add("model-syntax", int(found[1]) if found else 0, kind="MJCF", reason=reason)
        return None
    return _Reader(mujoco, model, text, path, report).model()


def _line(text: bytes, tag: str, name: str) -> int:
    """Line of the element of that name; 0 where it is in an included file."""
    pattern = rf"<{tag}\b[^<>]*?\bname=[\"']{re.escape(name)}[\"']".encode()
    found = re.search(pattern, text)
    return 0 if found is None else text.count(b"\n", 0, found.start()) + 1


class _Reader:
    """Rows of links from a compiled model, body by body."""

    def __init__(
        self, mujoco: Any, model: Any, text: bytes, path: Path, report: ModelReport
    ) -> None:
        self.mujoco, self.m, self.text, self.path = mujoco, model, text, path
        self.report = report
        self.rows: list[dict[str, Any]] = []
        self.link: list[int] = []
        """Link of each body."""
        kinds = mujoco.mjtJoint
        self.hinge, self.slide = int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)
        self.ball = int(kinds.mjJNT_BALL)
        self.moving = [
            j for j in range(model.njnt) if model.jnt_type[j] in (self.hinge, self.slide)
        ]

    def model(self) -> RobotModel | None:
        m = self.m
        if (balls := np.flatnonzero(m.jnt_type == self.ball)).size:
            for joint in balls:
                name = self._joint(joint)
                line = _line(self.text, "joint", name)
                self.report.add("model-joint", line, f"joint {name!r}", got="'ball'")
            return None
        follows = self._couplings()
        free = [j for j in self.moving if j not in follows]
        for body in range(m.nbody):
            self._body(body)
        for row in self.rows:
            self._drive(row, follows, free)
        limited = m.jnt_limited[free].astype(bool)
        limits = np.where(limited[:, np.newaxis], m.jnt_range[free], np.nan)
        rows = self.rows
        return RobotModel(
            name=m.names[: m.names.index(b"\0")].decode() or self.path.stem,
            path=self.path,
            link_names=tuple(row["name"] for row in rows),
            parent=tuple(row["parent"] for row in rows),
            joints=tuple("" if row["joint"] < 0 else self._joint(row["joint"]) for row in rows),
            kinds=tuple(row["kind"] for row in rows),
            driver=tuple(row["driver"] for row in rows),
            multiplier=np.array([row["multiplier"] for row in rows]),
            offset=np.array([row["offset"] for row in rows]),
            **{name: np.stack([row[name] for row in rows], axis=-1)
               for name in ("axis", "anchor", "xyz", "rotation")},
            joint_names=tuple(self._joint(j) for j in free),
            lower=limits[:, 0], upper=limits[:, 1],
            mass=np.array([row["mass"] for row in rows]),
            geoms=tuple(self._geom(g) for g in range(m.ngeom) if self._known(g)),
            lines=tuple(_line(self.text, "body", row["name"]) for row in rows),
            base=0,
            home=m.qpos0[m.jnt_qposadr[free]].copy(),
        )  # fmt: skip

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
            if joint not in self.moving or joint in found or other in found:
                continue
            rest = m.qpos0[m.jnt_qposadr[joint]]
            if other < 0:
                found[joint] = (-1, 0.0, float(rest + a))
            elif other in self.moving and not any(curved):
                start = m.qpos0[m.jnt_qposadr[other]]
                found[joint] = (other, float(b), float(rest + a - b * start))
        return found

    def _body(self, body: int) -> None:
        m = self.m
        parent = -1 if body == 0 else self.link[m.body_parentid[body]]
        first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
        joints = [j for j in range(first, first + count) if j in self.moving]
        xyz, rotation = m.body_pos[body].copy(), from_quaternion(*m.body_quat[body])
        for joint in joints[:-1]:
            self._row("", parent, joint, xyz, rotation, np.nan)
            parent, xyz, rotation = len(self.rows) - 1, np.zeros(3), np.eye(3)
        name = m.body(body).name or f"body{body}"
        mass = np.nan if body == 0 else float(m.body_mass[body])
        self._row(name, parent, joints[-1] if joints else -1, xyz, rotation, mass)
        self.link.append(len(self.rows) - 1)

    def _row(
        self, name: str, parent: int, joint: int, xyz: np.ndarray, rotation: np.ndarray, mass: float
    ) -> None:
        m = self.m
        kind = "fixed"
        axis, anchor = np.array([1.0, 0.0, 0.0]), np.zeros(3)
        if joint >= 0:
            turns = m.jnt_type[joint] == self.hinge
            limited = bool(m.jnt_limited[joint])
            kind = ("revolute" if limited else "continuous") if turns else "prismatic"
            axis, anchor = m.jnt_axis[joint].copy(), m.jnt_pos[joint].copy()
        self.rows.append({"name": name, "parent": parent, "joint": joint, "kind": kind,
                          "axis": axis, "anchor": anchor, "xyz": xyz, "rotation": rotation,
                          "mass": mass})  # fmt: skip

    def _drive(
        self, row: dict[str, Any], follows: dict[int, tuple[int, float, float]], free: list[int]
    ) -> None:
        """The coordinate that a link follows; MuJoCo measures them from `qpos0`."""
        joint = row["joint"]
        row.update(driver=-1, multiplier=0.0, offset=0.0)
        if joint < 0:
            return
        rest = float(self.m.qpos0[self.m.jnt_qposadr[joint]])
        other, multiplier, offset = follows.get(joint, (joint, 1.0, 0.0))
        if other < 0:
            self._hold(row, offset - rest)
        else:
            row.update(driver=free.index(other), multiplier=multiplier, offset=offset - rest)

    def _hold(self, row: dict[str, Any], at: float) -> None:
        """Make a joint fixed by an equality part of its link's pose."""
        terms = motion_terms(row["kind"], row["axis"], row["anchor"])
        share = factors(np.array([row["kind"] == "prismatic"]), np.array([at]))
        held = np.eye(4) + np.sum(np.concatenate(share) * terms, axis=0)
        row["xyz"] = row["xyz"] + row["rotation"] @ held[:3, 3]
        row["rotation"] = row["rotation"] @ held[:3, :3]
        row["kind"] = "fixed"

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
        link = self.link[m.geom_bodyid[geom]]
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
