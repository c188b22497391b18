"""Test for slip of a whole contact: the odds of slip, by the patterns of lags that it causes.

First the nuisances are projected out of the lags, then the rest is compared with the lags at each
coefficient of friction.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import SlipState
from skin.contact.slip.parameters import PARAMETERS, PATTERNS
from skin.contact.slip.state import PLANE

__all__ = ["FRICTIONS", "ROUNDING", "alarm_odds", "detect_pattern"]

FRICTIONS = np.geomspace(PARAMETERS.least_friction, PARAMETERS.greatest_friction, PATTERNS)
"""Coefficients of friction whose patterns are tested."""
RANK = 1e-9
"""[numeric] Fraction of a column below which it depends on those before it."""
BLIND = 0.01
"""[numeric] Smallest fraction of a unit's own lag outside the nuisances for a test of the unit
alone."""
ROUNDING = 1e-9
"""[numeric] Log-odds without information: sums are rounded by 1e-13."""


@jitable
def alarm_odds(share, dt_s, settings):
    """Log-odds of an alarm: derivations.md, equation 18.

    Odds against a true hypothesis have mean 1, so that at most one test in ``odds`` exceeds them; a
    low-pass with a time constant T has 1 / T independent tests a second.
    """
    looks_per_hour = 3600.0 * share / dt_s
    return np.log(max(looks_per_hour / settings["false_alarms_per_hour"], 1.0))


@jitable
def _project_nuisances(members, motions, stuck, out_of_plane, settings, data):
    """Project the nuisances out of the lags: derivations.md, equations 14 and 15.

    Gram-Schmidt makes the nuisances orthonormal, in sigmas of the lags; the prior of each counts as
    one more reading. Returns the number of nuisances.
    """
    slips, prior = data.slips, data.all[0]["prior"]
    nuisances = motions + 2 if stuck >= PARAMETERS.soft_units else motions + 1
    for i in members:
        s = slips[i]
        s["redundancy"] = 1.0
        x, y = s["direction"][0], s["direction"][1]
        s["residual"] = -s["root_weight"] * (x * s["lag"][0] + y * s["lag"][1])
    for a in range(nuisances):
        prior[a, :] = 0.0
        if a == motions:
            prior[a, a] = 1.0 / settings["gain_error"]
        elif a > motions:
            prior[a, a] = 1.0 / PARAMETERS.soft_ground
        elif a >= PLANE:
            prior[a, a] = 1.0 / out_of_plane
        for i in members:
            s = slips[i]
            if a >= motions:
                size = s["imposed"]  # a gain error common to all units
                if a > motions:
                    # Soft ground, which yields in proportion to the distance from the centre;
                    # gains that are learned have less prior variance.
                    size = s["direction"][0] * (s["moved"][0] - s["followed"][0])
                    size += s["direction"][1] * (s["moved"][1] - s["followed"][1])
                    size *= s["square_distance"]
                    size /= settings["gain_error"] ** 2 * s["gain_information"]
                s["design"][0, a] = size * s["direction"][0]
                s["design"][1, a] = size * s["direction"][1]
            s["design"][0, a] *= s["root_weight"]
            s["design"][1, a] *= s["root_weight"]
        _orthonormalise(a, members, slips, prior)
        explained = 0.0
        for i in members:
            s, design = slips[i], slips[i]["design"]
            x, y = design[0, a], design[1, a]
            explained += s["root_weight"] * (x * s["lag"][0] + y * s["lag"][1])
            s["nuisance"][a] = x * s["direction"][0] + y * s["direction"][1]
        for i in members:
            s = slips[i]
            s["residual"] += explained * s["nuisance"][a]
            s["redundancy"] -= s["nuisance"][a] ** 2
    for i in members:
        s = slips[i]
        left = s["residual"] / np.sqrt(max(s["redundancy"], BLIND))
        s["slip_score"] = left if s["redundancy"] > BLIND else 0.0
    return nuisances


@jitable
def _common(a, b, members, slips, prior):
    """Scalar product of two columns, each with its prior as further readings."""
    total = 0.0
    for i in members:
        design = slips[i]["design"]
        total += design[0, a] * design[0, b] + design[1, a] * design[1, b]
    for c in range(PLANE, b + 1):
        total += prior[a, c] * prior[b, c]
    return total


@jitable
def _orthonormalise(a, members, slips, prior):
    """Make column a orthogonal to those before and normal; 0 if it depends on them."""
    before = prior[a, a] ** 2
    for i in members:
        design = slips[i]["design"]
        before += design[0, a] ** 2 + design[1, a] ** 2
    for b in range(a):
        common = _common(a, b, members, slips, prior)
        for i in members:
            design = slips[i]["design"]
            design[0, a] -= common * design[0, b]
            design[1, a] -= common * design[1, b]
        for c in range(PLANE, b + 1):
            prior[a, c] -= common * prior[b, c]
    square = _common(a, a, members, slips, prior)
    scale = 1.0 / np.sqrt(square) if square > RANK * before else 0.0
    for i in members:
        slips[i]["design"][0, a] *= scale
        slips[i]["design"][1, a] *= scale
    for c in range(PLANE, a + 1):
        prior[a, c] *= scale


@jitable
def detect_pattern(record, members, motions, stuck, out_of_plane, alarm, settings, data):
    """Detect slip of the whole contact: derivations.md, equations 14 to 18.

    `alarm` is the log-odds for its onset, and for gross slip. Returns the log-odds of slip, and the
    fraction of the load that sticks: 1 without an alarm.
    """
    nuisances = _project_nuisances(members, motions, stuck, out_of_plane, settings, data)
    pull, square = 0.0, 0.0
    for i in members:
        u = data.units[i]
        x_mm, y_mm = u["displacement"][0], u["displacement"][1]
        pull += u["force"][0] * x_mm + u["force"][1] * y_mm
        square += x_mm**2 + y_mm**2
    if not pull > 0.0:
        return 0.0, 1.0
    softness = square / pull
    odds, best = _odds(members, nuisances, softness, record["load"], settings, data)
    # A reported slip lasts until its odds fall below 1.
    least = ROUNDING if record["slip"] == SlipState.INCIPIENT else alarm
    if not odds > least:
        return odds, 1.0
    limit = FRICTIONS[best] * softness
    for i in members:
        s = data.slips[i]
        s["in_pattern"] = 1.0 if s["imposed"] > limit * s["load"] else 0.0
    sticks = 1.0 - data.all[0]["slipping"][best]
    return odds, sticks if odds > alarm else max(sticks, settings["gross_ratio"])


@jitable
def _odds(members, nuisances, softness, load, settings, data):
    """Log-odds of the patterns with an alarming amount of slip, against those with less and none;
    and the likeliest pattern."""
    evidence, slipping = data.all[0]["evidence"], data.all[0]["slipping"]
    most, much, little, ratio = 0.0, 0, 0, settings["incipient_ratio"]
    for k in range(PATTERNS):
        evidence[k], slipping[k] = 0.0, 0.0
        if k == 0 or slipping[k - 1] > 0.0:  # else nothing slips at a greater friction either
            limit = FRICTIONS[k] * softness
            evidence[k], slipped = _explain(limit, members, nuisances, data.slips)
            slipping[k] = slipped / load
        most = max(most, evidence[k])
        much += 1.0 - slipping[k] < ratio
        little += slipping[k] > 0.0 and 1.0 - slipping[k] >= ratio
    if much == 0:
        return 0.0, 0
    slips, holds, best = 0.0, np.exp(-most), -1
    for k in range(PATTERNS):
        likely = np.exp(evidence[k] - most)
        if 1.0 - slipping[k] < ratio:
            slips += likely / much
            if best < 0 or evidence[k] > evidence[best]:
                best = k
        elif slipping[k] > 0.0:
            holds += likely / little
    return np.log(max(slips, 1e-300)) - np.log(holds), best


@jitable
def _explain(limit, members, nuisances, slips):
    """Likelihood of the pattern of slip at one coefficient of friction (equation 16): units slip
    whose displacement is above the limit times their load.

    Returns the log-odds against no slip, and the load that slips.
    """
    lagged, square, slipped = 0.0, 0.0, 0.0
    for i in members:
        s = slips[i]
        lag = max(s["imposed"] - limit * s["load"], 0.0)
        slipped += s["load"] if lag > 0.0 else 0.0
        lag *= s["root_weight"]
        lagged += lag * s["residual"]
        square += lag * lag
        s["predicted_lag"] = lag
    for a in range(nuisances):
        common = 0.0
        for i in members:
            common += slips[i]["predicted_lag"] * slips[i]["nuisance"][a]
        square -= common * common
    square = max(square, 0.0)
    prior = 1.0 / PARAMETERS.amplitude**2
    odds = (lagged + prior) ** 2 / (square + prior) - prior - np.log(1.0 + square / prior)
    return 0.5 * odds, slipped
