"""Faces on one elastic half space, which yields at each unit under the forces on all.

The surface at unit i yields by its own law and that of the half space under it::

    depth_i = own_i(f_i) + body * f_i + sum_j A_ij f_j,   f_i >= 0
    shift_i = own_i(q_i) + body * q_i + sum_j B_ij q_j,   |q_i| <= limit_i

solved by projected Gauss-Seidel sweeps that start from the last step's forces. Each unit's own part
of a sweep is exact, for any knees of its law, so that the sweeps converge to the only solution.

A and B are displacements of the middle of one square under a uniform traction on another, in closed
form (Love 1929, and the same for Cerruti's tangential force). The lateral displacement by normal
loads is neglected: it is 0 in an incompressible half space, small in others. On a curved patch the
distance is the chord.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.errors import SkinError
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, inverse, scaled, stiffening
from skin.sim.mechanics.springs import SHORT, SLIP_MM, Faces, Springs, yields
from topology import Topology

__all__ = ["HalfSpace", "influence"]

SWEEPS = 2000
"""Upper bound of the number of sweeps."""


class HalfSpace:
    """A foundation for `skin.sim.mechanics.contact.Mechanics` whose units yield together.

    Parameters
    ----------
    springs : Springs
    normal : ndarray, shape (n, n)
        A, mm/N: depth of unit i under the normal force of unit j.
    shear : ndarray, shape (2 n, 2 n)
        B, mm/N: rows and columns are x of all units, then y.
    tolerance : float
        Convergence limit of a sweep, relative to the largest force.

    Raises
    ------
    SkinError
        If A or B is not positive definite: the half space would create energy.
    """

    def __init__(
        self,
        springs: Springs,
        normal: np.ndarray,
        shear: np.ndarray,
        *,
        tolerance: float = 1e-6,
    ) -> None:
        self.n = springs.gain_per_mm.size
        self.springs = springs
        self.tolerance = tolerance
        self.normal, self.shear = normal, shear
        self._touched = np.zeros(0, np.int64)
        for name, matrix in (("normal", self.normal), ("shear", self.shear)):
            least = np.linalg.eigvalsh(matrix).min(initial=1.0)
            if not least > 0.0:
                raise SkinError(
                    f"{name}: must be positive definite; got a least eigenvalue of {least:.3g} "
                    "mm/N (do sensing areas overlap?)"
                )

    @classmethod
    def of(cls, topology: Topology, modulus_pa: float = 6e5, poisson: float = 0.5) -> HalfSpace:
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
        coupled = self.normal[np.ix_(units, units)]
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
        coupled = self.shear[np.ix_(both, both)]
        _check_settled("tangential forces", _drag(
            self.springs, units, coupled, faces, body_mm_per_n, self.tolerance, SWEEPS
        ))  # fmt: skip

    def surface(self, units: np.ndarray, traction: np.ndarray) -> np.ndarray:
        """Tangential displacement in mm of untouched faces, shape (2, m), by their indices (m,),
        under tractions on the others in newton, shape (2, n)."""
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
    count = units.size
    done, settled = 0, False
    while not settled and done < sweeps:
        change = largest = 0.0
        for k in range(count):
            i = units[k]
            others = 0.0
            for m in range(count):
                others += coupled[k, m] * held[m]
            target = depth[i] - (others - coupled[k, k] * held[k])
            series = body + coupled[k, k]
            new = 0.0
            if target > 0.0:
                law = law_at(springs.normal, i)
                new = force(yields(target, law, series), law)
            change = max(change, abs(new - held[k]))
            largest = max(largest, new)
            held[k] = new
        done += 1
        settled = change <= tolerance * largest
    for k in range(count):
        i = units[k]
        load[i] = held[k]
        own_mm[i] = inverse(held[k], law_at(springs.normal, i))
    return settled


def _drag_python(springs, units, coupled, faces, body, tolerance, sweeps):
    """`Foundation.drag`, in place; returns whether the sweeps have settled."""
    count = units.size
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
            own = coupled[k, k]
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
        if change <= tolerance * largest:
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


def influence(
    position: np.ndarray,
    rotation: np.ndarray,
    area: np.ndarray,
    *,
    modulus_pa: float,
    poisson: float = 0.5,
    patch: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the surface of a half space at each unit under the force of each other.

    With a, b from the middle of unit i to the corners of the square of unit j, r their length: the
    integral of 1/r is [a asinh(b/a) + b asinh(a/b)], of its parts x²/r³ and y²/r³ the second and
    the first term, of xy/r³ it is [-r].

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre.
    rotation : ndarray, shape (3, 3, n)
        Columns are the units' axes, z into the half space.
    area : ndarray, shape (n,)
        m²; each force is spread over a square of this area along the unit's x and y.
    modulus_pa, poisson : float
        Young's modulus and Poisson's ratio.
    patch : ndarray, shape (n,), int32, optional
        Units of different patches are independent; all are one patch if None.

    Returns
    -------
    normal : ndarray, shape (n, n)
        mm/N, symmetric.
    shear : ndarray, shape (2 n, 2 n)
        mm/N, symmetric; x of all units, then y.
    """
    n = area.size
    gap = position[:, :, np.newaxis] - position[:, np.newaxis]  # i from j
    x, y = np.einsum("rij,raj->aij", gap, rotation[:, :2])
    flat = np.hypot(x, y)
    chord = np.linalg.norm(gap, axis=0) / np.where(flat > 0.0, flat, 1.0)
    x, y = np.where(flat > 0.0, chord * x, x), np.where(flat > 0.0, chord * y, y)
    half = 0.5 * np.sqrt(area)
    first, second, length = np.zeros((3, n, n))
    for sign, to_a, to_b in ((1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)):
        a, b = x + to_a * half, y + to_b * half
        first += sign * a * np.arcsinh(np.divide(b, np.abs(a), out=0.0 * a, where=a != 0.0))
        second += sign * b * np.arcsinh(np.divide(a, np.abs(b), out=0.0 * b, where=b != 0.0))
        length += sign * np.hypot(a, b)
    facing = np.einsum("ri,rj->ij", rotation[:, 2], rotation[:, 2])
    apart = facing <= 0.0
    if patch is not None:
        apart |= patch[:, np.newaxis] != patch
    scale = np.where(apart, 0.0, 1e3 * (1.0 + poisson) / (np.pi * modulus_pa) / area)
    rest = 1.0 - poisson
    normal = facing * scale * rest * (first + second)
    in_j = scale * np.array([
        [rest * first + second, -poisson * length], [-poisson * length, first + rest * second],
    ])  # fmt: skip
    to_i = np.einsum("rai,rbj->abij", rotation[:, :2], rotation[:, :2])
    shear = np.einsum("abij,bcij->aicj", to_i, in_j).reshape(2 * n, 2 * n)
    # Betti: units of different area or frame have symmetric influences
    return 0.5 * (normal + normal.T), 0.5 * (shear + shear.T)
