"""Displacement of the surface of an elastic half space at one unit under the force of another.

The displacement of the middle of one square under a uniform traction on another, in closed form
(Love 1929, and the same for Cerruti's tangential force). The lateral displacement by normal loads
is neglected: it is 0 in an incompressible half space, small in others. On a curved patch the
distance is the chord.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled

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
    normal, shear = np.empty((n, n)), np.empty((2 * n, 2 * n))
    per_n = 1e3 * (1.0 + poisson) / (np.pi * modulus_pa)
    one = np.zeros(n, np.int32) if patch is None else patch
    _influence(position, rotation, area, one, per_n, poisson, normal, shear)
    # Betti: units of different area or frame have symmetric influences
    return 0.5 * (normal + normal.T), 0.5 * (shear + shear.T)


def _influence_python(position, rotation, area, patch, per_n, poisson, normal, shear):
    """Both matrices of `influence` before they are made symmetric, in place.

    With `a`, `b` from the middle of unit i to the corners of the square of unit j, r their length:
    the integral of 1/r is [a asinh(b/a) + b asinh(a/b)], of its parts x²/r³ and y²/r³ the second
    and the first term, of xy/r³ it is [-r].
    """
    n = area.size
    for j in range(n):
        half = 0.5 * np.sqrt(area[j])
        for i in range(n):
            away = facing = x = y = 0.0
            for r in range(3):
                gap = position[r, i] - position[r, j]
                away += gap * gap
                x += gap * rotation[r, 0, j]
                y += gap * rotation[r, 1, j]
                facing += rotation[r, 2, i] * rotation[r, 2, j]
            if patch[i] != patch[j] or facing <= 0.0:
                normal[i, j] = 0.0
                shear[i, j] = shear[i, n + j] = shear[n + i, j] = shear[n + i, n + j] = 0.0
                continue
            flat = np.sqrt(x * x + y * y)
            if flat > 0.0:
                chord = np.sqrt(away) / flat
                x, y = x * chord, y * chord
            first = second = length = 0.0
            for k in range(4):
                sign = 1.0 if k in {0, 3} else -1.0
                a, b = x + half * (2 * (k // 2) - 1), y + half * (2 * (k % 2) - 1)
                if a != 0.0:
                    first += sign * a * np.arcsinh(b / abs(a))
                if b != 0.0:
                    second += sign * b * np.arcsinh(a / abs(b))
                length += sign * np.sqrt(a * a + b * b)
            scale = per_n / area[j]
            normal[i, j] = facing * scale * (1.0 - poisson) * (first + second)
            xx = scale * ((1.0 - poisson) * first + second)
            yy = scale * (first + (1.0 - poisson) * second)
            xy = -scale * poisson * length
            for a in range(2):
                in_x = in_y = 0.0
                for r in range(3):
                    in_x += rotation[r, a, i] * rotation[r, 0, j]
                    in_y += rotation[r, a, i] * rotation[r, 1, j]
                shear[a * n + i, j] = in_x * xx + in_y * xy
                shear[a * n + i, n + j] = in_x * xy + in_y * yy


_influence = compiled(_influence_python, fastmath=("contract",))
