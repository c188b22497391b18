"""Friction from units that slip and units that stick, and the resulting grip force."""

from __future__ import annotations

import math

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import NO_FRICTION, SlipState, UnitSlip
from skin.contact.slip.parameters import PARAMETERS

__all__ = ["friction_margin", "learn_friction", "show_bounds"]

FAR = -5.0
"""[numeric] Sigmas below the mean from which a bound has no information."""


@jitable
def learn_friction(record, members, alarm, data):
    """Loads of slipping units, and lower bounds by stuck ones: equations 19 and 20."""
    keep = max(0.0, 1.0 - data.cycle[0]["elapsed_s"] / PARAMETERS.memory_s)
    # A lower bound whose error rate is that of an alarm.
    sigmas = np.sqrt(2.0 * alarm)
    # In gross slip, units slide although no slip of their own was detected.
    since_s = (data.cycle[0]["now_ns"] - record["gross_ns"]) * 1e-9
    all_slide = record["slip"] == SlipState.GROSS and since_s < PARAMETERS.rest_s
    seen, seen_sum = 0.0, 0.0
    for i in members:
        s, slipping = data.slips[i], data.slip[i] == UnitSlip.SLIPPING
        s["slid_shear"] *= keep
        s["slid_load"] *= keep
        s["slid_variance"] *= keep
        force, sigma = data.units[i]["force"], data.units[i]["force_sigma"]
        # Along the slip direction: a vector length would be biased by its noise.
        shear = force[0] * s["direction"][0] + force[1] * s["direction"][1]
        ratio = shear / force[2]
        variance = 0.5 * (sigma[0] ** 2 + sigma[1] ** 2) + (ratio * sigma[2]) ** 2
        variance *= max(s["noise_ratio"], 1.0)
        if all_slide or (slipping and s["sliding_s"] > 0.0):
            s["slid_shear"] += shear
            s["slid_load"] += force[2]
            s["slid_variance"] += variance
        elif not slipping:
            bound = ratio - sigmas * np.sqrt(variance) / force[2]
            s["borne"] = max(s["borne"], bound)
            record["friction_at_least"] = max(record["friction_at_least"], bound)
        if _has_slid(s):
            seen += 1.0
            seen_sum += s["slid_shear"] / s["slid_load"]
    if seen > 0.0:
        if not record["friction_information"] > 0.0:
            record["friction_mean"] = seen_sum / seen
            record["friction_spread"] = PARAMETERS.friction_spread * record["friction_mean"]
        _follow_friction(record, members, data.slips)


@jitable
def _has_slid(s):
    """Whether a unit has slid for long enough to measure friction."""
    square = PARAMETERS.outlier_sigmas**2 * s["slid_variance"]
    return s["slid_shear"] > 0.0 and s["slid_shear"] ** 2 > square


@jitable
def _follow_friction(record, members, slips):
    """One step of expectation-maximisation for the friction of the faces, which is normal over
    them: sliding faces measure it, sticking ones bound it from below (equation 20)."""
    mean, spread = record["friction_mean"], record["friction_spread"]
    variance = spread**2
    informative, further, squares, known = 0.0, 0.0, 0.0, 0.0
    for i in members:
        s, excess, information = slips[i], 0.0, 0.0
        if _has_slid(s):
            value = s["slid_shear"] / s["slid_load"]
            noise = s["slid_variance"] / s["slid_load"] ** 2
            information = variance / (variance + noise)
            excess = information * (value - mean)
        elif s["borne"] > 0.0:
            at_least = (s["borne"] - mean) / spread
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


@jitable
def _hazard(z):
    """Density of a normal number over the chance that it is greater than z."""
    if z > 8.0:
        return z + 1.0 / z
    return math.exp(-0.5 * z * z) / (math.sqrt(0.5 * math.pi) * math.erfc(z / math.sqrt(2.0)))


@jitable
def friction_margin(record, settings):
    """Friction so far, free fraction of its cone, and the grip force: equation 21. NaN where
    friction is not known: see `show_bounds`.

    The friction force that holds shear and torsion together is on an ellipsoid: ``(shear / friction
    load)² + (torsion / friction load arm)² = 1`` (Howe and Cutkosky 1996). Returns the used
    friction.
    """
    if record["friction_information"] > 0.0:
        record["friction"] = record["friction_mean"]
        between = PARAMETERS.friction_spread * record["friction"]
        record["friction_sigma"] = np.sqrt(1.0 / record["friction_information"] + between**2)
    else:
        record["friction"] = settings["friction"]
        record["friction_sigma"] = np.nan
        record["friction_spread"] = np.nan
    record["margin"] = record["grip_force"] = record["grip_force_sigma"] = np.nan
    demand = record["shear"]
    if record["arm"] > 0.0:  # else a point, which bears no measurable torsion
        demand = np.sqrt(demand**2 + (record["torsion"] / record["arm"]) ** 2)
    if record["friction"] > 0.0:
        record["margin"] = 1.0 - demand / (record["friction"] * record["load"])
        grip = settings["safety"] * demand / record["friction"]
        record["grip_force"] = grip
        relative = record["friction_sigma"] / record["friction"]
        noise = settings["safety"] / record["friction"]
        normal, covariance, across = record["axes"][:, 2], record["wrench_covariance"], 0.0
        for a in range(3):
            across += covariance[a, a]
            for b in range(3):
                across -= normal[a] * covariance[a, b] * normal[b]
        square = 0.5 * max(across, 0.0)  # of a component of the force across the normal, N²
        record["grip_force_sigma"] = np.sqrt((grip * relative) ** 2 + noise**2 * square)
    else:
        record["flags"] |= NO_FRICTION
    return demand / record["load"]


@jitable
def show_bounds(record, ratio, settings):
    """Bounds of margin and grip force where friction is not known: it is at least what sticking
    units have borne, and the present load suffices. Else these numbers themselves.

    `ratio` is the friction in use. Nothing is decided by these bounds.
    """
    record["margin_at_least"], record["grip_force_at_most"] = record["margin"], record["grip_force"]
    if record["flags"] & NO_FRICTION == 0:
        return
    least, holds = record["friction_at_least"], record["slip"] < SlipState.INCIPIENT
    record["margin_at_least"] = 0.0
    record["grip_force_at_most"] = settings["safety"] * record["load"] if holds else np.nan
    if holds and ratio < least:
        record["margin_at_least"] = 1.0 - ratio / least
        record["grip_force_at_most"] *= ratio / least
