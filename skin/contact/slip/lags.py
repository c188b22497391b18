"""The rigid motion of a body, fitted to the units that stick to it, each unit's lag behind it, and
the odds of slip by the patterns of lags that it causes.

The filter of a unit has its lag, its gain error and its anchor; the noise of lags relative to sigma
is measured while the body sticks. In the test, first the nuisances are projected out of the lags,
then the rest is compared with the lags at each coefficient of friction.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import SlipState, UnitSlip
from skin.contact.slip.parameters import PARAMETERS, PATTERNS, SETTLED
from skin.contact.slip.state import MOTIONS, PLANE

__all__ = [
    "FRICTIONS", "ROUNDING", "alarm_odds", "begin_cycle", "contact_frame", "correct",
    "detect_pattern", "fit_motion", "learn_noise", "lowpass_share", "predict", "take_units",
]  # fmt: skip

RANK = 1e-9
"""[numeric] Fraction of a pivot, or of a column, below which it depends on those before it."""
FLAT = 1e-3
"""[numeric] One minus the length of the mean normal below which a contact is flat."""
RIDGE = 1e-6
"""[numeric] Regularisation of motions out of the plane, relative to the diagonal."""
LEAST_SIGMA_MM = 1e-6
"""[numeric] Lower bound of the sigma of a displacement, millimetre."""
AT_MOST_RECENT = 0.5
"""[numeric] Largest weight of one cycle in the mean of a lag: with more, the lag would equal its
mean and have no residual."""
TINY = 1e-12
"""[numeric] Lower bound of a weight times a variance."""
FRICTIONS = np.geomspace(PARAMETERS.least_friction, PARAMETERS.greatest_friction, PATTERNS)
"""Coefficients of friction whose patterns are tested."""
BLIND = 0.01
"""[numeric] Smallest fraction of a unit's own lag outside the nuisances for a test of the unit
alone."""
ROUNDING = 1e-9
"""[numeric] Log-odds without information: sums are rounded by 1e-13."""

# -- the body --------------------------------------------------------------------------------------


@jitable
def contact_frame(record, members, model, data):
    """Axes and centre of the contact; returns whether it is flat."""
    fit, square = data.all[0], 0.0
    for a in range(3):
        mean = 0.0
        for i in members:
            mean += data.units[i]["force"][2] * model.poses[i]["rotation"][a, 2]
        square += mean**2
        for axis in range(3):
            fit["axes"][axis, a] = record["axes"][a, axis]
        fit["centre"][a] = record["middle"][a] - model.settings[0]["origin"][a]
    return np.sqrt(square) > (1.0 - FLAT) * record["load"]


@jitable
def _design_motions(pose, fit, size, motions, s):
    """Displacement of one unit by each motion of the body: derivations.md, equation 1."""
    scale, axes, design = 1.0 / size, fit["axes"], s["design"]
    position, rotation, centre = pose["position"], pose["rotation"], fit["centre"]
    qx = (position[0] - centre[0]) * scale
    qy = (position[1] - centre[1]) * scale
    qz = (position[2] - centre[2]) * scale
    s["square_distance"] = qx * qx + qy * qy + qz * qz
    for c in range(2):
        ax, ay, az = rotation[0, c], rotation[1, c], rotation[2, c]
        # Rotation about an axis e moves q by e x q; its component along a is e . (q x a).
        rx, ry, rz = qy * az - qz * ay, qz * ax - qx * az, qx * ay - qy * ax
        design[c, 0] = ax * axes[0, 0] + ay * axes[0, 1] + az * axes[0, 2]
        design[c, 1] = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
        design[c, 2] = rx * axes[2, 0] + ry * axes[2, 1] + rz * axes[2, 2]
        if motions > PLANE:
            design[c, 3] = ax * axes[2, 0] + ay * axes[2, 1] + az * axes[2, 2]
            design[c, 4] = rx * axes[0, 0] + ry * axes[0, 1] + rz * axes[0, 2]
            design[c, 5] = rx * axes[1, 0] + ry * axes[1, 1] + rz * axes[1, 2]


@jitable
def fit_motion(members, motions, stuck, floor_mm, data):
    """Weighted least squares of the body's motion, none without sticking units, and how it moves
    each unit: derivations.md, equations 2 to 4.

    Each unit gets the variance of its predicted displacement, mean of both components, by the
    factor of the normal equations. Returns the one-sigma, mm, of the motion out of the contact's
    plane that the anchors may have missed.
    """
    fit, floor, variance = data.all[0], floor_mm**2, 1.0
    equations, motion = fit["equations"], fit["motion"]
    _normal_equations(members, motions, floor, equations, data)
    for a in range(MOTIONS):
        motion[a] = 0.0
    if motions > PLANE and stuck > 0:
        # Out of the plane, few units cannot distinguish motion from slip; their depths can.
        deeper, total = 0.0, 0.0
        for i in members:
            deeper += data.slips[i]["weight"] * data.slips[i]["deeper"] ** 2
            total += data.slips[i]["weight"]
        variance = floor + deeper / total
        # Pose of the body out of the plane by the anchors (equation 4). A late unit was anchored
        # further along the plane than the others, so only motions out of it are compared.
        placement, further = fit["placement_equations"], motions - PLANE
        for a in range(further):
            placement[a, MOTIONS] = 0.0
            for b in range(a + 1):
                placement[a, b] = equations[a + PLANE, b + PLANE]
            placement[a, a] *= 1.0 + RIDGE
            for i in members:
                s = data.slips[i]
                for c in range(2):
                    share = s["weight"] * s["design"][c, a + PLANE]
                    placement[a, MOTIONS] += share * s["followed_out"][c]
        _solve(placement, further, fit["placement"])
        for a in range(further):
            equations[a + PLANE, a + PLANE] += 1.0 / variance
            equations[a + PLANE, MOTIONS] += fit["placement"][a] / variance
    if stuck > 0:
        _solve(equations, motions, motion)
    for i in members:
        s, solved = data.slips[i], data.slips[i]["nuisance"]  # not in use yet
        for c in range(2):
            out, now = 0.0, 0.0
            for a in range(PLANE, motions):
                out += s["design"][c, a] * motion[a]
            for a in range(min(motions, PLANE)):
                now += s["design"][c, a] * motion[a]
            s["moved_out"][c], s["now"][c] = out, out + now
            for a in range(motions):
                rest = s["design"][c, a]
                for b in range(a):
                    rest -= equations[a, b] * solved[b]
                solved[a] = rest / equations[a, a] if equations[a, a] > 0.0 else 0.0
                s["body_variance"] += 0.5 * solved[a] * solved[a]
    return np.sqrt(variance)


@jitable
def _normal_equations(members, motions, floor, equations, data):
    """Normal equations of the displacements since anchoring, without learned gains."""
    equations[:] = 0.0
    for i in members:
        s, here = data.slips[i], data.units[i]["displacement"]
        s["weight"] = s["held"] / (s["noise"] + s["anchor_variance"] + floor)
        for c in range(2):
            along = here[c] - s["anchor"][c] - s["gain_error"] * (s["moved"][c] - s["followed"][c])
            for a in range(motions):
                share = s["weight"] * s["design"][c, a]
                equations[a, MOTIONS] += share * along
                for b in range(a + 1):
                    equations[a, b] += share * s["design"][c, b]


@jitable
def _solve(equations, motions, x):
    """Cholesky solution of ``equations[:, :motions] x = equations[:, MOTIONS]``, given the lower
    triangle; dependent motions are 0."""
    for j in range(motions):
        before = equations[j, j]
        for k in range(j):
            equations[j, j] -= equations[j, k] ** 2
        if equations[j, j] <= RANK * before or before <= 0.0:
            equations[j, j] = 0.0
            for i in range(j + 1, motions):
                equations[i, j] = 0.0
            continue
        equations[j, j] = np.sqrt(equations[j, j])
        for i in range(j + 1, motions):
            for k in range(j):
                equations[i, j] -= equations[i, k] * equations[j, k]
            equations[i, j] /= equations[j, j]
    for j in range(motions):
        x[j] = equations[j, MOTIONS]
        for k in range(j):
            x[j] -= equations[j, k] * x[k]
        x[j] = x[j] / equations[j, j] if equations[j, j] > 0.0 else 0.0
    for j in range(motions - 1, -1, -1):
        for k in range(j + 1, motions):
            x[j] -= equations[k, j] * x[k]
        x[j] = x[j] / equations[j, j] if equations[j, j] > 0.0 else 0.0


# -- the units -------------------------------------------------------------------------------------


@jitable
def take_units(record, members, size, motions, model, data):
    """Prepare the units of a contact for its test, and initialise new ones.

    Returns the number of sticking units, and the number of units anchored to this body, sticking or
    slipping.
    """
    stuck, known, deep, was_deep = 0, 0, 0.0, 0.0
    noise, prior = data.all[0], PARAMETERS.unit_noise_prior
    for i in members:
        if data.slip[i] != UnitSlip.NO_CONTACT:
            deep += data.units[i]["displacement"][2]
            was_deep += data.slips[i]["anchor_depth"]
    # Fraction of its depth at anchoring that a unit's film may keep without load.
    remembered = PARAMETERS.film_memory * deep / max(was_deep, 1e-9)
    for i in members:
        u, s = data.units[i], data.slips[i]
        depth, sigma = u["displacement"][2], u["displacement_sigma"]
        # At the edge of a contact: its film recovers and no longer follows the body.
        at_most = depth + PARAMETERS.outlier_sigmas * sigma[2]
        recovers = at_most < remembered * s["anchor_depth"]
        if recovers:
            data.slip[i] = UnitSlip.NO_CONTACT
        new = data.slip[i] == UnitSlip.NO_CONTACT
        if s["body"] == record["parent"]:
            s["body"] = record["id"]
        anchored = not new and s["body"] == record["id"]
        held = anchored and data.slip[i] != UnitSlip.SLIPPING
        known += anchored
        stuck += held
        s["body"] = record["id"]
        s["held"] = 1.0 if held else 0.0
        s["new"] = 1.0 if new else 0.0
        s["joined"] = 1.0 if not (new or anchored) else 0.0
        s["in_pattern"] = s["body_variance"] = 0.0
        reported = 0.5 * (sigma[0] ** 2 + sigma[1] ** 2)
        s["reported"] = max(reported, LEAST_SIGMA_MM**2)
        s["load"] = u["force"][2]
        if new:
            s["anchor_depth"] = s["anchor_depth"] if recovers else depth
            s["slid_shear"] = s["slid_load"] = s["slid_variance"] = s["borne"] = 0.0
        s["deeper"] = depth - s["anchor_depth"]
        # equations 13 and 13a: variance of its noise, and of its slow noise over sigma squared
        share = 1.0 / (s["noise_count"] + prior)
        ratio = max(1.0, (s["noise_sum"] + prior * noise["lag_ratio"]) * share)
        s["noise_ratio"] = noise["growth"] * ratio
        s["noise"] = s["reported"] * s["noise_ratio"]
        s["wander"] = max(0.0, (s["slow_sum"] + prior * noise["wander"]) * share)
        _design_motions(model.poses[i], data.all[0], size, motions, s)
    return stuck, known


@jitable
def lowpass_share(members, motions, stuck, dt_s, slips):
    """Gain of the low-pass of lags in this cycle: derivations.md, equation 5."""
    square, total, noise = 0.0, 0.0, 0.0
    for i in members:
        s = slips[i]
        ahead_x = s["now"][0] - s["moved_slow"][0]
        ahead_y = s["now"][1] - s["moved_slow"][1]
        heavy = s["held"] * s["load"]
        total += heavy
        square += heavy * (ahead_x * ahead_x + ahead_y * ahead_y)
        noise += heavy * s["noise"]
    slow = 1.0 - np.exp(-dt_s / PARAMETERS.slow_s)
    if not total > 0.0:
        return slow
    # Error of a fit of so many motions to so many units, relative to a unit's noise.
    square -= noise * motions / max(stuck, 1)
    rms = np.sqrt(square / total) if square > 0.0 else 0.0
    span = PARAMETERS.outlier_sigmas * np.sqrt(noise / total)
    return max(slow, 1.0 - span / max(rms, span))


@jitable
def predict(members, share, settings, data):
    """Lag of each unit behind its predicted displacement: equations 6 to 9; `share` is the gain of
    its low-pass."""
    floor, noise_scale = settings["floor_mm"] ** 2, max(1.0, data.all[0]["reading_ratio"])
    for i in members:
        s, here = data.slips[i], data.units[i]["displacement"]
        new, joined = s["new"] > 0.0, s["joined"] > 0.0
        if new:
            s["gain_error"], s["gain_information"] = 0.0, 1.0 / settings["gain_error"] ** 2
            s["lag_mean"][:] = 0.0
        s["innovation2"] = s["step2"] = 0.0
        spread = max(s["noise"], noise_scale * s["reported"]) + s["lag_variance"] + floor
        most = PARAMETERS.outlier_sigmas * np.sqrt(spread)
        for c in range(2):
            now = s["now"][c]
            if joined:
                # From another contact that became part of this one: the same lag, another motion.
                further = now - s["moved"][c]
                s["anchor"][c] -= further
                s["followed"][c] += further
                s["moved_slow"][c] += further
            elif new:
                s["anchor"][c] = here[c] - now
                s["followed"][c] = s["moved_slow"][c] = now
            if joined or new:
                s["followed_out"][c] = s["moved_out"][c]
            s["moved_slow"][c] += share * (now - s["moved_slow"][c])
            followed = now - s["followed"][c]
            behind = here[c] - s["anchor"][c] - now - s["gain_error"] * followed
            further = behind - s["lag"][c]
            s["innovation2"] += further * further
            s["step2"] += (behind - s["behind"][c]) ** 2
            s["behind"][c], s["moved"][c] = behind, now
            s["lag"][c] += share * min(max(further, -most), most)
            if new:
                s["lag"][c] = 0.0
        _score(s, share, data.cycle[0]["elapsed_s"], floor)


@jitable
def _score(s, share, dt_s, floor):
    """Variance of the lag of a unit, and its predicted displacement: equations 7 to 9."""
    new, noise, held = s["new"] > 0.0, s["noise"], s["held"]
    unsettled = new or s["joined"] > 0.0
    variance = s["lag_variance"]
    variance = noise if new else variance + share * (share * noise - (2.0 - share) * variance)
    anchor_variance = 0.0 if new else s["anchor_variance"]
    if unsettled:
        anchor_variance += noise + s["body_variance"]
    anchor_variance = max(anchor_variance, s["wander"] * s["reported"])
    s["lag_variance"], s["anchor_variance"] = variance, anchor_variance
    square = (s["moved"][0] - s["followed"][0]) ** 2 + (s["moved"][1] - s["followed"][1]) ** 2
    weight = 1.0 / (variance + anchor_variance + square / s["gain_information"] + floor)
    s["weight"] = 0.0 if new else weight
    # Friction drags a unit along: a slipping unit lags against its own displacement.
    x, y = s["anchor"][0] + s["moved_slow"][0], s["anchor"][1] + s["moved_slow"][1]
    far = np.sqrt(x * x + y * y)
    s["imposed"] = far
    s["direction"][0], s["direction"][1] = x / max(far, 1e-9), y / max(far, 1e-9)
    # Excludes slipping units, and units whose noise is unknown.
    s["age_s"] = 0.0 if unsettled else s["age_s"] + dt_s
    settled = s["age_s"] > 2.0 * SETTLED * PARAMETERS.slow_s
    s["root_weight"] = np.sqrt(held * s["weight"]) if settled else 0.0


@jitable
def correct(members, dt_s, data):
    """Anchors and gain errors of sticking units: derivations.md, equations 10 and 11.

    An anchor is the mean displacement while the unit stuck, with a slow decay: creep and a drifting
    tare are no slip. The gain error is the slope of that line.
    """
    slowest = min(1.0, dt_s / PARAMETERS.creep_s)
    for i in members:
        s, here = data.slips[i], data.units[i]["displacement"]
        if s["new"] > 0.0 or not s["held"] > 0.0:
            continue  # the first reading is the anchor already
        variance, noise = s["anchor_variance"], s["noise"] + s["body_variance"]
        gain = max(variance / (variance + noise), slowest)
        gain_error, rest, square = s["gain_error"], 0.0, 0.0
        for c in range(2):
            travel = s["moved"][c] - s["followed"][c]
            lag = here[c] - s["anchor"][c] - s["moved"][c]
            s["anchor"][c] += gain * lag
            s["lag"][c] -= gain * lag - gain * gain_error * travel
            s["followed"][c] += gain * travel
            s["followed_out"][c] += gain * (s["moved_out"][c] - s["followed_out"][c])
            square += travel * travel
            rest += travel * (lag - gain_error * travel)
        s["anchor_depth"] += gain * s["deeper"]
        information = (1.0 - gain) / s["noise"]
        s["gain_information"] += information * square
        s["gain_error"] += information * rest / s["gain_information"]
        s["anchor_variance"] += gain * (gain * noise - (2.0 - gain) * variance)


# -- noise -----------------------------------------------------------------------------------------


@jitable
def begin_cycle(noise, dt_s):
    """Decay the sums of all units, `SLIP`, and compute their ratios."""
    keep, prior = max(0.0, 1.0 - dt_s / PARAMETERS.memory_s), PARAMETERS.noise_prior
    soon = np.exp(-dt_s / PARAMETERS.slow_s)
    noise["lags"] *= keep
    noise["lag_count"] *= keep
    noise["readings"] *= keep
    noise["reading_count"] *= keep
    noise["steps"] *= keep
    noise["step_count"] *= keep
    noise["slow"] *= keep
    noise["slow_count"] *= keep
    noise["recent"] *= soon
    noise["recent_count"] *= soon
    noise["lag_ratio"] = (noise["lags"] + prior) / (noise["lag_count"] + prior)
    noise["reading_ratio"] = (noise["readings"] + prior) / (noise["reading_count"] + prior)
    usual = (noise["steps"] + prior) / (noise["step_count"] + prior)
    now = (noise["recent"] + prior * usual) / (noise["recent_count"] + prior)
    # Squares of successive changes, which have a reading in common, correlate by a quarter.
    chance = PARAMETERS.outlier_sigmas * np.sqrt(3.0 / (noise["recent_count"] + prior))
    noise["growth"] = max(1.0, now / usual - chance)
    noise["wander"] = max(0.0, noise["slow"] / (noise["slow_count"] + prior))


@jitable
def learn_noise(members, stuck, motions, share, data):
    """Update the variance of readings and of low-passed lags: derivations.md, equations 12 and 13.

    That of the lags contains noise that is correlated from cycle to cycle, which sigma does not.
    Units that slip are excluded, and outliers are clipped.
    """
    dt_s, noise = data.cycle[0]["elapsed_s"], data.all[0]
    free = 2.0 * stuck - motions
    if free < 1.0:
        return
    free /= stuck
    # Independent readings: a low-pass has one in twice its time constant.
    weight, recent = 0.5 * share * free, min(AT_MOST_RECENT, dt_s / PARAMETERS.rest_s)
    keep = 1.0 - min(1.0, dt_s / PARAMETERS.memory_s)
    outlier = PARAMETERS.outlier_sigmas**2
    most, most_reading = outlier * noise["lag_ratio"], outlier * noise["reading_ratio"]
    # Variance of low-passed white noise, and the fraction of it that remains without its mean.
    keeps, slower = 1.0 - recent, 1.0 - share
    common = recent / (1.0 - keeps * slower)
    mean = (2.0 * keeps * slower * common + recent) * recent / (1.0 - keeps * keeps)
    scale = share / (2.0 - share) * (1.0 - 2.0 * common + mean)
    lags, readings, steps, slow, count = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in members:
        s = data.slips[i]
        if not (s["held"] > 0.0 and s["age_s"] > SETTLED * PARAMETERS.slow_s):
            continue
        square, whole = 0.0, 0.0
        for c in range(2):
            further = s["lag"][c] - s["lag_mean"][c]
            s["lag_mean"][c] += recent * further
            square += (further * (1.0 - recent)) ** 2
            whole += s["lag"][c] ** 2
        told = free * s["reported"]
        seen = min(square / (scale * told), most)
        # What the model of a lag explains but for slow noise.
        expected = free / max(s["weight"] * told, TINY) - s["wander"]
        beyond = min(whole / told, outlier * (expected + s["wander"])) - expected
        lags += seen
        slow += beyond
        readings += min(s["innovation2"] / told, most_reading)
        steps += min(0.5 * s["step2"] / told, most_reading)
        count += 1.0
        s["noise_sum"] = keep * s["noise_sum"] + weight * seen
        s["slow_sum"] = keep * s["slow_sum"] + weight * beyond
        s["noise_count"] = keep * s["noise_count"] + weight
    noise["lags"] += weight * lags
    noise["lag_count"] += weight * count
    noise["slow"] += weight * slow
    noise["slow_count"] += weight * count
    noise["readings"] += free * readings
    noise["reading_count"] += free * count
    noise["steps"] += free * steps
    noise["step_count"] += free * count
    noise["recent"] += free * steps
    noise["recent_count"] += free * count


# -- the test of a contact ------------------------------------------------------------------------


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
