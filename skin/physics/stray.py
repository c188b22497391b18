"""What films add at other units' chips, at rest and as they move, by magnet theory.

The field of a pair is a polynomial without a constant in dx, dy and H of the neighbour: the change
since the neighbour was at rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from skin.errors import SkinError
from skin.physics.film_table import load_film_table
from skin.physics.halbach import chips_seen, crest_ut, near
from topology import Topology

__all__ = [
    "DEGREES", "DEPTH_MAX_MM", "DISPLACEMENT_MAX_MM", "HORIZON_M", "NEAR_M", "field_at_rest",
    "monomials", "moving_ut2", "near", "pairs_seen", "powers", "resting_ut", "scan_poses",
    "scan_stray",
]  # fmt: skip

DEPTH_MAX_MM, DISPLACEMENT_MAX_MM = 2.0, 2.5
"""Range of the scans [paper: what a unit is calibrated for]."""
NEAR_M = 0.039
"""To which films are more than dipoles [assumed: the reach of a stencil]."""
PAIRS_AT_ONCE = 65536
HORIZON_M = 0.1
"""What is left out is summed to this distance [derived: beyond it a film adds less than 0.1 µT]."""
DEGREES = (1, 2, 3, 4)


def powers(degree: int) -> np.ndarray:
    """Exponents of (dx, dy, H) of every term but the constant, shape (terms, 3).

    By degree: three linear ones, then six quadratic, ten cubic, fifteen quartic ones.
    """
    every = [p for p in product(range(degree + 1), repeat=3) if 1 <= sum(p) <= degree]
    return np.array(sorted(every, key=lambda p: (sum(p), [-e for e in p])))


def monomials(displacement_mm: np.ndarray, degree: int) -> np.ndarray:
    """Every term of `powers`.

    Parameters
    ----------
    displacement_mm : ndarray, shape (..., 3, m)
        Of a film: tangential dx, dy, and depth H.
    degree : int

    Returns
    -------
    ndarray, shape (..., terms, m)
    """
    given = np.asarray(displacement_mm, float)
    x, y, h = ([given[..., axis, :] ** e for e in range(degree + 1)] for axis in range(3))
    return np.stack([x[i] * y[j] * h[k] for i, j, k in powers(degree)], axis=-2)


def scan_poses(depth_max_mm: float, displacement_max_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a scan: rings of equal area at several depths, their ends and the middle included.

    Returns
    -------
    moved : ndarray, shape (t, 3)
        dx, dy, H; at rest first.
    share : ndarray, shape (t,)
        Of each pose in means over all displacements in the range, equally likely by area and
        depth: the trapezoid rule.
    """
    around = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    area = np.linspace(0.0, 1.0, 6)[1:]
    radius = displacement_max_mm * np.sqrt(area)
    x = np.concatenate([[0.0], *[r * np.cos(around + r) for r in radius]])
    y = np.concatenate([[0.0], *[r * np.sin(around + r) for r in radius]])
    ring = np.where(area < 1.0, 1.0, 0.5) / around.size
    depth = np.linspace(0.0, depth_max_mm, 6)
    moved = np.stack([np.tile(x, 6), np.tile(y, 6), np.repeat(depth, x.size)], axis=1)
    ends = np.where((depth > 0.0) & (depth < depth_max_mm), 1.0, 0.5)
    share = np.outer(ends, np.concatenate([[0.5], np.repeat(ring, around.size)])).ravel()
    return moved, share / share.sum()


def pairs_seen(topology: Topology, radius_m: float) -> Iterator[np.ndarray]:
    """Pairs within a radius, some at a time: units, and those whose films they see, shape (2, m).

    Parameters
    ----------
    topology : Topology
        As of `skin.physics.stencil.with_films_apart`.
    radius_m : float
    """
    pairs = np.stack(near(topology, radius_m))
    pairs = np.hstack([pairs, pairs[::-1]])
    for first in range(0, pairs.shape[1], PAIRS_AT_ONCE):
        yield pairs[:, first : first + PAIRS_AT_ONCE]


