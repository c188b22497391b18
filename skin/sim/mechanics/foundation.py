"""Foundation of a body: independent springs (Winkler), or springs on one elastic half space.

The surface at unit i yields by its own law and that of the half space under it::

    depth_i = own_i(f_i) + body * f_i + sum_j A_ij f_j,   f_i >= 0
    shift_i = own_i(q_i) + body * q_i + sum_j B_ij q_j,   |q_i| <= limit_i

Without A and B this is a Winkler foundation, solved in closed form; with them it is solved by
projected Gauss-Seidel sweeps that start from the last step's forces. Each unit's own part of a
sweep is exact, for any knees of its law, so that the sweeps converge to the only solution.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from skin.errors import SkinError
from skin.sim.mechanics.foundation_kernels import Faces, Touched, drag, press
from skin.sim.mechanics.influence import influence
from skin.sim.mechanics.springs import Springs
from topology import Topology

__all__ = ["Foundation"]

SWEEPS = 2000
"""Upper bound of the number of sweeps."""


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
    1
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
        """Whether units yield to forces on others."""
        self.normal = np.zeros((0, 0)) if normal is None else np.ascontiguousarray(normal, float)
        self.shear = np.zeros((0, 0)) if shear is None else np.ascontiguousarray(shear, float)
        # group of units on the same half space
        self._group = np.arange(self.n)
        if self.together:
            linked = csr_array(self.normal != 0.0)
            self._group = connected_components(linked, directed=False)[1]
        # units by group
        self._order = np.argsort(self._group, kind="stable")
        if self.together:
            bounds = np.searchsorted(self._group[self._order], np.arange(self._group.max() + 2))
            for units in np.split(self._order, bounds[1:-1]):
                _check_definite("normal", self.normal, units)
                _check_definite("shear", self.shear, np.concatenate([units, self.n + units]))
        self._parts: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._touched = Touched(np.empty(0, np.int64), np.zeros(1, np.int64), *2 * [np.empty(0)])

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
        quadratic in the touched units of a patch: about a millisecond for 1024 units of 16 patches,
        half of one for 256 units of a single patch, more than a bus carries. A single patch of 1024
        would take tens of them, more than a cycle at 250 Hz.
        """
        normal, shear = influence(
            topology.position, topology.rotation, topology.area, patch=topology.patch,
            modulus_pa=modulus_pa, poisson=poisson,
        )  # fmt: skip
        return cls(Springs.of(topology), normal, shear)

    @property
    def coupling_error(self) -> float:
        """Residual of the sweeps relative to the forces; 0 for independent units."""
        return self.tolerance if self.together else 0.0

    def press(
        self,
        depth_mm: np.ndarray,
        load: np.ndarray,
        own_mm: np.ndarray,
        *,
        body_mm_per_n: float = 0.0,
    ) -> int:
        """Normal loads under a body that penetrates the unloaded faces; returns the number of
        sweeps.

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
        touched = self._touch(self._order[depth_mm[self._order] > 0.0])
        sweeps = press(
            self.springs, touched, depth_mm, body_mm_per_n, self.tolerance, SWEEPS, load, own_mm
        )
        return _settled("normal loads", sweeps)

    def drag(self, faces: Faces, *, body_mm_per_n: float = 0.0) -> int:
        """Tangential forces of faces that a body drags; returns the number of sweeps.

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
        sweeps = drag(self.springs, self._touched, faces, body_mm_per_n, self.tolerance, SWEEPS)
        return _settled("tangential forces", sweeps)

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n)."""
        if not self.together:
            return np.zeros((2, units.size))
        rows = self.shear.reshape(2, self.n, 2 * self.n)[:, units]
        return rows @ traction.reshape(-1)

    def spread(self, force: np.ndarray) -> np.ndarray:
        """Displacement of the half space alone at every face under forces in newton: mm, both of
        shape (3, n), unit frames."""
        moved_mm = np.zeros((3, self.n))
        if self.together:
            loaded = np.flatnonzero(force.any(axis=0))
            both = np.concatenate([loaded, self.n + loaded])
            moved_mm[2] = self.normal[:, loaded] @ force[2, loaded]
            moved_mm[:2] = (self.shear[:, both] @ force[:2, loaded].ravel()).reshape(2, self.n)
        return moved_mm

    def _touch(self, units: np.ndarray) -> Touched:
        """The touched units and their influences, cached while they stay the same."""
        if np.array_equal(units, self._touched.units):
            return self._touched
        start = np.zeros(2, np.int64)
        start[1] = units.size
        normal = shear = np.empty(0)
        if self.together and units.size:
            start = np.flatnonzero(np.diff(self._group[units], prepend=-1, append=-1))
            parts = [self._part(group) for group in np.split(units, start[1:-1])]
            normal, shear = map(np.concatenate, zip(*parts, strict=True))
        self._touched = Touched(units, start, normal, shear)
        return self._touched

    def _part(self, units: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Influences among units of one group; those of the last request are cached, since a moving
        body leaves most groups unchanged."""
        group = int(self._group[units[0]])
        known = self._parts.get(group)
        if known is None or not np.array_equal(known[0], units):
            both = np.concatenate([units, self.n + units])
            normal, shear = self.normal[np.ix_(units, units)], self.shear[np.ix_(both, both)]
            known = self._parts[group] = units, normal.ravel(), shear.ravel()
        return known[1], known[2]


def _settled(what: str, sweeps: int) -> int:
    if sweeps > SWEEPS:
        raise SkinError(f"{what}: must settle within {SWEEPS} sweeps; got no end")
    return sweeps


def _check_definite(name: str, matrix: np.ndarray, rows: np.ndarray) -> None:
    """Check the work of forces on these rows."""
    square = matrix[np.ix_(rows, rows)]
    try:
        np.linalg.cholesky(square)
    except np.linalg.LinAlgError:
        raise SkinError(
            f"{name}: must be positive definite; got a least eigenvalue of "
            f"{np.linalg.eigvalsh(square)[0]:.3g} mm/N (do sensing areas overlap?)"
        ) from None
