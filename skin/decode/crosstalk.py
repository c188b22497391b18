"""The fields that neighbours' films add at every chip, from where the last decoding put the films.

Decode, predict from the displacements, decode again with the prediction as background: a sweep. In
a live skin the displacements of the last cycle serve, so that one decoding a cycle is one sweep.

What the terms of a stencil are worth, on an array at 12 mm pitch all of whose units move at random
through the whole range (times of one core at 2.6 GHz, 4096
units; the displacement is that of `field-angle`, cold start, without noise):

======  =====  =========  =====  =======  ======  =============================
degree  reach  tolerance  terms  ns/unit  missed  µm rms after 0 / 1 / 2 sweeps
======  =====  =========  =====  =======  ======  =============================
1       18 mm  0 µT          24        5   77 µT   153 / 43 / 43
2       18 mm  0 µT          72        9   29 µT   153 / 18 / 16
3       18 mm  0 µT         152       15   20 µT   153 / 14 / 9.8
3       25 mm  0 µT         228       20   14 µT   153 / 13 / 7.2
2       30 mm  0 µT         180       17   24 µT   153 / 17 / 13
3       30 mm  0 µT         380       29  8.6 µT   153 / 12 / 4.8
4       39 mm  0 µT        1224      101  2.7 µT   153 / 11 / 1.9
4       39 mm  20 µT         69       10   17 µT   153 / 14 / 9.2
4       39 mm  **15 µT**     84       12   12 µT   153 / 12 / 6.3
4       39 mm  10 µT        112       14  8.7 µT   153 / 12 / 4.8
4       39 mm  **5 µT**     168       19  4.6 µT   153 / 11 / 2.9
======  =====  =========  =====  =======  ======  =============================

So terms are chosen by tolerance, not by degree and reach; `residue_ut` states what is missed. With
noise of 105 µT, which makes 70 µm of a unit at rest, that is hardly seen at 12 mm.

Sweeps needed: each leaves `contraction` of what the one before left, down to the residue. At 15,
13.5, 12, 10, 8 mm pitch that is 0.06, 0.10, 0.17, 0.32, 0.40 on a 6 x 6 array of films that are not
displaced, so two sweeps do from 12 mm on; at 5 mm, where films overlap, sweeps do not converge and
the skin is refused. `sine` gains less: near its crest no sweep helps.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.bound import Bound
from bus.compiled.chained import call
from skin.decode import crosstalk_kernels as kernels
from skin.decode.crosstalk_cells import find_lattices
from skin.decode.crosstalk_kernels import (
    Background,
    FilmData,
    FilmModel,
    Films,
    Known,
    PairData,
    PairModel,
)
from skin.decode.crosstalk_lattice import Lattice
from skin.decode.crosstalk_placement import films_ut2, placement_ut2
from skin.decode.crosstalk_scattered import Scattered
from skin.decode.crosstalk_terms import Part
from skin.decode.density import sparse_enough
from skin.decode.resting import FilmsSeen
from skin.physics.stencil import Stencil, check_stencil
from topology import Topology

__all__ = ["ACCURATE_UT", "LIVE_UT", "CrossTalk"]

LIVE_UT, ACCURATE_UT = 15.0, 5.0
"""Tolerances, µT, for one sweep a cycle, whose own error is larger, and for two or more
[tuned on the table above]."""
BEYOND_MM = 0.5
"""How far beyond the stencil's range its polynomials are still followed; then films stand still
[assumed]."""
PULLED_MM = 0.3
"""The same, of a film that is pulled off its chip [assumed]."""
IDLE_DISPLACEMENT_MM = 0.5
"""Displacement that a film at rest never reads as [derived: the noise of its field is 0.07 mm]."""
FRICTION = 3.0
"""A film is displaced by this many times its depth at most, before it slips [assumed]."""
BACKGROUND_ROWS = 5
"""Of a whole background: Hz, the field's three axes, and a variance."""


