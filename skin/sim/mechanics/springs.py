"""Springs of units, each by itself (Winkler): what a body presses and drags them to bear, and how
far they yield to a force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.physics import force_law
from topology import Topology

__all__ = ["SHORT", "SLIP_MM", "Faces", "Springs", "under", "yields"]

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
        In: normal forces in newton, and the units' own depths, as from `Springs.press`.
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


class Springs(NamedTuple):
    """Laws of n units.

    Attributes
    ----------
    normal : ndarray, shape (terms, n)
        Laws of the normal force by the depth, as `skin.physics.force_law.at` takes them.
    shear : ndarray, shape (terms, n)
        The same of the tangential force, at the reference depth.
    gain_per_mm, reference_mm : ndarray, shape (n,)
        Relative growth of the tangential stiffness per millimetre of depth about the reference.

    Examples
    --------
    >>> from topology import load
    >>> force, own_mm = np.zeros(64), np.zeros(64)
    >>> Springs.of(load("palm")).press(np.full(64, 2.0), force, own_mm)
    >>> round(float(force[0]), 9)
    7.2
    """

    normal: np.ndarray
    shear: np.ndarray
    gain_per_mm: np.ndarray
    reference_mm: np.ndarray

    @classmethod
    def of(cls, topology: Topology) -> Springs:
        """The elastic laws of `skin.physics.elastic.Elastic`."""
        p = topology.parameters
        return cls(
            force_law.stacked(force_law.normal_law_mm(p)),
            force_law.stacked(force_law.shear_law(p)),
            p["shear_gain_per_mm"].copy(),
            p["field_reference_mm"].copy(),
        )

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
        _press(self.normal, depth_mm, body_mm_per_n, load, own_mm)

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
        _drag(self, faces, body_mm_per_n)

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n): none."""
        return np.zeros((2, units.size))


@jitable
def yields(target, law, series):
    """Displacement of a unit, of what it and a compliance in series yield together."""
    return force_law.inverse(target, force_law.in_series(law, series))


def under(
    springs: Springs, force: np.ndarray, depth_mm: np.ndarray, displacement_mm: np.ndarray
) -> None:
    """Displacements of independent units under forces.

    Parameters
    ----------
    springs : Springs
    force : ndarray, shape (3, n)
        Newton, unit frame; a pull, below 0 along z, counts as no load.
    depth_mm : ndarray, shape (n,)
        Written.
    displacement_mm : ndarray, shape (2, n)
        Written.
    """
    depth_mm[:] = force_law.inverse(np.maximum(force[2], 0.0), tuple(springs.normal))
    stiff = force_law.stiffening(depth_mm, springs.gain_per_mm, springs.reference_mm)
    size = np.hypot(force[0], force[1])
    travel = force_law.inverse(size / stiff, tuple(springs.shear))
    displacement_mm[:] = force[:2] * (travel / np.where(size > 0.0, size, 1.0))


def _press_python(normal, depth_mm, body, load, own_mm):
    """`Springs.press`, in place."""
    for i in range(depth_mm.size):
        law = force_law.at(normal, i)
        own_mm[i] = yields(max(depth_mm[i], 0.0), law, body)
        load[i] = force_law.force(own_mm[i], law)


def _drag_python(springs, faces, body):
    """`Springs.drag`, in place."""
    for i in range(faces.load.size):
        load, kinetic_n = faces.load[i], faces.load[i] * faces.kinetic[i]
        x, y = faces.want_mm[0, i], faces.want_mm[1, i]
        length = np.sqrt(x * x + y * y)
        stiff = force_law.stiffening(
            faces.depth_mm[i], springs.gain_per_mm[i], springs.reference_mm[i]
        )
        law = force_law.scaled(force_law.at(springs.shear, i), stiff)
        stuck_n = force_law.force(yields(length, law, body), law) if load > 0.0 else 0.0
        limit = kinetic_n if faces.slipping[i] else load * faces.static[i]
        for _ in range(2):
            force_n = min(stuck_n, limit)
            own = force_law.inverse(force_n, law)
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
