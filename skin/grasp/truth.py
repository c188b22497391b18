"""GraspTruth: the true state of the objects, and of every contact of a unit."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from skin.sim.truth import Truth

__all__ = ["GraspTruth"]


@dataclass(slots=True)
class GraspTruth:
    """n units and o objects at one instant, before any noise; valid until the next cycle.

    Attributes
    ----------
    time_s : float
    units : Truth
        Forces and temperatures of the units, in their frames.
    object_names : tuple of str
    position : ndarray, shape (3, o)
        Centres of mass, metre, frame of the world.
    rotation : ndarray, shape (3, 3, o)
    velocity : ndarray, shape (6, o)
        Of the centre of mass, metre per second, and turning, radian per second; frame of the world.
    wrench : ndarray, shape (6, o)
        Wrench of the skin on each object: newton, and newton metre about its centre of mass.
    touched_by : ndarray, shape (n,), int32
        Object on each unit; -1 for none, -2 for a link or the surroundings.
    slipping : ndarray, shape (n,), bool
    normal_n, drag_n, limit_n : ndarray, shape (n,)
        Newton: along the object's normal, across it, and the limit of friction.
    bottomed : ndarray, shape (n,), bool
        Pressed until the film would lie on its chip, where the elastic laws end.
    """

    time_s: float
    units: Truth
    object_names: tuple[str, ...]
    position: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    wrench: np.ndarray
    touched_by: np.ndarray
    slipping: np.ndarray
    normal_n: np.ndarray
    drag_n: np.ndarray
    limit_n: np.ndarray
    bottomed: np.ndarray

    def margin(self, index: int = 0) -> float:
        """Free fraction of the friction on an object; NaN without contact."""
        mine = self.touched_by == index
        limit = float(self.limit_n[mine].sum())
        return 1.0 - float(self.drag_n[mine].sum()) / limit if limit > 0.0 else float("nan")

    def copy(self) -> GraspTruth:
        """A copy that is not overwritten."""
        values = (getattr(self, field.name) for field in fields(self))
        return GraspTruth(*(v.copy() if hasattr(v, "copy") else v for v in values))
