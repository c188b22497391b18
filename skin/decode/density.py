"""How near units may be to each other: what is too dense to be decoded, and what would do.

Two limits, both of the magnets: a film that moves through its range must not come into a
neighbour's chip, and what a film adds at its neighbours must grow less with every sweep. They are
looked at for the skin as a whole; where they are broken, the two units that are nearest to each
other say which key of the file to change.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skin.errors import TooDenseError
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from topology import Topology
from topology.errors import Issue, Report
from topology.layout import count
from topology.read import open_source, read
from topology.schema import File
from topology.source import Key

__all__ = ["contraction_of", "sparse_enough"]

DEPTHS = 5
"""Depths, from rest to the largest of the stencil, at which the contraction is looked at."""
TURNS = 60
"""Steps of the power iteration."""
NAMED = 3
"""Units that a message names."""


def sparse_enough(topology: Topology, stencil: Stencil | None = None) -> tuple[Stencil, float]:
    """The stencil of a skin, and its contraction.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil, optional
        Of the same units; from magnet theory (`Stencil.of`) if not given.

    Raises
    ------
    TooDenseError
        Units are too near to each other; the message has the key that sets the nearest two apart.
    """
    try:
        stencil = Stencil.of(topology) if stencil is None else stencil
        contraction = contraction_of(topology, stencil)
    except TooDenseError as error:
        why = "for films not to come into the chips next to them"
        raise TooDenseError(_issue(topology, why, error.units) or str(error)) from None
    if contraction < 1.0:
        return stencil, contraction
    why = "for what films add at the chips next to them to grow less with every sweep"
    raise TooDenseError(
        _issue(topology, why, range(topology.n))
        or f"{topology.name}: cross-talk: must grow less with every sweep; got {contraction:.2f} "
        "of it after one (units too near to each other, or films too weak)"
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


# -- what to change --------------------------------------------------------------------------------


def _issue(topology: Topology, why: str, units: Sequence[int]) -> str:
    """What to change in the file that a skin came from, for the two units that are nearest to each
    other; empty where that is not known."""
    source, patches = None, ()
    if topology.path is not None:
        source = open_source(topology.path, str(topology.path), Report())
    if source is not None and (file := read(File, source)) is not None:
        patches = file.patches
    sizes = [(patch.name, count(patch)) for patch in patches]
    if source is None or sizes != [
        *zip(topology.patch_names, np.bincount(topology.patch), strict=False)
    ]:
        return ""  # what was loaded is not any more what the file says
    i, j = _nearest(topology)
    names = ", ".join(topology.unit_names[unit] for unit in units[:NAMED])
    why += f" ({names}{f', … {len(units)} units' if len(units) > NAMED else ''})"
    apart_mm = 1e3 * float(np.linalg.norm(topology.position[:, i] - topology.position[:, j]))
    expected = f"farther from {topology.unit_names[i]}, {why}"
    got = f"{topology.unit_names[j]} at {apart_mm:.4g} mm"
    number = int(topology.patch[j])
    at: Key = ("patches", number, "pose")
    if topology.patch[i] == number:
        first = int(np.argmax(topology.patch == number))
        at = ("patches", number, "units", j - first, "xyz_m")
        for name in ("radius_m", "row_pitch_m", "pitch_m"):  # the last one decides most
            if (given := getattr(patches[number], name, None)) is not None:
                at, expected, got = ("patches", number, name), f"larger, {why}", f"{given:g}"
    message = f"must be {expected}; got {got} (12 mm suffices for films as in the paper)"
    return str(Issue(source.shown, source.line(at), source.where(at), message))


def _nearest(topology: Topology) -> tuple[int, int]:
    """The two units of one frame that are nearest to each other."""
    frame = np.array(topology.patch_frames or ("skin",) * len(topology.patch_names))[topology.patch]
    between = topology.position[:, :, np.newaxis] - topology.position[:, np.newaxis]
    distance = np.where(frame == frame[:, np.newaxis], np.linalg.norm(between, axis=0), np.inf)
    np.fill_diagonal(distance, np.inf)
    i, j = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return int(min(i, j)), int(max(i, j))
