"""Forward kinematics: from coordinates of joints to poses of links and of the units on them.

A link's joint turns or slides in the link's own frame, so that with T_parent_link at rest, and the
motion of the joint at a coordinate, ``T_base_link = T_base_parent T_parent_link motion``. Letters:
L links, J joints, n units.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from topology import Topology
from topology.robot.model import RobotModel

__all__ = ["LinkModel", "Mounted", "Poses", "move", "move_python", "tables"]

FIXED, TURNS, SLIDES = 0, 1, 2
KINDS = {"fixed": FIXED, "revolute": TURNS, "continuous": TURNS, "prismatic": SLIDES}


class LinkModel(NamedTuple):
    """Links in a tree, parents first; see `topology.robot.model.RobotModel`."""

    parent: np.ndarray  # (L,), int32
    kind: np.ndarray  # (L,), int32
    driver: np.ndarray  # (L,), int32
    multiplier: np.ndarray  # (L,)
    offset: np.ndarray  # (L,)
    axis: np.ndarray  # (L, 3)
    anchor: np.ndarray  # (L, 3), m
    xyz: np.ndarray  # (L, 3), m
    rotation: np.ndarray  # (L, 3, 3)
    limits: np.ndarray  # (2, J), rad or m; infinite where there are none
    base: np.ndarray  # (1,), int64: the link whose frame is the skin's


class Mounted(NamedTuple):
    """Units on links."""

    link: np.ndarray  # (n,), int32
    position: np.ndarray  # (3, n), metre, frame of the link
    rotation: np.ndarray  # (3, 3, n), R_link_unit


class Poses(NamedTuple):
    """Poses in the skin frame."""

    link_rotation: np.ndarray  # (L, 3, 3)
    link_position: np.ndarray  # (L, 3), m
    position: np.ndarray  # (3, n), m
    rotation: np.ndarray  # (3, 3, n)
    contact_position: np.ndarray  # (n, 3) or (0, 3), m, about the middle: as contacts have them
    contact_rotation: np.ndarray  # (n, 3, 3) or (0, 3, 3)
    middle: np.ndarray  # (3,), m


def tables(robot: RobotModel, topology: Topology) -> tuple[LinkModel, Mounted]:
    """The links of a robot, and the units of a topology on them, as the kernel takes them."""
    kinds = [KINDS[kind] for kind in robot.kinds]
    driven = np.array(robot.driver, np.int32)
    limits = np.stack(
        [np.nan_to_num(robot.lower, nan=-np.inf), np.nan_to_num(robot.upper, nan=np.inf)]
    )
    model = LinkModel(
        np.array(robot.parent, np.int32),
        np.where(driven < 0, FIXED, kinds).astype(np.int32),
        driven,
        np.array(robot.multiplier),
        np.array(robot.offset),
        np.ascontiguousarray(robot.axis.T),
        np.ascontiguousarray(robot.anchor.T),
        np.ascontiguousarray(robot.xyz.T),
        np.ascontiguousarray(np.moveaxis(robot.rotation, 2, 0)),
        limits,
        np.array([robot.base]),
    )
    names = topology.patch_links or ("",) * len(topology.patch_names)
    carrier = [robot.link_names.index(name) if name else robot.base for name in names]
    link = np.array(carrier, np.int32)[topology.patch]
    at = robot.forward(robot.home)[link]
    turn = np.swapaxes(at[:, :3, :3], 1, 2)
    away = topology.position.T - at[:, :3, 3]
    return model, Mounted(
        link,
        np.ascontiguousarray(np.einsum("nij,nj->in", turn, away)),
        np.ascontiguousarray(np.einsum("nij,jkn->ikn", turn, topology.rotation)),
    )


@jitable(inline=True)
def _turned(axis: np.ndarray, angle: float, out: np.ndarray) -> None:
    """Rotation about a unit vector: Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z


@jitable(inline=True)
def _copy(a: np.ndarray, out: np.ndarray) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, j]


