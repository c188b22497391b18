"""A part of the skin in one cycle: a patch, or all patches on one frame or link of a robot."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skin.errors import OptionError, SkinError, as_numbers
from topology.pose import pose_fault

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.state import Reading, State

__all__ = ["Patch", "as_pose", "wrench_adjoint"]


class Patch:
    """A view of a state; nothing is computed before it is read.

    Parameters
    ----------
    state : State
    name : str
        Of a patch, or of a frame or link that carries patches: those are one part then, whose frame
        is that of the first of them. Where a patch has the name of what carries it, all patches on
        that are meant.

    Attributes
    ----------
    state : State
    name : str
    index : ndarray, shape (m,), int
        Its units, as indices of the skin.

    Raises
    ------
    OptionError
        There is no patch, frame or link of this name, or it is that of a patch and of a frame that
        carries others.

    Examples
    --------
    >>> import skin
    >>> with skin.open("gripper", simulate=True, pace=False) as gripper:
    ...     state = next(iter(gripper))
    >>> pad = state.patch("left")
    >>> pad.index.size, pad.units.force.shape, len(pad.contacts), pad.wrench.tolist()
    (16, (3, 16), 0, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    """

    def __init__(self, state: State, name: str) -> None:
        self.state, self.name = state, name
        skin = state.topology
        carried = np.array([frame == name for frame in skin.patch_frames], bool)
        called = np.array([patch == name for patch in skin.patch_names])
        found = carried if carried.any() else called
        if not found.any():
            raise OptionError.unknown("patch", name, {*skin.patch_names, *skin.patch_frames})
        if (called & ~found).any():
            carrier = skin.patch_frames[int(np.argmax(called))]
            raise OptionError(
                f"patch: must be the name of one part; got {name!r}, a patch on {carrier!r} and a "
                "frame that carries other patches"
            )
        self._first = int(np.argmax(found))
        self.index = np.flatnonzero(found[skin.patch])

    @property
    def unit_names(self) -> list[str]:
        """Names of its units."""
        return [self.state.topology.unit_names[i] for i in self.index]

    @property
    def units(self) -> Reading:
        """Its units; the arrays are copies."""
        return self.state.units[self.index]

    @property
    def contacts(self) -> list[Contact]:
        """Contacts that have units of it; also one that lies across its edge."""
        own = set(self.index.tolist())
        return [one for one in self.state.contacts if not own.isdisjoint(one.units.tolist())]

    @property
    def coverage(self) -> float:
        """Share of its sensing area whose units are valid."""
        area = self.state.topology.area[self.index]
        return float(area @ self.state.units.valid[self.index] / area.sum())

    @property
    def whole(self) -> bool:
        """Whether `wrench` is complete: no unit of it is silent, or those that are bear no part of
        any contact of the skin (`State.whole`)."""
        silent = self.index[~self.state.units.valid[self.index]]
        silent = silent[self.state.topology.feels[silent]]
        return silent.size == 0 or self.state.whole

    @property
    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Where its frame is now: R_skin_patch, shape (3, 3), and the origin, shape (3,), metre,
        skin frame. That of the file, moved as its units have moved since."""
        skin, unit = self.state.topology, self.index[0]
        position, rotation = self.state.poses
        turn = rotation[..., unit] @ skin.rotation[..., unit].T
        away = skin.patch_position[:, self._first] - skin.position[:, unit]
        return turn @ skin.patch_rotation[..., self._first], position[:, unit] + turn @ away

    @property
    def wrench(self) -> np.ndarray:
        """Force in newton and torque in newton metre about the origin of the skin frame, exerted by
        the world on the valid units of the patch in contact; shape (6,). NaN, as its sigma, where
        no unit is valid."""
        return self._wrench[0]

    @property
    def wrench_sigma(self) -> np.ndarray:
        """One-sigma of each component of `wrench`, shape (6,): by the covariances of its contacts,
        that of a contact across its edge as a whole. Where nothing touches, the noise of the sum of
        its units, or that sum; never 0. Errors that contacts have in common (the ambient field)
        count as independent, and units that are silent far from any contact are in `whole` alone.
        """
        return np.sqrt(np.diag(self._wrench[1]))

    @property
    def local_wrench(self) -> np.ndarray:
        """`wrench` in the frame of the patch, about its origin; shape (6,)."""
        return wrench_adjoint(*self.pose) @ self._wrench[0]

    @property
    def local_wrench_sigma(self) -> np.ndarray:
        """One-sigma of each component of `local_wrench`, shape (6,)."""
        adjoint = wrench_adjoint(*self.pose)
        return np.sqrt(np.diag(adjoint @ self._wrench[1] @ adjoint.T))

    @cached_property
    def _wrench(self) -> tuple[np.ndarray, np.ndarray]:
        """Wrench and covariance, skin frame."""
        state, valid = self.state, self.index[self.state.units.valid[self.index]]
        if valid.size == 0:
            return np.full(6, np.nan), np.full((6, 6), np.nan)
        label = state.label[valid]
        if (label != -1).any():
            wrenches, _ = self._of_units(valid[label != -1])
            _, without_identity = self._of_units(valid[label < -1])
            tracked = [one.wrench_covariance for one in self.contacts]
            return wrenches.sum(axis=1), np.sum([without_identity, *tracked], axis=0)
        wrenches, noise = self._of_units(valid)
        rest = wrenches.sum(axis=1)
        larger = np.maximum(np.abs(rest) / np.sqrt(np.maximum(np.diag(noise), 1e-300)), 1.0)
        return np.zeros(6), noise * np.outer(larger, larger)

    def _of_units(self, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrenches of units, shape (6, m), and the covariance of their sum by their noise."""
        position, rotation = (pose[..., units] for pose in self.state.poses)
        read = self.state.units
        axes = np.concatenate([rotation, np.cross(position[:, np.newaxis], rotation, axis=0)])
        wrenches = np.einsum("abn,bn->an", axes, read.force[:, units], dtype=float)
        variance = np.square(read.force_sigma[:, units], dtype=float)
        return wrenches, np.einsum("abn,bn,cbn->ac", axes, variance, axes)

    def __repr__(self) -> str:
        valid = f"{self.coverage:.0%} valid"
        force = ", ".join(f"{newton:.2f}" for newton in self.wrench[:3])
        return (f"<Patch {self.name!r}: {self.index.size} units, {valid}, "
                f"{len(self.contacts)} contacts, force ({force}) N>")  # fmt: skip


def as_pose(
    rotation: np.ndarray, translation: np.ndarray, name: str = "translation"
) -> tuple[np.ndarray, np.ndarray]:
    """A rotation and a translation as arrays of numbers; `name` is that of the translation.

    Raises
    ------
    SkinError
        An array of another shape, a translation that is not finite, or no rotation.
    """
    turn, shift = as_numbers("rotation", rotation), as_numbers(name, translation)
    if turn.shape != (3, 3) or shift.shape != (3,):
        raise SkinError(
            f"rotation, {name}: must have shapes (3, 3) and (3,); got {turn.shape} and "
            f"{shift.shape}"
        )
    if (fault := pose_fault(shift[:, np.newaxis], turn[:, :, np.newaxis], name)) is not None:
        raise SkinError(fault[1])
    return turn, shift


def wrench_adjoint(rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """The matrix that turns a wrench about the origin of the skin frame into that in another frame.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Columns are the axes of the frame, in the skin frame.
    origin : ndarray, shape (3,)
        Metre, origin of the frame, in the skin frame, about which the torque is then given.

    Returns
    -------
    ndarray, shape (6, 6)

    Examples
    --------
    >>> (wrench_adjoint(np.eye(3), [0.1, 0, 0]) @ [0, 0, 2.0, 0, -0.2, 0]).tolist()
    [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
    """
    x, y, z = origin
    turn, adjoint = np.transpose(rotation), np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = turn
    adjoint[3:, :3] = -turn @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return adjoint
