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
from skin.contact.slip.data import MOTIONS, PLANE, SlipArrays, slip_arrays
from skin.contact.slip.friction import (
    friction_margin,
    learn_friction,
    show_bounds,
    stick_ratio_by_cone,
)
from skin.contact.slip.noise import begin_cycle, is_noisy, learn_noise, unlike_readings
from skin.contact.slip.parameters import LEAST_UNITS, PARAMETERS, UNITS_FOR_TURN, SlipModel
from skin.contact.slip.pattern_test import (
    ROUNDING,
    alarm_odds,
    detect_pattern,
    project_nuisances,
)  # fmt: skip
from skin.contact.slip.rigid_fit import contact_frame, fit_motion, move_units
from skin.contact.slip.state_machine import (
    begin_contact,
    count_slipping,
    decide_contact,
    decide_units,
    is_kept,
    misses_units,
    still_slides,
)
from skin.contact.slip.unit_filter import Pace, correct, gather, lowpass_share, predict, scatter

__all__ = ["detect_slip"]

LEAST_SIZE_M = 1e-4
"""[numeric] Lower bound of the size of a contact, metre."""


@jitable(inline=True)
def _test_lags(record, dt_s, geometry, model: SlipModel, reading, units, slip: SlipArrays):
    """Test units by their lags behind the body's motion.

    Writes motion and rotation of the body; returns the number of tested units, the fraction of the
    load that sticks by the pattern test, and the log-odds of slip and of an alarm.
    """
    scratch = slip.scratch
    unit, row, fit = scratch.unit, scratch.row, scratch.fit
    flat = contact_frame(record, units.members, reading.force, geometry, fit)
    size = max(record["arm"], LEAST_SIZE_M)
    motions = PLANE if flat else MOTIONS
    length, stuck, known = gather(record, reading, units, geometry, size, motions, slip)
    if stuck < UNITS_FOR_TURN:
        motions = 2
    fit.motion[:] = 0.0
    out_of_plane = 1.0
    if stuck:
        out_of_plane = fit_motion(length, motions, model, unit, row, fit)
    move_units(length, motions, row, fit.motion)
    share = lowpass_share(length, motions, stuck, dt_s, unit, row)
    pace = Pace(share, dt_s, unlike_readings(scratch.noise))
    predict(length, pace, model, unit, row)
    alarm = alarm_odds(share, dt_s, model)
    tested, sticks, odds = 0, 1.0, 0.0
    if record["slip"] == SlipState.GROSS:
        tested = record["end"] - record["begin"]
    elif known >= LEAST_UNITS:
        tested = record["end"] - record["begin"]
        nuisances = project_nuisances(
            length, motions, stuck, out_of_plane, model, unit, row, scratch.pattern.prior
        )
        odds, sticks = detect_pattern(
            record, units.members, reading.force, length, nuisances, alarm, model, scratch
        )
        decide_units(record, units, dt_s, alarm, model, slip)
        # Slip that may have begun is not noise.
        if not odds > ROUNDING:
            learn_noise(length, stuck, motions, share, dt_s, scratch)
        correct(length, dt_s, unit, row)
    for c in range(3):
        record["motion"][c] = fit.axes[0, c] * fit.motion[0] + fit.axes[1, c] * fit.motion[1]
        record["rotation"][c] = fit.axes[2, c] * fit.motion[2] * 1e-3 / size
    return tested, sticks, odds, alarm


