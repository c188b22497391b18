"""Stick or slip of each unit, and the state of the contact, with hysteresis."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import BORN, SlipState, UnitSlip
from skin.contact.slip.data import SlipArrays, UnitFilter, UnitHistory, UnitRows
from skin.contact.slip.parameters import LEAST_UNITS, PARAMETERS, SlipModel

__all__ = [
    "begin_contact", "count_slipping", "decide_contact", "decide_units", "is_kept", "misses_units",
    "still_slides",
]  # fmt: skip


@jitable(inline=True)
def begin_contact(record, contacts, units, now_ns):
    """Reset a new contact, but for the state of the one that it split from; a resumed one keeps its
    friction, and its state if that is recent and its units were silent and not lifted."""
    lifted = True
    for at in range(record["begin"], record["end"]):
        i = units.members[at]
        if record["event"] & BORN and record["parent"] == 0:
            units.slip[i] = UnitSlip.NO_CONTACT
        lifted &= units.slip[i] == UnitSlip.NO_CONTACT
    if record["event"] & BORN:
        record["decided_ns"] = 0
        record["friction_information"] = 0.0
        record["friction_mean"] = 0.0
        record["friction_spread"] = 0.0
        record["friction_lower"] = 0.0
        for slot in range(contacts.size):
            parent = contacts[slot]
            if record["parent"] > 0 and parent["id"] == record["parent"]:
                record["slip"], record["onset_ns"] = parent["slip"], parent["onset_ns"]
                record["stick_ratio"] = parent["stick_ratio"]
                record["gross_ns"] = parent["gross_ns"]
                record["gross_ratio"] = parent["gross_ratio"]
                record["decided_ns"] = parent["decided_ns"]
    if lifted or not _is_recent(record, now_ns):
        record["slip"] = SlipState.UNKNOWN
        record["onset_ns"] = 0


@jitable(inline=True)
def decide_units(record, units, dt_s, alarm, model: SlipModel, slip: SlipArrays):
    """Stick or slip of each unit of a contact, at log-odds of `alarm` and the number of units."""
    state, first, row = units.slip, record["begin"], slip.scratch.row
    count = record["end"] - first
    least = 2.0 * (alarm + np.log(count))
    for j in range(count):
        i = units.members[first + j]
        if state[i] == UnitSlip.NO_CONTACT:
            state[i] = UnitSlip.STICK
        elif state[i] == UnitSlip.SLIPPING:
            if _comes_to_rest(slip.history, i, slip.scratch.unit, row.noise[j], j, dt_s, model):
                state[i] = UnitSlip.RE_STICK
        elif row.slip_score[j] > 0.0 and row.slip_score[j] ** 2 > least:
            state[i] = UnitSlip.SLIPPING
            _begin_slip(slip.history, i)
        row.held[j] = 1.0 if state[i] != UnitSlip.SLIPPING else 0.0


@jitable(inline=True)
def _begin_slip(history: UnitHistory, i):
    for c in range(2):
        history.mean_lag[c, i] = 0.0
        history.lag_sum[c, i] = 0.0
    history.lag_cycles[i] = 0.0
    history.sliding_s[i] = PARAMETERS.rest_s


@jitable(inline=True)
def _comes_to_rest(history: UnitHistory, i, unit: UnitFilter, noise, j, dt_s, model: SlipModel):
    """Whether a slipping unit sticks again: its lag no longer grows."""
    mean, total = history.mean_lag, history.lag_sum
    history.sliding_s[i] -= dt_s
    total[0, i] += unit.lag[0, j]
    total[1, i] += unit.lag[1, j]
    history.lag_cycles[i] += 1.0
    cycles = history.lag_cycles[i]
    if cycles * dt_s < PARAMETERS.rest_s:
        return False
    mean_x, mean_y = total[0, i] / cycles, total[1, i] / cycles
    further = (mean_x - mean[0, i]) ** 2 + (mean_y - mean[1, i]) ** 2
    variance = noise / cycles
    if further > PARAMETERS.outlier_sigmas**2 * 2.0 * (variance + model.floor_mm**2):
        mean[0, i], mean[1, i] = mean_x, mean_y
        history.sliding_s[i] = cycles * dt_s
        total[0, i], total[1, i], history.lag_cycles[i] = 0.0, 0.0, 0.0
        return False
    unit.anchor[0, j] += mean_x
    unit.anchor[1, j] += mean_y
    unit.anchor_variance[j] = variance
    unit.lag[0, j] -= mean_x
    unit.lag[1, j] -= mean_y
    return True


@jitable(inline=True)
def count_slipping(record, units, row: UnitRows):
    """Number of slipping units and the load on them; new units stick."""
    slipping, load_slipping, first = 0, 0.0, record["begin"]
    for j in range(record["end"] - first):
        i = units.members[first + j]
        if units.slip[i] == UnitSlip.NO_CONTACT:
            units.slip[i] = UnitSlip.STICK
        elif units.slip[i] == UnitSlip.SLIPPING:
            slipping += 1
            load_slipping += row.load[j]
    return slipping, load_slipping


@jitable(inline=True)
def _is_recent(record, now_ns):
    """Whether its state was decided so recently that its units could not have come to rest."""
    return (now_ns - record["decided_ns"]) * 1e-9 < PARAMETERS.rest_s


@jitable(inline=True)
def misses_units(record, silent, history: UnitHistory):
    """Whether units are silent that were in this contact when last heard; `silent` lists all that
    were touched."""
    misses = False
    for i in silent:
        misses |= history.body[i] == record["id"]
    return misses


@jitable(inline=True)
def is_kept(record, misses, tested, now_ns):
    """Whether the state of the contact is kept for want of units: in gross slip, where what is
    heard of a face uses another friction than all of it, or where too few are heard for a test."""
    short = record["slip"] == SlipState.GROSS or tested < LEAST_UNITS
    return misses and short and _is_recent(record, now_ns)


@jitable(inline=True)
def still_slides(record, ratio, misses, now_ns, dt_s):
    """Whether gross slip continues: sliding faces use all of their friction, no more and no less;
    their slip is not detected otherwise. A face that `misses` units is not averaged."""
    if (now_ns - record["gross_ns"]) * 1e-9 < PARAMETERS.rest_s:
        share = 0.0 if misses else min(1.0, dt_s / PARAMETERS.slow_s)
        record["gross_ratio"] += share * (ratio - record["gross_ratio"])
        return True
    least = 1.0 - PARAMETERS.outlier_sigmas * PARAMETERS.friction_spread
    return least * record["gross_ratio"] < ratio < record["gross_ratio"] / least


@jitable(inline=True)
def decide_contact(record, units, now_ns, tested, ratio, model: SlipModel, slip: SlipArrays):
    """State of the contact from its stick ratio; see derivations.md. `ratio` is the used friction,
    `tested` the number of tested units."""
    before, state = record["slip"], _state(record, model, tested)
    if state >= SlipState.INCIPIENT and before < SlipState.INCIPIENT:
        record["onset_ns"] = now_ns
        row, first = slip.scratch.row, record["begin"]
        for j in range(record["end"] - first):
            i = units.members[first + j]
            if units.slip[i] == UnitSlip.SLIPPING or row.in_pattern[j] > 0.0:
                slip.history.began[i] = record["id"]
    elif state < SlipState.INCIPIENT:
        record["onset_ns"] = 0
    if state == SlipState.GROSS and before != SlipState.GROSS:
        record["gross_ns"] = now_ns
        record["gross_ratio"] = ratio
    record["slip"] = state
    record["decided_ns"] = now_ns


@jitable(inline=True)
def _state(record, model: SlipModel, tested):
    """State of the contact by this cycle alone, without hysteresis."""
    before, stick = record["slip"], record["stick_ratio"]
    if tested < LEAST_UNITS and not np.isfinite(record["margin"]):
        return SlipState.UNKNOWN
    few = tested - record["slip_units"] < LEAST_UNITS
    if stick < model.gross_ratio or (few and record["margin"] < 0.0):
        return SlipState.GROSS
    leave = 0.5 + 0.5 * model.incipient_ratio
    slips = stick < model.incipient_ratio or (before == SlipState.INCIPIENT and stick < leave)
    # Where all units slide alike there are no lags: only the cone can show it. Friction learned by
    # an alarm does not count: a false alarm would cause further ones.
    unknown = not record["friction_information"] > 0.0
    used_up = unknown and record["margin"] < 0.0
    return SlipState.INCIPIENT if slips or used_up else SlipState.STICK
