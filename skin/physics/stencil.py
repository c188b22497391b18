"""The field that a moving neighbour adds at a chip, as a polynomial of where the neighbour is.

Units of different frames move against each other, so what one adds at the other is no constant of
the skin: such pairs are left out.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from skin.errors import ScanError, SkinError, TooDenseError
from skin.physics.halbach import chips_seen
from skin.physics.multipoles import films_as_made, multipole_field
from skin.physics.stray import (
    DEGREES,
    DEPTH_MAX_MM,
    DISPLACEMENT_MAX_MM,
    NEAR_M,
    field_at_rest,
    monomials,
    moving_ut2,
    near,
    pairs_seen,
    powers,
    scan_poses,
    scan_stray,
)
from topology import Topology, UnitModel
from topology.files import arrays_of, check_path, read_arrays, whole_file
from topology.neighbours import compressed_rows

__all__ = [
    "AS_MADE", "Stencil", "check_stencil", "neighbours_at_rest", "neighbours_moving_ut2",
    "rest_sigma_ut", "with_films_apart",
]  # fmt: skip

PRESSED = (2.0 / 3.0, 1.0 / 2.0)
"""Chance that a neighbour of a pressed unit is pressed, and that two given ones are [derived: any
share p of a skin may be pressed, each as likely, and a pressed unit is one of many in proportion to
p: the means of p and of p² by the density 2 p]."""
AS_MADE = UnitModel().stray_sigma_relative
KINDS_AT_ONCE = 512
SAME_MM, SAME_TURN = 1e-3, 1e-5
"""Pairs that differ by less in place, mm, and in attitude are of a kind [assumed: far below the
tolerances of a skin]."""
SEPARATION_M = 10.0
"""Between frames, so that none feels another [assumed]."""
SAME_SKIN_M = 2e-4
"""Units that are this much nearer or farther than in a saved stencil are other units [assumed:
how well units are placed]."""
STENCIL_FILE = arrays_of("a stencil", "format", "neighbour", "coefficients", "strength", "rest_ut")
FORMAT = 1
"""Of the file that a stencil is saved to."""


@dataclass(frozen=True, eq=False)
class Stencil:
    """What the neighbours of every unit add at its chip, in compressed rows of m pairs.

    Pairs of one kind differ in nothing but the strength of the film: on a flat lattice all pairs
    of one offset are of a kind, on a curved skin nearly every pair is its own.

    Attributes
    ----------
    start : ndarray, shape (n + 1,), int32
    neighbour : ndarray, shape (m,), int32
        Neighbours of unit i are ``neighbour[start[i]:start[i + 1]]``.
    kind : ndarray, shape (m,), int32
    apart_m : ndarray, shape (m,)
        Distance of the centres of each pair.
    coefficients : ndarray, shape (k, 3, terms), float64
        Of each kind, for a film of strength 1: µT per mm and its powers (`powers`), axes of the
        chip of the unit, from (dx, dy, H) of the neighbour in the neighbour's frame.
    sigma_ut : ndarray, shape (k, 3)
        One-sigma of what each kind predicts for a film of strength 1, the mean over the range of
        the scan: what the polynomial misses, and the noise of the scan.
    strength : ndarray, shape (n,)
        Of each unit's film: `field_amplitude_ut`, 0 of sensors of another kind; 1 where the pairs
        were measured themselves.
    rest_ut : ndarray, shape (3, n)
        What all neighbours within `HORIZON_M`, however far beyond the reach, add while they are at
        rest: constant, and large along z.
    degree : int
    reach_m : float
        Neighbours nearer than this are in.
    depth_max_mm, displacement_max_mm : float
        Range of the scan.
    left_out_rms_ut : ndarray, shape (n,)
        What farther neighbours add to one axis of each unit if they move at random through the
        range of the scan: root of the mean square, over the axes too. A skin pressed all over is
        about that.
    rest_sigma_ut : ndarray, shape (3, n)
        One-sigma of `rest_ut`, without what errors of placement add. The lateral part counts in
        units that were not tared in their places, the part along z in all: no tare takes it off.
    drawn : bool
        Whether all of it is that of the drawing, so that it is off as `stray_sigma_relative`,
        `placement_sigma_mm` and `placement_sigma_rad` say.
    """

    start: np.ndarray
    neighbour: np.ndarray
    kind: np.ndarray
    apart_m: np.ndarray
    coefficients: np.ndarray
    sigma_ut: np.ndarray
    strength: np.ndarray
    rest_ut: np.ndarray
    degree: int
    reach_m: float
    depth_max_mm: float
    displacement_max_mm: float
    left_out_rms_ut: np.ndarray
    rest_sigma_ut: np.ndarray
    drawn: bool = False

    @property
    def n(self) -> int:
        """Number of units."""
        return len(self.start) - 1

    @property
    def unit(self) -> np.ndarray:
        """Unit of each pair, shape (m,)."""
        return np.repeat(np.arange(self.n), np.diff(self.start))

    @property
    def gram(self) -> np.ndarray:
        """Means of the products of all terms over the range of the scan, shape (terms, terms).

        ``c @ gram @ c`` is the mean square of a polynomial with coefficients c.
        """
        moved, share = scan_poses(self.depth_max_mm, self.displacement_max_mm)
        terms = monomials(moved.T, self.degree)
        return terms * share @ terms.T

    def __call__(self, displacement_mm: np.ndarray) -> np.ndarray:
        """Predict the change of the field at every chip since all units were at rest.

        Every term of every pair in float64; `skin.decode.crosstalk` is the fast way.

        Parameters
        ----------
        displacement_mm : ndarray, shape (..., 3, n)
            dx, dy, H of every unit, its own frame: `Reading.displacement_mm`.

        Returns
        -------
        ndarray, shape (..., 3, n)
            Microtesla, axes of the chips.
        """
        given = np.asarray(displacement_mm, float)
        terms = (monomials(given, self.degree) * self.strength)[..., self.neighbour]
        each = np.einsum("map,...pm->...am", self.coefficients[self.kind], terms)
        out = np.zeros(given.shape)
        np.add.at(np.moveaxis(out, -1, 0), self.unit, np.moveaxis(each, -1, 0))
        return out

    def save(self, path: str | Path, *, simulated: bool = False) -> None:
        """Write all of it to a file, as numpy's .npz, whole or not at all; over no file but a
        stencil. One of simulated units is refused by skins on a real bus."""
        with whole_file(Path(path), over=STENCIL_FILE) as file:
            self.write(file, simulated=simulated)

    def write(self, file: IO[bytes], *, simulated: bool = False) -> None:
        """Write all of it to an open file; see `save`."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        np.savez_compressed(file, format=FORMAT, simulated=simulated, **values)

    @classmethod
    def load(cls, path: str | Path, topology: Topology) -> Stencil:
        """Read a file that `save` wrote.

        Parameters
        ----------
        path : str or Path
        topology : Topology
            Of the same units.

        Raises
        ------
        SkinError
            No such file, another kind of file, or a stencil of another skin.
        """
        check_path("path", path, SkinError)
        try:
            saved = read_arrays(path)
            if (version := int(saved["format"])) != FORMAT:
                raise SkinError(f"{path}: format: must be {FORMAT}; got {version}")
            values: dict[str, Any] = {f.name: saved[f.name][()] for f in dataclasses.fields(cls)}
            found = cls(**values)
            found._check()
            is_simulated = bool(saved["simulated"])
        except (OSError, LookupError, AttributeError, ValueError, TypeError) as error:
            raise SkinError(f"{path}: must be a stencil that was saved; got {error}") from None
        if is_simulated and not topology.in_process:
            raise SkinError(f"{path}: must be the stencil of real units, as {topology.name} is on "
                            "a real bus; got one of simulated units")  # fmt: skip
        if found.n != topology.n:
            raise SkinError(
                f"{path}: must be the stencil of {topology.n} units, as {topology.name}; "
                f"got {found.n}"
            )
        off = np.abs(_distance(topology, found.unit, found.neighbour) - found.apart_m)
        if off.max(initial=0.0) > SAME_SKIN_M:
            worst = int(np.argmax(off))
            i, j = (topology.unit_names[k[worst]] for k in (found.unit, found.neighbour))
            raise SkinError(
                f"{path}: must be the stencil of {topology.name}, {i} and {j} being "
                f"{1e3 * (found.apart_m[worst]):.4g} mm apart in it; got a skin that differs by "
                f"{1e3 * off[worst]:.2g} mm"
            )
        return found

    def _check(self) -> None:
        """Refuse arrays that do not fit each other: compiled code would read outside of them."""
        n, m, (k, _, terms) = self.n, self.neighbour.size, self.coefficients.shape
        shapes = {
            "start": (n + 1,), "neighbour": (m,), "kind": (m,), "apart_m": (m,),
            "coefficients": (k, 3, terms), "sigma_ut": (k, 3), "strength": (n,),
            "rest_ut": (3, n), "left_out_rms_ut": (n,),
            "rest_sigma_ut": (3, n),
        }  # fmt: skip
        for name, shape in shapes.items():
            array = getattr(self, name)
            kind = "i" if name in ("start", "neighbour", "kind") else "f"
            if array.shape != shape or array.dtype.kind != kind or not np.isfinite(array).all():
                raise ValueError(f"{name} of shape {array.shape}, {array.dtype}")
        ends = self.start[0] == 0 and self.start[-1] == m and (np.diff(self.start) >= 0).all()
        for name, end in (("neighbour", n), ("kind", k)):
            index = getattr(self, name)
            if not ends or (m and not 0 <= index.min() <= index.max() < end):
                raise ValueError(f"start or {name} out of range")
        if self.degree not in DEGREES or terms != len(powers(self.degree)):
            raise ValueError(f"degree {self.degree} with {terms} terms")

    @classmethod
    def of(
        cls,
        topology: Topology,
        *,
        degree: int = 4,
        reach_m: float = 0.025,
    ) -> Stencil:
        """Scan one neighbour for every kind of pair of a skin, from magnet theory, and fit.

        Parameters
        ----------
        topology : Topology
        degree : int
            1 to 4.
        reach_m : float
            Between unit centres.

        Raises
        ------
        ScanError
            A degree that is not there.
        TooDenseError
            Units so near that a film is moved into a neighbour's chip.
        """
        if degree not in DEGREES:
            raise ScanError(f"degree: must be 1, 2, 3 or 4; got {degree}")
        topology = _with_films(topology)
        separated = _frames_separated(topology)
        start, neighbour = compressed_rows(topology.n, *near(separated, reach_m))
        unit = np.repeat(np.arange(topology.n), np.diff(start))
        kind, coefficients, sigma = _fitted(topology, unit, neighbour, degree)
        too_near = np.flatnonzero(np.isnan(sigma[kind, 0]))
        if too_near.size:
            units = np.unique(unit[too_near])
            raise TooDenseError(
                f"{topology.unit_names[units[0]]}: must keep its chip clear of its neighbours' "
                f"films, which move by {DISPLACEMENT_MAX_MM:g} mm; got one that comes into it or "
                f"next to it, as with {len(units)} units of {topology.name}",
                [int(u) for u in units],
            )
        lateral2, axial2 = moving_ut2(separated, unit, neighbour)
        return cls(
            start, neighbour, kind, _distance(topology, unit, neighbour), coefficients, sigma,
            topology.parameters["field_amplitude_ut"].copy(), field_at_rest(separated), degree,
            reach_m, DEPTH_MAX_MM, DISPLACEMENT_MAX_MM, np.sqrt((2.0 * lateral2 + axial2) / 3.0),
            rest_sigma_ut(topology), drawn=True,
        )  # fmt: skip


