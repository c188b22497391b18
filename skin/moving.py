"""Moving: patches that move against each other, by poses or by the joints of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import OptionError, SkinError
from skin.pipeline import Pipeline
from topology import Topology
from topology.pose import pose_fault

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.robot.joints import Joints

__all__ = ["Moving"]


class Moving:
    """Poses of the units of an open skin, set while it runs.

    Attributes
    ----------
    topology : Topology
    pipeline : Pipeline
    """

    topology: Topology
    pipeline: Pipeline

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of all units, for patches that move against each other.

        They hold from the next cycle on; the skin frame stays. Once a cycle is cheap. Units that
        come close do not become neighbours.

        Parameters
        ----------
        position : ndarray, shape (3, n)
            Metre, skin frame.
        rotation : ndarray, shape (3, 3, n)
            Columns are the unit's axes in the skin frame.

        Raises
        ------
        SkinError
            An array of another shape, a position that is not finite, or no rotation.
        """
        self.pipeline.move(position, rotation)

    def move_joints(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set the joints of the robot that carries the skin, and with them the poses of all units.

        As `move`, by forward kinematics; mimic joints follow. Poses set by `move` or `move_patch`
        before are lost.

        Parameters
        ----------
        q : mapping of str to float, or ndarray, shape (J,)
            Radian or metre, by name, where other joints stay; or all of them, in
            the order of ``topology.robot.joint_names``.

        Raises
        ------
        SkinError
            The topology file has no [robot].
        OptionError
            No such joint, the wrong number of coordinates, one that is not finite, or one outside
            its limits. No joint has moved then.
        """
        self.pipeline.move_joints(q)

    def turn(self, attitude: np.ndarray) -> None:
        """Report the attitude of the skin in the world, from an IMU or the robot's kinematics.

        Where too few units are untouched to estimate the ambient field, the estimate is turned by
        these attitudes; turns of the untouched skin before that make the field at its tare known.
        Call it after `move` or `move_joints`, so that patches on links turn with these. From the
        first call on only reported turns count: call it as often as the skin turns, about 60 µs for
        each frame that carries patches. Recordings do not contain it.

        Parameters
        ----------
        attitude : ndarray, shape (3, 3)
            A rotation: columns are the axes of the skin frame in any fixed frame.

        Raises
        ------
        OptionError
            It is not a rotation.
        """
        self.pipeline.turn(attitude)

    @property
    def joints(self) -> Joints:
        """The robot's joints: their coordinates, and poses of links; see `skin.robot.joints`."""
        return self.pipeline.joints

    def link_pose(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """T_skin_link of the robot now; see `skin.robot.joints.Joints.link_pose`."""
        return self.joints.link_pose(name)

    def wrench_in(self, link: str, wrench: Contact | np.ndarray) -> Any:
        """A wrench in a link's frame; see `skin.robot.joints.Joints.wrench_in`."""
        return self.joints.wrench_in(link, wrench)

    def move_patch(self, name: str, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Set the pose of one patch, by a rigid motion from its pose in the file; see `move`.

        Parameters
        ----------
        name : str
            Of `Topology.patch_names`.
        rotation : ndarray, shape (3, 3)
        translation : ndarray, shape (3,)
            Metre. A point p of the skin frame is now at ``rotation @ p + translation``.

        Raises
        ------
        OptionError
            There is no such patch.
        SkinError
            An array of another shape, a translation that is not finite, or no rotation.
        """
        topology = self.topology
        if name not in topology.patch_names:
            raise OptionError.unknown("patch", name, topology.patch_names)
        turn, shift = np.asarray(rotation, float), np.asarray(translation, float)
        if turn.shape != (3, 3) or shift.shape != (3,):
            raise SkinError(
                "rotation, translation: must have shapes (3, 3) and (3,); "
                f"got {turn.shape} and {shift.shape}"
            )
        fault = pose_fault(shift[:, np.newaxis], turn[:, :, np.newaxis], "translation")
        if fault is not None:
            raise SkinError(fault[1])
        units = topology.patch == topology.patch_names.index(name)
        position, turned = (pose.copy() for pose in self.pipeline.poses)
        position[:, units] = turn @ topology.position[:, units] + shift[:, np.newaxis]
        turned[:, :, units] = np.einsum("ij,jkn->ikn", turn, topology.rotation[:, :, units])
        self.move(position, turned)
