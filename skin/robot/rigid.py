"""A single patch moved as a rigid body from its pose in the file."""

from __future__ import annotations

import numpy as np

from skin.errors import OptionError, SkinError
from topology import Topology
from topology.pose import pose_fault

__all__ = ["with_patch_moved"]


def with_patch_moved(
    topology: Topology,
    poses: tuple[np.ndarray, np.ndarray],
    name: str,
    rotation: np.ndarray,
    translation: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (3, n) and rotations (3, 3, n) with one patch moved; see `Skin.move_patch`.

    Raises
    ------
    OptionError
        There is no such patch.
    SkinError
        An array of another shape, a translation that is not finite, or no rotation.
    """
    if name not in topology.patch_names:
        raise OptionError.unknown("patch", name, topology.patch_names)
    units = topology.patch == topology.patch_names.index(name)
    turn, shift = np.asarray(rotation, float), np.asarray(translation, float)
    if turn.shape != (3, 3) or shift.shape != (3,):
        raise SkinError(
            "rotation, translation: must have shapes (3, 3) and (3,); "
            f"got {turn.shape} and {shift.shape}"
        )
    fault = pose_fault(shift[:, np.newaxis], turn[:, :, np.newaxis], "translation")
    if fault is not None:
        raise SkinError(fault[1])
    position, turned = (pose.copy() for pose in poses)
    position[:, units] = turn @ topology.position[:, units] + shift[:, np.newaxis]
    turned[:, :, units] = np.einsum("ij,jkn->ikn", turn, topology.rotation[:, :, units])
    return position, turned
