"""The stage that detects slip, in the order of docs/explanation/derivations.md: a test of the units
by their lags, then stick or slip of units and contact, with hysteresis, friction and the grip
force."""

from __future__ import annotations

import math

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.record import (
    BORN,
    BRIDGE,
    FEW_UNITS,
    NO_FRICTION,
    NOISY,
    RESUMED,
    SILENT,
    WEAK,
    SlipState,
    UnitSlip,
)  # fmt: skip
from skin.contact.slip import lags
from skin.contact.slip.parameters import LEAST_UNITS, PARAMETERS, UNITS_FOR_TURN
from skin.contact.slip.state import MOTIONS, PLANE

__all__ = ["detect_slip", "detect_slip_python"]

LEAST_SIZE_M = 1e-4
"""[numeric] Lower bound of the size of a contact, metre."""
FAR = -5.0
"""[numeric] Sigmas below the mean from which a bound has no information."""


@jitable
def _show_motion(record, fit, size):
    """Displacement and rotation of the skin by the body."""
    axes, motion = fit["axes"], fit["motion"]
    for c in range(3):
        record["motion"][c] = axes[0, c] * motion[0] + axes[1, c] * motion[1]
        record["rotation"][c] = axes[2, c] * motion[2] * 1e-3 / size


@jitable
def _begin_contact(record, members, data):
    """Take the state over from the contact that a new one split from; a resumed one keeps its
    friction, and its state if that is recent and its units were silent and not lifted."""
    lifted = True
    for i in members:
        if record["event"] & BORN and record["parent"] == 0:
            data.slip[i] = UnitSlip.NO_CONTACT
        lifted &= data.slip[i] == UnitSlip.NO_CONTACT
    if record["event"] & BORN and record["parent"] > 0:
        for parent in data.contacts:
            if parent["id"] == record["parent"]:
                record["slip"], record["onset_ns"] = parent["slip"], parent["onset_ns"]
                record["stick_ratio"] = parent["stick_ratio"]
                record["gross_ns"] = parent["gross_ns"]
                record["gross_ratio"] = parent["gross_ratio"]
                record["decided_ns"] = parent["decided_ns"]
    # decided so recently that its units could not have come to rest
    since_s = 1e-9 * (data.cycle[0]["now_ns"] - record["decided_ns"])
    if lifted or since_s >= PARAMETERS.rest_s:
        record["slip"] = SlipState.UNKNOWN
        record["onset_ns"] = 0


@jitable
def _decide_units(members, alarm, floor_mm, data):
    """Stick or slip of each unit of a contact, at log-odds of `alarm` and the number of units."""
    dt_s, least = data.cycle[0]["elapsed_s"], 2.0 * (alarm + np.log(members.size))
    for i in members:
        s, state = data.slips[i], data.slip[i]
        if state == UnitSlip.NO_CONTACT:
            data.slip[i] = UnitSlip.STICK
        elif state == UnitSlip.SLIPPING:
            if _comes_to_rest(s, dt_s, floor_mm):
                data.slip[i] = UnitSlip.RE_STICK
        elif s["slip_score"] > 0.0 and s["slip_score"] ** 2 > least:
            data.slip[i] = UnitSlip.SLIPPING
            s["mean_lag"][:] = 0.0
            s["lag_sum"][:] = 0.0
            s["lag_cycles"], s["sliding_s"] = 0.0, PARAMETERS.rest_s
        s["held"] = 1.0 if data.slip[i] != UnitSlip.SLIPPING else 0.0


@jitable
def _comes_to_rest(s, dt_s, floor_mm):
    """Whether a slipping unit sticks again: its lag no longer grows."""
    total, mean, lag = s["lag_sum"], s["mean_lag"], s["lag"]
    s["sliding_s"] -= dt_s
    s["lag_cycles"] += 1.0
    total[0] += lag[0]
    total[1] += lag[1]
    cycles = s["lag_cycles"]
    if cycles * dt_s < PARAMETERS.rest_s:
        return False
    mean_x, mean_y = total[0] / cycles, total[1] / cycles
    further = (mean_x - mean[0]) ** 2 + (mean_y - mean[1]) ** 2
    variance = s["noise"] / cycles
    if further > PARAMETERS.outlier_sigmas**2 * 2.0 * (variance + floor_mm**2):
        mean[0], mean[1] = mean_x, mean_y
        s["sliding_s"] = cycles * dt_s
        total[0], total[1], s["lag_cycles"] = 0.0, 0.0, 0.0
        return False
    s["anchor"][0] += mean_x
    s["anchor"][1] += mean_y
    s["anchor_variance"] = variance
    lag[0] -= mean_x
    lag[1] -= mean_y
    return True