@jitable(inline=True)
def _times(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Product of two matrices of shape (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@jitable(inline=True)
def _add_turned(at: np.ndarray, turn: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    """A point of a frame, in the frame around it."""
    for i in range(3):
        out[i] = at[i] + (turn[i, 0] * v[0] + turn[i, 1] * v[1] + turn[i, 2] * v[2])


@jitable
def _links(model: LinkModel, q: np.ndarray, poses: Poses, scratch: np.ndarray) -> None:
    """Poses of all links in the frame of the root."""
    motion, whole, shift = scratch[0], scratch[1], scratch[2, 0]
    for k in range(model.parent.size):
        turn, at = poses.link_rotation[k], poses.link_position[k]
        above = model.parent[k]
        if above < 0:
            _copy(model.rotation[k], turn)
            for i in range(3):
                at[i] = model.xyz[k, i]
        else:
            _times(poses.link_rotation[above], model.rotation[k], turn)
            _add_turned(
                poses.link_position[above], poses.link_rotation[above], model.xyz[k], at
            )  # fmt: skip
        if model.kind[k] == FIXED:
            continue
        where = model.multiplier[k] * q[model.driver[k]] + model.offset[k]
        if model.kind[k] == SLIDES:
            for i in range(3):
                shift[i] = where * model.axis[k, i]
            _add_turned(at, turn, shift, at)
            continue
        _turned(model.axis[k], where, motion)
        for i in range(3):
            row = motion[i]
            anchor = model.anchor[k]
            shift[i] = anchor[i] - (
                row[0] * anchor[0] + row[1] * anchor[1] + row[2] * anchor[2]
            )  # fmt: skip
        _add_turned(at, turn, shift, at)
        _times(turn, motion, whole)
        _copy(whole, turn)


@jitable
def _rebase(base: int, poses: Poses, scratch: np.ndarray) -> None:
    """Poses of all links in the frame of one of them, in place of the root's."""
    back, whole, start = scratch[0], scratch[1], scratch[2, 0]
    for i in range(3):
        start[i] = poses.link_position[base, i]
        for j in range(3):
            back[i, j] = poses.link_rotation[base, j, i]
    for k in range(poses.link_position.shape[0]):
        at = poses.link_position[k]
        for i in range(3):
            at[i] -= start[i]
        x, y, z = at[0], at[1], at[2]
        for i in range(3):
            at[i] = back[i, 0] * x + back[i, 1] * y + back[i, 2] * z
        _times(back, poses.link_rotation[k], whole)
        _copy(whole, poses.link_rotation[k])


@jitable
def _units(mounted: Mounted, poses: Poses) -> None:
    """Poses of all units, and of contacts, if there are any."""
    n, link = mounted.link.size, mounted.link
    own, own_turn = mounted.position, mounted.rotation
    turn, at = poses.link_rotation, poses.link_position
    for i in range(3):
        total = 0.0
        for u in range(n):
            k = link[u]
            a, b, c = turn[k, i, 0], turn[k, i, 1], turn[k, i, 2]
            p = at[k, i] + (a * own[0, u] + b * own[1, u] + c * own[2, u])
            poses.position[i, u] = p
            total += p
            for j in range(3):
                poses.rotation[i, j, u] = (
                    a * own_turn[0, j, u] + b * own_turn[1, j, u] + c * own_turn[2, j, u]
                )  # fmt: skip
        poses.middle[i] = total / n
    for u in range(poses.contact_position.shape[0]):
        for i in range(3):
            poses.contact_position[u, i] = poses.position[i, u] - poses.middle[i]
            for j in range(3):
                poses.contact_rotation[u, i, j] = poses.rotation[i, j, u]


def move_python(
    model: LinkModel, mounted: Mounted, q: np.ndarray, poses: Poses, scratch: np.ndarray
) -> int:
    """Poses of links and units at the coordinates of the joints.

    Parameters
    ----------
    model : LinkModel
    mounted : Mounted
    q : ndarray, shape (J,), float64
        Radian or metre.
    poses : Poses
        Written; unchanged where a coordinate is refused.
    scratch : ndarray, shape (3, 3, 3), float64

    Returns
    -------
    int
        The first joint whose coordinate is not finite or outside its limits; -1 if all are fine.
    """
    for j in range(q.size):
        if not (model.limits[0, j] <= q[j] <= model.limits[1, j]) or not math.isfinite(q[j]):
            return j
    _links(model, q, poses, scratch)
    if model.base[0] > 0:
        _rebase(model.base[0], poses, scratch)
    _units(mounted, poses)
    return -1


move = compiled(move_python, fastmath={"contract"}, allocates=False)
