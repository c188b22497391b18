"""What one film adds at a neighbour's chip as it moves: scans of magnet theory, and fits of scans.

The field of a pair is a polynomial without a constant in dx, dy and H of the neighbour: the change
since the neighbour was at rest.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from itertools import product

import numpy as np

from skin.physics.film_table import load_film_table
from skin.physics.halbach import CHIP_AXES, HalbachField
from topology import Topology
from topology.neighbours import neighbour_pairs

__all__ = [
    "DEGREES", "HORIZON_M", "SEPARATION_M", "Pairs", "blocked", "field_at_rest",
    "left_out", "monomials", "moving_ut2", "near", "powers", "scan_poses", "scan_stray",
]  # fmt: skip

SAME_MM = 1e-3
"""Pairs whose chips sit within this of each other, as their films see them, share a fit [assumed:
far below the tolerances of a skin]."""
SEPARATION_M = 10.0
"""Between the pairs of the bench, and between frames: none feels another [assumed]."""
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


def near(topology: Topology, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of units nearer than a radius, on any frames, each once."""
    n = topology.n
    return neighbour_pairs(topology.position, np.full(n, radius_m), np.zeros(n, int))


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


def scan_stray(topology: Topology, kinds: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Field of a film of amplitude 1 µT at a chip at azimuth 0, film frame: change since rest.

    Parameters
    ----------
    kinds : ndarray, shape (3, k)
        Distance from the axis and height of the chip over the film, mm, and reference depth.
    moved : ndarray, shape (t, 3)

    Returns
    -------
    ndarray, shape (k, t, 3)
    """
    count = kinds.shape[1]
    if count == 0:
        return np.zeros((0, len(moved), 3))
    # films first, then the units with the chips that look at them, whose own films stand still
    position = np.zeros((3, 2 * count))
    position[1] = np.tile(SEPARATION_M * np.arange(count), 2)
    film = HalbachField(topology, reach_m=0.0).film
    position[0, count:] = 1e-3 * kinds[0]
    position[2, count:] = 1e-3 * (kinds[1] - film.chip_mm)
    nominal = {
        name: np.repeat(value[..., :1], 2 * count, axis=-1)
        for name, value in topology.parameters.items()
    }
    nominal["field_amplitude_ut"] = np.ones(2 * count)
    nominal["field_reference_mm"] = np.tile(kinds[2], 2)
    bench = dataclasses.replace(
        topology,
        unit_names=tuple(f"{part} {k}" for part in ("film", "chip") for k in range(count)),
        position=position,
        rotation=np.repeat(np.eye(3)[:, :, None], 2 * count, axis=2),
        parameters=nominal,
    )  # fmt: skip
    at = np.vstack([np.zeros((1, 3)), moved])
    displacement = np.zeros((len(at), 2, 2 * count))
    displacement[:, :, :count] = at[:, :2, None]
    depth = np.zeros((len(at), 2 * count))
    depth[:, :count] = at[:, 2:]
    warm = np.repeat(nominal["film_reference_c"][None], len(at), axis=0)
    # chip k feels film k, and nothing the other way: there is no such pair
    start = np.concatenate([np.zeros(count, np.int32), np.arange(count + 1, dtype=np.int32)])
    felt = start, np.arange(count, dtype=np.int32)
    both = HalbachField(bench, felt=felt)(displacement, depth, warm)
    own = HalbachField(bench, reach_m=0.0)(displacement, depth, warm)
    seen = CHIP_AXES[:, None] * (both - own)[:, :, count:]
    return (seen[1:] - seen[0]).transpose(2, 0, 1)


def blocked(kinds: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Kinds of pairs of which the film comes into the chip or next to it, shape (k,), bool.

    Parameters
    ----------
    kinds, moved : ndarray
        As of `scan_stray`.
    """
    table = load_film_table()
    away, height = kinds[:2, :, np.newaxis]
    x, y, depth = moved.T
    across, above = np.hypot(away - x, y), height - depth
    near = (across <= table.rho.last) & (above >= table.nearest_mm) & (above <= table.z.last)
    return ~(near | (np.hypot(across, above) >= table.far_mm)).all(axis=1)


def field_at_rest(topology: Topology, horizon_m: float = HORIZON_M) -> np.ndarray:
    """What resting neighbours within a distance add at every chip, shape (3, n)."""
    still = np.zeros((2, topology.n)), np.zeros(topology.n)
    warm = topology.parameters["film_reference_c"]
    both, own = (HalbachField(topology, reach_m=reach_m) for reach_m in (horizon_m, 0.0))
    return both(*still, warm) - own(*still, warm)


def left_out(
    topology: Topology,
    unit: np.ndarray,
    neighbour: np.ndarray,
    depth_max_mm: float,
    displacement_max_mm: float,
) -> np.ndarray:
    """`Stencil.left_out_rms_ut`: see `moving_ut2`."""
    lateral2, axial2 = moving_ut2(topology, unit, neighbour, depth_max_mm, displacement_max_mm)
    return np.sqrt((2.0 * lateral2 + axial2) / 3.0)


def moving_ut2(
    topology: Topology,
    unit: np.ndarray,
    neighbour: np.ndarray,
    depth_max_mm: float,
    displacement_max_mm: float,
    pressed: tuple[float, float] = (1.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of what all films but some add at each chip as they move at random through a
    range, of x or y and of z, µT², shape (n,) each.

    Pairs are taken to stand side by side, as on a flat skin. Films are pressed alike, so that what
    they add in the mean adds up with its sign; their spreads are independent.

    Parameters
    ----------
    topology : Topology
    unit, neighbour : ndarray, shape (m,)
        Pairs that are in a stencil: not counted.
    depth_max_mm, displacement_max_mm : float
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

    moved, share = scan_poses(depth_max_mm, displacement_max_mm)
    film = HalbachField(topology, reach_m=0.0).film
    distance = np.geomspace(max(float(d.min()), 0.008), HORIZON_M, 24)
    reference = float(topology.parameters["field_reference_mm"].min())
    seen = np.stack([1e3 * distance, np.full(24, film.chip_mm), np.full(24, reference)])
    stray = scan_stray(topology, seen, moved)
    middle = np.einsum("t,kta->ka", share, stray)
    spread = np.einsum("t,kta->ak", share, (stray - middle[:, np.newaxis]) ** 2)

    def told(values: np.ndarray, power: int) -> np.ndarray:
        """At the distance of each pair; what falls with a power is given times that power."""
        return np.interp(d, distance, values * distance**power) / d**power

    def added(values: np.ndarray) -> np.ndarray:
        return np.bincount(at, values, minlength=n)

    # along the line between the two, and along z
    along, _, up = (strength[by] * told(row, 4) for row in middle.T)
    one, two = pressed
    each = strength[by] ** 2
    lateral2 = two * (added(x * along) ** 2 + added(y * along) ** 2)
    lateral2 += added(one * each * told(spread[0] + spread[1], 8) + (one - two) * along**2)
    axial2 = two * added(up) ** 2
    axial2 += added(one * each * told(spread[2], 8) + (one - two) * up**2)
    return 0.5 * lateral2, axial2


@dataclass(frozen=True, eq=False)
class Pairs:
    """Kinds of pairs of a skin.

    A film looks the same from every side, so that kinds which differ in azimuth alone share a scan
    (`seen`), with the chip at azimuth 0 of the film.
    """

    kind: np.ndarray  # (m,) of each pair
    scan: np.ndarray  # (k,) scan of each kind
    azimuth: np.ndarray  # (k,) of the chip around the film, film frame
    to_chip: np.ndarray  # (3, 3, k) from the scan's axes to those of the chip
    seen: np.ndarray  # (3, s) scans: distance from the axis and height over the film, mm; reference

    @classmethod
    def of(cls, topology: Topology, unit: np.ndarray, neighbour: np.ndarray) -> Pairs:
        film = HalbachField(topology, reach_m=0.0).film
        inward = topology.rotation[:, 2]
        place = 1e3 * topology.position + film.middle_mm * inward
        between = place[:, unit] + film.chip_mm * inward[:, unit] - place[:, neighbour]
        of_film = topology.rotation[:, :, neighbour]
        between = np.einsum("abm,am->bm", of_film, between)
        turn = np.einsum("bam,bcm->acm", topology.rotation[:, :, unit], of_film)
        reference = topology.parameters["field_reference_mm"][neighbour]
        alike = np.vstack([between / SAME_MM, turn.reshape(9, -1) / 1e-5, reference / 1e-6])
        _, first, kind = np.unique(
            np.rint(alike).astype(np.int64), axis=1, return_index=True, return_inverse=True
        )
        between, turn, reference = between[:, first], turn[:, :, first], reference[first]
        away, azimuth = np.hypot(between[0], between[1]), np.arctan2(between[1], between[0])
        key = np.rint(np.stack([away / SAME_MM, between[2] / SAME_MM, reference / 1e-6]))
        seen, scan = np.unique(key.astype(np.int64), axis=1, return_inverse=True)
        # film at azimuth 0 -> its displacement turned there; field turned back, then to the chip
        to_chip = np.einsum("a,abk,bck->ack", CHIP_AXES, turn, _about_z(azimuth))
        return cls(
            kind.ravel().astype(np.int32), scan.ravel(), azimuth, to_chip,
            seen * np.array([[SAME_MM], [SAME_MM], [1e-6]]),
        )  # fmt: skip

    def turned(self, values: np.ndarray, degree: int) -> np.ndarray:
        """Coefficients of every kind, (k, 3, terms), from those of the scans, (s, 3, terms)."""
        turn = _turned_terms(self.azimuth, degree)
        return np.einsum("adk,kdp,pqk->kaq", self.to_chip, values[self.scan], turn, optimize=True)

    def spread(self, sigma: np.ndarray) -> np.ndarray:
        """One-sigma of every kind, shape (k, 3), from that of the scans, (s, 3)."""
        return np.sqrt(np.einsum("adk,kd->ka", self.to_chip**2, sigma[self.scan] ** 2))


def _about_z(angle: np.ndarray) -> np.ndarray:
    """Rotations about z, shape (3, 3, m)."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def _turned_terms(azimuth: np.ndarray, degree: int) -> np.ndarray:
    """Terms of a displacement turned by -azimuth, from its own terms, shape (terms, terms, m)."""
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 4 * len(powers(degree))))
    turned = np.einsum("abm,bt->mat", _about_z(-azimuth), samples)
    q, r = np.linalg.qr(monomials(samples, degree).T)
    return np.einsum("mpt,tq->pqm", monomials(turned, degree), np.linalg.solve(r, q.T).T)
