"""What the kernels of `skin.sim.engine.touch` are given: units, geoms, bodies, touches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.sim.engine.mesh import Meshes
from skin.sim.mechanics.springs import Springs

__all__ = ["Bodies", "Mounted", "Surfaces", "Touch"]


class Mounted(NamedTuple):
    """Where n units hang on b bodies, and how they yield.

    Attributes
    ----------
    body : ndarray, shape (n,), int32
    place : ndarray, shape (3, n)
        Metre, frame of the body.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the frame of the body.
    weight : ndarray, shape (n, g)
        What a unit does to a geom: 0 nothing, 1 all, 0.5 where the geom carries skin itself, which
        yields as much and does the other half.
    springs : Springs
    """

    body: np.ndarray
    place: np.ndarray
    rotation: np.ndarray
    weight: np.ndarray
    springs: Springs


class Surfaces(NamedTuple):
    """The g geoms of a model as a skin feels them.

    Attributes
    ----------
    kind : ndarray, shape (g,), int32
        As in `skin.sim.engine.rays`.
    body : ndarray, shape (g,), int32
    size : ndarray, shape (g, 3)
        Metre.
    radius : ndarray, shape (g,)
        Of a ball around it, metre; infinite for a plane.
    static, kinetic : ndarray, shape (g,)
        Coefficients of friction, at rest and in motion.
    compliance : ndarray, shape (g,)
        mm/N, to the force of one unit.
    mesh : ndarray, shape (g,), int32
    meshes : Meshes
    """

    kind: np.ndarray
    body: np.ndarray
    size: np.ndarray
    radius: np.ndarray
    static: np.ndarray
    kinetic: np.ndarray
    compliance: np.ndarray
    mesh: np.ndarray
    meshes: Meshes


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
    """What touches each of n units, and what is remembered of it while it does.

    Attributes
    ----------
    body, geom : ndarray, shape (n,), int32
        -1 where nothing touches.
    anchor_m, normal : ndarray, shape (3, n)
        Tip, and the solid's outward normal there; frame of the body that touches.
    tip_mm : ndarray, shape (3, n)
        Tip from where it is unloaded, unit frame.
    slipping : ndarray, shape (n,), bool
    force : ndarray, shape (3, n)
        Newton, unit frame.
    normal_n, drag_n, limit_n : ndarray, shape (n,)
        Along the solid's normal, across it, and what friction holds across it.
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
        """Of n units, none."""
        return cls(
            np.full(n, -1, np.int32), np.full(n, -1, np.int32), np.zeros((3, n)),
            np.zeros((3, n)), np.zeros((3, n)), np.zeros(n, bool), np.zeros((3, n)), np.zeros(n),
            np.zeros(n), np.zeros(n), np.zeros(n),
        )  # fmt: skip
