"""What a wrench leaves out: loads below the gate, and possible loads of silent units.

They count as errors, whose root mean square is in the sigmas: the rules are in
docs/explanation/derivations.md, "What a wrench leaves out".
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import OPEN, OUT, UNSEEN, UNTOUCHED
from skin.contact.shape import add_first, add_second, beside, swept
from skin.contact.wrench import total_wrench

__all__ = [
    "add_apart", "add_light", "add_missed", "add_silent", "clear", "nothing_touches", "remember",
]  # fmt: skip

OPEN_TO_ALL, TAKEN = -1, -2
"""Marks a neighbour of contacts: in no sum yet; excluded."""


@jitable
def remember(model, data):
    """Store the upper bounds of heard loads, and the largest load in contact around them, and mark
    the units with light loads: heard, and in no contact. Returns how many units are not heard."""
    units, keep_sigma, silent = data.units, model.settings[0]["keep_sigma"], 0
    for i in range(units.size):
        u = units[i]
        if u["kind"] > OPEN:
            u["counted"] = TAKEN
            silent += 1
            continue
        u["borne"] = max(u["force"][2], keep_sigma * u["force_sigma"][2])
        u["around"] = 0.0
        u["pressed"] = data.label[i] >= 0
        u["counted"] = OPEN_TO_ALL if u["kind"] == OUT and data.label[i] < 0 else TAKEN
    for j in data.members[: data.cycle[0]["touching_units"]]:
        load = units[j]["force"][2]
        for i in model.neighbour[model.start[j] : model.start[j + 1]]:
            if units[i]["kind"] <= OPEN and load > units[i]["around"]:
                units[i]["around"] = load
    return silent


@jitable
def _count_light(u, pose, sign, s):
    """Add the load below the gate of a unit, or with a sign of -1 remove it."""
    load, variance = sign * u["force"][2], sign * u["force_sigma"][2] ** 2
    s["light_units"] += sign
    s["light"] += load
    s["light_variance"] += variance
    add_first(s["light_position"], load, pose["position"])
    add_first(s["light_variance_position"], variance, pose["position"])
    add_second(s["light_variance_square"], variance, pose["position"])


@jitable
def add_light(k, total, members, model, data):
    """Add the loads below the gate of the neighbours to row k, each once: their readings are
    unbiased, since none is selected by its load.

    `counted` holds the last row that counted each unit, `OPEN_TO_ALL` before the first, and `TAKEN`
    for other units. Row `total`, to which all rows are added later, gets the correction that makes
    it count each unit once.
    """
    for i in members:
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            u, counted = data.units[j], data.units[j]["counted"]
            if counted == TAKEN or counted == k:  # noqa: PLR1714
                continue
            _count_light(u, model.poses[j], 1.0, data.sums[k])
            if counted >= 0:
                _count_light(u, model.poses[j], -1.0, data.sums[total])
            u["counted"] = k


@jitable
def add_missed(s, keep_sigma):
    """Add the neighbours' loads below the gate, which are in no wrench, to the covariance of a
    contact.

    Their most likely sum is that of their readings, or 0 where noise makes it negative; it acts at
    these units. The gate leaves out so many sigmas of a unit at least, which act at any of them.
    Both act along the force of the contact, since the same body presses all [assumed].

    Parameters
    ----------
    s : SUMS
    keep_sigma : float
    """
    load, variance, triangle = s["load"], s["light_variance"], s["wrench_covariance"]
    if not (load > 0.0 and s["light_units"] > 0.0):
        return
    likely = max(s["light"], 0.0)
    least = keep_sigma * keep_sigma * variance / s["light_units"] - likely * likely
    share = least / variance if least > 0.0 else 0.0
    s["missed"] += likely * likely + share * variance
    turned = 1.0 if likely > 0.0 else 0.0
    along = s["wrench"][0] / load, s["wrench"][1] / load, s["wrench"][2] / load
    place, spread = s["light_position"], s["light_variance_position"]
    here, there = beside(along, place), beside(along, spread)
    torque, row = swept(s["light_variance_square"], along), 0
    for a in range(3):
        for b in range(a, 3):
            triangle[row] += (share * variance + likely * likely) * along[a] * along[b]
            row += 1
        for b in range(3):
            triangle[row] -= along[a] * (share * there[b] + likely * here[b])
            row += 1
    last = 0
    for a in range(3):
        for b in range(a, 3):
            triangle[row + last] += share * torque[last] + turned * here[a] * here[b]
            last += 1


@jitable
def _is_new(i, at, label, model):
    """Whether the neighbour at this place is the first of unit i with its label."""
    for before in range(model.start[i], at):
        if label[model.neighbour[before]] == label[model.neighbour[at]]:
            return False
    return True


@jitable
def _not_centred(i, model, data):
    """Whether the loads in contact around a unit do not all fall with the distance from it."""
    neighbour, start, label, units = model.neighbour, model.start, data.label, data.units
    around, keep_sigma = neighbour[start[i] : start[i + 1]], model.settings[0]["keep_sigma"]
    for near in around:
        if label[near] < 0:
            continue
        for far in neighbour[start[near] : start[near + 1]]:
            beyond, u = label[far] >= 0, units[far]
            for other in around:
                beyond &= far != other
            most = u["force"][2] + keep_sigma * u["force_sigma"][2]
            if beyond and most >= units[near]["force"][2]:
                return True
    return False


@jitable
def _bound(i, model, data):
    """Upper bound of the load of a silent unit, N, and whether it is free of contacts as far as its
    neighbours show."""
    u, now, noise, heard = data.units[i], 0.0, 0.0, False
    known, before = u["borne"] == u["borne"], u["around"]
    most = u["borne"] if known else -1.0
    for j in model.neighbour[model.start[i] : model.start[i + 1]]:
        other = data.units[j]
        if other["kind"] > OPEN:
            continue
        heard = True
        if data.label[j] >= 0 and other["force"][2] > now:
            now, noise = other["force"][2], other["force_sigma"][2]
        elif not known and other["borne"] == other["borne"]:
            most = max(most, other["borne"])
    ceiling = model.poses[i]["most"]
    changed = abs(now - before)
    if now > 0.0 and before > 0.0:
        most = most * max(1.0, now / before) + changed
    elif now > 0.0:
        bounded = _not_centred(i, model, data) or not np.isfinite(ceiling)
        most = max(most, now) if bounded else ceiling
    elif most < 0.0:
        most = ceiling if np.isfinite(ceiling) else 0.0
    # each of two readings may be off by the gate
    gate = 2.0 * model.settings[0]["keep_sigma"] * noise
    still = now == 0.0 or (before > 0.0 and changed <= gate)
    return min(most, ceiling), heard and still and u["pressed"] == 0


@jitable
def _add(s, p, variance):
    """Add a possible load of a unit at p, in any direction."""
    s["unseen"] += variance
    add_first(s["unseen_position"], variance, p)
    add_second(s["unseen_square"], variance, p)


@jitable
def add_apart(s, touched, model, data):
    """Add to the total what heard units may bear that are neither in contact nor next to one, and
    the even load that their zeros may hide.

    Comes after `add_light`.

    Parameters
    ----------
    s : SUMS
    touched : bool
        Whether there is any contact.
    model : ContactModel
    data : ContactData
    """
    poses, keep_sigma = model.poses, model.settings[0]["keep_sigma"]
    total, variance, most, lone = 0.0, 0.0, 0.0, -1
    for i in range(data.units.size):
        u = data.units[i]
        load, sigma = u["force"][2], u["force_sigma"][2]
        if poses[i]["doubt"] > 0.0:
            _add(s, poses[i]["position"], poses[i]["doubt"])
        if u["counted"] != OPEN_TO_ALL or not sigma < np.inf:
            continue
        total, variance = total + load, variance + sigma * sigma
        gate = keep_sigma * sigma
        if max(load, gate) > most and (not touched or load > gate):
            most, lone = max(load, gate), i
    square = 0.0 if touched else max(most * most, variance)
    if total > 0.0 and (not touched or total * total > keep_sigma * keep_sigma * variance):
        square = max(square, total * total)
    if touched and most * most > square:
        _add(s, poses[lone]["position"], most * most)
    elif square > 0.0 and variance > 0.0:
        for i in range(data.units.size):
            sigma = data.units[i]["force_sigma"][2]
            if data.units[i]["counted"] == OPEN_TO_ALL and sigma < np.inf:
                _add(s, poses[i]["position"], square / variance * sigma * sigma)


@jitable
def add_silent(count, model, data):
    """Add the area and the possible load of silent units to the contacts next to them, once each,
    and to the total, the row after the next of `count`, which is complete but for these."""
    label, poses, whole = data.label, model.poses, data.sums[count + 1]
    for i in range(data.units.size):
        if data.units[i]["kind"] <= OPEN:
            continue
        felt, place, variance, hidden = poses[i]["feels"] > 0.0, poses[i]["position"], 0.0, 0.0
        if felt:
            most, seen = _bound(i, model, data)
            variance, hidden = most * most, 0.0 if seen else 1.0
            _add(whole, place, variance)
            whole["hidden"] = max(whole["hidden"], hidden)
        for at in range(model.start[i], model.start[i + 1]):
            k = label[model.neighbour[at]]
            if k < 0 or not _is_new(i, at, label, model):
                continue
            s = data.sums[k]
            s["silent_area"] += poses[i]["area"]
            whole["silent_area"] += poses[i]["area"]
            if felt:
                _add(s, place, variance)
                s["hidden"] = max(s["hidden"], hidden)


@jitable
def clear(k, data):
    """Reset a row of the sums."""
    data.columns[k, :] = 0.0
    data.sums[k]["peak_unit"] = data.sums[k]["hot_unit"] = -1.0


@jitable
def nothing_touches(silent, model, data):
    """The total without contacts: only what heard and silent units may bear."""
    last = data.contacts.size - 1
    data.contacts[last] = UNTOUCHED[0]
    record, s = data.contacts[last], data.sums[1]
    clear(1, data)
    add_apart(s, False, model, data)
    if silent > 0:
        add_silent(0, model, data)
    total_wrench(s, record, model.settings[0]["origin"])
    record["load_sigma"] = np.sqrt(s["unseen"])
    if s["hidden"] > 0.0:
        record["flags"] |= UNSEEN
