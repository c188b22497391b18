"""Displacement of the surface of an elastic half space at one unit under the force of another.

The displacement of the middle of one square under a uniform traction on another, in closed form
(Love 1929, and the same for Cerruti's tangential force). The lateral displacement by normal loads
is neglected: it is 0 in an incompressible half space, small in others. On a curved patch the
distance is the chord.
"""

from __future__ import annotations

import numpy as np

__all__ = ["influence"]


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
