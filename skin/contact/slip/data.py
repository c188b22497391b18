"""What slip remembers of units, and what it works on: named arrays, allocated once.

The units of a contact are gathered into rows padded to whole vectors, so that loops over a row
become vector instructions, and scattered back at the end. All displacements are in millimetres and
in the tangent plane of each unit.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from bus.compiled import aligned
from skin.contact.slip.parameters import PARAMETERS

__all__ = [
    "LANES", "MOTIONS", "NUISANCES", "PLANE", "BodyFit", "PatternScratch", "SlipData",
    "SlipScratch", "UnitFilter", "UnitHistory", "UnitRows", "row_length",
]  # fmt: skip

_Kind = TypeVar("_Kind", bound=tuple)

MOTIONS, PLANE = 7, 4
"""Motions of a body: along both axes of the contact, about its normal, a swelling (the first four,
in the plane); where the skin is curved, along the normal and about the two axes."""
NUISANCES = MOTIONS + 3
"""What may look like slip and is none: those; a gain that all units share; soft ground under a flat
face; soft ground under a round one."""
LANES = 8
"""Numbers of a vector."""
_LEADING = {
    **dict.fromkeys(
        ("anchor", "lag", "moved", "moved_slow", "moved_recent", "followed", "followed_out"), (2,)
    ),
    **dict.fromkeys(("mean_lag", "lag_sum", "displacement", "direction", "moved_out"), (2,)),
    "design": (2, NUISANCES),
    "nuisance": (NUISANCES,),
}
"""Axes of arrays before that of units; none for the others."""


class UnitFilter(NamedTuple):
    """What is kept of each unit while its contact lasts; shape (n,) or (2, n) with n padded."""

    anchor: np.ndarray  # (2, n) displacement at no motion of the body
    anchor_variance: np.ndarray
    lag: np.ndarray  # (2, n) behind the body, low-passed
    lag_variance: np.ndarray
    moved: np.ndarray  # (2, n) displacement that the body's motion asks for
    moved_slow: np.ndarray  # (2, n) the same, low-passed as the lag is
    moved_recent: np.ndarray  # (2, n) the same, low-passed over `recent_s`
    followed: np.ndarray  # (2, n) its part that the anchor has had time to follow
    followed_out: np.ndarray  # (2, n) what of that is due to motions out of the contact's plane
    gain_error: np.ndarray  # share of the displacement since then by which it goes too far
    gain_information: np.ndarray  # inverse variance of that
    anchor_depth: np.ndarray  # how deep it was pressed, low-passed as the anchor
    score: np.ndarray  # length of the lag in its sigmas
    clipped: np.ndarray  # 1 where friction cannot have held it, as far as the contact tells


class UnitHistory(NamedTuple):
    """What else is kept of each unit, and not needed in rows; shape (n,) or (2, n) as there."""

    body: np.ndarray  # identity of the contact that it is anchored to
    mean_lag: np.ndarray  # (2, n) of a slipping unit: mean of the last stretch of time
    lag_sum: np.ndarray  # (2, n) sum of this stretch
    lag_cycles: np.ndarray  # length of this stretch
    sliding_s: np.ndarray  # how long it still counts as seen sliding


class UnitRows(NamedTuple):
    """Scratch for the units of one contact; shape (length,), (2, length), …"""

    held: np.ndarray  # 1 where it sticks and is anchored to this body
    new: np.ndarray  # 1 where it has just come into contact
    joined: np.ndarray  # 1 where it was anchored to another body
    displacement: np.ndarray  # (2, length)
    noise: np.ndarray  # variance of that
    load: np.ndarray  # N
    weight: np.ndarray  # in the fit; later, inverse variance of the lag
    deeper: np.ndarray  # than at its anchor
    imposed: np.ndarray  # how far the body asks it to be displaced
    direction: np.ndarray  # (2, length) in which
    slip_score: np.ndarray  # its own lag against that direction, in sigmas
    square_distance: np.ndarray  # from the centre, in sizes of the contact
    root_weight: np.ndarray  # of the lag, where it is held
    residual: np.ndarray  # lag in sigmas that the nuisances leave
    redundancy: np.ndarray  # share of its own lag that they leave
    predicted_lag: np.ndarray  # by a pattern of slip, in sigmas
    moved_out: np.ndarray  # (2, length) of `moved`, due to motions out of the plane
    design: np.ndarray  # (2, NUISANCES, length) of motions; later, orthonormal nuisance basis
    nuisance: np.ndarray  # (NUISANCES, length) that basis along `direction`


class BodyFit(NamedTuple):
    """Scratch for the motion of one body."""

    axes: np.ndarray  # (3, 3) rows: major, minor, normal of the contact
    centre: np.ndarray  # (3,) m, about the middle of the array
    mean_normal: np.ndarray  # (3,) N, units' normals times loads
    equations: np.ndarray  # (MOTIONS, MOTIONS + 1) normal equations, right side last
    placement_equations: np.ndarray  # the same of the motions out of the plane, from the anchors
    motion: np.ndarray  # (MOTIONS,) mm at the contact's size
    placement: np.ndarray  # (MOTIONS - PLANE,)


class PatternScratch(NamedTuple):
    """Scratch of the pattern test."""

    prior: np.ndarray  # (NUISANCES, NUISANCES) rows of prior knowledge of the nuisance basis
    likelihood: np.ndarray  # (patterns,) twice the log likelihood ratio
    slipping: np.ndarray  # (patterns,) share of the load that slips


class SlipScratch(NamedTuple):
    """What is written anew for each contact."""

    unit: UnitFilter  # rows, gathered
    row: UnitRows
    fit: BodyFit
    pattern: PatternScratch
    unit_rows: np.ndarray  # (rows, length) all of `unit`, and of `row`: to be padded
    rows: np.ndarray


class SlipData(NamedTuple):
    """All arrays of slip."""

    kept: UnitFilter
    history: UnitHistory
    scratch: SlipScratch

    @staticmethod
    def zeros(n: int) -> SlipData:
        """For n units that nothing has touched yet."""
        length = row_length(n)
        kept, _ = _named(UnitFilter, length)
        history, _ = _named(UnitHistory, length)
        unit, unit_rows = _named(UnitFilter, length)
        row, rows = _named(UnitRows, length)
        fit = BodyFit(
            np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((MOTIONS, MOTIONS + 1)),
            np.zeros((MOTIONS - PLANE, MOTIONS + 1)), np.zeros(MOTIONS), np.zeros(MOTIONS - PLANE),
        )  # fmt: skip
        prior, grid = np.zeros((NUISANCES, NUISANCES)), np.zeros((2, PARAMETERS.patterns))
        pattern = PatternScratch(prior, grid[0], grid[1])
        return SlipData(kept, history, SlipScratch(unit, row, fit, pattern, unit_rows, rows))


def row_length(n: int) -> int:
    """Length of rows for n units: odd in whole vectors, so that rows that are used together do not
    fight for the same cache lines."""
    length = (n + LANES - 1) // LANES * LANES
    return length + LANES * (1 + (length // LANES) % 2)


def _named(kind: type[_Kind], length: int) -> tuple[_Kind, np.ndarray]:
    """Named arrays of one block, and the block, shape (rows, length)."""
    shapes = [_LEADING.get(name, ()) for name in kind._fields]
    ends = np.cumsum([np.prod(shape, dtype=int) for shape in shapes])
    block = aligned.zeros((int(ends[-1]), length))
    parts = np.split(block, ends[:-1])
    arrays = (part.reshape(*shape, length) for part, shape in zip(parts, shapes, strict=True))
    return kind(*arrays), block
