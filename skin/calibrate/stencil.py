"""The field that a moving neighbour adds at a chip, as a polynomial of where the neighbour is.

A film looks the same from every side, so what it adds at a chip depends on the distance of the
chip from the film's axis and its height along it alone: one fit serves all pairs that share these,
on flat, curved and irregular skins, once it is turned to where the chip really is.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from itertools import product

import numpy as np

from skin.calibrate.fit import Fit, check_levels, check_samples, least_squares
from skin.errors import ScanError
from skin.sim.halbach import CHIP_AXES, HalbachField
from topology import Topology
from topology.neighbours import compressed_rows, pairs_within

__all__ = ["Stencil", "fit_stray", "monomials", "powers"]

SAME_MM = 1e-3
"""Pairs whose chips sit within this of each other, as their films see them, share a fit."""
APART_M = 10.0
"""Between the pairs of the bench: none feels another."""
HORIZON_M = 0.1
"""What is left out is summed to this distance; beyond it a film adds less than 0.1 µT."""


def powers(degree: int) -> np.ndarray:
    """Exponents of (dx, dy, H) of every term but the constant, shape (terms, 3).

    By degree: three linear ones, then six quadratic ones, then ten cubic ones.
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
    x, y, h = given[..., 0, :], given[..., 1, :], given[..., 2, :]
    return np.stack([x**i * y**j * h**k for i, j, k in powers(degree)], axis=-2)


def fit_stray(
    stray_ut: np.ndarray,
    displacement_mm: np.ndarray,
    *,
    degree: int = 2,
    sigma_ut: float = 1.0,
) -> tuple[Fit, Fit, Fit]:
    """Fit the three axes of a neighbour's stray field to a scan of the neighbour.

    Parameters
    ----------
    stray_ut : ndarray, shape (t, 3)
        Change of the field at the chip since the neighbour was at rest.
    displacement_mm : ndarray, shape (t, 3)
        Of the neighbour: dx, dy, H.
    degree : int
        1, 2 or 3.
    sigma_ut : float

    Returns
    -------
    tuple of Fit
        Coefficients of `powers` along x, y and z.

    Raises
    ------
    ScanError
        Too few samples or levels of a displacement, or a value that is not finite.
    """
    if degree not in (1, 2, 3):
        raise ScanError(f"degree: must be 1, 2 or 3; got {degree}")
    terms = powers(degree)
    check_samples(len(terms), stray_ut=stray_ut, displacement_mm=displacement_mm)
    moved = np.asarray(displacement_mm, float)
    for axis, name in enumerate(("dx", "dy", "H")):
        check_levels(f"displacement_mm ({name})", moved[:, axis], degree + 1, 0.05)
    matrix = monomials(moved.T, degree).T
    names = tuple("".join(f"{name}^{e} " for name, e in zip(("dx", "dy", "H"), term, strict=True)
                          if e).strip() for term in terms)  # fmt: skip
    stray = np.asarray(stray_ut, float)
    return tuple(least_squares(matrix, stray[:, axis], sigma_ut, names) for axis in range(3))


