"""Foundation of a body: independent springs (Winkler), or springs on one elastic half space.

The surface at unit i yields by its own law and that of the half space under it::

    depth_i = own_i(f_i) + body * f_i + sum_j A_ij f_j,   f_i >= 0
    shift_i = own_i(q_i) + body * q_i + sum_j B_ij q_j,   |q_i| <= limit_i

Without A and B this is a Winkler foundation, solved in closed form; with them it is solved by
projected Gauss-Seidel sweeps that start from the last step's forces. Each unit's own part of a
sweep is exact, for any knees of its law, so that the sweeps converge to the only solution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.errors import SkinError
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, inverse, scaled, stiffening
from skin.sim.mechanics.half_space import influence
from skin.sim.mechanics.springs import Springs, yields
from topology import Topology

__all__ = ["SLIP_MM", "Faces", "Foundation"]

SWEEPS = 2000
"""Upper bound of the number of sweeps."""

SLIP_MM = 1e-6
"""Slip in one step below which a face counts as stuck, millimetre [assumed]."""

SHORT = 1.0 - 1e-12
"""Relative distance to its limit within which a face slips: the error of the sweeps."""


class Faces(NamedTuple):
    """State of n faces that a body drags in one step.

    Attributes
    ----------
    want_mm : ndarray, shape (2, n)
        In: displacement of the surfaces without slip in this step.
    load, depth_mm : ndarray, shape (n,)
        In: normal forces in newton, and the units' own depths, as from `Foundation.press`.
    static, kinetic : ndarray, shape (n,)
        In: static and kinetic coefficients of friction.
    slipping : ndarray, shape (n,), bool
        In: whether the face was slipping; out: whether it is.
    traction : ndarray, shape (2, n)
        Newton; in: start of the sweeps; out: tangential forces.
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


class Foundation:
    """Elastic support of n units.

    Parameters
    ----------
    springs : Springs
    normal : ndarray, shape (n, n), optional
        A, mm/N: depth of unit i under the normal force of unit j.
    shear : ndarray, shape (2 n, 2 n), optional
        B, mm/N: rows and columns are x of all units, then y; given where A is.
    tolerance : float
        Convergence limit of a sweep, relative to the largest force.

    Attributes
    ----------
    together : bool
        Whether units yield to forces on others.

    Raises
    ------
    SkinError
        If A or B is not positive definite: the half space would create energy.

    Examples
    --------
    >>> from topology import load
    >>> palm = Foundation.winkler(load("palm"))
    >>> force, own_mm = np.zeros(64), np.zeros(64)
    >>> palm.press(np.full(64, 2.0), force, own_mm)
    >>> round(float(force[0]), 9)
    7.2
    """

    def __init__(
        self,
        springs: Springs,
        normal: np.ndarray | None = None,
        shear: np.ndarray | None = None,
        *,
        tolerance: float = 1e-6,
    ) -> None:
        self.n = springs.gain_per_mm.size
        self.springs = springs
        self.tolerance = tolerance
        self.together = normal is not None
        none = np.zeros((0, 0))
        self.normal, self.shear = (none if each is None else each for each in (normal, shear))
        self._touched = np.zeros(0, np.int64)
        for name, matrix in (("normal", self.normal), ("shear", self.shear)):
            least = np.linalg.eigvalsh(matrix).min(initial=1.0)
            if not least > 0.0:
                raise SkinError(
                    f"{name}: must be positive definite; got a least eigenvalue of {least:.3g} "
                    "mm/N (do sensing areas overlap?)"
                )

    @classmethod
    def winkler(cls, topology: Topology) -> Foundation:
        """Independent units."""
        return cls(Springs.of(topology))

    @classmethod
    def half_space(
        cls, topology: Topology, modulus_pa: float = 6e5, poisson: float = 0.5
    ) -> Foundation:
        """The units of a patch on one elastic body; patches are independent.

        The default modulus is that of the casting silicone [assumed]. The time of a step is
        quadratic in the number of touched units.
        """
        normal, shear = influence(
            topology.position, topology.rotation, topology.area, patch=topology.patch,
            modulus_pa=modulus_pa, poisson=poisson,
        )  # fmt: skip
        return cls(Springs.of(topology), normal, shear)

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
            Newton; start of the sweeps on entry, the loads on return, none below 0.
        own_mm : ndarray, shape (n,)
            Written: the unit's own part of the depth, which its electronics measure.
        body_mm_per_n : float
            Compliance of the body at each unit.

        Raises
        ------
        SkinError
            The sweeps do not converge.
        """
        units = self._touched = np.flatnonzero(depth_mm > 0.0)
        coupled = self.normal[np.ix_(units, units)] if self.together else self.normal
        _check_settled("normal loads", _press(
            self.springs, units, coupled, depth_mm, body_mm_per_n, self.tolerance, SWEEPS, load,
            own_mm,
        ))  # fmt: skip

    def drag(self, faces: Faces, *, body_mm_per_n: float = 0.0) -> None:
        """Tangential forces of faces that a body drags.

        The Coulomb return map: a face whose force exceeds its static limit slips along the force,
        until the force is that of kinetic friction.

        Parameters
        ----------
        faces : Faces
            Those in contact are those of the last `press`.
        body_mm_per_n : float
            Compliance of the body at each unit.

        Raises
        ------
        SkinError
            The sweeps do not converge.
        """
        units = self._touched
        both = np.concatenate([units, self.n + units])
        coupled = self.shear[np.ix_(both, both)] if self.together else self.shear
        _check_settled("tangential forces", _drag(
            self.springs, units, coupled, faces, body_mm_per_n, self.tolerance, SWEEPS
        ))  # fmt: skip

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n)."""
        if not self.together:
            return np.zeros((2, units.size))
        rows = self.shear.reshape(2, self.n, 2 * self.n)[:, units]
        return rows @ traction.reshape(-1)


