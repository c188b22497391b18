"""State of slip: the record of each unit, and stick or slip of units and contact, with hysteresis.

All displacements are in millimetres and in the tangent plane of each unit.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import BORN, SlipState, UnitSlip
from skin.contact.slip.parameters import LEAST_UNITS, PARAMETERS, PATTERNS

__all__ = [
    "MEMBER",
    "MOTIONS",
    "NUISANCES",
    "PLANE",
    "SLIP",
    "SLIP_UNIT",
    "begin_contact",
    "count_slipping",
    "decide_contact",
    "decide_units",
    "is_kept",
    "misses_units",
    "still_slides",
]  # fmt: skip

MOTIONS, PLANE = 6, 3
"""Motions of a body: along both axes of the contact and about its normal (the first three, in the
plane); where the skin is curved, along the normal and about the two axes."""
NUISANCES = MOTIONS + 2
"""Nuisance parameters: those; a common gain error of all units; soft ground."""

_F, _L = np.float64, np.int64
SLIP_UNIT = np.dtype(
    [
        # while its contact lasts
        ("anchor", _F, (2,)),  # displacement without motion of the body
        ("anchor_variance", _F),
        ("anchor_depth", _F),  # depth, low-passed as the anchor
        ("lag", _F, (2,)),  # behind the body, low-passed
        ("lag_variance", _F),
        ("lag_mean", _F, (2,)),  # of the lag over `rest_s`
        ("behind", _F, (2,)),  # lag in the last cycle, not low-passed
        ("moved", _F, (2,)),  # displacement predicted by the body's motion
        ("moved_slow", _F, (2,)),  # the same, low-passed as the lag is
        ("followed", _F, (2,)),  # the part that the anchor has followed
        ("followed_out", _F, (2,)),  # the part of that by motions out of the contact's plane
        ("gain_error", _F),  # relative error of the displacement since anchoring
        ("gain_information", _F),  # inverse variance of that
        ("age_s", _F),  # time since it was anchored
        ("body", _L),  # identity of the contact that it is anchored to
        ("began", _L),  # identity of the contact whose last slip began here
        ("mean_lag", _F, (2,)),  # of a slipping unit: mean over the last interval
        ("lag_sum", _F, (2,)),  # sum over this interval
        ("lag_cycles", _F),  # length of this interval
        ("sliding_s", _F),  # remaining time for which it counts as sliding
        ("slid_shear", _F),  # sum of the forces along its slip in this contact
        ("slid_load", _F),  # sum of the loads
        ("slid_variance", _F),  # sum of the variances of shear less friction times load
        ("borne", _F),  # largest friction that it has borne in this contact without slip
        # for longer
        ("noise_ratio", _F),  # variance of the noise over sigma squared; 0 before contact
        ("noise_sum", _F),  # sum of squared noise over sigma squared
        ("noise_count", _F),  # number of terms in it
        ("slow_sum", _F),  # sum of squared lags beyond their variance, over sigma squared
        ("noisy", _F),  # 1 where its noise is greater than sigma says
        # scratch of a cycle
        ("held", _F),  # 1 where it sticks and is anchored to this body
        ("new", _F),  # 1 where it has just come into contact
        ("joined", _F),  # 1 where it was anchored to another body
        ("in_pattern", _F),  # 1 where it slips in the likeliest pattern
        ("load", _F),  # N
        ("deeper", _F),  # depth beyond that at its anchor
        ("reported", _F),  # variance of its displacement by sigma
        ("noise", _F),  # its measured variance
        ("wander", _F),  # variance of its slow noise over sigma squared
        ("weight", _F),  # in the fit; later, inverse variance of the lag
        ("root_weight", _F),  # of the lag, where it is held
        ("body_variance", _F),  # mm², of the predicted displacement
        ("now", _F, (2,)),  # displacement predicted by the motion of the body
        ("moved_out", _F, (2,)),  # of `now`, due to motions out of the plane
        ("imposed", _F),  # displacement predicted by the body's motion
        ("direction", _F, (2,)),  # of `imposed`
        ("square_distance", _F),  # from the centre, in sizes of the contact
        ("innovation2", _F),  # squared innovation of the reading
        ("step2", _F),  # squared change of `behind` since the last cycle
        ("residual", _F),  # lag in sigmas, nuisances removed
        ("redundancy", _F),  # fraction of its own lag that they leave
        ("slip_score", _F),  # its own lag along `direction`, in sigmas
        ("predicted_lag", _F),  # by a pattern of slip, in sigmas
        ("design", _F, (2, NUISANCES)),  # by each motion; later, orthonormal nuisance basis
        ("nuisance", _F, (NUISANCES,)),  # that basis along `direction`
    ],
    align=True,
)
"""What the detector of slip knows of a unit."""

SLIP = np.dtype(
    [
        # Noise of all units: sums over sigma squared, each with its number of terms, kept.
        ("lags", _F),  # squared lags
        ("lag_count", _F),
        ("readings", _F),  # innovations
        ("reading_count", _F),
        ("steps", _F),  # changes of innovations from cycle to cycle, over `memory_s`
        ("step_count", _F),
        ("recent", _F),  # the same over `slow_s`
        ("recent_count", _F),
        ("slow", _F),  # what is beyond the variance of lags
        ("slow_count", _F),
        ("lag_ratio", _F),  # means of these: of lags
        ("reading_ratio", _F),  # of innovations
        ("wander", _F),  # of slow noise
        ("growth", _F),  # recent changes over those of before
        # scratch of one contact
        ("axes", _F, (3, 3)),  # rows: major, minor, normal of the contact
        ("centre", _F, (3,)),  # m, about the middle of the array
        ("equations", _F, (MOTIONS, MOTIONS + 1)),  # normal equations, right side last
        ("placement_equations", _F, (MOTIONS, MOTIONS + 1)),  # of motions out of the plane
        ("motion", _F, (MOTIONS,)),  # mm at the contact's size
        ("placement", _F, (MOTIONS,)),
        ("prior", _F, (NUISANCES, NUISANCES)),  # rows of the prior of the nuisance basis
        ("evidence", _F, (PATTERNS,)),  # log-odds against no slip
        ("slipping", _F, (PATTERNS,)),  # fraction of the load that slips
    ],
    align=True,
)
"""What it knows of all units together, and of the contact at hand; one record."""


MEMBER = np.dtype([("began", _L), ("noise_ratio", _F), ("noisy", _F)])
"""Slip of a unit of a contact; see `SLIP_UNIT`."""


@jitable
def begin_contact(record, members, data):
    """Reset a new contact, but for the state of the one that it split from; a resumed one keeps its
    friction, and its state if that is recent and its units were silent and not lifted."""
    lifted = True
    for i in members:
        if record["event"] & BORN and record["parent"] == 0:
            data.slip[i] = UnitSlip.NO_CONTACT
        lifted &= data.slip[i] == UnitSlip.NO_CONTACT
    if record["event"] & BORN:
        record["decided_ns"] = 0
        record["friction_information"] = record["friction_mean"] = 0.0
        record["friction_spread"] = record["friction_lower"] = 0.0
        for parent in data.contacts:
            if record["parent"] > 0 and parent["id"] == record["parent"]:
                record["slip"], record["onset_ns"] = parent["slip"], parent["onset_ns"]
                record["stick_ratio"] = parent["stick_ratio"]
                record["gross_ns"] = parent["gross_ns"]
                record["gross_ratio"] = parent["gross_ratio"]
                record["decided_ns"] = parent["decided_ns"]
    if lifted or not _is_recent(record, data.cycle[0]["now_ns"]):
        record["slip"] = SlipState.UNKNOWN
        record["onset_ns"] = 0


@jitable
def decide_units(members, alarm, floor_mm, data):
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
def count_slipping(members, data):
    """Number of slipping units and the load on them; new units stick."""
    slipping, load_slipping = 0, 0.0
    for i in members:
        if data.slip[i] == UnitSlip.NO_CONTACT:
            data.slip[i] = UnitSlip.STICK
        elif data.slip[i] == UnitSlip.SLIPPING:
            slipping += 1
            load_slipping += data.slips[i]["load"]
    return slipping, load_slipping


@jitable
def _is_recent(record, now_ns):
    """Whether its state was decided so recently that its units could not have come to rest."""
    return (now_ns - record["decided_ns"]) * 1e-9 < PARAMETERS.rest_s


@jitable
def misses_units(record, silent, data):
    """Whether units are silent that were in this contact when last heard; the first `silent` units
    of the queue are all that were touched."""
    for at in range(silent):
        if data.slips[data.lists[at]["queue"]]["body"] == record["id"]:
            return True
    return False


@jitable
def is_kept(record, misses, tested, now_ns):
    """Whether the state of the contact is kept for want of units: in gross slip, where what is
    heard of a face uses another friction than all of it, or where too few are heard for a test."""
    short = record["slip"] == SlipState.GROSS or tested < LEAST_UNITS
    return misses and short and _is_recent(record, now_ns)


@jitable
def still_slides(record, ratio, misses, cycle):
    """Whether gross slip continues: sliding faces use all of their friction, no more and no less;
    their slip is not detected otherwise. A face that `misses` units is not averaged."""
    if (cycle["now_ns"] - record["gross_ns"]) * 1e-9 < PARAMETERS.rest_s:
        share = 0.0 if misses else min(1.0, cycle["elapsed_s"] / PARAMETERS.slow_s)
        record["gross_ratio"] += share * (ratio - record["gross_ratio"])
        return True
    least = 1.0 - PARAMETERS.outlier_sigmas * PARAMETERS.friction_spread
    return least * record["gross_ratio"] < ratio < record["gross_ratio"] / least


@jitable
def decide_contact(record, members, tested, ratio, settings, data):
    """State of the contact from its stick ratio; see derivations.md. `ratio` is the used friction,
    `tested` the number of tested units."""
    now_ns = data.cycle[0]["now_ns"]
    before, state = record["slip"], _state(record, settings, tested)
    if state >= SlipState.INCIPIENT and before < SlipState.INCIPIENT:
        record["onset_ns"] = now_ns
        for i in members:
            if data.slip[i] == UnitSlip.SLIPPING or data.slips[i]["in_pattern"] > 0.0:
                data.slips[i]["began"] = record["id"]
    elif state < SlipState.INCIPIENT:
        record["onset_ns"] = 0
    if state == SlipState.GROSS and before != SlipState.GROSS:
        record["gross_ns"] = now_ns
        record["gross_ratio"] = ratio
    record["slip"] = state
    record["decided_ns"] = now_ns


@jitable
def _state(record, settings, tested):
    """State of the contact by this cycle alone, without hysteresis."""
    before, stick = record["slip"], record["stick_ratio"]
    if tested < LEAST_UNITS and not np.isfinite(record["margin"]):
        return SlipState.UNKNOWN
    few = tested - record["slip_units"] < LEAST_UNITS
    if stick < settings["gross_ratio"] or (few and record["margin"] < 0.0):
        return SlipState.GROSS
    leave = 0.5 + 0.5 * settings["incipient_ratio"]
    slips = stick < settings["incipient_ratio"]
    slips = slips or (before == SlipState.INCIPIENT and stick < leave)
    # Where all units slide alike there are no lags: only the cone can show it. Friction learned by
    # an alarm does not count: a false alarm would cause further ones.
    unknown = not record["friction_information"] > 0.0
    used_up = unknown and record["margin"] < 0.0
    return SlipState.INCIPIENT if slips or used_up else SlipState.STICK
