"""The fields that neighbours' films add at every chip, from where the last decoding put the films.

Decode, predict from the displacements, decode again with the prediction as background: a sweep. In
a live skin the displacements of the last cycle serve, so that one decoding a cycle is one sweep. A
film adds a polynomial of degree 4 of its displacement at the chips within 25 mm (`Stencil.of`).
What sweeps leave: `docs/explanation/derivations.md`, "Sweeps".
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.jit import compiled, jitable
from skin.decode.density import sparse_enough
from skin.decode.resting import share_shown, stray_ut2
from skin.errors import check_array
from skin.physics.stencil import Stencil, check_stencil
from skin.physics.stray import powers
from topology import Topology

__all__ = ["CrossTalk", "add_stray", "add_stray_python"]

BEYOND_MM = 0.5
"""How far beyond the stencil's range its polynomials are still followed; then films stand still
[assumed]."""
PULLED_MM = 0.3
"""The same, of a film that is pulled off its chip [assumed]."""
IDLE_DISPLACEMENT_MM = 0.5
"""Displacement that a film at rest never reads as [derived: the noise of its field is 0.07 mm]."""
FRICTION = 3.0
"""A film is displaced by this many times its depth at most, before it slips [assumed]."""
FREQUENCY, FIELD, VARIANCE = 0, 1, 4
"""Rows of a background: Hz, three of the field in the axes of the chips, variance of an axis."""


class StrayModel(NamedTuple):
    """What does not change: of n films, of m pairs of a film and a unit near it, by film and by
    unit in compressed rows, and of the polynomials of the pairs."""

    strength: np.ndarray  # (n,) of the films
    drift_per_k: np.ndarray  # (n,) relative change of the strength
    rest_ut: np.ndarray  # (3, n) field of all neighbours at rest, which the offsets hold already
    idle_depth_mm: float  # a film at rest is pressed less than this,
    idle_pull_mm: float  # pulled less than this,
    idle_displacement_mm2: float  # and its squared tangential displacement is less than this
    displacement_max_mm: float  # dx and dy, where films are taken to stand still
    depth_min_mm: float
    depth_max_mm: float
    parent: np.ndarray  # (terms,) int64: each is an earlier one, 0 being the weight, 1 the first,
    factor: np.ndarray  # (terms,) int64: times dx, dy or H
    film_start: np.ndarray  # (n + 1,) int32
    receiver: np.ndarray  # (m,) int32, the units near each film
    place: np.ndarray  # (n,) int64, where the coefficients of a film begin
    coefficients: np.ndarray  # by term: three axes of each unit; films that see alike share them
    unit_start: np.ndarray  # (n + 1,) int32
    neighbour: np.ndarray  # (m,) int32, the films near each unit
    prior_ut2: np.ndarray  # (m,) mean square of what each of them may add to an axis
    always_ut2: np.ndarray  # (n,) variance of an axis where all neighbours are known


class StrayData(NamedTuple):
    """One cycle: what is read, what is written, what is kept, and scratch."""

    displacement_mm: np.ndarray  # (3, n); NaN in dx or dy alone: not looked at since at rest
    usable: np.ndarray  # (n,) bool
    out: np.ndarray  # (5, n), written: the background with what the films add
    base: np.ndarray  # (5, n), background that the result begins with
    film_above_k: np.ndarray  # (n,) temperature of each film above that of its calibration
    known: np.ndarray  # (n,) 1 for films that are usable and within the range, else 0
    residue_ut2: np.ndarray  # (n,) variance of an axis
    term: np.ndarray  # (1 + terms,), scratch
    sums: np.ndarray  # scratch, three axes of the units of the film that most are near to


@jitable
def add_field(film, weight, x, y, h, model, data):
    """Add the field of a film, sum(c w dx^i dy^j H^k), at all units near it."""
    out, term, sums, parent = data.out, data.term, data.sums, model.parent
    first, last = model.film_start[film], model.film_start[film + 1]
    term[0], moved, coefficients = weight, (x, y, h), model.coefficients
    lanes, at = 3 * (last - first), model.place[film]
    for i in range(lanes):
        sums[i] = 0.0
    for k in range(parent.size):
        term[1 + k] = value = term[parent[k]] * moved[model.factor[k]]
        for i in range(lanes):
            # unsigned: numba adds the length to an index that may be negative, which no vector of
            # neighbours can
            sums[i] += value * coefficients[np.uintp(at + i)]
        at += lanes
    for p in range(first, last):
        for axis in range(3):
            out[FIELD + axis, model.receiver[p]] += sums[3 * (p - first) + axis]


@jitable
def add_film(film, warmer, model, data):
    """Add the field of a film if it counts; returns whether `known` has changed.

    A film whose depth is known, but whose dx or dy is NaN, counts as not displaced: it has not been
    looked at since nothing touches it.
    """
    real = data.out.dtype.type
    moved, nothing = data.displacement_mm, real(0.0)
    x, y, h = moved[0, film], moved[1, film], moved[2, film]
    if np.isnan(x) or np.isnan(y):
        x, y = nothing, nothing
    is_known = data.usable[film] and np.isfinite(x + y + h)
    far, highest = real(model.displacement_max_mm), real(model.depth_min_mm)
    deepest = real(model.depth_max_mm)
    away = h > model.idle_depth_mm or h < -model.idle_pull_mm
    if is_known and (away or x * x + y * y > model.idle_displacement_mm2):
        weight = model.strength[film] * (real(1.0) + model.drift_per_k[film] * warmer)
        add_field(film, weight, min(max(x, -far), far), min(max(y, -far), far),
                  min(max(h, highest), deepest), model, data)  # fmt: skip
    is_within = max(abs(x), abs(y)) <= far and highest <= h <= deepest
    now, was = real(1.0) if is_known and is_within else nothing, data.known[film]
    data.known[film] = now
    return now != was


def add_stray_python(model, data):
    """Add the fields of neighbours' films to a background.

    The field of neighbours at rest changes with their temperature, taken to be that of the unit's
    own film.

    Parameters
    ----------
    model : StrayModel
    data : StrayData
    """
    base, out, above, n = data.base, data.out, data.film_above_k, data.usable.size
    real = out.dtype.type
    for i in range(n):
        # NaN: a unit that has not been heard of
        warmer = real(0.0) if np.isnan(above[i]) else above[i]
        out[FREQUENCY, i] = base[FREQUENCY, i]
        for axis in range(3):
            more = model.rest_ut[axis, i] * (model.drift_per_k[i] * warmer)
            out[FIELD + axis, i] = base[FIELD + axis, i] + more
    changed = False
    for film in range(n):
        warmer = real(0.0) if np.isnan(above[film]) else above[film]
        changed |= add_film(film, warmer, model, data)
    for i in range(n):
        if changed:
            data.residue_ut2[i] = model.always_ut2[i]
            for p in range(model.unit_start[i], model.unit_start[i + 1]):
                unknown = real(1.0) - data.known[model.neighbour[p]]
                data.residue_ut2[i] += model.prior_ut2[p] * unknown
        out[VARIANCE, i] = base[VARIANCE, i] + data.residue_ut2[i]


add_stray = compiled(add_stray_python, fastmath={"contract"}, allocates=False)


class CrossTalk:
    """Predicts the stray fields of n units.

    A sweep leaves about `contraction` of what the one before left, and never less than
    `residue_ut`.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil, optional
        Of the same units; from magnet theory (`Stencil.of`) if not given.
    dtype : "float32" or "float64"
    idle_mm : float
        A film that is pressed less than this can be displaced by three times this at most, as
        friction has it: it counts as at rest, unless it is pulled by more than three times this, or
        its field shows a displacement that is no noise (`IDLE_DISPLACEMENT_MM`). 0: only a film
        that is not displaced at all counts as at rest.

    Attributes
    ----------
    stencil : Stencil
    contraction : float
        Largest share of the cross-talk that one sweep leaves, of films that are not displaced.
    residue_ut : ndarray, shape (n,)
        One-sigma, per axis, of what a prediction from true displacements misses: fits, and
        neighbours beyond the reach.
    axial_ut2 : ndarray, shape (n,)
        Variance along z by films of another make as they move, where the stencil is that of the
        drawing; less where a tare has shown how they are made.
    residue_ut2 : ndarray, shape (n,)
        Variance of x or y: the square of `residue_ut`, plus what errors of placement and films of
        another make add where the stencil is that of the drawing, plus what neighbours may add that
        are not known now: not usable,
        NaN, or so far beyond the stencil's range that they are taken to stand at its end.

    Raises
    ------
    TooDenseError
        Units are too near to each other: sweeps would not converge, or a film is moved into a
        neighbour's chip. The message has the line of the file and the nearest value that works.
    SkinError
        A stencil of other units; an array of another type or shape.

    Examples
    --------
    >>> import topology
    >>> palm = topology.load("palm")
    >>> crosstalk = CrossTalk(palm)
    >>> pressed = np.zeros((3, palm.n), np.float32)
    >>> pressed[2, 27] = 1.5
    >>> background = np.zeros((5, palm.n), np.float32)
    >>> _, *stray, _ = crosstalk.predict(pressed, np.ones(palm.n, bool), background)
    >>> bool(stray[0][28] != 0.0 and stray[0][27] == 0.0)
    True
    """

    def __init__(
        self,
        topology: Topology,
        stencil: Stencil | None = None,
        *,
        dtype: str = "float32",
        idle_mm: float = 0.027,
    ) -> None:
        if stencil is not None:
            check_stencil(topology, stencil)
        self.stencil, self.contraction = stencil, _ = sparse_enough(topology, stencil)
        real = np.dtype(dtype)
        always = self._residues()
        self.residue_ut = np.sqrt(always)
        self._by_tare_ut2, self._drawn_axial_ut2 = stray_ut2(topology, stencil)
        self._off_ut2, self.axial_ut2 = self._off_by(topology)
        real = np.dtype(dtype)
        self._model = self._model_of(topology, always + self._off_ut2, idle_mm, real)
        self._data = _data_of(self._model, real)
        self.residue_ut2 = self._data.residue_ut2

    def predict(
        self,
        displacement_mm: np.ndarray,
        usable: np.ndarray,
        out: np.ndarray,
        base: np.ndarray | None = None,
        film_above: np.ndarray | None = None,
    ) -> np.ndarray:
        """Stray fields of all films that are known, have moved and are within reach.

        Parameters
        ----------
        displacement_mm : ndarray, shape (3, n)
            Of this cycle or the last one: `Reading.displacement_mm`. NaN in dx or dy alone: not
            looked at since at rest; NaN in H: not known.
        usable : ndarray, shape (n,), bool
            Units whose displacement may be believed.
        out : ndarray, shape (5, n)
            Written: a background as of a decoder, the fields in rows 1 to 3, µT in the axes of the
            chips; row 0 is that of `base`, and `residue_ut2` is added to row 4.
        base : ndarray, shape (5, n), optional
            Added: the rest of the background.
        film_above : ndarray, shape (n,), optional
            Temperature of each film above that of its calibration, kelvin: its field, and that of
            the neighbours at rest, is weaker by `film_drift_per_k`.

        Returns
        -------
        ndarray, shape (5, n)
            `out`. All arrays have the type of this object and are contiguous.
        """
        kernel, *given = self.call(displacement_mm, usable, out, base, film_above)
        kernel(*given)
        return out

    def call(
        self,
        displacement_mm: np.ndarray,
        usable: np.ndarray,
        out: np.ndarray,
        base: np.ndarray | None = None,
        film_above: np.ndarray | None = None,
    ) -> tuple[Any, ...]:
        """The kernel of a prediction, with its arguments; as of `predict`."""
        own = self._data
        base = own.base if base is None else base
        film_above = own.film_above_k if film_above is None else film_above
        given = displacement_mm, usable, out, base, film_above
        for name, array, like in zip(StrayData._fields, given, own, strict=False):
            check_array(name, array, like)
        return add_stray, self._model, StrayData(*given, *own[len(given) :])

    def retare(self, topology: Topology) -> None:
        """Count what films and places at rest are off by only in units that are not tared now, and
        what films may be off by as they move as the tare has shown it."""
        now, self.axial_ut2 = self._off_by(topology)
        for variance in (self._model.always_ut2, self.residue_ut2):
            np.add(variance, (now - self._off_ut2).astype(variance.dtype), out=variance)
        self._off_ut2 = now

    def _off_by(self, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
        """Variance by films and places that are not as drawn, with what a tare has shown of the
        films: of x or y and of z, shape (n,) each."""
        lateral_ut2 = np.where(topology.tared, self._by_tare_ut2[1], self._by_tare_ut2[0])
        return lateral_ut2, self._drawn_axial_ut2 * share_shown(topology, self.stencil)

    def _model_of(
        self, topology: Topology, always_ut2: np.ndarray, idle_mm: float, real: np.dtype
    ) -> StrayModel:
        """What the films are, when they count, and what one may add to a unit near it."""
        stencil, film, strength = self.stencil, self.stencil.neighbour, self.stencil.strength
        square = np.sum((stencil.coefficients @ stencil.gram) * stencil.coefficients, axis=(1, 2))
        return StrayModel(
            strength=strength.astype(real),
            drift_per_k=topology.parameters["film_drift_per_k"].astype(real),
            rest_ut=np.ascontiguousarray(stencil.rest_ut, real),
            idle_depth_mm=float(idle_mm),
            idle_pull_mm=FRICTION * idle_mm,
            idle_displacement_mm2=IDLE_DISPLACEMENT_MM**2 if idle_mm else 0.0,
            displacement_max_mm=stencil.displacement_max_mm + BEYOND_MM,
            depth_min_mm=-PULLED_MM,
            depth_max_mm=stencil.depth_max_mm + BEYOND_MM,
            unit_start=stencil.start,
            neighbour=film,
            prior_ut2=(square[stencil.kind] * strength[film] ** 2 / 3.0).astype(real),
            always_ut2=always_ut2.astype(real),
            **_polynomials(stencil, real),
        )

    def _residues(self) -> np.ndarray:
        """Variance of an axis of each unit where all neighbours are known, shape (n,)."""
        stencil = self.stencil
        fits = np.sum(stencil.sigma_ut**2, axis=1)[stencil.kind]
        fits *= stencil.strength[stencil.neighbour] ** 2
        missed = np.bincount(stencil.unit, fits, minlength=stencil.n) / 3.0
        return missed + stencil.left_out_rms_ut**2


def _polynomials(stencil: Stencil, real: np.dtype) -> dict[str, np.ndarray]:
    """The polynomials of a stencil, by film; films whose pairs are of the same kinds share
    coefficients."""
    exponents = powers(stencil.degree)
    row = {(0, 0, 0): 0} | {tuple(term): 1 + k for k, term in enumerate(exponents.tolist())}
    factor = np.argmax(exponents > 0, axis=1)
    below = exponents - np.eye(3, dtype=int)[factor]
    order = np.lexsort((stencil.unit, stencil.kind, stencil.neighbour))
    kind, film = stencil.kind[order], stencil.neighbour[order]
    start = np.append(0, np.cumsum(np.bincount(film, minlength=stencil.n)))
    place, parts, known, size = np.zeros(stencil.n, np.int64), [np.zeros(1)], {}, 1
    for i in range(stencil.n):
        kinds = kind[start[i] : start[i + 1]]
        if kinds.tobytes() not in known:
            known[kinds.tobytes()] = size
            parts.append(stencil.coefficients[kinds].transpose(2, 0, 1).reshape(-1))
            size += parts[-1].size
        place[i] = known[kinds.tobytes()]
    return {
        "parent": np.array([row[tuple(term)] for term in below.tolist()]), "factor": factor,
        "film_start": start.astype(np.int32), "receiver": stencil.unit[order].astype(np.int32),
        "place": place, "coefficients": np.concatenate(parts).astype(real),
    }  # fmt: skip


def _data_of(model: StrayModel, real: np.dtype) -> StrayData:
    """Buffers; what a prediction reads and writes is zero."""
    n = model.strength.size
    most = 3 * int(np.diff(model.film_start).max(initial=0))
    return StrayData(
        zeros((3, n), real), np.zeros(n, bool), zeros((5, n), real), zeros((5, n), real),
        zeros(n, real), known=np.ones(n, real), residue_ut2=model.always_ut2.copy(),
        term=zeros(1 + model.parent.size, real), sums=zeros(most, real),
    )  # fmt: skip