@jitable
def _still_slides(record, ratio, misses, cycle):
    """Whether gross slip continues: sliding faces use all of their friction, no more and no less;
    their slip is not detected otherwise. A face that `misses` units is not averaged."""
    if (cycle["now_ns"] - record["gross_ns"]) * 1e-9 < PARAMETERS.rest_s:
        share = 0.0 if misses else min(1.0, cycle["elapsed_s"] / PARAMETERS.slow_s)
        record["gross_ratio"] += share * (ratio - record["gross_ratio"])
        return True
    least = 1.0 - PARAMETERS.outlier_sigmas * PARAMETERS.friction_spread
    return least * record["gross_ratio"] < ratio < record["gross_ratio"] / least


@jitable
def _decide_contact(record, members, tested, ratio, settings, data):
    """State of the contact from its stick ratio, with hysteresis; see derivations.md. `ratio` is
    the used friction, `tested` the number of tested units."""
    now_ns, before, stick = data.cycle[0]["now_ns"], record["slip"], record["stick_ratio"]
    few = tested - record["slip_units"] < LEAST_UNITS
    # Where all units slide alike there are no lags: only the cone can show it. Friction learned by
    # an alarm does not count: a false alarm would cause further ones.
    used_up = record["margin"] < 0.0 and not record["friction_information"] > 0.0
    leave = 0.5 + 0.5 * settings["incipient_ratio"]
    least = leave if before == SlipState.INCIPIENT else settings["incipient_ratio"]
    state = SlipState.STICK
    if tested < LEAST_UNITS and not np.isfinite(record["margin"]):
        state = SlipState.UNKNOWN
    elif stick < settings["gross_ratio"] or (few and record["margin"] < 0.0):
        state = SlipState.GROSS
    elif stick < least or used_up:
        state = SlipState.INCIPIENT
    if state >= SlipState.INCIPIENT and before < SlipState.INCIPIENT:
        record["onset_ns"] = now_ns
        for i in members:
            if data.slip[i] == UnitSlip.SLIPPING or data.slips[i]["in_pattern"] > 0.0:
                data.slips[i]["began"] = record["id"]
    elif state < SlipState.INCIPIENT:
        record["onset_ns"] = 0
    if state == SlipState.GROSS and before != SlipState.GROSS:
        record["gross_ns"], record["gross_ratio"] = now_ns, ratio
    record["slip"], record["decided_ns"] = state, now_ns


# -- friction --------------------------------------------------------------------------------------


