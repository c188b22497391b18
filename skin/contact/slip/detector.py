"""The stage that detects slip; the order of its calls is that of
docs/explanation/derivations.md."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import (
    BORN,
    BRIDGE,
    FEW_UNITS,
    NOISY,
    RESUMED,
    SILENT,
    WEAK,
    SlipState,
    UnitSlip,
)  # fmt: skip
from skin.contact.slip.friction import (
    friction_margin,
    learn_friction,
    show_bounds,
    stick_ratio_by_cone,
)
from skin.contact.slip.parameters import LEAST_UNITS, PARAMETERS, UNITS_FOR_TURN
from skin.contact.slip.pattern_test import (
    ROUNDING,
    alarm_odds,
    detect_pattern,
    project_nuisances,
)  # fmt: skip
from skin.contact.slip.rigid_fit import contact_frame, fit_motion, move_units
from skin.contact.slip.state import (
    MOTIONS,
    PLANE,
    begin_contact,
    count_slipping,
    decide_contact,
    decide_units,
    is_kept,
    misses_units,
    still_slides,
)
from skin.contact.slip.unit_filter import (
    begin_cycle,
    correct,
    is_noisy,
    learn_noise,
    lowpass_share,
    predict,
    take_units,
)  # fmt: skip

__all__ = ["detect_slip"]

LEAST_SIZE_M = 1e-4
"""[numeric] Lower bound of the size of a contact, metre."""


@jitable
def _test_lags(record, members, model, data):
    """Test units by their lags behind the body's motion.

    Writes motion and rotation of the body; returns the number of tested units, the fraction of the
    load that sticks by the pattern test, and the log-odds of slip and of an alarm.
    """
    fit, settings, dt_s = data.all[0], model.settings[0], data.cycle[0]["elapsed_s"]
    motions = PLANE if contact_frame(record, members, model, data) else MOTIONS
    size = max(record["arm"], LEAST_SIZE_M)
    stuck, known = take_units(record, members, size, motions, model, data)
    if stuck < UNITS_FOR_TURN:
        motions = 2
    fit["motion"][:] = 0.0
    out_of_plane = 1.0
    if stuck:
        out_of_plane = fit_motion(members, motions, settings["floor_mm"], data)
    move_units(members, motions, fit["motion"], data.slips)
    share = lowpass_share(members, motions, stuck, dt_s, data.slips)
    predict(members, share, settings, data)
    alarm = alarm_odds(share, dt_s, settings)
    tested, sticks, odds = 0, 1.0, 0.0
    if record["slip"] == SlipState.GROSS:
        tested = members.size
    elif known >= LEAST_UNITS:
        tested = members.size
        nuisances = project_nuisances(members, motions, stuck, out_of_plane, settings, data)
        odds, sticks = detect_pattern(record, members, nuisances, alarm, settings, data)
        decide_units(members, alarm, settings["floor_mm"], data)
        # Slip that may have begun is not noise.
        if not odds > ROUNDING:
            learn_noise(members, stuck, motions, share, data)
        correct(members, dt_s, data)
    axes, motion = fit["axes"], fit["motion"]
    for c in range(3):
        record["motion"][c] = axes[0, c] * motion[0] + axes[1, c] * motion[1]
        record["rotation"][c] = axes[2, c] * motion[2] * 1e-3 / size
    return tested, sticks, odds, alarm


@jitable
def _detect_contact(record, members, silent, model, data):
    """Detect slip of one contact and its units; `silent` touched units are silent."""
    settings, cycle = model.settings[0], data.cycle[0]
    if record["event"] & (BORN | RESUMED):
        begin_contact(record, members, data)
    tested, sticks, odds, alarm = _test_lags(record, members, model, data)
    slipping, load_slipping = count_slipping(members, data)
    record["slip_units"] = slipping
    record["body_units"] = tested
    record["pattern"] = np.sqrt(2.0 * max(odds, 0.0))
    stuck_before = record["stick_ratio"]
    record["stick_ratio"] = min(sticks, 1.0 - load_slipping / record["load"])
    learn_friction(record, members, alarm, data)
    ratio = friction_margin(record, settings)
    if tested < LEAST_UNITS:
        record["flags"] |= FEW_UNITS
        if np.isfinite(record["margin"]):
            record["stick_ratio"] = stick_ratio_by_cone(record)
    misses = misses_units(record, silent, data)
    slides = record["slip"] == SlipState.GROSS and tested >= LEAST_UNITS
    if slides and still_slides(record, ratio, misses, cycle):
        record["stick_ratio"] = 0.0
        record["decided_ns"] = cycle["now_ns"]
    elif is_kept(record, misses, tested, cycle["now_ns"]):
        record["stick_ratio"] = stuck_before
    elif not slides:
        decide_contact(record, members, tested, ratio, settings, data)
    else:
        record["slip"] = SlipState.STICK
        record["onset_ns"] = 0
        for i in members:
            data.slip[i] = UnitSlip.NO_CONTACT
    show_bounds(record, ratio, settings)
    _report(record, members, odds, alarm, model, data)


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
        s["noisy"] = is_noisy(s["noise_sum"], s["noise_count"], limit)
        if s["noisy"] > 0.0:
            record["flags"] |= NOISY
        if slides or data.slip[i] == UnitSlip.SLIPPING or s["in_pattern"] > 0.0:
            total += s["load"]
            for a in range(3):
                component = s["direction"][0] * rotation[a, 0] + s["direction"][1] * rotation[a, 1]
                direction[a] += s["load"] * component
    for a in range(3):
        direction[a] = direction[a] / total if total > 0.0 else np.nan


@jitable
def detect_slip(model, data):
    """Detect slip of the ``data.cycle["slips"]`` contacts that are described, and of their units.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
        Written: `slip`, `slips`, `all`, and the fields of `contacts` that belong to slip and
        friction.
    """
    begin_cycle(data.all[0], data.cycle[0]["elapsed_s"])
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
    for k in range(data.cycle[0]["slips"]):
        record = data.contacts[data.slots[k]["present"]]
        if not record["flags"] & WEAK:
            members = data.members[record["begin"] : record["end"]]
            _detect_contact(record, members, silent, model, data)
    for at in range(data.cycle[0]["touching_units"]):
        s, told = data.slips[data.members[at]], data.told[at]
        told["began"], told["noisy"] = s["began"], s["noisy"]
        told["noise_ratio"] = s["noise_ratio"]
