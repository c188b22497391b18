"""State and scratch of slip: named arrays, allocated once.

The units of a contact are gathered into rows padded to whole vectors, so that loops over a row
become vector instructions, and scattered back at the end. All displacements are in millimetres and
in the tangent plane of each unit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled import aligned
from bus.compiled.jit import jitable
from skin.contact.slip.parameters import PATTERNS

__all__ = [
    "BEGAN", "GROWTH", "LAGS", "LAG_RATIO", "LANES", "MOTIONS", "NOISE_RATIO", "NOISY_UNIT",
    "NUISANCES", "PLANE", "READINGS", "READING_RATIO", "RECENT_STEPS", "SLOW", "STEPS", "WANDER",
    "BodyFit", "PatternScratch", "SlipArrays", "SlipData", "SlipScratch", "UnitFilter",
    "UnitHistory", "UnitRows", "padded", "row_length", "slip_arrays", "unit_filter",
]  # fmt: skip

MOTIONS, PLANE = 6, 3
"""Motions of a body: along both axes of the contact and about its normal (the first three, in the
plane); where the skin is curved, along the normal and about the two axes."""
NUISANCES = MOTIONS + 2
"""Nuisance parameters: those; a common gain error of all units; soft ground."""
LANES = 8
"""Length of a padded vector."""


class UnitFilter(NamedTuple):
    """State of each unit while its contact lasts, and its noise for longer; shape (n,) or (2, n)
    with n padded."""

    anchor: np.ndarray  # (2, n) displacement without motion of the body
    anchor_variance: np.ndarray
    lag: np.ndarray  # (2, n) behind the body, low-passed
    lag_variance: np.ndarray
    moved: np.ndarray  # (2, n) displacement predicted by the body's motion
    moved_slow: np.ndarray  # (2, n) the same, low-passed as the lag is
    followed: np.ndarray  # (2, n) the part that the anchor has followed
    followed_out: np.ndarray  # (2, n) the part of that by motions out of the contact's plane
    gain_error: np.ndarray  # relative error of the displacement since anchoring
    gain_information: np.ndarray  # inverse variance of that
    anchor_depth: np.ndarray  # depth, low-passed as the anchor
    lag_mean: np.ndarray  # (2, n) of the lag over `rest_s`
    noise_ratio: np.ndarray  # variance of the noise over sigma squared; 0 before contact
    noise_sum: np.ndarray  # sum of squared noise over sigma squared
    noise_count: np.ndarray  # number of terms in it
    age_s: np.ndarray  # time since it was anchored
    behind: np.ndarray  # (2, n) lag in the last cycle, not low-passed
    slow_sum: np.ndarray  # sum of squared lags beyond their variance, over sigma squared


class UnitHistory(NamedTuple):
    """Further state of each unit that is not gathered into rows; shape (n,) or (2, n) as there."""

    body: np.ndarray  # identity of the contact that it is anchored to
    began: np.ndarray  # identity of the contact whose last slip began here
    mean_lag: np.ndarray  # (2, n) of a slipping unit: mean over the last interval
    lag_sum: np.ndarray  # (2, n) sum over this interval
    lag_cycles: np.ndarray  # length of this interval
    sliding_s: np.ndarray  # remaining time for which it counts as sliding
    slid_shear: np.ndarray  # sum of the forces along its slip in this contact
    slid_load: np.ndarray  # sum of the loads
    slid_variance: np.ndarray  # sum of the variances of shear less friction times load
    borne: np.ndarray  # largest friction that it has borne in this contact without slip
    noisy: np.ndarray  # 1 where its noise is greater than sigma says


class UnitRows(NamedTuple):
    """Scratch for the units of one contact; shape (length,), (2, length), …"""

    held: np.ndarray  # 1 where it sticks and is anchored to this body
    new: np.ndarray  # 1 where it has just come into contact
    joined: np.ndarray  # 1 where it was anchored to another body
    displacement: np.ndarray  # (2, length)
    reported: np.ndarray  # its variance by sigma
    noise: np.ndarray  # its measured variance
    load: np.ndarray  # N
    weight: np.ndarray  # in the fit; later, inverse variance of the lag
    deeper: np.ndarray  # depth beyond that at its anchor
    imposed: np.ndarray  # displacement predicted by the body's motion
    direction: np.ndarray  # (2, length) of `imposed`
    slip_score: np.ndarray  # its own lag along `direction`, in sigmas
    square_distance: np.ndarray  # from the centre, in sizes of the contact
    root_weight: np.ndarray  # of the lag, where it is held
    residual: np.ndarray  # lag in sigmas, nuisances removed
    redundancy: np.ndarray  # fraction of its own lag that they leave
    predicted_lag: np.ndarray  # by a pattern of slip, in sigmas
    now: np.ndarray  # (2, length) displacement predicted by the motion of the body
    moved_out: np.ndarray  # (2, length) of `now`, due to motions out of the plane
    surprise: np.ndarray  # squared innovation of the reading
    most: np.ndarray  # mm, bound of an innovation
    body_variance: np.ndarray  # mm², of the predicted displacement
    wander: np.ndarray  # variance of its slow noise over sigma squared
    step: np.ndarray  # squared change of `behind` since the last cycle
    in_pattern: np.ndarray  # 1 where it slips in the likeliest pattern
    design: tuple[np.ndarray, np.ndarray]  # (NUISANCES, length) each of motions, along x and y;
    # later, orthonormal nuisance basis
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

    prior: np.ndarray  # (NUISANCES, NUISANCES) rows of the prior of the nuisance basis
    evidence: np.ndarray  # (PATTERNS,) twice the logarithm of the odds against no slip
    slipping: np.ndarray  # (PATTERNS,) fraction of the load that slips


class SlipScratch(NamedTuple):
    """Scratch that is overwritten for each contact."""

    unit: UnitFilter  # rows, gathered
    row: UnitRows
    fit: BodyFit
    pattern: PatternScratch
    noise: np.ndarray  # (NOISES,) of all units, see `LAGS`; persistent
    unit_rows: np.ndarray  # (FILTER_ROWS, length) all of `unit`, to be padded
    rows: np.ndarray  # (UNIT_ROWS, length) all of `row`


class SlipArrays(NamedTuple):
    """All arrays of slip by name; see `slip_arrays`."""

    kept: UnitFilter
    history: UnitHistory
    scratch: SlipScratch


class SlipData(NamedTuple):
    """State and scratch of slip in few blocks, since each array argument of a kernel costs time."""

    kept: np.ndarray  # (FILTER_ROWS, length), see `UnitFilter`
    history: np.ndarray  # (HISTORY_ROWS, length), see `UnitHistory`
    unit: np.ndarray  # (FILTER_ROWS, length), scratch: the units of one contact
    row: np.ndarray  # (UNIT_ROWS, length), scratch, see `UnitRows`
    equations: np.ndarray  # scratch, as the others: see `BodyFit`
    placement_equations: np.ndarray
    vectors: np.ndarray  # (7, MOTIONS), the rest of `BodyFit`
    prior: np.ndarray  # see `PatternScratch`
    grid: np.ndarray  # (2, PATTERNS), the rest of `PatternScratch`
    noise: np.ndarray  # (NOISES,), kept, see `LAGS`

    @staticmethod
    def zeros(n: int) -> SlipData:
        """For n untouched units."""
        length = row_length(n)
        return SlipData(
            aligned.zeros((FILTER_ROWS, length)), aligned.zeros((HISTORY_ROWS, length)),
            aligned.zeros((FILTER_ROWS, length)), aligned.zeros((UNIT_ROWS, length)),
            np.zeros((MOTIONS, MOTIONS + 1)), np.zeros((MOTIONS - PLANE, MOTIONS + 1)),
            np.zeros((7, MOTIONS)), np.zeros((NUISANCES, NUISANCES)),
            np.zeros((2, PATTERNS)), np.zeros(NOISES),
        )  # fmt: skip


FILTER_ROWS, HISTORY_ROWS, UNIT_ROWS, NOISES = 26, 13, 29 + 3 * NUISANCES, 14
LAGS, READINGS, STEPS, SLOW, RECENT_STEPS = 0, 2, 4, 6, 8
"""Noise of all units: sums over sigma squared, each with its number of terms after it: squared
lags, innovations, their changes from cycle to cycle (over `memory_s` and over `slow_s`), and what
is beyond the variance of lags."""
LAG_RATIO, READING_RATIO, WANDER, GROWTH = 10, 11, 12, 13
"""Means of these: of lags, of innovations, of slow noise; recent changes over those of before."""


BEGAN, NOISY_UNIT, NOISE_RATIO = 1, 12, 19
"""Rows of `UnitHistory.began` and `noisy`, and of `UnitFilter.noise_ratio`."""


def row_length(n: int) -> int:
    """Row length for n units: an odd number of vectors, so that rows used together fall into
    different cache lines."""
    length = (n + LANES - 1) // LANES * LANES
    return length + LANES * (1 + (length // LANES) % 2)


@jitable(inline=True)
def padded(count, rows):
    """Pad `count` units in all rows of a block with zeros; returns the length in whole vectors."""
    length = (count + LANES - 1) // LANES * LANES
    for k in range(rows.shape[0]):
        for j in range(count, length):
            rows[k, j] = 0.0
    return length


@jitable(inline=True)
def unit_filter(b):
    """The rows of a block by name."""
    return UnitFilter(
        b[0:2], b[2], b[3:5], b[5], b[6:8], b[8:10], b[10:12], b[12:14], b[14], b[15], b[16],
        b[17:19], b[NOISE_RATIO], b[20], b[21], b[22], b[23:25],
        b[25],
    )  # fmt: skip


@jitable(inline=True)
def slip_arrays(data: SlipData):
    """State and scratch of slip by name."""
    h, r, v = data.history, data.row, data.vectors
    k = 29 + NUISANCES
    row = UnitRows(
        r[0], r[1], r[2], r[3:5], r[5], r[6], r[7], r[8], r[9], r[10], r[11:13], r[13], r[14],
        r[15], r[16], r[17], r[18], r[19:21], r[21:23], r[23], r[24], r[25], r[26], r[27],
        r[28], (r[29:k], r[k : k + NUISANCES]), r[k + NUISANCES : k + 2 * NUISANCES],
    )  # fmt: skip
    fit = BodyFit(v[0:3], v[3], v[4], data.equations, data.placement_equations, v[5], v[6])
    pattern = PatternScratch(data.prior, data.grid[0], data.grid[1])
    scratch = SlipScratch(unit_filter(data.unit), row, fit, pattern, data.noise, data.unit, r)
    history = UnitHistory(
        h[0], h[BEGAN], h[2:4], h[4:6], h[6], h[7], h[8], h[9], h[10], h[11], h[NOISY_UNIT],
    )  # fmt: skip
    return SlipArrays(unit_filter(data.kept), history, scratch)