def resting_ut(topology: Topology, at: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Field of films at rest, at their reference temperature, at other units' chips.

    Parameters
    ----------
    topology : Topology
    at, by : ndarray, shape (m,)
        Unit of the chip, and of the film.

    Returns
    -------
    ndarray, shape (3, m)
        Axes of the chips; NaN where a chip is inside or next to the film.
    """
    p = topology.parameters
    points, turn = chips_seen(topology, at, by)
    strength = p["field_amplitude_ut"] / crest_ut(p["field_reference_mm"])
    return np.einsum("abm,bm->am", turn, load_film_table().perfect_ut(points) * strength[by])


def scan_stray(points_mm: np.ndarray, reference_mm: np.ndarray, moved_mm: np.ndarray) -> np.ndarray:
    """What a film of amplitude 1 µT adds at k points as it moves, since it was at rest.

    Parameters
    ----------
    points_mm : ndarray, shape (3, k)
        Frame of the film at rest.
    reference_mm : ndarray, shape (k,)
        Depth of the film at which its crest is 1 µT.
    moved_mm : ndarray, shape (t, 3)
        dx, dy, H of the film.

    Returns
    -------
    ndarray, shape (3, k, t)
        Frame of the film; NaN where a point comes into the film or next to it.
    """
    rest, film_ut = points_mm[:, :, np.newaxis], load_film_table().perfect_ut
    change = film_ut(rest - moved_mm.T[:, np.newaxis]) - film_ut(rest)
    return change / crest_ut(reference_mm)[:, np.newaxis]


def field_at_rest(topology: Topology, horizon_m: float = HORIZON_M) -> np.ndarray:
    """What resting neighbours within a distance add at every chip, shape (3, n).

    Raises
    ------
    SkinError
        A chip is inside or next to a neighbour's film.
    """
    out = np.zeros((3, topology.n))
    for at, by in pairs_seen(topology, horizon_m):
        field = resting_ut(topology, at, by)
        out += [np.bincount(at, row, minlength=topology.n) for row in field]
    lost = ~np.isfinite(out).all(axis=0)
    if lost.any():
        raise SkinError(
            f"{topology.unit_names[int(np.argmax(lost))]}: must keep its chip clear of its "
            "neighbours' films; got one of them inside or next to a film"
        )
    return out


def moving_ut2(
    topology: Topology,
    unit: np.ndarray,
    neighbour: np.ndarray,
    pressed: tuple[float, float] = (1.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of what all films but some add at each chip as they move at random through the
    range of the scans, of x or y and of z, µT², shape (n,) each.

    Pairs are taken to stand side by side, as on a flat skin. Films are pressed alike, so that what
    they add in the mean adds up with its sign; their spreads are independent.

    Parameters
    ----------
    topology : Topology
    unit, neighbour : ndarray, shape (m,)
        Pairs that are in a stencil: not counted.
    pressed : tuple of float
        Chance that one film is pressed, and that two given ones are; all are if not given.
    """
    n, strength = topology.n, topology.parameters["field_amplitude_ut"]
    i, j = near(topology, HORIZON_M)
    at, by = np.concatenate([i, j]), np.concatenate([j, i])
    missing = ~np.isin(at * n + by, np.asarray(unit, np.int64) * n + neighbour)
    at, by = at[missing], by[missing]
    if not at.size:
        return np.zeros(n), np.zeros(n)
    between = topology.position[:, at] - topology.position[:, by]
    d = np.linalg.norm(between, axis=0)
    x, y, _ = np.einsum("abp,ap->bp", topology.rotation[:, :, at], between)
    x, y = np.stack([x, y]) / np.maximum(np.hypot(x, y), 1e-12)

    moved, share = scan_poses(DEPTH_MAX_MM, DISPLACEMENT_MAX_MM)
    distance = np.geomspace(max(float(d.min()), 0.008), HORIZON_M, 24)
    height = np.full_like(distance, load_film_table().film.chip_mm)
    reference = np.full_like(distance, topology.parameters["field_reference_mm"].min())
    points = np.stack([1e3 * distance, np.zeros_like(distance), height])
    stray = scan_stray(points, reference, moved)
    middle = stray @ share
    spread = (stray - middle[:, :, np.newaxis]) ** 2 @ share

    def told(values: np.ndarray, power: int) -> np.ndarray:
        """At the distance of each pair; what falls with a power is given times that power."""
        return np.interp(d, distance, values * distance**power) / d**power

    def added(values: np.ndarray) -> np.ndarray:
        return np.bincount(at, values, minlength=n)

    # along the line between the two, and along z
    along, _, up = (strength[by] * told(row, 4) for row in middle)
    one, two = pressed
    each = strength[by] ** 2
    lateral2 = two * (added(x * along) ** 2 + added(y * along) ** 2)
    lateral2 += added(one * each * told(spread[0] + spread[1], 8) + (one - two) * along**2)
    axial2 = two * added(up) ** 2
    axial2 += added(one * each * told(spread[2], 8) + (one - two) * up**2)
    return 0.5 * lateral2, axial2
