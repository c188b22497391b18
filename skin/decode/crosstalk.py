"""The fields that neighbours' films add at every chip, from where the last decoding put the films.

Decode, predict from the displacements, decode again with the prediction as background: a sweep. In
a live skin the displacements of the last cycle serve, so that one decoding a cycle is one sweep.

What the terms of a stencil are worth, on an array at 12 mm pitch all of whose units move at random
through the whole range (`python -m benchmarks crosstalk`; times of one core at 2.6 GHz, 4096
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
noise of 105 µT a pressed array at 12 mm then reads as its units would alone.

Sweeps needed: each leaves `contraction` of what the one before left, down to the residue. At 15,
13.5, 12, 10, 8 mm pitch that is 0.06, 0.10, 0.17, 0.32, 0.40 on a 6 x 6 array of films that are not
displaced, so two sweeps do from 12 mm on; at 5 mm, where films overlap, sweeps do not converge and
the skin is refused. `sine` gains less: near its crest no sweep helps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.bound import Bound
from skin.decode import crosstalk_kernels as kernels
from skin.decode.crosstalk_cells import find_lattices
from skin.decode.crosstalk_plan import Lattice, Scattered
from skin.errors import SkinError
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from topology import Topology

__all__ = ["ACCURATE_UT", "LIVE_UT", "CrossTalk", "contraction_of"]

LIVE_UT, ACCURATE_UT = 15.0, 5.0
"""Tolerances for one sweep a cycle, whose own error is larger, and for two or more."""
BEYOND_MM = 0.5
"""How far beyond the stencil's range its polynomials are still followed; then films stand still."""
PULLED_MM = 0.3
"""The same, of a film that is pulled off its chip."""
IDLE_REACH_MM = 0.5
"""Displacement that a film at rest never reads as: the noise of its field is 0.07 mm."""
DEPTHS = 5
"""Depths, from rest to the largest of the stencil, at which the contraction is looked at."""
TURNS = 60
"""Steps of the power iteration."""


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
        its field tells of a displacement that is no noise (`IDLE_REACH_MM`). 0: only a film that is
        not displaced at all counts as at rest.
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
    residue_ut2 : ndarray, shape (n,)
        Its square, plus what neighbours may add that are not known now: not usable, NaN, or so far
        beyond the stencil's range that they are taken to stand at its end.
    idle_ut : float
        What neighbours that count as at rest may add to any axis of the worst unit.
    terms : int
        Computed for a unit inside the largest lattice; 0 without one.
    on_lattice : int
        Pairs that share coefficients.

    Raises
    ------
    SkinError
        Sweeps would not converge: units too near to each other for films as weak as these.

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
        stencil = Stencil.of(topology, degree=degree) if stencil is None else stencil
        if stencil.n != topology.n:
            raise SkinError(
                f"stencil: must be of {topology.n} units, as {topology.name}; got {stencil.n}"
            )
        self.stencil = stencil
        real = np.dtype(dtype)
        unit = stencil.unit
        self.contraction = contraction_of(topology, stencil)
        if self.contraction >= 1.0:
            raise SkinError(
                f"{topology.name}: cross-talk: must grow less with every sweep; got "
                f"{self.contraction:.2f} of it after one (units too near to each other, or films "
                "too weak)"
            )
        self._lattices = [
            Lattice(cells, stencil, unit, tolerance_ut, real)
            for cells in (find_lattices(topology) if lattices else ())
        ]
        left = np.ones(unit.size, bool)
        for lattice in self._lattices:
            left[lattice.pairs] = False
        self._scattered = (
            Scattered(np.flatnonzero(left), stencil, unit, tolerance_ut, real)
            if left.any() else None
        )  # fmt: skip
        self.terms = max((lattice.terms for lattice in self._lattices), default=0)
        self.on_lattice = int(np.sum(~left))

        n = topology.n
        self.strength = stencil.strength.astype(real)
        self._drift = topology.parameters["film_drift_per_k"].astype(real)
        self._rest = np.ascontiguousarray(stencil.rest_ut, real)
        reach_mm = IDLE_REACH_MM if idle_mm else 0.0
        self._idle = np.array([idle_mm, 3.0 * idle_mm, reach_mm**2], real)
        reach, deepest = stencil.displacement_max_mm, stencil.depth_max_mm
        self._most = np.array([reach + BEYOND_MM, -PULLED_MM, deepest + BEYOND_MM], real)
        self._sources = zeros((5, n), real)
        self._sources[kernels.KNOWN] = 1.0
        self._stale, self._todo = np.zeros((2, n), np.uint8)
        order = np.argsort(stencil.neighbour, kind="stable")
        counts = np.bincount(stencil.neighbour, minlength=n)
        self._felt = np.append(0, np.cumsum(counts)).astype(np.int32), unit[order].astype(np.int32)
        self._errors(unit, real)
        self.idle_ut = self._idle_bound(unit, idle_mm)

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
    ) -> Callable[[], np.ndarray]:
        """`predict` with arrays that stay the same, for a call each cycle: they are looked at once.

        Parameters
        ----------
        displacement_mm, usable, out, base, film_above : ndarray
            As of `predict`.
        """
        films = Bound(
            kernels.films, displacement_mm, usable, film_above, self.strength, self._drift,
            self._rest, self._idle, self._most, base, self.residue_ut2, *self._sources,
            self._stale, out,
        )  # fmt: skip
        unknown = Bound(
            kernels.unknown, self.stencil.start, self.stencil.neighbour, self._prior, *self._felt,
            self._sources[kernels.KNOWN], self._stale, self._todo, self._always,
            self.residue_ut2, base, out,
        )  # fmt: skip
        parts = [(kernels.lattice, lattice) for lattice in self._lattices]
        if self._scattered is not None:
            parts.append((kernels.scattered, self._scattered))
        adding = [Bound(kernel, self._sources, *part.arguments, out) for kernel, part in parts]

        def call() -> np.ndarray:
            moved, changed = films()
            if changed:
                unknown()
            if moved:
                for add in adding:
                    add()
            return out

        return call

    def warmup(self) -> None:
        """Compile what this skin needs, or load it."""
        n = self._sources.shape[1]
        pressed = np.ones((3, n), self._sources.dtype)
        taken = np.zeros((kernels.ROWS, n), pressed.dtype)
        for usable in (np.zeros(n, bool), np.ones(n, bool)):
            self.predict(pressed, usable, taken, taken)
            self.predict(pressed, usable, np.empty_like(pressed))

    def _errors(self, unit: np.ndarray, real: np.dtype) -> None:
        """Set what is not known of a prediction, in any case and of units that are not known."""
        stencil, n = self.stencil, self.stencil.n
        gram, mean = stencil.gram, stencil.mean
        strength = stencil.strength[stencil.neighbour]
        fits = np.sum(stencil.sigma_ut**2, axis=1)[stencil.kind]
        variance = np.bincount(unit, fits * strength**2, minlength=n)
        shift = np.zeros((n, 3))
        for part in (*self._lattices, *([self._scattered] if self._scattered else ())):
            at, by = unit[part.pairs], strength[part.pairs]
            off = part.off @ mean
            square = np.sum((part.off @ gram) * part.off, axis=(1, 2)) - np.sum(off**2, axis=1)
            variance += np.bincount(at, square * by**2, minlength=n)
            np.add.at(shift, at, off * by[:, np.newaxis])
        always = (variance + np.sum(shift**2, axis=1)) / 3.0 + stencil.left_out_rms_ut**2
        whole = np.sum((stencil.coefficients @ gram) * stencil.coefficients, axis=(1, 2))
        self.residue_ut = np.sqrt(always)
        self._always = always.astype(real)
        self._prior = (whole[stencil.kind] * strength**2 / 3.0).astype(real)
        self.residue_ut2 = self._always.copy()

    def _idle_bound(self, unit: np.ndarray, idle_mm: float) -> float:
        """`idle_ut`, from the linear terms."""
        stencil = self.stencil
        linear = np.abs(stencil.coefficients[:, :, :3])
        each = 3.0 * idle_mm * np.hypot(linear[:, :, 0], linear[:, :, 1])
        each = (each + idle_mm * linear[:, :, 2])[stencil.kind]
        each *= stencil.strength[stencil.neighbour, np.newaxis]
        return max(
            float(np.bincount(unit, column, minlength=stencil.n).max(initial=0.0))
            for column in each.T
        )


