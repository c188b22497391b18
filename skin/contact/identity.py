"""Contacts with identities that persist through motion, merging and splitting.

A contact keeps its identity while it has units in common with itself a cycle before: clusters are
matched with the slots of the cycle before by the load on common units. Each unit stores the slot
that last owned it. When two contacts merge, the heavier one represents both and the units keep
their owners, so that the parts get their identities back when they separate. When one splits, the
heavier part keeps the identity, as does a contact that is lost and soon returns to its place.

Clusters are units above the gate, joined along the neighbour graph. The gate is a normal load in
sigmas: one that starts a contact, and a smaller one that keeps a unit in it. A unit may start a
contact alone, by the mean of two successive cycles, or together with a neighbour. Shear alone makes
no contact: stray fields read as shear on untouched units.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.model import IN_CONTACT, UNCOUNTED
from skin.contact.record import (
    ABSORBED,
    BORN,
    BRIDGE,
    FREE,
    LOST,
    MERGED,
    NEW,
    OPEN,
    OUT,
    PRESENT,
    RESUMED,
    SILENT,
    SPLIT,
    UNTRACKED,
)

__all__ = ["EARLY", "SAME", "find_contacts", "find_contacts_python", "join", "remember",
           "take_readings"]  # fmt: skip

SAME, EARLY = -1, -2
"""Return values for an unchanged set of contacts, and for a stamp that is not later."""

QUIET = 0.25
"""An absorbed contact represents itself again when its load exceeds the other's fourfold, or when
they part: the representative does not change with every squeeze [assumed]."""
NEARBY = 1e-3
"""Weight of a unit that a contact owns, relative to one that it once owned [assumed]."""
TINY = 1e-200
"""Lower bound of sigma, newton, for numbers without noise."""

# -- clusters --------------------------------------------------------------------------------------


@jitable
def take_readings(readings, model, data):
    """Copy the readings of a cycle into the records of the units, and list the units above the
    gate; returns how many. A unit that is not valid or has a non-finite number is silent; the shear
    of unloaded units is not read.
    """
    settings, cycle, count = model.settings[0], data.cycle[0], 0
    cycle["cycles"] += 1
    for i in range(data.units.size):
        u = data.units[i]
        load, sigma = np.float64(readings.force[2, i]), np.float64(readings.force_sigma[2, i])
        u["force"][2], u["force_sigma"][2] = load, sigma
        data.label[i] = -1
        heard = readings.valid[i] and np.isfinite(load) and 0.0 <= sigma < np.inf
        u["kind"] = OUT
        if heard and load > settings["keep_sigma"] * sigma:
            heard = _take_loaded(i, u, readings, settings["slip"], cycle)
            if heard:
                u["kind"] = OPEN
                data.lists[count]["loaded"] = i
                count += 1
        if not heard:
            u["kind"] = BRIDGE if u["touching"] else SILENT
    return count


@jitable
def _take_loaded(i, u, readings, needs_displacement, cycle):
    """Copy all that is given of one unit above the gate; returns whether what is needed is
    finite."""
    total = 0.0
    for a in range(3):
        u["force"][a] = readings.force[a, i]
        u["force_sigma"][a] = readings.force_sigma[a, i]
        total += abs(u["force"][a]) + abs(u["force_sigma"][a])
        if cycle["has_depth"]:
            u["displacement"][a] = readings.displacement_mm[a, i]
            u["displacement_sigma"][a] = readings.displacement_sigma_mm[a, i]
        if needs_displacement:
            total += abs(u["displacement"][a]) + abs(u["displacement_sigma"][a])
    if cycle["has_field"]:
        u["residue"] = readings.residue_ut2[i]
        for a in range(6):
            u["per_ut"][a] = readings.force_per_ut[a, i]
    u["temperature"] = readings.temperature[i] if cycle["has_temperature"] else np.nan
    # load in sigmas, in this cycle and the one before
    u["level_before"] = u["level"] if u["level_cycle"] == cycle["cycles"] - 1 else -np.inf
    if np.isfinite(total):
        u["level"] = u["force"][2] / max(u["force_sigma"][2], TINY)
        u["level_cycle"] = cycle["cycles"]
    return np.isfinite(total)


@jitable
def _spread(first, part, stored, model, data):
    """Flood-fill a cluster from a unit: its open units go into `members` from `stored` on; returns
    the end of `queue`, which lists all of its units, and of `members`."""
    units, label, lists = data.units, data.label, data.lists
    label[first] = part
    lists[0]["queue"] = first
    head, tail = 0, 1
    while head < tail:
        i = lists[head]["queue"]
        head += 1
        if units[i]["kind"] == OPEN:
            data.members[stored] = i
            stored += 1
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            if label[j] < 0 and (units[j]["kind"] == OPEN or units[j]["kind"] == BRIDGE):
                label[j] = part
                lists[tail]["queue"] = j
                tail += 1
    return tail, stored


@jitable
def _starts(members, model, units):
    """Whether a unit of a cluster starts a contact, alone, with the cycle before or with a
    neighbour; or was in one."""
    settings = model.settings[0]
    alone = settings["start_sigma"]
    twice = np.sqrt(2.0) * settings["repeat_sigma"]
    both = np.sqrt(2.0) * settings["pair_sigma"]
    for i in members:
        u = units[i]
        level = u["level"]
        if u["touching"] or level > alone or level + u["level_before"] > twice:
            return True
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            other = units[j]
            if other["level_cycle"] == u["level_cycle"] and level + other["level"] > both:
                return True
    return False


@jitable
def join(loaded, model, data):
    """Join the units above the gate to clusters.

    Silent units that were in contact connect their neighbours, so that one lost frame does not cut
    a contact in two, but belong to no cluster.

    Parameters
    ----------
    loaded : int
        Listed units.
    model : ContactModel
    data : ContactData

    Returns
    -------
    int
        Number of clusters with a unit that starts a contact or was in one. Units of cluster k are
        ``members[begin[k]:begin[k + 1]]``; `label` is the cluster of each unit, -1.
    """
    units, lists, parts, stored = data.units, data.lists, 0, 0
    lists[0]["begin"] = 0
    for at in range(loaded):
        first = lists[at]["loaded"]
        if units[first]["kind"] != OPEN or data.label[first] >= 0:
            continue
        tail, end = _spread(first, parts, stored, model, data)
        if _starts(data.members[stored:end], model, units):
            parts += 1
            lists[parts]["begin"] = end
            stored = end
            continue
        for k in range(tail):
            i = lists[k]["queue"]
            units[i]["kind"] = OUT if units[i]["kind"] == OPEN else SILENT
            data.label[i] = -1
    return parts


# -- identities ------------------------------------------------------------------------------------


@jitable
def _drop_lightest(parts, data):
    """Remove the lightest cluster, of equal ones the last: its units get the label UNTRACKED and
    come last, so that the next ones move up."""
    units, lists, members = data.units, data.lists, data.members
    lightest, least = 0, np.inf
    for part in range(parts):
        load = 0.0
        for i in members[lists[part]["begin"] : lists[part + 1]["begin"]]:
            load += units[i]["force"][2]
        if load <= least:
            lightest, least = part, load
    begin, end, last = lists[lightest]["begin"], lists[lightest + 1]["begin"], lists[parts]["begin"]
    for at in range(begin, end):
        lists[at]["queue"] = members[at]
        data.label[members[at]] = UNTRACKED
    for at in range(end, last):
        members[at - end + begin] = members[at]
        data.label[members[at]] -= 1
    for at in range(begin, end):
        members[last - end + at] = lists[at]["queue"]
    for part in range(lightest, parts):
        lists[part]["begin"] = lists[part + 1]["begin"] - end + begin


@jitable
def _add(load, part, slot, first, end, data):
    """Add a common load of a cluster, whose pairs begin at `first`, and a slot; returns the end of
    the pairs."""
    at = data.slots[slot]["mark"]
    if at < first:  # of a cluster before, or none
        at = end
        data.slots[slot]["mark"] = at
        pair = data.pairs[at]
        pair["part"], pair["slot"], pair["load"] = part, slot, 0.0
        end += 1
    data.pairs[at]["load"] += load
    return end


@jitable
def _share(parts, begin, nearby, model, data):
    """Pairs of a cluster and a slot that owned units of it in the cycle before, from `begin` on;
    returns their end.

    Where `nearby`, those of clusters that are new and have not split: common load including
    units that a slot owned once, and neighbours of such units.
    """
    units, slots, end = data.units, data.slots, begin
    for slot in range(data.cycle[0]["in_use"]):
        slots[slot]["mark"] = -1
    for part in range(parts):
        if nearby and (slots[part]["slot_of"] >= 0 or slots[part]["parent"] >= 0):
            continue
        first = end
        for i in data.members[data.lists[part]["begin"] : data.lists[part + 1]["begin"]]:
            load, owner = units[i]["force"][2], units[i]["owner"]
            if owner >= 0 and (nearby or units[i]["touching"]):
                end = _add(load, part, owner, first, end, data)
            if not nearby:
                continue
            for j in model.neighbour[model.start[i] : model.start[i + 1]]:
                if units[j]["owner"] >= 0:
                    end = _add(NEARBY * load, part, units[j]["owner"], first, end, data)
    return end


@jitable
def _assign(pairs, track, other, other_worth, contacts, slots):
    """Assign slots in two states to clusters, one to one, greedily by the largest common load, of
    equal ones the first slot; that on units of a slot in the second state is weighted by
    `other_worth`.
    """
    most = 1.0
    while most > 0.0:
        most, part, slot = 0.0, -1, -1
        for pair in pairs:
            if slots[pair["part"]]["slot_of"] >= 0 or slots[pair["slot"]]["part_of"] >= 0:
                continue
            now = contacts[pair["slot"]]["track"]
            weight = 1.0 if now == track else (other_worth if now == other else 0.0)
            worth = weight * pair["load"]
            if worth > most or (worth == most > 0.0 and pair["slot"] < slot):
                most, part, slot = worth, pair["part"], pair["slot"]
        if most > 0.0:
            slots[part]["slot_of"], slots[slot]["part_of"] = slot, part


@jitable
def _disown(contacts, units):
    """Units of slots that are free, or are another contact from now on, have no owner."""
    for i in range(units.size):
        slot = units[i]["owner"]
        if slot >= 0 and (contacts[slot]["track"] == FREE or contacts[slot]["event"] & BORN):
            units[i]["owner"] = -1


@jitable
def _longest_away(contacts, slots):
    """The slot without a cluster that was lost, or absorbed, first."""
    oldest = -1
    for slot in range(slots.size):
        away = slots[slot]["part_of"] < 0 and contacts[slot]["track"] != PRESENT
        if away and (oldest < 0 or contacts[slot]["seen_ns"] < contacts[oldest]["seen_ns"]):
            oldest = slot
    return oldest


@jitable
def _end(parts, count, settle_ns, data):
    """End slots that were present or absorbed and have no cluster: `ended` lists their identities,
    unless the most of their load went into another contact, which absorbs them."""
    slots, contacts, cycle = data.slots, data.contacts, data.cycle[0]
    in_use = cycle["in_use"]
    while in_use > 0 and contacts[in_use - 1]["track"] == FREE:
        in_use -= 1
    for part in range(parts):
        in_use = max(in_use, slots[part]["slot_of"] + 1)
    cycle["in_use"] = in_use
    for slot in range(in_use):
        ends = slots[slot]["part_of"] < 0 and contacts[slot]["track"] in (PRESENT, ABSORBED)
        slots[slot]["most"] = 0.0 if ends else np.inf
        if ends:
            contacts[slot]["into"] = -1
    for at in range(count):
        pair = data.pairs[at]
        slot = pair["slot"]
        if slot < in_use and pair["load"] > slots[slot]["most"]:
            slots[slot]["most"] = pair["load"]
            contacts[slot]["into"] = slots[pair["part"]]["slot_of"]
    for slot in range(in_use):
        record = contacts[slot]
        if slots[slot]["most"] == np.inf:
            continue
        if record["into"] < 0:
            slots[cycle["ended"]]["ended"] = record["id"]
            cycle["ended"] += 1
            record["track"] = LOST
            continue
        if record["track"] == PRESENT:
            if contacts[record["into"]]["track"] == PRESENT:
                contacts[record["into"]]["event"] |= MERGED
            record["track"] = ABSORBED
            if record["seen_ns"] - record["born_ns"] < settle_ns:
                record["track"] = FREE
        if record["track"] == ABSORBED:
            record["seen_ns"] = cycle["now_ns"]


@jitable
def _absorbed_into(contacts, other, slot):
    return contacts[other]["track"] == ABSORBED and contacts[other]["into"] == slot


@jitable
def _own(slot, model, data):
    """Set the owner of a contact's units: those of absorbed slots keep it, new ones take that of
    their heaviest neighbour."""
    units, label, contacts = data.units, data.label, data.contacts
    for i in data.members[contacts[slot]["begin"] : contacts[slot]["end"]]:
        mine = units[i]["owner"]
        if mine >= 0 and (mine == slot or _absorbed_into(contacts, mine, slot)):
            continue
        best, heaviest = slot, 0.0
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            there, load = units[j]["owner"], units[j]["force"][2]
            if label[j] != label[i] or there < 0 or not load > heaviest:
                continue
            if there == slot or _absorbed_into(contacts, there, slot):
                best, heaviest = there, load
        units[i]["owner"] = best


@jitable
def _claim(parts, count, model, data):
    """Assign clusters without a slot: split from a contact, back from the lost, moved, or new."""
    slots, pairs, contacts, cycle = data.slots, data.pairs, data.contacts, data.cycle[0]
    unclaimed = 0
    for part in range(parts):
        slots[part]["parent"], slots[part]["most"] = -1, 0.0
        unclaimed += slots[part]["slot_of"] < 0
    if unclaimed == 0:
        return
    for at in range(count):
        slot, shared = pairs[at]["slot"], pairs[at]["load"]
        part = slots[pairs[at]["part"]]
        if part["slot_of"] >= 0 or slots[slot]["part_of"] < 0:
            continue
        if shared > part["most"] or (shared == part["most"] and slot < part["parent"]):
            part["most"], part["parent"] = shared, slot
    for part in range(parts):
        if slots[part]["parent"] >= 0:
            contacts[slots[part]["parent"]]["event"] |= SPLIT
    end = _share(parts, count, True, model, data)
    _assign(pairs[count:end], LOST, PRESENT, 1.0, contacts, slots)
    vacant = 0
    for part in range(parts):
        if slots[part]["slot_of"] >= 0:
            continue
        while vacant < slots.size and contacts[vacant]["track"] != FREE:
            vacant += 1
        slot = vacant if vacant < slots.size else _longest_away(contacts, slots)
        slots[part]["slot_of"] = slot
        slots[slot]["part_of"] = part
        contacts[slot] = NEW[0]
        record, parent = contacts[slot], slots[part]["parent"]
        cycle["last_id"] += 1
        record["track"], record["event"], record["id"] = PRESENT, BORN, cycle["last_id"]
        record["parent"] = contacts[parent]["id"] if parent >= 0 else 0
        record["born_ns"] = cycle["now_ns"]


@jitable
def _keep(parts, count, model, data):
    """Assign slots to the clusters that go on, by the first `count` pairs; free those of contacts
    that were lost for too long."""
    slots, contacts, cycle = data.slots, data.contacts, data.cycle[0]
    for part in range(parts):
        slots[part]["slot_of"] = -1
    for slot in range(cycle["in_use"]):
        record = contacts[slot]
        slots[slot]["part_of"], record["event"] = -1, 0
        lost_ns = cycle["now_ns"] - record["seen_ns"]
        if record["track"] == LOST and lost_ns > model.settings[0]["memory_ns"]:
            record["track"] = FREE
    _assign(data.pairs[:count], PRESENT, ABSORBED, QUIET, contacts, slots)


@jitable
def _go_on(parts, model, data):
    """Write what has changed of the contacts that have a cluster, and who owns its units."""
    slots, contacts, cycle = data.slots, data.contacts, data.cycle[0]
    for part in range(parts):
        record = contacts[slots[part]["slot_of"]]
        if record["track"] == LOST or record["track"] == ABSORBED:
            record["event"] |= RESUMED
        record["track"], record["into"] = PRESENT, -1
        record["seen_ns"] = cycle["now_ns"]
        record["cycles"] += 1
        record["begin"], record["end"] = data.lists[part]["begin"], data.lists[part + 1]["begin"]
    for part in range(parts):
        _own(slots[part]["slot_of"], model, data)


@jitable
def _order(parts, data):
    """Contacts by age: `present` holds their slots, `label` of a unit counts along it."""
    slots, contacts = data.slots, data.contacts
    for part in range(parts):
        slot, at = slots[part]["slot_of"], part
        while at > 0 and contacts[slots[at - 1]["present"]]["id"] > contacts[slot]["id"]:
            slots[at]["present"] = slots[at - 1]["present"]
            at -= 1
        slots[at]["present"] = slot
    for k in range(parts):
        record = contacts[slots[k]["present"]]
        for i in data.members[record["begin"] : record["end"]]:
            data.label[i] = k


# -- what may be borne unseen ----------------------------------------------------------------------


@jitable
def remember(model, data):
    """Store which units touch, for the next cycle; the upper bounds of heard loads and the largest
    load in contact around them; of units that are not heard, what they may bear. Resets `counted`,
    and, where there is no contact, the slip of the units that are heard."""
    units, keep_sigma, silent = data.units, model.settings[0]["keep_sigma"], 0
    untouched = data.cycle[0]["present"] == 0
    for i in range(units.size):
        u, pressed = units[i], data.label[i] >= 0
        u["counted"] = UNCOUNTED
        u["touching"] = u["kind"] == OPEN or (u["kind"] == BRIDGE and pressed)
        if u["kind"] > OPEN:
            data.label[i] = -1
            silent += 1
            continue
        u["borne"] = max(u["force"][2], keep_sigma * u["force_sigma"][2])
        u["around"] = 0.0
        u["pressed"] = pressed
        if u["kind"] != OUT or pressed:
            u["counted"] = IN_CONTACT
        if untouched:
            data.slip[i] = 0
    for j in data.members[: data.cycle[0]["touching_units"]]:
        load = units[j]["force"][2]
        for i in model.neighbour[model.start[j] : model.start[j + 1]]:
            if units[i]["kind"] <= OPEN and load > units[i]["around"]:
                units[i]["around"] = load
    for i in range(units.size if silent > 0 else 0):
        if units[i]["kind"] > OPEN:
            _bound(i, model, data)


@jitable
def _bound(i, model, data):
    """Square of the upper bound of the load of a silent unit, and whether it may hide a part of a
    contact as far as its neighbours show."""
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
    feels = model.poses[i]["feels"] > 0.0
    u["possible"] = min(most, ceiling) ** 2 if feels else 0.0
    u["hides"] = feels and not (heard and still and u["pressed"] == 0)


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


def find_contacts_python(readings, model, data):
    """Find the contacts of the next cycle, at ``data.cycle["now_ns"]``.

    Parameters
    ----------
    readings : Readings
    model : ContactModel
    data : ContactData
        `units`, `label`, `members` and the identities of `contacts` are written.

    Returns
    -------
    int
        Number of contacts; SAME where they are those of the last call; EARLY where the stamp is not
        later than that, and nothing was done.
    """
    slots, cycle, room = data.slots, data.cycle[0], data.slots.size // 2
    elapsed_s = cycle["period_s"]
    if cycle["begun"]:
        if cycle["now_ns"] <= cycle["last_ns"]:
            return EARLY
        elapsed_s = 1e-9 * (cycle["now_ns"] - cycle["last_ns"])
    cycle["begun"], cycle["last_ns"] = 1, cycle["now_ns"]
    cycle["elapsed_before_s"], cycle["elapsed_s"] = cycle["elapsed_s"], elapsed_s
    before = cycle["present"]
    parts = join(take_readings(readings, model, data), model, data)
    cycle["touching_units"] = data.lists[parts]["begin"]
    cycle["untracked"], cycle["ended"] = max(0, parts - room), 0
    while parts > room:
        _drop_lightest(parts, data)
        parts -= 1
    if parts > 0 or before > 0:
        count = _share(parts, 0, False, model, data)
        _keep(parts, count, model, data)
        _claim(parts, count, model, data)
        _end(parts, count, model.settings[0]["settle_ns"], data)
        _disown(data.contacts, data.units)
        _go_on(parts, model, data)
        _order(parts, data)
    cycle["present"] = parts
    remember(model, data)
    same = parts == before
    for k in range(parts):
        same &= slots[k]["before"] == slots[k]["present"]
        slots[k]["before"] = slots[k]["present"]
    return SAME if same else parts


find_contacts = compiled(find_contacts_python, fastmath={"contract"}, allocates=False)