@jitable(inline=True)
def _detect_contact(record, dt_s, now_ns, model, data, silent, slip: SlipArrays):
    """Detect slip of one contact and its units; `silent` lists touched units that are silent."""
    reading, units = data.reading, data.units
    first, last = record["begin"], record["end"]
    if record["event"] & (BORN | RESUMED):
        begin_contact(record, data.contacts, units, now_ns)
    tested, sticks, odds, alarm = _test_lags(
        record, dt_s, model.geometry, model.slip, reading, units, slip
    )
    slipping, load_slipping = count_slipping(record, units, slip.scratch.row)
    scatter(first, last - first, units.members, slip.scratch.unit, slip.kept)
    record["slip_units"] = slipping
    record["body_units"] = tested
    record["pattern"] = np.sqrt(2.0 * max(odds, 0.0))
    stuck_before = record["stick_ratio"]
    record["stick_ratio"] = min(sticks, 1.0 - load_slipping / record["load"])
    learn_friction(record, reading, units, alarm, slip, now_ns, dt_s)
    ratio = friction_margin(record, model.slip)
    if tested < LEAST_UNITS:
        record["flags"] |= FEW_UNITS
        if np.isfinite(record["margin"]):
            record["stick_ratio"] = stick_ratio_by_cone(record)
    misses = misses_units(record, silent, slip.history)
    slides = record["slip"] == SlipState.GROSS and tested >= LEAST_UNITS
    if slides and still_slides(record, ratio, misses, now_ns, dt_s):
        record["stick_ratio"] = 0.0
        record["decided_ns"] = now_ns
    elif is_kept(record, misses, tested, now_ns):
        record["stick_ratio"] = stuck_before
    elif not slides:
        decide_contact(record, units, now_ns, tested, ratio, model.slip, slip)
    else:
        record["slip"] = SlipState.STICK
        record["onset_ns"] = 0
        for at in range(first, last):
            units.slip[units.members[at]] = UnitSlip.NO_CONTACT
    show_bounds(record, ratio, model.slip)
    _report(
        record, units, geometry=model.geometry, odds=odds, alarm=alarm, model=model.slip, slip=slip
    )


@jitable(inline=True)
def _report(record, units, geometry, odds, alarm, model: SlipModel, slip: SlipArrays):
    """Probability and direction of slip, and noisy units: derivations.md, equation 13 and state
    machine."""
    if record["slip"] >= SlipState.INCIPIENT:
        odds = max(odds, alarm)
    begins = model.slips_per_hour / 3600.0 * PARAMETERS.slow_s
    record["slip_probability"] = 1.0 / (1.0 + np.exp(-min(odds, 700.0)) / begins)
    if record["slip"] == SlipState.UNKNOWN:
        record["slip_probability"] = np.nan
    direction, row, total = record["slip_direction"], slip.scratch.row, 0.0
    direction[:] = 0.0
    slides = record["slip"] == SlipState.GROSS
    count, unit, noisy = record["end"] - record["begin"], slip.scratch.unit, slip.history.noisy
    for j in range(count):
        i = units.members[record["begin"] + j]
        noisy[i] = is_noisy(unit.noise_sum[j], unit.noise_count[j], alarm + np.log(count))
        if noisy[i] > 0.0:
            record["flags"] |= NOISY
        if slides or units.slip[i] == UnitSlip.SLIPPING or row.in_pattern[j] > 0.0:
            total += row.load[j]
            for a in range(3):
                component = row.direction[0, j] * geometry.pose[i]["rotation"][a, 0]
                component += row.direction[1, j] * geometry.pose[i]["rotation"][a, 1]
                direction[a] += row.load[j] * component
    for a in range(3):
        direction[a] = direction[a] / total if total > 0.0 else np.nan


@jitable(fastmath={"contract", "reassoc"})
def detect_slip(count, dt_s, now_ns, model, data):
    """Detect slip of the described contacts and their units.

    Parameters
    ----------
    count : int
        Contacts.
    dt_s : float
        Time since the last call.
    now_ns : int
        Time stamp of the cycle.
    model : NamedTuple
        `geometry` (`pose`, `origin`) and `slip`, a `SlipModel`.
    data : NamedTuple
        Read: `reading` (`force`, `force_sigma`, `displacement`, `displacement_sigma`, each of shape
        (3, n), newton and millimetre, unit frame), `units` (`kind`, `label`, `members`),
        `slots.present`. Kept: `units.slip`, `slip`, a `SlipData`, and the fields of `contacts` that
        belong to slip and friction.
    """
    units, slip = data.units, slip_arrays(data.slip)
    begin_cycle(slip.scratch.noise, dt_s)
    silent = 0  # that were touched, listed in `queue`
    for i in range(units.kind.size):
        if units.slip[i] == UnitSlip.NO_CONTACT:
            continue
        if units.kind[i] == BRIDGE or units.kind[i] == SILENT:
            units.queue[silent] = i
            silent += 1
        elif units.label[i] < 0:
            units.slip[i] = UnitSlip.NO_CONTACT
            slip.kept.anchor_depth[i] = 0.0
    for k in range(count):
        record = data.contacts[data.slots.present[k]]
        if not record["flags"] & WEAK:
            _detect_contact(record, dt_s, now_ns, model, data, units.queue[:silent], slip)
