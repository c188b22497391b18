"""Foundation of a body: each unit is a spring of its own (Winkler)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.physics.force_law import at as law_at
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
        _press(self.springs.normal, depth_mm, body_mm_per_n, load, own_mm)

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
        _drag(self.springs, faces, body_mm_per_n)

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n): none."""
        return np.zeros((2, units.size))


def _press_python(normal, depth_mm, body, load, own_mm):
    """`Winkler.press`, in place."""
    for i in range(depth_mm.size):
        law = law_at(normal, i)
        own_mm[i] = yields(max(depth_mm[i], 0.0), law, body)
        load[i] = force(own_mm[i], law)


def _drag_python(springs, faces, body):
    """`Winkler.drag`, in place."""
    for i in range(faces.load.size):
        load, kinetic_n = faces.load[i], faces.load[i] * faces.kinetic[i]
        x, y = faces.want_mm[0, i], faces.want_mm[1, i]
        length = np.sqrt(x * x + y * y)
        stiff = stiffening(faces.depth_mm[i], springs.gain_per_mm[i], springs.reference_mm[i])
        law = scaled(law_at(springs.shear, i), stiff)
        stuck_n = force(yields(length, law, body), law) if load > 0.0 else 0.0
        limit = kinetic_n if faces.slipping[i] else load * faces.static[i]
        for _ in range(2):
            force_n = min(stuck_n, limit)
            own = inverse(force_n, law)
            held = length if force_n < SHORT * limit else own + body * force_n
            slip = length - held if limit > 0.0 else 0.0
            if faces.slipping[i] or slip <= SLIP_MM:
                break
            faces.slipping[i] = True
            limit = kinetic_n  # a face that begins to slip
        faces.slipping[i] = slip > SLIP_MM
        for a in range(2):
            along = faces.want_mm[a, i] / length if length > 0.0 else 0.0
            faces.traction[a, i], faces.own_mm[a, i] = force_n * along, own * along
            faces.held_mm[a, i] = held * along if load > 0.0 else 0.0
            faces.slip_mm[a, i] = slip * along


_press = compiled(_press_python, fastmath=("contract",))
_drag = compiled(_drag_python, fastmath=("contract",))
