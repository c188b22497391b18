"""Joints: the coordinates of a robot, and the resulting poses of links and units."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, overload

import numpy as np

from bus.compiled.bound import Bound
from skin.contact.contact import Contact
from skin.contact.model import POSE
from skin.contact.wrench import wrench_in_frame
from skin.errors import OptionError, SkinError, shown
from skin.robot.closeness import CloseFilm, Closeness
from skin.robot.kinematics import Poses, move, tables
from topology import Topology
from topology.robot.model import RobotModel

if TYPE_CHECKING:
    from skin.contact.model import Geometry

__all__ = ["Joints"]


class Joints:
    """The joints of a robot that carries a skin.

    Parameters
    ----------
    topology : Topology
        With a robot.
    geometry : Geometry, optional
        Of contacts; updated with the units.

    Attributes
    ----------
    robot : RobotModel
    q : ndarray, shape (J,), float64
        Current coordinates, rad or m, in the order of ``robot.joint_names``.

    Raises
    ------
    SkinError
        The topology has no robot.
    """

    def __init__(self, topology: Topology, geometry: Geometry | None = None) -> None:
        if topology.robot is None:
            raise SkinError(
                f"{topology.name}: must have a [robot] for joints to be moved; got none"
            )
        self._topology = topology
        self.robot: RobotModel = topology.robot
        self.q = topology.robot.home.copy()
        self._asked = self.q.copy()
        self._index = {name: j for j, name in enumerate(self.robot.joint_names)}
        links, n = len(self.robot.link_names), topology.n
        alone = np.empty(0, POSE)
        pose = alone if geometry is None else geometry.pose
        middle = np.empty(3) if geometry is None else geometry.origin
        self._poses = Poses(
            np.empty((links, 3, 3)), np.empty((links, 3)), np.empty((3, n)), np.empty((3, 3, n)),
            pose["position"], pose["rotation"], middle,
        )  # fmt: skip
        kept = self._poses._replace(
            contact_position=alone["position"], contact_rotation=alone["rotation"],
            middle=np.empty(3),
        )  # fmt: skip
        self._tables = tables(self.robot, topology)
        scratch = np.empty((3, 3, 3))
        move(*self._tables, self.q, kept, scratch)  # at home, for any poses of contacts
        self._move = Bound(move, *self._tables, self._asked, self._poses, scratch)

    @property
    def unit_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Position (3, n), metre, and rotation (3, 3, n) of all units, skin frame; views."""
        return self._poses.position, self._poses.rotation

    def move(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set coordinates; those that a mapping does not name stay. See `skin.live.Skin`.

        Raises
        ------
        OptionError
            No joint of that name, not as many coordinates as joints, one that is not finite, or
            one outside its joint's limits; nothing has moved then.
        """
        asked = self._asked
        if isinstance(q, Mapping):
            self._take_named(q)
        else:
            self._take(q)
        wrong = self._move()
        if wrong >= 0:
            raise self._refused(wrong)
        self.q[:] = asked

    def _take_named(self, q: Mapping[str, float]) -> None:
        """Set some coordinates by name."""
        asked, index = self._asked, self._index
        asked[:] = self.q
        name, value = "", None
        try:
            for name, value in q.items():
                asked[index[name]] = value
        except KeyError:
            raise self._unknown(name) from None
        except (TypeError, ValueError, OverflowError):
            raise OptionError(f"q[{name!r}]: must be a number; got {shown(value)}") from None

    def _take(self, q: np.ndarray) -> None:
        """Set coordinates in the model's order."""
        try:
            shape = np.shape(q)
            if shape == self.q.shape:
                self._asked[:] = q
        except (TypeError, ValueError, OverflowError):
            raise OptionError(f"q: must be numbers; got {shown(q)}") from None
        if shape != self.q.shape:
            names = ", ".join(self.robot.joint_names)
            raise OptionError(
                f"q: must have shape {self.q.shape}, one for each of {names}; got {shape}"
            )

    def _unknown(self, name: object) -> OptionError:
        robot = self.robot
        if name in robot.joints and (j := robot.driver[robot.joints.index(str(name))]) >= 0:
            leader = robot.joint_names[j]
            return OptionError(
                f"q: must leave out {name!r}, which follows {leader!r}; got {name!r}"
            )
        return OptionError.unknown("q", name, robot.joint_names)

    def _refused(self, joint: int) -> OptionError:
        name, value = self.robot.joint_names[joint], float(self._asked[joint])
        if not np.isfinite(value):
            return OptionError(f"q[{name!r}]: must be finite; got {value}")
        low, high = self.robot.lower[joint], self.robot.upper[joint]
        return OptionError(
            f"q[{name!r}]: must be within the joint's limits, {low:g} to {high:g}; got {value!r}"
        )

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
        link = self.robot.link_names.index(name)
        return self._poses.link_rotation[link].copy(), self._poses.link_position[link].copy()

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
        if np.shape(wrench) != (6,):
            raise SkinError(f"wrench: must have shape (6,); got {np.shape(wrench)}")
        return wrench_in_frame(wrench, rotation, origin)