def _check_settled(what: str, settled: bool) -> None:
    if not settled:
        raise SkinError(f"{what}: must settle within {SWEEPS} sweeps; got no end")


def _press_python(springs, units, coupled, depth, body, tolerance, sweeps, load, own_mm):
    """`Foundation.press`, in place; returns whether the sweeps have settled."""
    held = load[units]
    load[:] = 0.0
    own_mm[:] = 0.0
    count, size = units.size, coupled.shape[0]
    done, settled = 0, False
    while not settled and done < sweeps:
        change = largest = 0.0
        for k in range(count):
            i = units[k]
            target, series = depth[i], body
            if size > 0:
                others = 0.0
                for m in range(count):
                    others += coupled[k, m] * held[m]
                target -= others - coupled[k, k] * held[k]
                series += coupled[k, k]
            new = 0.0
            if target > 0.0:
                law = law_at(springs.normal, i)
                new = force(yields(target, law, series), law)
            change = max(change, abs(new - held[k]))
            largest = max(largest, new)
            held[k] = new
        done += 1
        settled = size == 0 or change <= tolerance * largest
    for k in range(count):
        i = units[k]
        load[i] = held[k]
        own_mm[i] = inverse(held[k], law_at(springs.normal, i))
    return settled


def _drag_python(springs, units, coupled, faces, body, tolerance, sweeps):
    """`Foundation.drag`, in place; returns whether the sweeps have settled."""
    count, size = units.size, coupled.shape[0]
    limit, stiff, forces = np.empty(count), np.empty(count), np.zeros((2, count))
    for k in range(count):
        i = units[k]
        limit[k] = faces.load[i] * (faces.kinetic[i] if faces.slipping[i] else faces.static[i])
        stiff[k] = stiffening(faces.depth_mm[i], springs.gain_per_mm[i], springs.reference_mm[i])
        if limit[k] > 0.0:
            forces[0, k], forces[1, k] = faces.traction[0, i], faces.traction[1, i]
    for written in (faces.traction, faces.own_mm, faces.held_mm, faces.slip_mm):
        written[:] = 0.0
    done, settled = 0, False
    while not settled and done < sweeps:
        change = largest = 0.0
        for k in range(count):
            if not limit[k] > 0.0:
                continue
            i = units[k]
            by_x, by_y = _by_others(coupled, forces, k)
            # a square yields equally along x and y, without coupling
            own = coupled[k, k] if size > 0 else 0.0
            x = faces.want_mm[0, i] - (by_x - own * forces[0, k])
            y = faces.want_mm[1, i] - (by_y - own * forces[1, k])
            length = np.sqrt(x * x + y * y)
            law = scaled(law_at(springs.shear, i), stiff[k])
            force_n = min(force(yields(length, law, body + own), law), limit[k])
            share = force_n / length if length > 0.0 else 0.0
            x, y = share * x, share * y
            largest = max(largest, force_n)
            change = max(change, abs(x - forces[0, k]), abs(y - forces[1, k]))
            forces[0, k], forces[1, k] = x, y
        done += 1
        if size == 0 or change <= tolerance * largest:
            settled = True
            for k in range(count):
                law = scaled(law_at(springs.shear, units[k]), stiff[k])
                by = _by_others(coupled, forces, k)
                if _slips(faces, units[k], law, forces[:, k], by, body, limit[k]):
                    limit[k] = faces.load[units[k]] * faces.kinetic[units[k]]
                    settled = False
    for i in range(faces.slipping.size):
        faces.slipping[i] = np.hypot(faces.slip_mm[0, i], faces.slip_mm[1, i]) > SLIP_MM
    return settled


@jitable
def _by_others(coupled, forces, k):
    """Displacement of the half space at a face under the forces on all."""
    by_x = by_y = 0.0
    count = coupled.shape[0] // 2
    for m in range(count):
        by_x += coupled[k, m] * forces[0, m] + coupled[k, count + m] * forces[1, m]
        by_y += coupled[count + k, m] * forces[0, m] + coupled[count + k, count + m] * forces[1, m]
    return by_x, by_y


@jitable
def _slips(faces, i, law, pull, by, body, most_n):
    """Coulomb's return map of one face. True where it has begun to slip: its force drops to kinetic
    friction, so that others may follow."""
    want, held, slip = faces.want_mm, faces.held_mm, faces.slip_mm
    force_n = np.sqrt(pull[0] * pull[0] + pull[1] * pull[1])
    share = inverse(force_n, law) / force_n if force_n > 0.0 else 0.0
    stuck = most_n > 0.0 and force_n < SHORT * most_n
    for a in range(2):
        faces.traction[a, i], faces.own_mm[a, i] = pull[a], share * pull[a]
        held[a, i] = want[a, i] if stuck else (share + body) * pull[a] + by[a]
        slip[a, i] = want[a, i] - held[a, i] if most_n > 0.0 else 0.0
    if faces.slipping[i] or not np.hypot(slip[0, i], slip[1, i]) > SLIP_MM:
        return False
    faces.slipping[i] = True
    return faces.kinetic[i] < faces.static[i]


_press = compiled(_press_python, fastmath=("contract", "reassoc"))
_drag = compiled(_drag_python, fastmath=("contract", "reassoc"))
