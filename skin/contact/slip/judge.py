"""The stage that judges slip; the order of its calls is that of docs/derivations.md."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import BORN, BRIDGE, RESUMED, SILENT, WEAK, SlipState, UnitSlip
from skin.contact.slip.data import MOTIONS, PLANE, SlipArrays, slip_arrays
from skin.contact.slip.friction import friction_margin, learn_friction
from skin.contact.slip.parameters import PARAMETERS, SlipModel
from skin.contact.slip.pattern_test import detect_pattern, project_nuisances
from skin.contact.slip.rigid_fit import contact_frame, fit_motion
from skin.contact.slip.state_machine import (
    begin_contact,
    count_slipping,
    decide_contact,
    decide_units,
    slides_still,
)
from skin.contact.slip.unit_filter import correct, gather, lowpass_share, predict, scatter

__all__ = ["judge"]


class _Rates(NamedTuple):
    """Shares by which low-passes follow in this cycle."""

    slow: float  # lags, where the body is slow
    fast: float  # lags, where it is fast
    recent: float  # the recent motion


@jitable(inline=True)
def _rates(dt_s, model: SlipModel):
    radians = -2.0 * np.pi * dt_s
    slow = 1.0 - np.exp(radians * model.lowpass_hz)
    fast = 1.0 - np.exp(radians * max(PARAMETERS.fast_hz, model.lowpass_hz))
    return _Rates(slow, fast, 1.0 - np.exp(-dt_s / PARAMETERS.recent_s))


@jitable(inline=True)
def _judge_lags(record, dt_s, rates, geometry, model: SlipModel, reading, units, slip: SlipArrays):
    """Judge units by their lags behind the body's motion.

    Writes motion and rotation of the body; returns how many units judge, the share of the load
    that sticks by the pattern test, and the sigmas of the pattern.
    """
    scratch = slip.scratch
    unit, row, fit = scratch.unit, scratch.row, scratch.fit
    flat = contact_frame(record, units.members, reading.force, geometry, fit)
    size = max(record["arm"], PARAMETERS.least_arm_m)
    motions = PLANE if flat else MOTIONS
    length, stuck, known = gather(record, reading, units, geometry, size, motions, slip)
    if stuck < PARAMETERS.units_for_turn:
        motions = 2
    fit.motion[:] = 0.0
    out_of_plane = PARAMETERS.placement_mm
    if stuck:
        out_of_plane = fit_motion(length, stuck, motions, model, unit, row, fit)
    share = lowpass_share(length, motions, stuck, rates, unit, row, fit.motion)
    predict(length, motions, share, rates.recent, model, unit, row, fit.motion)
    judging, sticks, pattern = 0, 1.0, 0.0
    if record["slip"] == SlipState.GROSS:
        judging = record["end"] - record["begin"]
    elif known >= PARAMETERS.least_units:
        judging = record["end"] - record["begin"]
        nuisances = project_nuisances(
            length, motions, stuck, out_of_plane, model, unit, row, scratch.pattern.prior
        )
        haste = (share - rates.slow) / max(rates.fast - rates.slow, 1e-9)
        sticks, pattern = detect_pattern(
            record, units.members, reading.force, length, nuisances, haste, model, scratch
        )
        decide_units(record, units, dt_s, model, slip)
        correct(length, dt_s, model, unit, row)
    for c in range(3):
        record["motion"][c] = fit.axes[0, c] * fit.motion[0] + fit.axes[1, c] * fit.motion[1]
        record["rotation"][c] = fit.axes[2, c] * fit.motion[2] * 1e-3 / size
    return judging, sticks, pattern


@jitable(inline=True)
def _judge_contact(record, dt_s, now_ns, rates, model, reading, units, slip: SlipArrays):
    """Judge one contact and its units."""
    first, last = record["begin"], record["end"]
    if record["event"] & (BORN | RESUMED):
        begin_contact(record)
    judging, sticks, pattern = _judge_lags(
        record, dt_s, rates, model.geometry, model.slip, reading, units, slip
    )
    slipping, load_slipping = count_slipping(record, units, slip.scratch.row)
    scatter(first, last - first, units.members, slip.scratch.unit, slip.kept)
    record["slip_units"] = slipping
    record["body_units"] = judging
    record["pattern"] = pattern
    record["stick_ratio"] = min(sticks, 1.0 - load_slipping / record["load"])
    learn_friction(record, reading, units, slip.history, now_ns, dt_s)
    ratio = friction_margin(record, model.slip)
    if record["slip"] != SlipState.GROSS or judging < PARAMETERS.least_units:
        decide_contact(record, model.slip, now_ns, judging, ratio)
    elif not slides_still(record, ratio, now_ns, dt_s):
        record["slip"] = SlipState.STICK
        record["onset_ns"] = 0
        for at in range(first, last):
            units.slip[units.members[at]] = UnitSlip.NO_CONTACT


@jitable(fastmath={"contract", "reassoc"})
def judge(count, dt_s, now_ns, model, data):
    """Judge the units of the contacts that have been described.

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
    units = data.units
    for i in range(units.kind.size):
        if (
            units.slip[i] != UnitSlip.NO_CONTACT
            and units.label[i] < 0
            and units.kind[i] != BRIDGE
            and units.kind[i] != SILENT
        ):
            units.slip[i] = UnitSlip.NO_CONTACT
    rates, slip = _rates(dt_s, model.slip), slip_arrays(data.slip)
    for k in range(count):
        record = data.contacts[data.slots.present[k]]
        if not record["flags"] & WEAK:
            _judge_contact(record, dt_s, now_ns, rates, model, data.reading, units, slip)
