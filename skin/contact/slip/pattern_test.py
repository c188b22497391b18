"""The test for slip of a whole contact: a generalised likelihood ratio along patterns of slip.

First all that is no slip is taken out of the lags, then what is left is compared with the lags that
each coefficient of friction would let arise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import PLANE, PatternScratch, SlipScratch, UnitFilter, UnitRows
from skin.contact.slip.parameters import PARAMETERS, SlipModel

__all__ = ["FRICTIONS", "detect_pattern", "project_nuisances"]

FRICTIONS = PARAMETERS.least_friction * PARAMETERS.friction_step ** np.arange(PARAMETERS.patterns)
"""Coefficients of friction whose patterns are tested."""
RANK = 1e-9
"""Share of a column below which it depends on those before it."""
FROZEN = 1e9
"""Factor on the prior of a motion that is not to be found."""


class _Test(NamedTuple):
    """What the patterns of a contact are held against."""

    softness: float  # mm/N, of the units together
    load: float  # N
    incipient: float  # sigmas that a pattern of incipient slip must have
    gross: float  # and one of gross slip


@jitable(inline=True)
def project_nuisances(
    length, motions, stuck, out_of_plane, model: SlipModel, unit: UnitFilter, row: UnitRows, prior
):
    """Take out of the lags all that is no slip: derivations.md, equations 12 and 13.

    Gram and Schmidt make the nuisances orthonormal, in sigmas of the lags; what is known of each
    beforehand counts as one more reading. Returns the number of nuisances.
    """
    assume_noalias()
    shared = motions <= PLANE and stuck >= PARAMETERS.units_for_sharing
    yields = stuck >= PARAMETERS.units_for_swelling
    nuisances = motions + 1 + shared + yields
    mean = 0.0
    for j in range(length):
        mean += row.held[j] * row.load[j] / max(stuck, 1)
    root, along_x, along_y = row.root_weight, row.direction[0], row.direction[1]
    residual, redundancy = row.residual, row.redundancy
    for j in range(length):
        redundancy[j] = 1.0
        residual[j] = -root[j] * (unit.lag[0, j] * along_x[j] + unit.lag[1, j] * along_y[j])
    for a in range(nuisances):
        prior[a] = 0.0
        if a == motions:
            prior[a, a] = 1.0 / PARAMETERS.shared_gain
            _gain_columns(a, length, row)
        elif a > motions:
            prior[a, a] = 1.0 / PARAMETERS.soft_ground
            by_load = shared and a == motions + 1
            _ground_columns(a, length, by_load, mean, model.gain_error**2, unit, row)
        elif a >= PLANE:
            prior[a, a] = 1.0 / out_of_plane
        elif a == PLANE - 1:
            swelling = PARAMETERS.swelling_mm
            prior[a, a] = 1.0 / swelling if yields else FROZEN / swelling
        scale = _orthogonalise(a, length, row, prior)
        _take_out(a, length, scale, unit, row)
        for c in range(PLANE - 1, a + 1):
            prior[a, c] *= scale
    for j in range(length):
        behind = -(unit.lag[0, j] * along_x[j] + unit.lag[1, j] * along_y[j]) * root[j]
        own = residual[j] / np.sqrt(max(redundancy[j], PARAMETERS.least_redundancy))
        row.slip_score[j] = max(own, PARAMETERS.raw_share * behind)
    return nuisances


@jitable(inline=True)
def _gain_columns(a, length, row: UnitRows):
    """A gain error that all units share."""
    assume_noalias()
    for j in range(length):
        row.design[0][a, j] = row.imposed[j] * row.direction[0, j]
        row.design[1][a, j] = row.imposed[j] * row.direction[1, j]


@jitable(inline=True)
def _ground_columns(a, length, by_load, mean, gain_variance, unit: UnitFilter, row: UnitRows):
    """Soft ground, that yields by the load or by the distance from the centre."""
    assume_noalias()
    along_x, along_y = row.direction[0], row.direction[1]
    for j in range(length):
        far = along_x[j] * (unit.moved[0, j] - unit.followed[0, j])
        far += along_y[j] * (unit.moved[1, j] - unit.followed[1, j])
        far *= row.load[j] / mean - 1.0 if by_load else row.square_distance[j]
        # What has been learned is not to be feared any more.
        far /= gain_variance * unit.gain_information[j]
        row.design[0][a, j] = far * along_x[j]
        row.design[1][a, j] = far * along_y[j]


@jitable(inline=True)
def _orthogonalise(a, length, row: UnitRows, prior):
    """Weigh column a and make it orthogonal to those before; returns its scale, 0 if dependent."""
    assume_noalias()
    root, xa, ya = row.root_weight, row.design[0][a], row.design[1][a]
    before = prior[a, a] ** 2
    for j in range(length):
        xa[j] *= root[j]
        ya[j] *= root[j]
        before += xa[j] * xa[j] + ya[j] * ya[j]
    for b in range(a):
        xb, yb = row.design[0][b], row.design[1][b]
        common = 0.0
        for j in range(length):
            common += xa[j] * xb[j] + ya[j] * yb[j]
        for c in range(PLANE - 1, b + 1):
            common += prior[a, c] * prior[b, c]
        for j in range(length):
            xa[j] -= common * xb[j]
            ya[j] -= common * yb[j]
        for c in range(PLANE - 1, b + 1):
            prior[a, c] -= common * prior[b, c]
    square = 0.0
    for j in range(length):
        square += xa[j] * xa[j] + ya[j] * ya[j]
    for c in range(PLANE - 1, a + 1):
        square += prior[a, c] ** 2
    return 1.0 / np.sqrt(square) if square > RANK * before else 0.0


@jitable(inline=True)
def _take_out(a, length, scale, unit: UnitFilter, row: UnitRows):
    """Normalise column a and take what it explains out of the lags."""
    assume_noalias()
    xa, ya, nuisance = row.design[0][a], row.design[1][a], row.nuisance[a]
    root, along_x, along_y = row.root_weight, row.direction[0], row.direction[1]
    explained = 0.0
    for j in range(length):
        xa[j] *= scale
        ya[j] *= scale
        explained += root[j] * (xa[j] * unit.lag[0, j] + ya[j] * unit.lag[1, j])
        nuisance[j] = xa[j] * along_x[j] + ya[j] * along_y[j]
    residual, redundancy = row.residual, row.redundancy
    for j in range(length):
        residual[j] += explained * nuisance[j]
        redundancy[j] -= nuisance[j] * nuisance[j]


@jitable(inline=True)
def detect_pattern(
    record, members, force, length, nuisances, haste, model: SlipModel, scratch: SlipScratch
):
    """Slip as the whole contact shows it: derivations.md, equations 14 to 16.

    `haste` is 0 where lags are low-passed as for a slow body, 1 as for a fast one. Returns the
    share of the load that sticks, and the sigmas of the likeliest pattern.
    """
    unit, row = scratch.unit, scratch.row
    first, count = record["begin"], record["end"] - record["begin"]
    pull, square, way, pace = 0.0, 0.0, 0.0, 0.0
    for j in range(count):
        i = members[first + j]
        fx, fy = np.float64(force[0, i]), np.float64(force[1, i])
        x_mm, y_mm = row.displacement[0, j], row.displacement[1, j]
        pull += fx * x_mm + fy * y_mm
        square += x_mm**2 + y_mm**2
        x_mm = unit.moved[0, j] - unit.followed[0, j]
        y_mm = unit.moved[1, j] - unit.followed[1, j]
        way += (row.root_weight[j] * x_mm) ** 2 + (row.root_weight[j] * y_mm) ** 2
        x_mm = unit.moved_slow[0, j] - unit.moved_recent[0, j]
        y_mm = unit.moved_slow[1, j] - unit.moved_recent[1, j]
        pace += (row.root_weight[j] * x_mm) ** 2 + (row.root_weight[j] * y_mm) ** 2
    if not pull > 0.0:
        return 1.0, 0.0
    # A model that all units share is never quite right.
    model_error = np.sqrt(1.0 + PARAMETERS.shared_gain**2 * way)
    incipient, gross = 1.0, 1.0
    if pace > PARAMETERS.moving_sigmas**2 * count:
        moving = PARAMETERS.moving
        incipient, gross = moving + haste * (1.0 - moving), PARAMETERS.moving_gross
    sigmas = model.slip_sigmas
    test = _Test(
        square / pull, record["load"], incipient * model_error * sigmas,
        gross * model_error * sigmas,
    )  # fmt: skip
    sticks, found = _test_patterns(length, nuisances, test, model, unit, row, scratch.pattern)
    return sticks, found / model_error


@jitable(inline=True)
def _test_patterns(
    length, nuisances, test, model: SlipModel, unit: UnitFilter, row: UnitRows, grid: PatternScratch
):
    """The pattern that explains most, against noise and against those in which too little of the
    load slips to be of interest; returns the share of the load that sticks, and sigmas."""
    likelihood, slipping = grid.likelihood, grid.slipping
    most, little = 0.0, 0.0
    for k in range(FRICTIONS.size):
        likelihood[k], slipping[k] = _explain(FRICTIONS[k], length, nuisances, test, row)
        if 1.0 - slipping[k] > model.incipient_ratio:
            little = max(little, likelihood[k])
            likelihood[k] = 0.0
        most = max(most, likelihood[k])
    # Of those that explain nearly as much, the one with the least slip.
    best = 0
    for k in range(FRICTIONS.size):
        if likelihood[k] > 0.0 and likelihood[k] >= most - PARAMETERS.alike:
            best = k
    friction, share = FRICTIONS[best], slipping[best]
    least = test.incipient if 1.0 - share > model.gross_ratio else test.gross
    if most - little > least * least:
        for part in range(1, PARAMETERS.refinements):
            finer = FRICTIONS[best] * PARAMETERS.friction_step ** (part / PARAMETERS.refinements)
            explains, less = _explain(finer, length, nuisances, test, row)
            if 1.0 - less > model.incipient_ratio:
                little = max(little, explains)
            elif explains >= most - PARAMETERS.alike:
                most = max(most, explains)
                friction, share = finer, less
    found = np.sqrt(max(most - little, 0.0))
    is_found = found > least
    limit = friction * test.softness if is_found else np.inf
    for j in range(length):
        unit.clipped[j] = 1.0 if row.imposed[j] > limit * row.load[j] else 0.0
    return 1.0 - share if is_found else 1.0, found


@jitable(inline=True)
def _explain(friction, length, nuisances, test, row: UnitRows):
    """What the pattern of slip at one coefficient of friction explains of the lags (equation 15).

    Returns twice the logarithm of the likelihood ratio, and the share of the load that slips.
    """
    assume_noalias()
    imposed, root, predicted = row.imposed, row.root_weight, row.predicted_lag
    load, residual = row.load, row.residual
    limit = friction * test.softness
    lagged, square, slipped = 0.0, 0.0, 0.0
    for j in range(length):
        lag = max(imposed[j] - limit * load[j], 0.0)
        slipped += load[j] if lag > 0.0 else 0.0
        lag *= root[j]
        lagged += lag * residual[j]
        square += lag * lag
        predicted[j] = lag
    if lagged <= 0.0:
        return 0.0, slipped / test.load
    whole = square
    for a in range(nuisances):
        nuisance, common = row.nuisance[a], 0.0
        for j in range(length):
            common += predicted[j] * nuisance[j]
        square -= common * common
    left = square > PARAMETERS.least_pattern * whole
    return lagged * lagged / square if left else 0.0, slipped / test.load