def contraction_of(topology: Topology, stencil: Stencil) -> float:
    """Share of the cross-talk that a sweep leaves: the largest over depths, films not displaced.

    It is the spectral radius of ``d stray / d displacement · d displacement / d field``, of the
    tangential displacement, which alone the field decides. The depth of a neighbour enters both
    factors alike, so that it is largest where all units are as deep.

    Parameters
    ----------
    topology : Topology
        `field_amplitude_ut`, `field_growth_per_mm` and `field_wavenumber_rad_per_mm` say how far a
        field displaces: ``1 / (k M0(H))``.
    stencil : Stencil
    """
    p = topology.parameters
    exponents = powers(stencil.degree)
    unit, neighbour = stencil.unit, stencil.neighbour
    worst = 0.0
    for depth in np.linspace(0.0, stencil.depth_max_mm, DEPTHS):
        slope = np.zeros((stencil.coefficients.shape[0], 2, 2))
        for axis in range(2):
            alone = (exponents[:, axis] == 1) & (exponents[:, 1 - axis] == 0)
            height = depth ** exponents[alone, 2]
            slope[:, :, axis] = stencil.coefficients[:, :2, alone] @ height
        crest = p["field_amplitude_ut"] * np.exp(
            p["field_growth_per_mm"] * (depth - p["field_reference_mm"])
        )
        steepest = p["field_wavenumber_rad_per_mm"] * crest
        per_ut = np.divide(1.0, steepest, out=np.zeros(stencil.n), where=~topology.counts_only)
        each = slope[stencil.kind] * stencil.strength[neighbour, np.newaxis, np.newaxis]
        each *= per_ut[unit, np.newaxis, np.newaxis]
        worst = max(worst, _spectral_radius(each, unit, neighbour, stencil.n))
    return worst


def _spectral_radius(blocks: np.ndarray, unit: np.ndarray, neighbour: np.ndarray, n: int) -> float:
    """Of the matrix with 2 x 2 blocks at (unit, neighbour), by power iteration.

    The growth of a random vector over the last third of the steps: pairs of eigenvalues of one size
    would make that of a single step swing.
    """
    vector = np.random.default_rng(0).standard_normal((n, 2))
    grown = 0.0
    for step in range(TURNS):
        each = np.einsum("mab,mb->ma", blocks, vector[neighbour])
        vector = np.stack([np.bincount(unit, column, minlength=n) for column in each.T], axis=1)
        size = float(np.linalg.norm(vector))
        if size == 0.0:
            return 0.0
        vector /= size
        if step >= TURNS * 2 // 3:
            grown += np.log(size)
    return float(np.exp(grown / (TURNS - TURNS * 2 // 3)))
