"""Records for the kernels of `skin.sim.grasping.touch`: units, geoms, bodies, touches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.sim.mechanics.springs import Springs

__all__ = ["Bodies", "Mounted", "Surfaces", "Touch"]


class Mounted(NamedTuple):
    """Poses of n units on b bodies, and their laws.

    Attributes
    ----------
    body : ndarray, shape (n,), int32
    place : ndarray, shape (3, n)
        Metre, frame of the body.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the frame of the body.
    weight : ndarray, shape (n, g)
        Effect of a unit on a geom: 0 none, 1 full, 0.5 where the geom carries skin itself, which
        yields equally and has the other half.
    springs : Springs
    """

    body: np.ndarray
    place: np.ndarray
    rotation: np.ndarray
    weight: np.ndarray
    springs: Springs


class Surfaces(NamedTuple):
    """The g geoms of a model.

    Attributes
    ----------
    kind : ndarray, shape (g,), int32
        As in `skin.sim.mechanics.rays`.
    body : ndarray, shape (g,), int32
    size : ndarray, shape (g, 3)
        Metre.
    radius : ndarray, shape (g,)
        Of a ball around it, metre; infinite for a plane.
    static, kinetic : ndarray, shape (g,)
        Static and kinetic coefficients of friction.
    compliance : ndarray, shape (g,)
        mm/N, to the force of one unit.
    planes : ndarray, shape (p, 4)
    faces : ndarray, shape (g, 2)
        Of the hulls of meshes, as `hull_crossing` takes them.
    """

    kind: np.ndarray
    body: np.ndarray
    size: np.ndarray
    radius: np.ndarray
    static: np.ndarray
    kinetic: np.ndarray
    compliance: np.ndarray
    planes: np.ndarray
    faces: np.ndarray


class Bodies(NamedTuple):
    """Views of the engine's own arrays: poses of b bodies and g geoms, and wrenches on bodies.

    Attributes
    ----------
    position, middle : ndarray, shape (b, 3)
        Origins and centres of mass, metre.
    rotation : ndarray, shape (b, 9)
    geom_position, geom_rotation : ndarray, shape (g, 3) and (g, 9)
    wrench : ndarray, shape (b, 6)
        Added to: newton, and newton metre about the centre of mass.
    """

    position: np.ndarray
    middle: np.ndarray
    rotation: np.ndarray
    geom_position: np.ndarray
    geom_rotation: np.ndarray
    wrench: np.ndarray


class Touch(NamedTuple):
    """Contact of each of n units, and its state.

    Attributes
    ----------
    body, geom : ndarray, shape (n,), int32
        -1 without contact.
    anchor_m, normal : ndarray, shape (3, n)
        Tip, and the solid's outward normal there; frame of the touching body.
    tip_mm : ndarray, shape (3, n)
        Tip from where it is unloaded, unit frame.
    slipping : ndarray, shape (n,), bool
    force : ndarray, shape (3, n)
        Newton, unit frame.
    normal_n, drag_n, limit_n : ndarray, shape (n,)
        Along the solid's normal, across it, and the limit of friction.
    energy_j : ndarray, shape (n,)
        Stored.
    """

    body: np.ndarray
    geom: np.ndarray
    anchor_m: np.ndarray
    normal: np.ndarray
    tip_mm: np.ndarray
    slipping: np.ndarray
    force: np.ndarray
    normal_n: np.ndarray
    drag_n: np.ndarray
    limit_n: np.ndarray
    energy_j: np.ndarray

    @classmethod
    def nothing(cls, n: int) -> Touch:
        """No contacts of n units."""
        return cls(
            np.full(n, -1, np.int32), np.full(n, -1, np.int32), np.zeros((3, n)),
            np.zeros((3, n)), np.zeros((3, n)), np.zeros(n, bool), np.zeros((3, n)), np.zeros(n),
            np.zeros(n), np.zeros(n), np.zeros(n),
        )  # fmt: skip
