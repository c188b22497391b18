"""Foundation of a body: each unit is a spring of its own (Winkler)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.physics.force_law import force, inverse, scaled, stiffening
from skin.sim.mechanics.springs import Springs, yields

__all__ = ["SHORT", "SLIP_MM", "Faces", "Winkler"]

SLIP_MM = 1e-6
"""Slip in one step below which a face counts as stuck, millimetre [assumed]."""

SHORT = 1.0 - 1e-12
"""Relative distance to its limit within which a face slips: the error of rounding."""


class Faces(NamedTuple):
    """State of n faces that a body drags in one step.

    Attributes
    ----------
    want_mm : ndarray, shape (2, n)
        In: displacement of the surfaces without slip in this step.
    load, depth_mm : ndarray, shape (n,)
        In: normal forces in newton, and the units' own depths, as from `Winkler.press`.
    static, kinetic : ndarray, shape (n,)
        In: static and kinetic coefficients of friction.
    slipping : ndarray, shape (n,), bool
        In: whether the face was slipping; out: whether it is.
    traction : ndarray, shape (2, n)
        Newton; in: those of the last step; out: tangential forces.
    own_mm, held_mm, slip_mm : ndarray, shape (2, n)
        Out: the unit's own part of the displacement; the whole elastic displacement; the slip of
        the face in this step. 0 outside of the contact.
    """

    want_mm: np.ndarray
    load: np.ndarray
    depth_mm: np.ndarray
    static: np.ndarray
    kinetic: np.ndarray
    slipping: np.ndarray
    traction: np.ndarray
    own_mm: np.ndarray
    held_mm: np.ndarray
    slip_mm: np.ndarray


class Winkler:
    """Independent support of n units.

    Examples
    --------
    >>> from topology import load
    >>> palm = Winkler(Springs.of(load("palm")))
    >>> force, own_mm = np.zeros(64), np.zeros(64)
    >>> palm.press(np.full(64, 2.0), force, own_mm)
    >>> round(float(force[0]), 9)
    7.2
    """

    def __init__(self, springs: Springs) -> None:
        self.springs = springs

    def press(
        self,
        depth_mm: np.ndarray,
        load: np.ndarray,
        own_mm: np.ndarray,
        *,
        body_mm_per_n: float = 0.0,
    ) -> None:
        """Normal loads under a body that penetrates the unloaded faces.

        Parameters
        ----------
        depth_mm : ndarray, shape (n,)
            From `skin.sim.mechanics.body.penetration`; not above 0 without contact.
        load : ndarray, shape (n,)
            Newton; written, none below 0.
        own_mm : ndarray, shape (n,)
            Written: the unit's own part of the depth, which its electronics measure.
        body_mm_per_n : float
            Compliance of the body at each unit.
        """
        law = tuple(self.springs.normal)
        own_mm[:] = yields(np.maximum(depth_mm, 0.0), law, body_mm_per_n)
        load[:] = force(own_mm, law)

    def drag(self, faces: Faces, *, body_mm_per_n: float = 0.0) -> None:
        """Tangential forces of faces that a body drags.

        The Coulomb return map: a face whose force exceeds its static limit slips along the force,
        until the force is that of kinetic friction.

        Parameters
        ----------
        faces : Faces
        body_mm_per_n : float
            Compliance of the body at each unit.
        """
        want, load, slipping = faces.want_mm, faces.load, faces.slipping
        stiff = stiffening(faces.depth_mm, self.springs.gain_per_mm, self.springs.reference_mm)
        law = scaled(tuple(self.springs.shear), stiff)
        length = np.hypot(want[0], want[1])
        stuck_n = force(yields(length, law, body_mm_per_n), law)
        limit = load * np.where(slipping, faces.kinetic, faces.static)
        for _ in range(2):  # a face that begins to slip drops to kinetic friction
            force_n = np.where(load > 0.0, np.minimum(stuck_n, limit), 0.0)
            own = inverse(force_n, law)
            held = np.where(force_n < SHORT * limit, length, own + body_mm_per_n * force_n)
            slip = np.where(limit > 0.0, length - held, 0.0)
            begins = ~slipping & (slip > SLIP_MM)
            limit = np.where(begins, load * faces.kinetic, limit)
        slipping[:] = slip > SLIP_MM
        along = want / np.where(length > 0.0, length, 1.0)
        touched = load > 0.0
        faces.traction[:] = force_n * along
        faces.own_mm[:] = own * along
        faces.held_mm[:] = held * touched * along
        faces.slip_mm[:] = slip * along

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n): none."""
        return np.zeros((2, units.size))
