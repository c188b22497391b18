"""Contacts with identities that persist through motion, merging and splitting.

A contact keeps its identity while it has units in common with itself a cycle before: clusters are
matched with the slots of the cycle before by the load on common units. Each unit stores the slot
that last owned it. When two contacts merge, the heavier one represents both and the units keep
their owners, so that the parts get their identities back when they separate. When one splits, the
heavier part keeps the identity, as does a contact that is lost and soon returns to its place.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.cluster import join, take_readings
from skin.contact.record import (
    ABSORBED,
    BORN,
    BRIDGE,
    FREE,
    LOST,
    MERGED,
    NEW,
    OPEN,
    PRESENT,
    RESUMED,
    SPLIT,
)
from skin.contact.unseen import remember

__all__ = ["EARLY", "SAME", "find_contacts", "find_contacts_python"]

SAME, EARLY = -1, -2
"""Return values for an unchanged set of contacts, and for a stamp that is not later."""

QUIET = 0.25
"""An absorbed contact represents itself again when its load exceeds the other's fourfold, or when
they part: the representative does not change with every squeeze [assumed]."""
NEARBY = 1e-3
"""Weight of a unit that a contact owns, relative to one that it once owned [assumed]."""


@jitable
def _drop_lightest(parts, data):
    """Remove the lightest cluster, of equal ones the last: its units get label -1 and come last, so
    that the next ones move up."""
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
        data.label[members[at]] = -1
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
def _comes_first(one, other):
    """Whether a pair is worth more than another; of equal ones the first slot, then the first
    cluster comes first."""
    if one["worth"] != other["worth"]:
        return one["worth"] > other["worth"]
    if one["slot"] != other["slot"]:
        return one["slot"] < other["slot"]
    return one["part"] < other["part"]


@jitable
def _assign(pairs, track, other, other_worth, contacts, slots):
    """Assign slots in two states to clusters, one to one, greedily by the largest common load; that
    on units of a slot in the second state is weighted by `other_worth`."""
    for pair in pairs:
        now = contacts[pair["slot"]]["track"]
        pair["worth"] = pair["load"] if now == track else 0.0
        if now == other:
            pair["worth"] = other_worth * pair["load"]
    best = 0
    while best >= 0:
        best = -1
        for at in range(pairs.size):
            pair = pairs[at]
            taken = slots[pair["part"]]["slot_of"] >= 0 or slots[pair["slot"]]["part_of"] >= 0
            if not taken and pair["worth"] > 0.0:
                if best < 0 or _comes_first(pair, pairs[best]):
                    best = at
        if best >= 0:
            slots[pairs[best]["part"]]["slot_of"] = pairs[best]["slot"]
            slots[pairs[best]["slot"]]["part_of"] = pairs[best]["part"]


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
    cycle["in_use"], freed = in_use, False
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
                freed = True
        if record["track"] == ABSORBED:
            record["seen_ns"] = cycle["now_ns"]
    if freed:
        _disown(contacts, data.units)


@jitable
def _absorbed_into(contacts, other, slot):
    return contacts[other]["track"] == ABSORBED and contacts[other]["into"] == slot


@jitable
def _own(slot, represents, model, data):
    """Set the owner of a contact's units: those of absorbed slots keep it, new ones take a
    neighbour's. `represents` is whether there are absorbed ones."""
    units, label, contacts = data.units, data.label, data.contacts
    for i in data.members[contacts[slot]["begin"] : contacts[slot]["end"]]:
        mine = units[i]["owner"]
        kept = represents and mine >= 0 and _absorbed_into(contacts, mine, slot)
        if kept or mine == slot:
            continue
        best, heaviest = slot, 0.0
        if represents:
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
    _disown(contacts, data.units)


@jitable
def _keep(parts, count, model, data):
    """Assign slots to the clusters that go on, by the first `count` pairs; free those of contacts
    that were lost for too long."""
    slots, contacts, cycle = data.slots, data.contacts, data.cycle[0]
    for part in range(parts):
        slots[part]["slot_of"] = -1
    freed = False
    for slot in range(cycle["in_use"]):
        record = contacts[slot]
        slots[slot]["part_of"], record["event"] = -1, 0
        lost_ns = cycle["now_ns"] - record["seen_ns"]
        if record["track"] == LOST and lost_ns > model.settings[0]["memory_ns"]:
            record["track"] = FREE
            freed = True
    if freed:
        _disown(contacts, data.units)
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
    for slot in range(cycle["in_use"]):
        slots[slot]["mark"] = 0
    for slot in range(cycle["in_use"]):
        if contacts[slot]["track"] == ABSORBED:
            slots[contacts[slot]["into"]]["mark"] = 1  # represents absorbed ones
    for part in range(parts):
        slot = slots[part]["slot_of"]
        _own(slot, slots[slot]["mark"] > 0, model, data)


@jitable
def _order(parts, before, data):
    """Contacts by age: `present` holds their slots, `label` of a unit counts along it.

    Of the `before` contacts of the last cycle it has the order already, and new ones come in that
    of their identities: only those that are back are sorted in.
    """
    slots, contacts, stored = data.slots, data.contacts, 0
    for k in range(before):
        slots[stored]["present"] = slots[k]["present"]
        stored += slots[slots[k]["present"]]["part_of"] >= 0
    for part in range(parts):
        slot = slots[part]["slot_of"]
        if not contacts[slot]["event"] & (BORN | RESUMED):
            continue
        at = stored
        while at > 0 and contacts[slots[at - 1]["present"]]["id"] > contacts[slot]["id"]:
            slots[at]["present"] = slots[at - 1]["present"]
            at -= 1
        slots[at]["present"] = slot
        stored += 1
    for k in range(parts):
        record = contacts[slots[k]["present"]]
        for i in data.members[record["begin"] : record["end"]]:
            data.label[i] = k


@jitable
def _tick(cycle):
    """Take over the time of the cycle; returns whether it is later than that of the last one."""
    dt_s = cycle["period_s"]
    if cycle["begun"]:
        if cycle["now_ns"] <= cycle["last_ns"]:
            return False
        dt_s = 1e-9 * (cycle["now_ns"] - cycle["last_ns"])
    cycle["begun"], cycle["last_ns"] = 1, cycle["now_ns"]
    cycle["elapsed_before_s"], cycle["elapsed_s"] = cycle["elapsed_s"], dt_s
    return True


@jitable
def _settle(data):
    """Note which units touch, for the next cycle, and forget the slip of those that do not where
    there is no contact."""
    for i in range(data.units.size):
        u = data.units[i]
        bridge = u["kind"] == BRIDGE
        u["touching"] = u["kind"] == OPEN or (bridge and data.label[i] >= 0)
        if bridge:
            data.label[i] = -1
        # Silent units may be in contact still.
        if data.cycle[0]["present"] == 0 and u["kind"] <= OPEN:
            data.slip[i] = 0


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
    if not _tick(cycle):
        return EARLY
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
        _go_on(parts, model, data)
        _order(parts, before, data)
    cycle["present"] = parts
    _settle(data)
    remember(model, data)
    same = parts == before
    for k in range(parts):
        same &= slots[k]["before"] == slots[k]["present"]
        slots[k]["before"] = slots[k]["present"]
    return SAME if same else parts


find_contacts = compiled(find_contacts_python, fastmath={"contract"}, allocates=False)