@dataclass(frozen=True, eq=False)
class Stencil:
    """What the neighbours of every unit add at its chip, in compressed rows of m pairs.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int32
    neighbour : ndarray, shape (m,), int32
        Neighbours of unit i are ``neighbour[start[i]:start[i + 1]]``.
    coefficients : ndarray, shape (3, terms, m), float64
        µT per mm and its powers (`powers`), axes of the chip of the unit, from (dx, dy, H) of the
        neighbour in the neighbour's frame.
    covariance : ndarray, shape (3, terms, terms, m)
        Of the coefficients of each axis.
    rest_ut : ndarray, shape (3, n)
        What all neighbours within `HORIZON_M`, however far beyond the reach, add while they are at
        rest: constant, and large along z.
    degree : int
    reach_m : float
        Neighbours nearer than this are in.
    left_out_ut : float
        What farther neighbours add to the field of the worst unit, if all of them, each as strong
        as the strongest, moved at once to where on a flat skin they add most.
    residual_rms_ut, residual_max_ut : float
        Of the fits, of one neighbour at the nearest distance.
    """

    start: np.ndarray
    neighbour: np.ndarray
    coefficients: np.ndarray
    covariance: np.ndarray
    rest_ut: np.ndarray
    degree: int
    reach_m: float
    left_out_ut: float
    residual_rms_ut: float
    residual_max_ut: float

    @property
    def unit(self) -> np.ndarray:
        """Unit of each pair, shape (m,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def __call__(self, displacement_mm: np.ndarray) -> np.ndarray:
        """Predict the change of the field at every chip since all units were at rest.

        Parameters
        ----------
        displacement_mm : ndarray, shape (..., 3, n)
            dx, dy, H of every unit, its own frame: `Reading.displacement`.

        Returns
        -------
        ndarray, shape (..., 3, n)
            Microtesla, axes of the chips.
        """
        given = np.asarray(displacement_mm, float)
        terms = monomials(given, self.degree)[..., self.neighbour]
        each = np.einsum("apm,...pm->...am", self.coefficients, terms)
        out = np.zeros(given.shape)
        np.add.at(np.moveaxis(out, -1, 0), self.unit, np.moveaxis(each, -1, 0))
        return out

    @classmethod
    def of(
        cls,
        topology: Topology,
        *,
        degree: int = 2,
        reach_m: float = 0.03,
        depth_max_mm: float = 2.0,
        displacement_max_mm: float = 2.5,
        sigma_ut: float = 0.0,
        seed: int = 0,
    ) -> Stencil:
        """Scan one neighbour for every kind of pair of a skin, from magnet theory, and fit.

        Parameters
        ----------
        topology : Topology
        degree : int
            1, 2 or 3.
        reach_m : float
            Between unit centres.
        depth_max_mm, displacement_max_mm : float
            Range of the scans.
        sigma_ut : float
            One-sigma noise of the scans, after averaging; 0: exact ones.
        seed : int
            Of the noise.

        Raises
        ------
        ScanError
            A degree that is not there.
        """
        pairs = [np.stack([i, j]) for i, j, _ in pairs_within(topology.position, reach_m)]
        i, j = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
        start, neighbour = compressed_rows(topology.n, i, j)
        unit = np.repeat(np.arange(topology.n), np.diff(start))
        film = HalbachField(topology, reach_m=0.0).film
        inward = topology.rotation[:, 2]
        place = 1e3 * topology.position + film.middle_mm * inward
        between = place[:, unit] + film.chip_mm * inward[:, unit] - place[:, neighbour]
        of_film = topology.rotation[:, :, neighbour]
        between = np.einsum("abm,am->bm", of_film, between)
        away, azimuth = np.hypot(between[0], between[1]), np.arctan2(between[1], between[0])
        reference = topology.parameters["field_reference_mm"][neighbour]
        key = np.rint(np.stack([away / SAME_MM, between[2] / SAME_MM, reference / 1e-6]))
        kinds, kind = np.unique(key.astype(np.int64), axis=1, return_inverse=True)
        kinds = kinds * np.array([[SAME_MM], [SAME_MM], [1e-6]])
        moved = _poses(depth_max_mm, displacement_max_mm)
        stray = _scan(topology, kinds, moved)
        if sigma_ut:
            noise = np.random.default_rng(seed).standard_normal(stray.shape)
            stray = stray + sigma_ut * noise
        fits = [fit_stray(s, moved, degree=degree, sigma_ut=sigma_ut or 1.0) for s in stray]
        terms = len(powers(degree))
        values = np.array([[f.values for f in three] for three in fits]).reshape(-1, 3, terms)
        spread = np.array([[f.covariance for f in three] for three in fits])
        spread = spread.reshape(-1, 3, terms, terms)

        # film at azimuth 0 -> its displacement turned there; field turned back, then to the chip
        strength = topology.parameters["field_amplitude_ut"][neighbour]
        turn, back = _turned_terms(azimuth, degree), _about_z(azimuth)
        chip = CHIP_AXES[:, None, None] * topology.rotation.transpose(1, 0, 2)[:, :, unit]
        to_chip = np.einsum("abm,bcm,cdm->adm", chip, of_film, back) * strength
        coefficients = np.einsum("adm,mdp,pqm->aqm", to_chip, values[kind], turn)
        covariance = np.einsum(
            "adm,mdpr,pqm,rsm->aqsm", to_chip**2, spread[kind], turn, turn, optimize=True
        )
        nearest = int(np.argmin(kinds[0])) if fits else None
        scale = float(strength.max()) if fits else 0.0
        rms, worst = (0.0, 0.0) if nearest is None else (
            scale * max(f.residual_rms for f in fits[nearest]),
            scale * max(f.residual_max for f in fits[nearest]),
        )  # fmt: skip
        return cls(
            start, neighbour, coefficients, covariance, _at_rest(topology), degree, reach_m,
            _left_out(topology, reach_m, moved), rms, worst,
        )  # fmt: skip


def _poses(depth_max_mm: float, displacement_max_mm: float) -> np.ndarray:
    """dx, dy, H of a scan, shape (t, 3): discs of equal area at several depths, the rest first."""
    around = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    reach = displacement_max_mm * np.sqrt(np.linspace(0.0, 1.0, 6)[1:])
    x = np.concatenate([[0.0], *[r * np.cos(around + r) for r in reach]])
    y = np.concatenate([[0.0], *[r * np.sin(around + r) for r in reach]])
    depth = np.linspace(0.0, depth_max_mm, 6)
    return np.stack([np.tile(x, 6), np.tile(y, 6), np.repeat(depth, x.size)], axis=1)


def _at_rest(topology: Topology) -> np.ndarray:
    """What resting neighbours add at every chip, shape (3, n)."""
    still = np.zeros((2, topology.n)), np.zeros(topology.n)
    warm = topology.parameters["film_reference_c"]
    both, own = (HalbachField(topology, reach_m=reach) for reach in (HORIZON_M, 0.0))
    return both(*still, warm) - own(*still, warm)


def _scan(topology: Topology, kinds: np.ndarray, moved: np.ndarray) -> np.ndarray:
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
    position[1] = np.tile(APART_M * np.arange(count), 2)
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
    both = HalbachField(bench, reach_m=0.5 * APART_M)(displacement, depth, warm)
    own = HalbachField(bench, reach_m=0.0)(displacement, depth, warm)
    seen = CHIP_AXES[:, None] * (both - own)[:, :, count:]
    return (seen[1:] - seen[0]).transpose(2, 0, 1)


def _about_z(angle: np.ndarray) -> np.ndarray:
    """Rotations about z, shape (3, 3, m)."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def _turned_terms(azimuth: np.ndarray, degree: int) -> np.ndarray:
    """Terms of a displacement turned by -azimuth, from its own terms, shape (terms, terms, m)."""
    samples = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 4 * len(powers(degree))))
    turned = np.einsum("abm,bt->mat", _about_z(-azimuth), samples)
    inverse = np.linalg.pinv(monomials(samples, degree))
    return np.einsum("mpt,tq->pqm", monomials(turned, degree), inverse)


def _left_out(topology: Topology, reach_m: float, moved: np.ndarray) -> float:
    """Bound, in µT, of what neighbours beyond the reach add; see `Stencil.left_out_ut`."""
    if reach_m >= HORIZON_M:
        return 0.0
    film = HalbachField(topology, reach_m=0.0).film
    distance = np.geomspace(max(reach_m, 0.008), HORIZON_M, 24)
    reference = float(topology.parameters["field_reference_mm"].min())
    kinds = np.stack([1e3 * distance, np.full(24, film.chip_mm), np.full(24, reference)])
    stray = _scan(topology, kinds, moved)
    most = np.linalg.norm(stray, axis=2).max(axis=1)
    total = np.zeros(topology.n)
    strongest = float(topology.parameters["field_amplitude_ut"].max())
    for i, j, apart in pairs_within(topology.position, HORIZON_M):
        beyond = apart >= reach_m
        each = np.exp(np.interp(np.log(apart[beyond]), np.log(distance), np.log(most)))
        np.add.at(total, i[beyond], each)
        np.add.at(total, j[beyond], each)
    return strongest * float(total.max())