def _fitted(
    topology: Topology, unit: np.ndarray, neighbour: np.ndarray, degree: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinds of pairs, shape (m,), and `coefficients` and `sigma_ut` of each kind, as of `Stencil`;
    NaN of kinds whose film comes into the chip or next to it."""
    points, turn = chips_seen(topology, unit, neighbour)
    reference = topology.parameters["field_reference_mm"][neighbour]
    alike = np.vstack([points / SAME_MM, turn.reshape(9, -1) / SAME_TURN, reference / 1e-6])
    _, first, kind = np.unique(
        np.rint(alike).astype(np.int64), axis=1, return_index=True, return_inverse=True
    )
    moved, share = scan_poses(DEPTH_MAX_MM, DISPLACEMENT_MAX_MM)
    terms = monomials(moved.T, degree)
    fit = np.linalg.pinv(terms)
    values, sigma = np.empty((first.size, 3, len(terms))), np.empty((first.size, 3))
    for begin in range(0, first.size, KINDS_AT_ONCE):
        some = slice(begin, begin + KINDS_AT_ONCE)
        of = first[some]
        stray = scan_stray(points[:, of], reference[of], moved)
        stray = np.einsum("ack,ckt->kat", turn[:, :, of], stray)
        values[some] = stray @ fit
        sigma[some] = np.sqrt((stray - values[some] @ terms) ** 2 @ share)
    return kind.ravel().astype(np.int32), values, sigma


def check_stencil(topology: Topology, stencil: Any) -> None:
    """Raise SkinError for what is no stencil of as many units."""
    if getattr(stencil, "n", None) != topology.n:
        got = stencil.n if isinstance(stencil, Stencil) else type(stencil).__name__
        raise SkinError(f"stencil: must be of {topology.n} units, as {topology.name}; got {got}")


def neighbours_at_rest(topology: Topology) -> np.ndarray:
    """`Stencil.rest_ut` by magnet theory, without the rest of a stencil; shape (3, n)."""
    return field_at_rest(with_films_apart(topology))


def with_films_apart(topology: Topology) -> Topology:
    """The units that have films, frames so far from each other that none feels another."""
    return _frames_separated(_with_films(topology))


def rest_sigma_ut(topology: Topology) -> np.ndarray:
    """`Stencil.rest_sigma_ut` of magnet theory, shape (3, n).

    The covariance of the multipoles of films as they are made, which a skin's films share, is that
    for a `stray_sigma_relative` of `AS_MADE`. It does not say the same of all that films add: what
    a wide array adds along z at rest is off by twice that share. Of films beyond `NEAR_M`, which
    are dipoles, it is that share.
    """
    topology = with_films_apart(topology)
    shape, covariance = films_as_made()
    per_pole = np.zeros((topology.n, 3, shape.size))
    for at, by in pairs_seen(topology, NEAR_M):
        points, turn = chips_seen(topology, at, by)
        turn *= topology.parameters["field_amplitude_ut"][by]
        np.add.at(per_pole, at, np.einsum("acm,kcm->mak", turn, multipole_field(points)))
    variance = np.einsum("nak,kl,nal->an", per_pole, covariance, per_pole)
    far = np.abs(field_at_rest(topology) - field_at_rest(topology, NEAR_M))
    share = topology.parameters["stray_sigma_relative"]
    return share * (np.sqrt(np.maximum(variance, 0.0)) / AS_MADE + far)


def neighbours_moving_ut2(
    topology: Topology, pressed: tuple[float, float] = PRESSED
) -> tuple[np.ndarray, np.ndarray]:
    """`moving_ut2` of all neighbours, frames apart."""
    nobody = np.zeros(0, np.int64)
    return moving_ut2(with_films_apart(topology), nobody, nobody, pressed)


def _with_films(topology: Topology) -> Topology:
    """The same skin, in which sensors of another kind have no film."""
    strength = np.where(topology.counts_only, 0.0, topology.parameters["field_amplitude_ut"])
    parameters = {**topology.parameters, "field_amplitude_ut": strength}
    return dataclasses.replace(topology, parameters=parameters)


def _frames_separated(topology: Topology) -> Topology:
    """The same skin with its frames too far apart to feel each other."""
    if not topology.patch_frames:
        return topology
    _, frame = np.unique(np.array(topology.patch_frames)[topology.patch], return_inverse=True)
    position = topology.position.copy()
    position[0] += SEPARATION_M * frame
    return dataclasses.replace(topology, position=position)


def _distance(topology: Topology, unit: np.ndarray, neighbour: np.ndarray) -> np.ndarray:
    """Distances of the centres of pairs, metre."""
    return np.linalg.norm(topology.position[:, unit] - topology.position[:, neighbour], axis=0)
