"""Friction from units that slip and units that stick, and the resulting grip force."""

from __future__ import annotations

import math

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.cone import tangential_demand
from skin.contact.record import NO_FRICTION, SlipState, UnitSlip
from skin.contact.slip.data import SlipArrays, UnitHistory
from skin.contact.slip.parameters import PARAMETERS, SlipModel

__all__ = ["friction_margin", "learn_friction", "show_bounds", "stick_ratio_by_cone"]

FAR = -5.0
"""[numeric] Sigmas below the mean from which a bound has no information."""


@jitable(inline=True)
def learn_friction(record, reading, units, alarm, slip: SlipArrays, now_ns, dt_s):
    """Loads of slipping units, and lower bounds by stuck ones: equations 19 and 20."""
    history, unlike, row = slip.history, slip.kept.noise_ratio, slip.scratch.row
    keep = max(0.0, 1.0 - dt_s / PARAMETERS.memory_s)
    # A lower bound whose error rate is that of an alarm.
    sigmas = np.sqrt(2.0 * alarm)
    # In gross slip, units slide although no slip of their own was detected.
    since_s = (now_ns - record["gross_ns"]) * 1e-9
    all_slide = record["slip"] == SlipState.GROSS and since_s < PARAMETERS.rest_s
    seen, seen_sum = 0.0, 0.0
    for j in range(record["end"] - record["begin"]):
        i = units.members[record["begin"] + j]
        slipping = units.slip[i] == UnitSlip.SLIPPING
        history.slid_shear[i] *= keep
        history.slid_load[i] *= keep
        history.slid_variance[i] *= keep
        load, sigma = np.float64(reading.force[2, i]), reading.force_sigma
        # Along the slip direction: a vector length would be biased by its noise.
        shear = np.float64(reading.force[0, i]) * row.direction[0, j]
        shear += np.float64(reading.force[1, i]) * row.direction[1, j]
        ratio = shear / load
        variance = 0.5 * (np.float64(sigma[0, i]) ** 2 + np.float64(sigma[1, i]) ** 2)
        variance += (ratio * np.float64(sigma[2, i])) ** 2
        variance *= max(unlike[i], 1.0)
        if all_slide or (slipping and history.sliding_s[i] > 0.0):
            history.slid_shear[i] += shear
            history.slid_load[i] += load
            history.slid_variance[i] += variance
        elif not slipping:
            bound = ratio - sigmas * np.sqrt(variance) / load
            history.borne[i] = max(history.borne[i], bound)
            record["friction_lower"] = max(record["friction_lower"], bound)
        if _has_slid(i, history):
            seen += 1.0
            seen_sum += history.slid_shear[i] / history.slid_load[i]
    if seen > 0.0:
        if not record["friction_information"] > 0.0:
            record["friction_mean"] = seen_sum / seen
            record["friction_spread"] = PARAMETERS.friction_spread * record["friction_mean"]
        _follow_friction(record, units, history)


@jitable(inline=True)
def _has_slid(i, history: UnitHistory):
    """Whether a unit has slid for long enough to measure friction."""
    square = PARAMETERS.outlier_sigmas**2 * history.slid_variance[i]
    return history.slid_shear[i] > 0.0 and history.slid_shear[i] ** 2 > square


@jitable(inline=True)
def _follow_friction(record, units, history: UnitHistory):
    """One step of expectation-maximisation for the friction of the faces, which is normal over
    them: sliding faces measure it, sticking ones bound it from below (equation 20)."""
    mean, spread = record["friction_mean"], record["friction_spread"]
    variance = spread**2
    informative, further, squares, known = 0.0, 0.0, 0.0, 0.0
    for at in range(record["begin"], record["end"]):
        i = units.members[at]
        excess, information = 0.0, 0.0
        if _has_slid(i, history):
            value = history.slid_shear[i] / history.slid_load[i]
            noise = history.slid_variance[i] / history.slid_load[i] ** 2
            information = variance / (variance + noise)
            excess = information * (value - mean)
        elif history.borne[i] > 0.0:
            at_least = (history.borne[i] - mean) / spread
            if at_least > FAR:
                hazard = _hazard(at_least)
                excess, information = spread * hazard, hazard * (hazard - at_least)
        informative += information
        further += excess
        squares += information * (excess**2 + (1.0 - information) * variance)
        known += information
    if not informative > 0.0:
        return
    prior, faces = (PARAMETERS.friction_spread * mean) ** 2, PARAMETERS.friction_faces
    record["friction_mean"] = max(mean + further / informative, 1e-3)
    record["friction_spread"] = np.sqrt((squares + faces * prior) / (known + faces))
    record["friction_information"] = informative / variance


@jitable(inline=True)
def _hazard(z):
    """Density of a normal number over the chance that it is greater than z."""
    if z > 8.0:
        return z + 1.0 / z
    return math.exp(-0.5 * z * z) / (math.sqrt(0.5 * math.pi) * math.erfc(z / math.sqrt(2.0)))


@jitable(inline=True)
def friction_margin(record, model: SlipModel):
    """Friction so far, free fraction of its cone, and the grip force: equation 21. NaN where
    friction is not known: see `show_bounds`.

    Returns the used friction.
    """
    if record["friction_information"] > 0.0:
        record["friction"] = record["friction_mean"]
        between = PARAMETERS.friction_spread * record["friction"]
        record["friction_sigma"] = np.sqrt(1.0 / record["friction_information"] + between**2)
    else:
        record["friction"] = model.friction
        record["friction_sigma"] = np.nan
        record["friction_spread"] = np.nan
    demand = tangential_demand(record["shear"], record["torsion"], record["arm"])
    if record["friction"] > 0.0:
        record["margin"] = 1.0 - demand / (record["friction"] * record["load"])
        grip = model.safety * demand / record["friction"]
        record["grip_force"] = grip
        relative = record["friction_sigma"] / record["friction"]
        noise = model.safety / record["friction"]
        square = _tangential_variance(record)
        record["grip_force_sigma"] = np.sqrt((grip * relative) ** 2 + noise**2 * square)
    else:
        record["flags"] |= NO_FRICTION
        record["margin"] = np.nan
        record["grip_force"] = np.nan
        record["grip_force_sigma"] = np.nan
    return demand / record["load"]


@jitable(inline=True)
def show_bounds(record, ratio, model: SlipModel):
    """Replace unknown friction, margin and grip force by bounds: the friction that sticking units
    have borne is a lower bound, and the present load suffices.

    `ratio` is the friction in use. Nothing is decided by these numbers.
    """
    if record["flags"] & NO_FRICTION == 0:
        return
    least, holds = max(record["friction_lower"], 0.0), record["slip"] < SlipState.INCIPIENT
    record["friction"] = least
    record["margin"] = 0.0
    record["grip_force"] = model.safety * record["load"] if holds else np.nan
    if holds and ratio < least:
        record["margin"] = 1.0 - ratio / least
        record["grip_force"] *= ratio / least


@jitable(inline=True)
def stick_ratio_by_cone(record):
    """Fraction of the load that sticks where friction differs between faces, by the used fraction
    of the friction cone. For contacts of few units."""
    z = record["margin"] / PARAMETERS.friction_spread
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


@jitable(inline=True)
def _tangential_variance(record):
    """Variance of a component of the force across the contact's normal, N²."""
    normal, covariance = record["axes"][:, 2], record["wrench_covariance"]
    across = 0.0
    for a in range(3):
        across += covariance[a, a]
        for b in range(3):
            across -= normal[a] * covariance[a, b] * normal[b]
    return 0.5 * max(across, 0.0)
