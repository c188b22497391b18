"""Test for slip of a whole contact: the odds of slip, by the patterns of lags that it causes.

First the nuisances are projected out of the lags, then the rest is compared with the lags at each
coefficient of friction.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.record import SlipState
from skin.contact.slip.data import PLANE, PatternScratch, SlipScratch, UnitFilter, UnitRows
from skin.contact.slip.parameters import PARAMETERS, PATTERNS, SlipModel

__all__ = ["FRICTIONS", "ROUNDING", "alarm_odds", "detect_pattern", "project_nuisances"]

FRICTIONS = np.geomspace(PARAMETERS.least_friction, PARAMETERS.greatest_friction, PATTERNS)
"""Coefficients of friction whose patterns are tested."""
RANK = 1e-9
"""[numeric] Fraction of a column below which it depends on those before it."""
BLIND = 0.01
"""[numeric] Smallest fraction of a unit's own lag outside the nuisances for a test of the unit
alone."""
ROUNDING = 1e-9
"""[numeric] Log-odds without information: sums are rounded by 1e-13."""


@jitable(inline=True)
def alarm_odds(share, dt_s, model: SlipModel):
    """Log-odds of an alarm: derivations.md, equation 18.

    Odds against a true hypothesis have mean 1, so that at most one test in ``odds`` exceeds them; a
    low-pass with a time constant T has 1 / T independent tests a second.
    """
    looks_per_hour = 3600.0 * share / dt_s
    return np.log(max(looks_per_hour / model.false_alarms_per_hour, 1.0))


@jitable(inline=True)
def project_nuisances(
    length, motions, stuck, out_of_plane, model: SlipModel, unit: UnitFilter, row: UnitRows, prior
):
    """Project the nuisances out of the lags: derivations.md, equations 14 and 15.

    Gram-Schmidt makes the nuisances orthonormal, in sigmas of the lags; the prior of each counts as
    one more reading. Returns the number of nuisances.
    """
    assume_noalias()
    yields = stuck >= PARAMETERS.soft_units
    nuisances = motions + 1 + yields
    root, along_x, along_y = row.root_weight, row.direction[0], row.direction[1]
    residual, redundancy = row.residual, row.redundancy
    for j in range(length):
        redundancy[j] = 1.0
        residual[j] = -root[j] * (unit.lag[0, j] * along_x[j] + unit.lag[1, j] * along_y[j])
    for a in range(nuisances):
        prior[a] = 0.0
        if a == motions:
            prior[a, a] = 1.0 / model.gain_error
            _gain_columns(a, length, row)
        elif a > motions:
            prior[a, a] = 1.0 / PARAMETERS.soft_ground
            _ground_columns(a, length, model.gain_error**2, unit, row)
        elif a >= PLANE:
            prior[a, a] = 1.0 / out_of_plane
        scale = _orthogonalise(a, length, row, prior)
        _take_out(a, length, scale, unit, row)
        for c in range(PLANE, a + 1):
            prior[a, c] *= scale
    for j in range(length):
        left = residual[j] / np.sqrt(max(redundancy[j], BLIND))
        row.slip_score[j] = left if redundancy[j] > BLIND else 0.0
    return nuisances


@jitable(inline=True)
def _gain_columns(a, length, row: UnitRows):
    """A gain error common to all units."""
    assume_noalias()
    for j in range(length):
        row.design[0][a, j] = row.imposed[j] * row.direction[0, j]
        row.design[1][a, j] = row.imposed[j] * row.direction[1, j]


@jitable(inline=True)
def _ground_columns(a, length, gain_variance, unit: UnitFilter, row: UnitRows):
    """Soft ground, which yields in proportion to the distance from the centre."""
    assume_noalias()
    along_x, along_y = row.direction[0], row.direction[1]
    for j in range(length):
        far = along_x[j] * (unit.moved[0, j] - unit.followed[0, j])
        far += along_y[j] * (unit.moved[1, j] - unit.followed[1, j])
        # Gains that are learned have less prior variance.
        far *= row.square_distance[j] / (gain_variance * unit.gain_information[j])
        row.design[0][a, j] = far * along_x[j]
        row.design[1][a, j] = far * along_y[j]


@jitable(inline=True)
def _orthogonalise(a, length, row: UnitRows, prior):
    """Weight column a and make it orthogonal to those before; returns its scale, 0 if dependent."""
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
        for c in range(PLANE, b + 1):
            common += prior[a, c] * prior[b, c]
        for j in range(length):
            xa[j] -= common * xb[j]
            ya[j] -= common * yb[j]
        for c in range(PLANE, b + 1):
            prior[a, c] -= common * prior[b, c]
    square = 0.0
    for j in range(length):
        square += xa[j] * xa[j] + ya[j] * ya[j]
    for c in range(PLANE, a + 1):
        square += prior[a, c] ** 2
    return 1.0 / np.sqrt(square) if square > RANK * before else 0.0


@jitable(inline=True)
def _take_out(a, length, scale, unit: UnitFilter, row: UnitRows):
    """Normalise column a and subtract its projection from the lags."""
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
    record, members, force, length, nuisances, alarm, model: SlipModel, scratch: SlipScratch
):
    """Detect slip of the whole contact: derivations.md, equations 15 to 18.

    `alarm` is the log-odds for its onset, and for gross slip. Returns the log-odds of slip, and the
    fraction of the load that sticks: 1 without an alarm.
    """
    row = scratch.row
    first, count = record["begin"], record["end"] - record["begin"]
    pull, square = 0.0, 0.0
    for j in range(count):
        i = members[first + j]
        x_mm, y_mm = row.displacement[0, j], row.displacement[1, j]
        pull += np.float64(force[0, i]) * x_mm + np.float64(force[1, i]) * y_mm
        square += x_mm**2 + y_mm**2
    if not pull > 0.0:
        return 0.0, 1.0
    softness = square / pull
    odds, best = _odds(length, nuisances, softness, record["load"], model, row, scratch.pattern)
    # A reported slip lasts until its odds fall below 1.
    least = ROUNDING if record["slip"] == SlipState.INCIPIENT else alarm
    if not odds > least:
        return odds, 1.0
    limit = FRICTIONS[best] * softness
    for j in range(length):
        row.in_pattern[j] = 1.0 if row.imposed[j] > limit * row.load[j] else 0.0
    sticks = 1.0 - scratch.pattern.slipping[best]
    return odds, sticks if odds > alarm else max(sticks, model.gross_ratio)


@jitable(inline=True)
def _odds(length, nuisances, softness, load, model: SlipModel, row: UnitRows, grid: PatternScratch):
    """Log-odds of the patterns with an alarming amount of slip, against those with less and none;
    and the likeliest pattern."""
    evidence, slipping = grid.evidence, grid.slipping
    most, much, little = 0.0, 0, 0
    for k in range(PATTERNS):
        friction = FRICTIONS[k]
        evidence[k], slipping[k] = 0.0, 0.0
        if k == 0 or slipping[k - 1] > 0.0:  # else nothing slips at a greater friction either
            evidence[k], slipping[k] = _explain(friction, length, nuisances, softness, load, row)
        most = max(most, evidence[k])
        much += 1.0 - slipping[k] < model.incipient_ratio
        little += slipping[k] > 0.0 and 1.0 - slipping[k] >= model.incipient_ratio
    if much == 0:
        return 0.0, 0
    slips, holds, best = 0.0, np.exp(-most), -1
    for k in range(PATTERNS):
        likely = np.exp(evidence[k] - most)
        if 1.0 - slipping[k] < model.incipient_ratio:
            slips += likely / much
            if best < 0 or evidence[k] > evidence[best]:
                best = k
        elif slipping[k] > 0.0:
            holds += likely / little
    return np.log(max(slips, 1e-300)) - np.log(holds), best


@jitable(inline=True)
def _explain(friction, length, nuisances, softness, load, row: UnitRows):
    """Likelihood of the pattern of slip at one coefficient of friction (equation 16).

    Returns the log-odds against no slip, and the fraction of the load that slips.
    """
    assume_noalias()
    imposed, root, predicted = row.imposed, row.root_weight, row.predicted_lag
    limit = friction * softness
    lagged, square, slipped = 0.0, 0.0, 0.0
    for j in range(length):
        lag = max(imposed[j] - limit * row.load[j], 0.0)
        slipped += row.load[j] if lag > 0.0 else 0.0
        lag *= root[j]
        lagged += lag * row.residual[j]
        square += lag * lag
        predicted[j] = lag
    for a in range(nuisances):
        nuisance, common = row.nuisance[a], 0.0
        for j in range(length):
            common += predicted[j] * nuisance[j]
        square -= common * common
    square = max(square, 0.0)
    prior = 1.0 / PARAMETERS.amplitude**2
    odds = (lagged + prior) ** 2 / (square + prior) - prior - np.log(1.0 + square / prior)
    return 0.5 * odds, slipped / load