@jitable
def _learn_friction(record, members, alarm, data):
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
def _friction_margin(record, settings):
    """Friction so far, free fraction of its cone, and the grip force: equation 21. NaN where
    friction is not known: see `_show_bounds`.

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
def _show_bounds(record, ratio, settings):
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


# -- the contact -----------------------------------------------------------------------------------


@jitable
def _decide(record, members, sticks, odds, alarm, silent, model, data):
    """Decide the state of a contact after the test of its units, of which it learns friction;
    `silent` touched units are silent."""
    settings, cycle, tested = model.settings[0], data.cycle[0], record["body_units"]
    slipping, load_slipping = 0, 0.0
    for i in members:
        if data.slip[i] == UnitSlip.NO_CONTACT:
            data.slip[i] = UnitSlip.STICK
        elif data.slip[i] == UnitSlip.SLIPPING:
            slipping += 1
            load_slipping += data.slips[i]["load"]
    record["slip_units"] = slipping
    record["pattern"] = np.sqrt(2.0 * max(odds, 0.0))
    stuck_before = record["stick_ratio"]
    record["stick_ratio"] = min(sticks, 1.0 - load_slipping / record["load"])
    _learn_friction(record, members, alarm, data)
    ratio = _friction_margin(record, settings)
    if tested < LEAST_UNITS:
        record["flags"] |= FEW_UNITS
        if np.isfinite(record["margin"]):
            # By the used fraction of the friction cone, where friction differs between faces.
            z = record["margin"] / PARAMETERS.friction_spread
            record["stick_ratio"] = 0.5 * math.erfc(-z / math.sqrt(2.0))
    misses = False  # silent units that were in this contact when last heard
    for at in range(silent):
        misses |= data.slips[data.lists[at]["queue"]]["body"] == record["id"]
    # For want of units the state is kept: where what is heard of a sliding face uses another
    # friction than all of it, or where too few are heard for a test.
    short = record["slip"] == SlipState.GROSS or tested < LEAST_UNITS
    recent = 1e-9 * (cycle["now_ns"] - record["decided_ns"]) < PARAMETERS.rest_s
    slides = record["slip"] == SlipState.GROSS and tested >= LEAST_UNITS
    if slides and _still_slides(record, ratio, misses, cycle):
        record["stick_ratio"] = 0.0
        record["decided_ns"] = cycle["now_ns"]
    elif misses and short and recent:
        record["stick_ratio"] = stuck_before
    elif not slides:
        _decide_contact(record, members, tested, ratio, settings, data)
    else:
        record["slip"] = SlipState.STICK
        record["onset_ns"] = 0
        for i in members:
            data.slip[i] = UnitSlip.NO_CONTACT
    _show_bounds(record, ratio, settings)


@jitable
def _report(record, members, odds, alarm, model, data):
    """Probability and direction of slip, and noisy units: derivations.md, equation 13 and state
    machine."""
    if record["slip"] >= SlipState.INCIPIENT:
        odds = max(odds, alarm)
    begins = model.settings[0]["slips_per_hour"] / 3600.0 * PARAMETERS.slow_s
    record["slip_probability"] = 1.0 / (1.0 + np.exp(-min(odds, 700.0)) / begins)
    if record["slip"] == SlipState.UNKNOWN:
        record["slip_probability"] = np.nan
    direction, total, limit = record["slip_direction"], 0.0, alarm + np.log(members.size)
    direction[:] = 0.0
    slides = record["slip"] == SlipState.GROSS
    for i in members:
        s, rotation = data.slips[i], model.poses[i]["rotation"]
        # The one-sigma of a sum of squares is the root of twice their number.
        further = s["noise_sum"] - s["noise_count"]
        noisy = further > 0.0 and further**2 > 4.0 * limit * s["noise_count"]
        s["noisy"] = 1.0 if noisy else 0.0
        if s["noisy"] > 0.0:
            record["flags"] |= NOISY
        if slides or data.slip[i] == UnitSlip.SLIPPING or s["in_pattern"] > 0.0:
            total += s["load"]
            for a in range(3):
                component = s["direction"][0] * rotation[a, 0] + s["direction"][1] * rotation[a, 1]
                direction[a] += s["load"] * component
    for a in range(3):
        direction[a] = direction[a] / total if total > 0.0 else np.nan


def detect_slip_python(model, data):
    """Detect slip of the contacts that are described, and of their units.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
        Written: `slip`, `slips`, `all`, and the fields of `contacts` that belong to slip and
        friction.
    """
    fit, settings, dt_s = data.all[0], model.settings[0], data.cycle[0]["elapsed_s"]
    lags.begin_cycle(fit, dt_s)
    silent = 0  # that were touched, listed in `queue`
    for i in range(data.units.size):
        if data.slip[i] == UnitSlip.NO_CONTACT:
            continue
        kind = data.units[i]["kind"]
        if kind == BRIDGE or kind == SILENT:  # noqa: PLR1714
            data.lists[silent]["queue"] = i
            silent += 1
        elif data.label[i] < 0:
            data.slip[i] = UnitSlip.NO_CONTACT
            data.slips[i]["anchor_depth"] = 0.0
    for k in range(data.cycle[0]["present"]):
        record = data.contacts[data.slots[k]["present"]]
        if record["flags"] & WEAK:
            continue
        members = data.members[record["begin"] : record["end"]]
        if record["event"] & (BORN | RESUMED):
            _begin_contact(record, members, data)
        # the motion of the body, and the lags of units behind it
        flat = lags.contact_frame(record, members, model, data)
        motions = PLANE if flat else MOTIONS
        size = max(record["arm"], LEAST_SIZE_M)
        stuck, known = lags.take_units(record, members, size, motions, model, data)
        if stuck < UNITS_FOR_TURN:
            motions = 2
        out_of_plane = lags.fit_motion(members, motions, stuck, settings["floor_mm"], data)
        share = lags.lowpass_share(members, motions, stuck, dt_s, data.slips)
        lags.predict(members, share, settings, data)
        _show_motion(record, fit, size)
        # their test: the fraction of the load that sticks, and the log-odds of slip and an alarm
        alarm, sticks, odds = lags.alarm_odds(share, dt_s, settings), 1.0, 0.0
        slides = record["slip"] == SlipState.GROSS
        tested = members.size if slides or known >= LEAST_UNITS else 0
        if tested and not slides:
            odds, sticks = lags.detect_pattern(
                record, members, motions, stuck, out_of_plane, alarm, settings, data
            )
            _decide_units(members, alarm, settings["floor_mm"], data)
            # Slip that may have begun is not noise.
            if not odds > lags.ROUNDING:
                lags.learn_noise(members, stuck, motions, share, data)
            lags.correct(members, dt_s, data)
        record["body_units"] = tested
        _decide(record, members, sticks, odds, alarm, silent, model, data)
        _report(record, members, odds, alarm, model, data)
    for at in range(data.cycle[0]["touching_units"]):
        s, told = data.slips[data.members[at]], data.lists[at]
        told["began"], told["noisy"] = s["began"], s["noisy"]
        told["noise_ratio"] = s["noise_ratio"]


detect_slip = compiled(detect_slip_python, fastmath={"contract"}, allocates=False)
