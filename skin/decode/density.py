"""How near units may be to each other: what is too dense to be decoded, and what would do.

Two limits, both of the magnets: a film that moves through its range must not come into a
neighbour's chip, and what a film adds at its neighbours must grow less with every sweep. They are
looked at for the skin as a whole; where they are broken, patch by patch, for the key to change.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from skin.errors import TooDenseError
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from topology import Topology
from topology.errors import Issue
from topology.layout import count
from topology.read import open_source, read
from topology.report import Report
from topology.schema import File, Patch
from topology.source import Key, Source

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
        Units are too near to each other; every patch that is wrong is in the message.
    """
    try:
        stencil = Stencil.of(topology) if stencil is None else stencil
        contraction = contraction_of(topology, stencil)
    except TooDenseError as error:
        raise TooDenseError("\n".join(map(str, _issues(topology))) or str(error)) from None
    if contraction < 1.0:
        return stencil, contraction
    raise TooDenseError(
        "\n".join(map(str, _issues(topology)))
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


def _issues(topology: Topology) -> list[Issue]:
    """What to change in the file that a skin came from; none where that is not known."""
    report = Report()
    source = None
    if topology.path is not None:
        source = open_source(topology.path, str(topology.path), report)
    if source is None:
        return []
    patches = read(File, source, report).patches
    if report.issues:
        return []
    units = [(patch.name, count(patch)) for patch in patches]
    if units != [*zip(topology.patch_names, np.bincount(topology.patch), strict=False)]:
        return []  # what was loaded is not any more what the file says
    found = []
    for index, patch in enumerate(patches):
        part = _part(topology, np.flatnonzero(topology.patch == index))
        found += _of_patch(part, patch, ("patches", index), source)
    return found or _of_two(topology, source)


def _of_patch(skin: Topology, patch: Patch, at: Key, source: Source) -> list[Issue]:
    """What is wrong with a patch alone: the first key that decides how near its units are."""
    if not (why := _fault(skin)):
        return []
    for name in ("pitch_m", "row_pitch_m", "radius_m"):
        if (given := getattr(patch, name, None)) is not None:
            return [_issue(source, (*at, name), f"larger, {why}", f"{given:g}")]
    pair = _nearest(skin, ~np.eye(skin.n, dtype=bool))
    return [_too_near(skin, pair, (source, (*at, "units", pair[1], "xyz_m"), why))]


def _of_two(skin: Topology, source: Source) -> list[Issue]:
    """What is wrong with patches because they are near to each other: the pose of the later one."""
    frame = np.unique(np.array(skin.patch_frames)[skin.patch], return_inverse=True)[1]
    other = (skin.patch != skin.patch[:, np.newaxis]) & (frame == frame[:, np.newaxis])
    why = _fault(skin)
    if not why or not other.any():
        return []
    pair = _nearest(skin, other)
    return [_too_near(skin, pair, (source, ("patches", int(skin.patch[pair[1]]), "pose"), why))]


def _nearest(skin: Topology, of: np.ndarray) -> tuple[int, int]:
    """The two units that are nearest to each other, of the pairs in a mask."""
    between = skin.position[:, :, np.newaxis] - skin.position[:, np.newaxis]
    distance = np.where(of, np.linalg.norm(between, axis=0), np.inf)
    i, j = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return int(min(i, j)), int(max(i, j))


def _too_near(skin: Topology, pair: tuple[int, int], told: tuple[Source, Key, str]) -> Issue:
    """The issue of a pair that is to be farther apart."""
    i, j = pair
    now = 1e3 * float(np.linalg.norm(skin.position[:, i] - skin.position[:, j]))
    source, at, why = told
    expected = f"farther from {skin.unit_names[i]}, {why}"
    return _issue(source, at, expected, f"{skin.unit_names[j]} at {now:.4g} mm")


def _issue(source: Source, at: Key, expected: str, got: str) -> Issue:
    message = f"must be {expected}; got {got} (12 mm suffices for films as in the paper)"
    return Issue("too-dense", source.shown, source.line(at), source.where(at), message)


def _fault(skin: Topology) -> str:
    """Why a skin is too dense, in words; empty if it is not."""
    try:
        if contraction_of(skin, Stencil.of(skin)) < 1.0:
            return ""
    except TooDenseError as error:
        units = error.units
        what = "for films not to come into the chips next to them"
    else:
        units = range(skin.n)
        what = "for what films add at the chips next to them to grow less with every sweep"
    names = ", ".join(skin.unit_names[unit] for unit in units[:NAMED])
    return f"{what} ({names}{f', … {len(units)} units' if len(units) > NAMED else ''})"


def _part(skin: Topology, units: np.ndarray) -> Topology:
    """Some units of a skin, without their addresses."""
    frames, foreign = skin.frames, skin.counts_only
    parameters = {name: values[..., units] for name, values in skin.parameters.items()}
    parameters["field_amplitude_ut"] = np.where(
        foreign[units], 0.0, parameters["field_amplitude_ut"]
    )
    return dataclasses.replace(
        skin,
        frames=dataclasses.replace(frames, units=frames.units[:0], layout=frames.layout[:0]),
        unit_names=tuple(skin.unit_names[unit] for unit in units),
        patch=skin.patch[units],
        position=skin.position[:, units],
        rotation=skin.rotation[:, :, units],
        parameters=parameters,
    )
