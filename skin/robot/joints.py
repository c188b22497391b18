"""Joints: the coordinates of a robot, and the resulting poses of links and units."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import overload

import numpy as np

from skin.contact.contact import Contact
from skin.errors import OptionError, SkinError, as_numbers, shown
from skin.patch import wrench_adjoint
from skin.robot.closeness import CloseFilm, Closeness
from topology import Topology

__all__ = ["Joints", "units_on_links"]


def units_on_links(topology: Topology) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the units of a topology with a robot are on its links; without a link, on the base.

    Returns
    -------
    link : ndarray, shape (n,), int
    position : ndarray, shape (3, n), float64
        Metre, frame of the link.
    rotation : ndarray, shape (n, 3, 3), float64
        R_link_unit.

    Raises
    ------
    SkinError
        The topology has no robot.
    """
    robot = topology.robot
    if robot is None:
        raise SkinError(f"{topology.name}: must have a [robot] for joints to be moved; got none")
    names = topology.patch_links or ("",) * len(topology.patch_names)
    carrier = [robot.link_names.index(name) if name else robot.base for name in names]
    link = np.array(carrier)[topology.patch]
    at = robot.forward(robot.home)[link]
    back = np.swapaxes(at[:, :3, :3], 1, 2)
    away = topology.position.T - at[:, :3, 3]
    position = np.einsum("nij,nj->in", back, away)
    return link, position, back @ np.moveaxis(topology.rotation, 2, 0)


class Joints:
    """The joints of a robot that carries a skin.

    Parameters
    ----------
    topology : Topology
        With a robot.

    Attributes
    ----------
    robot : RobotModel
    q : ndarray, shape (J,), float64
        Current coordinates, rad or m, in the order of ``robot.joint_names``.
    unit_poses : tuple of ndarray
        Position (3, n), metre, and rotation (3, 3, n) of all units, skin frame.

    Raises
    ------
    SkinError
        The topology has no robot.
    """

    def __init__(self, topology: Topology) -> None:
        self._link, self._position, self._rotation = units_on_links(topology)
        assert topology.robot is not None
        self._topology, self.robot = topology, topology.robot
        self._index = {name: j for j, name in enumerate(self.robot.joint_names)}
        self._lower = np.nan_to_num(self.robot.lower, nan=-np.inf)
        self._upper = np.nan_to_num(self.robot.upper, nan=np.inf)
        self._place(self.robot.home.copy())

    def move(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set coordinates; those that a mapping does not name stay. See `skin.live.Skin`.

        Raises
        ------
        OptionError
            No joint of that name, not as many coordinates as joints, one that is not finite, or
            one outside its joint's limits; nothing has moved then.
        """
        asked = self._named(q) if isinstance(q, Mapping) else self._ordered(q)
        allowed = (asked >= self._lower) & (asked <= self._upper) & np.isfinite(asked)
        if not allowed.all():
            joint = int(np.argmin(allowed))
            raise self._refused(joint, float(asked[joint]))
        self._place(asked)

    def _place(self, q: np.ndarray) -> None:
        """Forward kinematics of links and units."""
        self.q, self._poses = q, self.robot.forward(q)
        at = self._poses[self._link]
        position = np.einsum("nij,jn->in", at[:, :3, :3], self._position) + at[:, :3, 3].T
        rotation = np.moveaxis(at[:, :3, :3] @ self._rotation, 0, 2)
        # in memory as a replay has them: sums over them are the same to the bit
        self.unit_poses = np.ascontiguousarray(position), np.ascontiguousarray(rotation)

    def _named(self, q: Mapping[str, float]) -> np.ndarray:
        """All coordinates, of which some are given by name."""
        asked = self.q.copy()
        for name, value in q.items():
            if name not in self._index:
                raise self._unknown(name)
            number = as_numbers(f"q[{name!r}]", value)
            if number.shape:
                raise OptionError(f"q[{name!r}]: must be a number; got {shown(value)}")
            asked[self._index[name]] = number
        return asked

    def _ordered(self, q: np.ndarray) -> np.ndarray:
        """All coordinates, given in the model's order."""
        asked = as_numbers("q", q)
        if asked.shape != self.q.shape:
            names = ", ".join(self.robot.joint_names)
            raise OptionError(
                f"q: must have shape {self.q.shape}, one for each of {names}; got {asked.shape}"
            )
        return asked

    def _unknown(self, name: object) -> OptionError:
        robot = self.robot
        drivers = {link.joint: link.driver for link in robot.links if link.joint}
        if (j := drivers.get(str(name), -1)) >= 0:
            leader = robot.joint_names[j]
            return OptionError(
                f"q: must leave out {name!r}, which follows {leader!r}; got {name!r}"
            )
        return OptionError.unknown("q", name, robot.joint_names)

    def _refused(self, joint: int, value: float) -> OptionError:
        name = self.robot.joint_names[joint]
        if not np.isfinite(value):
            return OptionError(f"q[{name!r}]: must be finite; got {value}")
        expected, got = self.robot.refused(joint, value)
        return OptionError(f"q[{name!r}]: must be {expected}; got {got}")

    def close_films(self) -> tuple[CloseFilm, ...]:
        """Units with a field of other links' films above the sigma of their own field.

        Computed again where units have moved, which takes milliseconds: not for every cycle. The
        field is reported, not subtracted. ``closeness.field_ut`` has it for every unit.
        """
        return self.closeness.look(*self.unit_poses)

    @cached_property
    def closeness(self) -> Closeness:
        """Computes these fields."""
        return Closeness(self._topology)

    def link_pose(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """T_skin_link: rotation, shape (3, 3), and translation, shape (3,), metre.

        Raises
        ------
        OptionError
            There is no such link.
        """
        if not name or name not in self.robot.link_names:
            raise OptionError.unknown("link", name, self.robot.names)
        pose = self._poses[self.robot.link_names.index(name)]
        return pose[:3, :3].copy(), pose[:3, 3].copy()

    @overload
    def wrench_in(self, link: str, wrench: Contact) -> tuple[np.ndarray, np.ndarray]: ...
    @overload
    def wrench_in(self, link: str, wrench: np.ndarray) -> np.ndarray: ...
    def wrench_in(
        self, link: str, wrench: Contact | np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | np.ndarray:
        """A wrench in the frame of a link as it is now: its axes, torques about its origin.

        Parameters
        ----------
        link : str
        wrench : Contact, or ndarray, shape (6,)
            N and N·m about the origin of the skin frame, as of `State.wrench`.

        Returns
        -------
        ndarray, shape (6,), or of a contact that and its covariance, shape (6, 6)
        """
        rotation, origin = self.link_pose(link)
        if isinstance(wrench, Contact):
            return wrench.wrench_in(rotation, origin)
        wrench = as_numbers("wrench", wrench)
        if wrench.shape != (6,):
            raise SkinError(f"wrench: must have shape (6,); got {wrench.shape}")
        return wrench_adjoint(rotation, origin) @ wrench
