"""Truth of a contact: loads, stick and slip of every unit, and what they add up to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bus.compiled.jit import compiled
from skin.sim.mechanics.body import Pose
from skin.sim.mechanics.friction import ONSETS

__all__ = ["MechanicsTruth", "mean_normal", "mean_normal_python"]


@dataclass(slots=True)
class MechanicsTruth:
    """What really goes on between a body and n units at one instant.

    Attributes
    ----------
    time_s : float
    pose : Pose
        Where the body is.
    contact : ndarray, shape (n,), bool
        Units that bear load.
    force : ndarray, shape (3, n)
        Newton, unit frame: the force of the body on the unit, z into the skin.
    displacement_mm : ndarray, shape (3, n)
        Millimetre, unit frame: tangential x, y and pressed depth H of the units themselves, by
        their elastic laws.
    slipping : ndarray, shape (n,), bool
        Faces over which the body moved in this step; loaded faces that do not slip stick.
    slip_mm : ndarray, shape (2, n)
        How far.
    slip_share : float
        Share of the load on faces that have slipped since the contact began to stick.
    onset_s : ndarray, shape (4,)
        When the share first passed each stage of `friction.ONSETS`; NaN: not yet.
    dissipated_j : float
        Work that friction took in this step.
    wrench : ndarray, shape (6,)
        Force in newton and moment in newton metre about the origin of the skin frame, each force
        acting in the middle of its face.
    centroid : ndarray, shape (3,)
        Mean position of the units, weighted by load, metre, skin frame; NaN without load.
    normal : ndarray, shape (3,)
        Unit vector out of the skin: mean normal of the body's surface, weighted by load; NaN
        without load, and where normals cancel, as in a grip.
    """

    time_s: float
    pose: Pose
    contact: np.ndarray
    force: np.ndarray
    displacement_mm: np.ndarray
    slipping: np.ndarray
    slip_mm: np.ndarray
    slip_share: float
    onset_s: np.ndarray
    dissipated_j: float
    wrench: np.ndarray
    centroid: np.ndarray
    normal: np.ndarray

    @classmethod
    def at_rest(cls, n: int) -> MechanicsTruth:
        """n untouched units; there is no body yet."""
        return cls(
            time_s=0.0,
            pose=(np.eye(3), np.full(3, np.nan)),
            contact=np.zeros(n, bool),
            force=np.zeros((3, n)),
            displacement_mm=np.zeros((3, n)),
            slipping=np.zeros(n, bool),
            slip_mm=np.zeros((2, n)),
            slip_share=0.0,
            onset_s=np.full(len(ONSETS), np.nan),
            dissipated_j=0.0,
            wrench=np.zeros(6),
            centroid=np.full(3, np.nan),
            normal=np.full(3, np.nan),
        )

    @property
    def load(self) -> np.ndarray:
        """Normal forces, newton, shape (n,)."""
        return self.force[2]

    @property
    def tangential(self) -> np.ndarray:
        """Tangential forces, newton, shape (2, n)."""
        return self.force[:2]

    def copy(self) -> MechanicsTruth:
        """A truth of its own, that later steps do not write to."""
        names = self.__dataclass_fields__
        arrays = {k: v.copy() for k in names if isinstance(v := getattr(self, k), np.ndarray)}
        return replace(self, **arrays)


def mean_normal_python(load, outward, mean):
    """Mean of the normals of a body's surface where it is met, turned towards it.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, the weights.
    outward : ndarray, shape (3, n)
        Outward normals of the body, NaN where nothing meets.
    mean : ndarray, shape (3,)
        Written: unit vector, NaN where there is none.
    """
    total = 0.0
    mean[:] = 0.0
    for i in range(load.size):
        if load[i] > 0.0:
            total += load[i]
            for r in range(3):
                mean[r] -= load[i] * outward[r, i]
    length = np.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2])
    for r in range(3):
        mean[r] = mean[r] / length if length > 1e-9 * total else np.nan


mean_normal = compiled(mean_normal_python)
