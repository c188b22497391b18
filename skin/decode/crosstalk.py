"""The fields that neighbours' films add at every chip, from where the last decoding put the films.

Decode, predict from the displacements, decode again with the prediction as background: a sweep. In
a live skin the displacements of the last cycle serve, so that one decoding a cycle is one sweep. A
film adds a polynomial of degree 4 of its displacement at the chips within 25 mm (`Stencil.of`).
What sweeps leave: `docs/explanation/derivations.md`, "Sweeps".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode.crosstalk_kernels import (
    FieldModel,
    FilmModel,
    Films,
    PairModel,
    StrayData,
    StrayModel,
    add_stray,
)
from skin.decode.density import sparse_enough
from skin.decode.resting import share_shown, stray_ut2
from skin.errors import check_array
from skin.physics.stencil import Stencil, check_stencil
from skin.physics.stray import powers
from topology import Topology

__all__ = ["CrossTalk"]

BEYOND_MM = 0.5
"""How far beyond the stencil's range its polynomials are still followed; then films stand still
[assumed]."""
PULLED_MM = 0.3
"""The same, of a film that is pulled off its chip [assumed]."""
IDLE_DISPLACEMENT_MM = 0.5
"""Displacement that a film at rest never reads as [derived: the noise of its field is 0.07 mm]."""
FRICTION = 3.0
"""A film is displaced by this many times its depth at most, before it slips [assumed]."""


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
    strength : ndarray, shape (n,)
        Of the films, as the stencil has it.
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
        self.strength = stencil.strength.astype(real)
        always = self._residues()
        self.residue_ut = np.sqrt(always)
        self._by_tare_ut2, self._drawn_axial_ut2 = stray_ut2(topology, stencil)
        self._off_ut2, self.axial_ut2 = self._off_by(topology)
        self._model = StrayModel(
            self._films_of(topology, idle_mm), self._pairs_of(always + self._off_ut2),
            _fields_of(stencil, real),
        )  # fmt: skip
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
        like = self._data
        for name, array, own in (("displacement_mm", displacement_mm, like.displacement_mm),
                                 ("usable", usable, like.usable), ("out", out, like.out),
                                 ("base", base, like.base),
                                 ("film_above", film_above, like.film_above_k)):  # fmt: skip
            if array is not None:
                check_array(name, array, own)
        data = self._data._replace(
            displacement_mm=displacement_mm, usable=usable, out=out,
            base=self._data.base if base is None else base,
            film_above_k=self._data.film_above_k if film_above is None else film_above,
        )  # fmt: skip
        return add_stray, self._model, data

    def retare(self, topology: Topology) -> None:
        """Count what films and places at rest are off by only in units that are not tared now, and
        what films may be off by as they move as the tare has shown it."""
        now, self.axial_ut2 = self._off_by(topology)
        for variance in (self._model.pairs.always_ut2, self.residue_ut2):
            np.add(variance, (now - self._off_ut2).astype(variance.dtype), out=variance)
        self._off_ut2 = now

    def _off_by(self, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
        """Variance by films and places that are not as drawn, with what a tare has shown of the
        films: of x or y and of z, shape (n,) each."""
        lateral_ut2 = np.where(topology.tared, self._by_tare_ut2[1], self._by_tare_ut2[0])
        return lateral_ut2, self._drawn_axial_ut2 * share_shown(topology, self.stencil)

    def _films_of(self, topology: Topology, idle_mm: float) -> FilmModel:
        """What the films are, and when they count."""
        stencil, real = self.stencil, self.strength.dtype
        return FilmModel(
            strength=self.strength,
            drift_per_k=topology.parameters["film_drift_per_k"].astype(real),
            rest_ut=np.ascontiguousarray(stencil.rest_ut, real),
            idle_depth_mm=float(idle_mm),
            idle_pull_mm=FRICTION * idle_mm,
            idle_displacement_mm2=IDLE_DISPLACEMENT_MM**2 if idle_mm else 0.0,
            displacement_max_mm=stencil.displacement_max_mm + BEYOND_MM,
            depth_min_mm=-PULLED_MM,
            depth_max_mm=stencil.depth_max_mm + BEYOND_MM,
        )

    def _pairs_of(self, always_ut2: np.ndarray) -> PairModel:
        """Who is near whom, and what one may add to the other."""
        stencil, real = self.stencil, self.strength.dtype
        film, coefficients = stencil.neighbour, stencil.coefficients
        square = np.sum((coefficients @ stencil.gram) * coefficients, axis=(1, 2))
        starts = np.append(0, np.cumsum(np.bincount(film, minlength=stencil.n)))
        return PairModel(
            start=stencil.start,
            neighbour=film,
            prior_ut2=(square[stencil.kind] * stencil.strength[film] ** 2 / 3.0).astype(real),
            receiver_start=starts.astype(np.int32),
            receiver=stencil.unit[np.argsort(film, kind="stable")].astype(np.int32),
            always_ut2=always_ut2.astype(real),
        )

    def _residues(self) -> np.ndarray:
        """Variance of an axis of each unit where all neighbours are known, shape (n,)."""
        stencil = self.stencil
        fits = np.sum(stencil.sigma_ut**2, axis=1)[stencil.kind]
        fits *= stencil.strength[stencil.neighbour] ** 2
        missed = np.bincount(stencil.unit, fits, minlength=stencil.n) / 3.0
        return missed + stencil.left_out_rms_ut**2


def _fields_of(stencil: Stencil, real: np.dtype) -> FieldModel:
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
    return FieldModel(
        np.array([row[tuple(term)] for term in below.tolist()]), factor, start.astype(np.int32),
        stencil.unit[order].astype(np.int32), place, np.concatenate(parts).astype(real),
    )  # fmt: skip


def _data_of(model: StrayModel, real: np.dtype) -> StrayData:
    """Buffers; what a prediction reads and writes is zero."""
    n, fields = model.films.strength.size, model.fields
    most = 3 * int(np.diff(fields.start).max(initial=0))
    stale, todo = np.zeros((2, n), np.uint8)
    return StrayData(
        displacement_mm=zeros((3, n), real), usable=np.zeros(n, bool), film_above_k=zeros(n, real),
        base=zeros((5, n), real), films=Films(*(zeros(n, real) for _ in Films._fields)),
        known=np.ones(n, real), stale=stale,
        residue_ut2=model.pairs.always_ut2.copy(), out=zeros((5, n), real), todo=todo,
        term=zeros(1 + fields.parent.size, real), sums=zeros(most, real),
    )  # fmt: skip