class CrossTalk:
    """Predicts the stray fields of n units.

    Flat lattices share the coefficients of an offset and are computed in shifted rows; pairs of
    curved and irregular skins have coefficients of their own. Which pair goes which way is seen
    from the stencil, and changes results by rounding and the tolerance only.

    A sweep leaves about `contraction` of what the one before left, and never less than
    `residue_ut`.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil, optional
        Of the same units; from magnet theory (`Stencil.of`) if not given.
    dtype : "float32" or "float64"
    degree : int
        Of the stencil, where none is given.
    tolerance_ut : float
        Root mean square, over axes and over all displacements in the stencil's range, of what may
        be saved in terms at any unit. 0: all terms.
    idle_mm : float
        A film that is pressed less than this can be displaced by three times this at most, as
        friction has it: it counts as at rest, unless it is pulled by more than three times this, or
        its field shows a displacement that is no noise (`IDLE_DISPLACEMENT_MM`). 0: only a film
        that is not displaced at all counts as at rest.
    lattices : bool
        False: every pair counts as one of an irregular skin.

    Attributes
    ----------
    stencil : Stencil
    strength : ndarray, shape (n,)
        Of the films, as the stencil has it.
    contraction : float
        Largest share of the cross-talk that one sweep leaves, of films that are not displaced.
    residue_ut : ndarray, shape (n,)
        One-sigma, per axis, of what a prediction from true displacements misses: fits, terms that
        were saved, neighbours beyond the reach.
    axial_ut2 : ndarray, shape (n,)
        Variance along z by films of another make as they move, where the stencil is that of the
        drawing; less where a tare has shown how they are made.
    residue_ut2 : ndarray, shape (n,)
        Variance of x or y: the square of `residue_ut`, plus what errors of placement and films of
        another make add where the stencil is that of the drawing, plus what neighbours may add that
        are not known now: not usable,
        NaN, or so far beyond the stencil's range that they are taken to stand at its end.
    idle_ut : float
        What neighbours that count as at rest may add to any axis of the worst unit.
    terms : int
        Computed for a unit inside the largest lattice; 0 without one.
    on_lattice : int
        Pairs that share coefficients.

    Raises
    ------
    TooDenseError
        Units are too near to each other: sweeps would not converge, or a film is moved into a
        neighbour's chip. The message has the line of the file and the nearest value that works.
    SkinError
        A stencil of other units.

    Examples
    --------
    >>> import topology
    >>> palm = topology.load("palm")
    >>> crosstalk = CrossTalk(palm)
    >>> pressed = np.zeros((3, palm.n), np.float32)
    >>> pressed[2, 27] = 1.5
    >>> stray = crosstalk.predict(pressed, np.ones(palm.n, bool), np.empty_like(pressed))
    >>> bool(stray[0, 28] != 0.0 and stray[0, 27] == 0.0)
    True
    """

    def __init__(
        self,
        topology: Topology,
        stencil: Stencil | None = None,
        *,
        dtype: str = "float32",
        degree: int = 4,
        tolerance_ut: float = LIVE_UT,
        idle_mm: float = 0.027,
        lattices: bool = True,
    ) -> None:
        if stencil is not None:
            check_stencil(topology, stencil)
        self.stencil, self.contraction = stencil, _ = sparse_enough(topology, stencil, degree)
        real = np.dtype(dtype)
        on_lattices = [
            Lattice(cells, stencil, tolerance_ut, real)
            for cells in (find_lattices(topology) if lattices else ())
        ]
        left = np.ones(stencil.kind.size, bool)
        for lattice in on_lattices:
            left[lattice.pairs] = False
        self._parts: list[Part] = [*on_lattices]
        if left.any():
            self._parts.append(Scattered(np.flatnonzero(left), stencil, tolerance_ut, real))
        self.terms = max((part.terms for part in self._parts), default=0)
        self.on_lattice = int(np.sum(~left))
        self.strength = stencil.strength.astype(real)
        self._films = Films(*(zeros(topology.n, real) for _ in Films._fields))
        self._film_model = self._films_of(topology, idle_mm)
        always = self._residues()
        self.residue_ut = np.sqrt(always)
        self._films_seen = FilmsSeen(topology, stencil) if stencil.drawn else None
        self._by_tare_ut2, self._films_axial_ut2 = films_ut2(topology, stencil)
        if stencil.drawn:
            self._by_tare_ut2 = self._by_tare_ut2 + placement_ut2(topology, stencil)
        self._off_ut2, self.axial_ut2 = self._off_by(topology)
        self._pair_model = self._pairs_of(always + self._off_ut2)
        self.residue_ut2 = self._pair_model.always_ut2.copy()
        stale, self._todo = np.zeros((2, topology.n), np.uint8)
        self._known = Known(np.ones(topology.n, real), stale, self.residue_ut2)
        self.idle_ut = self._idle_bound(idle_mm)

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
        out : ndarray, shape (3, n) or (5, n)
            Written: microtesla, axes of the chips. Of five rows, as of a decoder's background,
            these are rows 1 to 3; row 0 is that of `base`, and `residue_ut2` is added to row 4.
        base : ndarray, shape (3, n) or (5, n) as `out`, optional
            Added: the rest of the background.
        film_above : ndarray, shape (n,), optional
            Temperature of each film above that of its calibration, kelvin: its field, and that of
            the neighbours at rest, is weaker by `film_drift_per_k`.

        Returns
        -------
        ndarray, shape (3, n) or (5, n)
            `out`. All arrays have the type of this object and are contiguous.
        """
        return self.bound(displacement_mm, usable, out, base, film_above)()

    def bound(
        self,
        displacement_mm: np.ndarray,
        usable: np.ndarray,
        out: np.ndarray,
        base: np.ndarray | None = None,
        film_above: np.ndarray | None = None,
    ) -> Prediction:
        """`predict` with arrays that stay the same, for a call each cycle: they are looked at once.

        Parameters
        ----------
        displacement_mm, usable, out, base, film_above : ndarray
            As of `predict`.
        """
        if base is None:
            base = np.zeros_like(out)
        if film_above is None:
            film_above = np.zeros_like(self.strength)
        given, written, known = _rows(base), _rows(out), self._known
        data = FilmData(
            displacement_mm, usable, film_above, given, self._films, known, written
        )  # fmt: skip
        films = Bound(kernels.films, self._film_model, data)
        pairs = PairData(known, self._todo, given.variance_ut2, written.variance_ut2)
        unknown = Bound(kernels.unknown, self._pair_model, pairs)
        adding = [part.bound(self._films, written.field_ut) for part in self._parts]
        return Prediction(films, unknown, adding, out)

    def retare(self, topology: Topology) -> None:
        """Count what films and places at rest are off by only in units that are not tared now, and
        what films may be off by as they move as the tare has shown it."""
        now, self.axial_ut2 = self._off_by(topology)
        for variance in (self._pair_model.always_ut2, self.residue_ut2):
            np.add(variance, (now - self._off_ut2).astype(variance.dtype), out=variance)
        self._off_ut2 = now

    def warmup(self) -> None:
        """Compile what a cycle of this skin needs, or load it; nothing is predicted."""
        n, real = self.stencil.n, self.strength.dtype
        self.bound(np.zeros((3, n), real), np.zeros(n, bool), np.zeros((3, n), real))

    def _off_by(self, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
        """Variance by films and places that are not as drawn, with what a tare has shown of the
        films: of x or y and of z, shape (n,) each."""
        lateral_ut2 = np.where(topology.tared, self._by_tare_ut2[1], self._by_tare_ut2[0])
        seen, axial_ut2 = self._films_seen, self._films_axial_ut2
        return lateral_ut2, axial_ut2 if seen is None else axial_ut2 * seen.share2(topology)

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
        stencil, unit, n = self.stencil, self.stencil.unit, self.stencil.n
        gram, mean = stencil.gram, stencil.mean
        strength = stencil.strength[stencil.neighbour]
        fits = np.sum(stencil.sigma_ut**2, axis=1)[stencil.kind]
        variance = np.bincount(unit, fits * strength**2, minlength=n)
        shift = np.zeros((n, 3))
        for part in self._parts:
            at, by = unit[part.pairs], strength[part.pairs]
            off = part.off @ mean
            square = np.sum((part.off @ gram) * part.off, axis=(1, 2)) - np.sum(off**2, axis=1)
            variance += np.bincount(at, square * by**2, minlength=n)
            np.add.at(shift, at, off * by[:, np.newaxis])
        return (variance + np.sum(shift**2, axis=1)) / 3.0 + stencil.left_out_rms_ut**2

    def _idle_bound(self, idle_mm: float) -> float:
        """`idle_ut`, from the linear terms."""
        stencil = self.stencil
        linear = np.abs(stencil.coefficients[:, :, :3])
        each = FRICTION * idle_mm * np.hypot(linear[:, :, 0], linear[:, :, 1])
        each = (each + idle_mm * linear[:, :, 2])[stencil.kind]
        each *= stencil.strength[stencil.neighbour, np.newaxis]
        return max(
            float(np.bincount(stencil.unit, axis, minlength=stencil.n).max(initial=0.0))
            for axis in each.T
        )


class Prediction:
    """The calls that a prediction is made of, in their order.

    Attributes
    ----------
    films, unknown : Bound
        The kernels of `skin.decode.crosstalk_kernels`; the second where what is known has changed.
    adding : list of Bound
        Of each part, where any film counts.
    """

    __slots__ = ("_out", "adding", "films", "unknown")

    def __init__(self, films: Bound, unknown: Bound, adding: list[Bound], out: np.ndarray) -> None:
        self.films, self.unknown, self.adding, self._out = films, unknown, adding, out

    def __call__(self) -> np.ndarray:
        """Predict; see `CrossTalk.predict`."""
        found = call([self.films], 0)
        if found & 2:
            self.unknown()
        if found & 1:
            for add in self.adding:
                add()
        return self._out


def _rows(background: np.ndarray) -> Background:
    """The rows of a background, shape (5, n); of its field alone, shape (3, n), and others."""
    if len(background) == BACKGROUND_ROWS:
        return Background(background[0], background[1:4], background[4])
    frequency, variance = np.zeros_like(background[:2])
    return Background(frequency, background, variance)
