"""Moving: patches that move against each other, by poses or by the joints of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.pipeline import Pipeline
from skin.robot.rigid import with_patch_moved
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.robot.joints import Joints

__all__ = ["Moving"]


class Moving:
    """What an open skin can be told of where its units are.

    Attributes
    ----------
    topology : Topology
    pipeline : Pipeline
    """

    topology: Topology
    pipeline: Pipeline

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of all units, for patches that move against each other.

        Wrenches, centres and normals of the cycles to come are those of the new poses; the skin
        frame stays. As often as they change: once a cycle is cheap. Units become no neighbours by
        coming close.

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
        """Set the joints of the robot that carries the skin, and the poses of all units by them.

        As `move`, by forward kinematics; joints that follow others (mimic) do. A pose given by
        `move` or `move_patch` before is forgotten.

        Parameters
        ----------
        q : mapping of str to float, or ndarray, shape (J,)
            Radian or metre, by name, where the joints that are not named stay; or all of them, in
            the order of ``topology.robot.joint_names``.

        Raises
        ------
        SkinError
            The topology file has no [robot].
        OptionError
            No such joint, not as many coordinates as joints, one that is not finite, or one outside
            its limits. Nothing has moved then.
        """
        self.pipeline.move_joints(q)

    def turn(self, attitude: np.ndarray) -> None:
        """Report how the skin stands in the world, as an IMU or the robot's kinematics have it.

        Where too few units are untouched to see the ambient field, it turns with the skin by these
        attitudes; before, turns of the untouched skin let it know the field of its tare. After
        `move` or `move_joints`, so that patches on links turn with these. From the first call on
        the skin turns as is reported and not otherwise: to be called as often as it turns, about
        60 µs for each frame that carries patches. Recordings do not hold it.

        Parameters
        ----------
        attitude : ndarray, shape (3, 3)
            A rotation: columns are the axes of the skin frame in any frame at rest.

        Raises
        ------
        OptionError
            No rotation.
        """
        self.pipeline.turn(attitude)

    @property
    def joints(self) -> Joints:
        """The robot's joints: their coordinates, and poses of links; see `skin.robot.joints`."""
        return self.pipeline.joints

    def link_pose(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """T_skin_link of the robot, as it is now; see `skin.robot.joints.Joints.link_pose`."""
        return self.joints.link_pose(name)

    def wrench_in(self, link: str, wrench: Contact | np.ndarray) -> Any:
        """A wrench in a link's frame; see `skin.robot.joints.Joints.wrench_in`."""
        return self.joints.wrench_in(link, wrench)

    def move_patch(self, name: str, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Set the pose of one patch, by the rigid motion from where its file has it; see `move`.

        Parameters
        ----------
        name : str
            Of `Topology.patch_names`.
        rotation : ndarray, shape (3, 3)
        translation : ndarray, shape (3,)
            Metre. What was at p in the skin frame is at ``rotation @ p + translation`` now.

        Raises
        ------
        OptionError
            There is no such patch.
        SkinError
            An array of another shape, a translation that is not finite, or no rotation.
        """
        poses = self.pipeline.poses
        self.move(*with_patch_moved(self.topology, poses, name, rotation, translation))
