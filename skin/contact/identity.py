"""Identities of contacts: clusters are matched with the records of the cycle before.

Matching is by the load on common units. Each unit stores the record that last owned it. When two
contacts merge, the heavier one represents both and the units keep their owners, so that the parts
get their identities back when they separate.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import (
    ABSORBED,
    BORN,
    FREE,
    LOST,
    MERGED,
    PRESENT,
    RESUMED,
    SPLIT,
)

__all__ = ["identify", "keep_heaviest"]

QUIET = 0.25
"""An absorbed contact represents itself again when its load exceeds the other's fourfold, or when
they part: the representative does not change with every squeeze [assumed]."""
NEARBY = 1e-3
"""Weight of a unit that a contact owns, relative to one that it once owned [assumed]."""


@jitable
def _comes_first(pairs, a, b):
    """Whether pair a is worth more than b; of equal ones the first record, then the first cluster
    comes first."""
    one, other = pairs[a], pairs[b]
    if one["worth"] != other["worth"]:
        return one["worth"] > other["worth"]
    if one["slot"] != other["slot"]:
        return one["slot"] < other["slot"]
    return one["part"] < other["part"]


@jitable
def _sift(order, at, size, pairs):
    """Restore a heap of `size` pairs below the place `at`: none comes before the one above it."""
    moved = order[at]
    while 2 * at + 1 < size:
        below = 2 * at + 1
        if below + 1 < size and _comes_first(pairs, order[below + 1], order[below]):
            below += 1
        if not _comes_first(pairs, order[below], moved):
            break
        order[at] = order[below]
        at = below
    order[at] = moved


@jitable
def _heap(order, size, pairs):
    for at in range(size // 2 - 1, -1, -1):
        _sift(order, at, size, pairs)


@jitable
def _take_first(order, size, pairs):
    """The first pair of a heap of `size`, which has one less from then on."""
    first = order[0]
    order[0] = order[size - 1]
    _sift(order, 0, size - 1, pairs)
    return first


@jitable
def keep_heaviest(load, parts, room, data):
    """Keep the `room` heaviest clusters; the units of the others get label -1 and come last."""
    units, pairs, order = data.units, data.shared, data.order
    label, members, begin = units.label, units.members, units.begin
    old_members, old_end = units.queue, units.loaded  # free by now, used as scratch
    for part in range(parts):
        total = 0.0
        for at in range(begin[part], begin[part + 1]):
            total += load[members[at]]
            old_members[at] = members[at]
        pairs[part]["worth"], pairs[part]["slot"], pairs[part]["part"] = total, 0, part
        old_end[part] = begin[part + 1]
        order[part] = part
    _heap(order, parts, pairs)
    for taken in range(room):
        pairs[_take_first(order, parts - taken, pairs)]["worth"] = -1.0  # kept
    stored, kept = 0, 0
    for wanted in (True, False):
        for part in range(parts):
            if (pairs[part]["worth"] < 0.0) != wanted:
                continue
            for at in range(old_end[part - 1] if part else 0, old_end[part]):
                members[stored] = old_members[at]
                label[members[stored]] = kept if wanted else -1
                stored += 1
            if wanted:
                kept += 1
                begin[kept] = stored
    return kept


@jitable
def _add(load, part, slot, first, count, pairs, mark):
    """Add a common load of a cluster, whose pairs begin at `first`, and a record; returns the
    number of pairs."""
    at = mark[slot]
    if at < first:  # of a cluster before, or none
        at = count
        mark[slot] = at
        pairs[at]["part"], pairs[at]["slot"], pairs[at]["load"] = part, slot, 0.0
        count += 1
    pairs[at]["load"] += load
    return count


@jitable
def _share(load, units, parts, mark, pairs):
    """Pairs of a cluster and a record that owned units of it in the cycle before; returns how
    many."""
    mark[:] = -1
    count = 0
    for part in range(parts):
        first = count
        for at in range(units.begin[part], units.begin[part + 1]):
            i = units.members[at]
            if units.touching[i] and units.owner[i] >= 0:
                count = _add(load[i], part, units.owner[i], first, count, pairs, mark)
    return count


@jitable
def _share_nearby(load, graph, units, parts, slots, pairs):
    """The same of clusters that are new and have not split: common load including units that a
    record owned once, and neighbours of such units."""
    owner, mark = units.owner, slots.mark
    mark[:] = -1
    count = 0
    for part in range(parts):
        if slots.slot_of[part] >= 0 or slots.parent[part] >= 0:
            continue
        first = count
        for at in range(units.begin[part], units.begin[part + 1]):
            i = units.members[at]
            if owner[i] >= 0:
                count = _add(load[i], part, owner[i], first, count, pairs, mark)
            for near in range(graph.start[i], graph.start[i + 1]):
                slot = owner[graph.neighbour[near]]
                if slot >= 0:
                    count = _add(NEARBY * load[i], part, slot, first, count, pairs, mark)
    return count


@jitable
def _assign(pairs, contacts, track, other, other_worth, slots, order):
    """Assign records in two states to clusters, one to one, by the largest common load.

    The load on units of a record in the second state is weighted by `other_worth`. Costs
    p log p for p pairs, of which a unit adds at most one, and one for each neighbour.
    """
    slot_of, part_of = slots.slot_of, slots.part_of
    size = 0
    for at in range(pairs.size):
        pair = pairs[at]
        now = contacts[pair["slot"]]["track"]
        if now not in (track, other) or part_of[pair["slot"]] >= 0 or slot_of[pair["part"]] >= 0:
            continue
        pair["worth"] = pair["load"] if now == track else other_worth * pair["load"]
        order[size] = at
        size += pair["worth"] > 0.0
    _heap(order, size, pairs)
    while size > 0:
        pair = pairs[_take_first(order, size, pairs)]
        size -= 1
        if slot_of[pair["part"]] < 0 and part_of[pair["slot"]] < 0:
            slot_of[pair["part"]] = pair["slot"]
            part_of[pair["slot"]] = pair["part"]


@jitable
def _disown(contacts, owner):
    """Units of records that are free, or are another contact from now on, have no owner."""
    for i in range(owner.size):
        slot = owner[i]
        if slot >= 0 and (contacts[slot]["track"] == FREE or contacts[slot]["event"] & BORN):
            owner[i] = -1


@jitable
def _longest_away(contacts, part_of):
    """The record without a cluster that was lost, or absorbed, first."""
    oldest = -1
    for slot in range(contacts.size):
        away = part_of[slot] < 0 and contacts[slot]["track"] != PRESENT
        if away and (oldest < 0 or contacts[slot]["seen_ns"] < contacts[oldest]["seen_ns"]):
            oldest = slot
    return oldest


@jitable
def _end(settle_ns, now_ns, pairs, contacts, data):
    """End records that were present or absorbed and have no cluster; returns how many ended."""
    slots, most = data.slots, data.most
    for slot in range(contacts.size):
        ends = slots.part_of[slot] < 0 and contacts[slot]["track"] in (PRESENT, ABSORBED)
        most[slot] = 0.0 if ends else np.inf
        if ends:
            contacts[slot]["into"] = -1
    for at in range(pairs.size):
        slot = pairs[at]["slot"]
        if slot < contacts.size and pairs[at]["load"] > most[slot]:
            most[slot] = pairs[at]["load"]
            contacts[slot]["into"] = slots.slot_of[pairs[at]["part"]]
    count, freed = 0, False
    for slot in range(contacts.size):
        record = contacts[slot]
        track, into = record["track"], record["into"]
        if most[slot] == np.inf:
            continue
        if into < 0:
            slots.ended[count] = record["id"]
            count += 1
            record["track"] = LOST
        elif track == PRESENT:
            if contacts[into]["track"] == PRESENT:
                contacts[into]["event"] |= MERGED
            record["track"] = ABSORBED
            if record["seen_ns"] - record["born_ns"] < settle_ns:
                record["track"] = FREE
                freed = True
        if record["track"] == ABSORBED:
            record["seen_ns"] = now_ns
    if freed:
        _disown(contacts, data.units.owner)
    return count


@jitable
def _absorbed_into(contacts, other, slot):
    return contacts[other]["track"] == ABSORBED and contacts[other]["into"] == slot


@jitable
def _own(load, graph, units, slot, represents, contacts):
    """Set the owner of a contact's units: those of absorbed records keep it, new ones take a
    neighbour's. `represents` is whether there are absorbed ones."""
    label, owner, members = units.label, units.owner, units.members
    first, last = contacts[slot]["begin"], contacts[slot]["end"]
    if not represents:
        for at in range(first, last):
            owner[members[at]] = slot
        return
    for at in range(first, last):
        i = members[at]
        mine = owner[i]
        if mine == slot or (mine >= 0 and _absorbed_into(contacts, mine, slot)):
            continue
        best, heaviest = slot, 0.0
        for near in range(graph.start[i], graph.start[i + 1]):
            j = graph.neighbour[near]
            there = owner[j]
            if label[j] != label[i] or there < 0 or not load[j] > heaviest:
                continue
            if there == slot or _absorbed_into(contacts, there, slot):
                best, heaviest = there, load[j]
        owner[i] = best


@jitable
def _claim(load, graph, now_ns, parts, pairs, contacts, data):
    """Assign clusters without a record: split from a contact, back from the lost, moved, or new."""
    slots, most = data.slots, data.most
    slot_of, part_of, parent = slots.slot_of, slots.part_of, slots.parent
    parent[:parts] = -1
    most[:parts] = 0.0
    for at in range(pairs.size):
        part, slot, shared = pairs[at]["part"], pairs[at]["slot"], pairs[at]["load"]
        if slot_of[part] >= 0 or part_of[slot] < 0:
            continue
        if shared > most[part] or (shared == most[part] and slot < parent[part]):
            most[part], parent[part] = shared, slot
    for part in range(parts):
        if parent[part] >= 0:
            contacts[parent[part]]["event"] |= SPLIT
    count = _share_nearby(load, graph, data.units, parts, slots, data.nearby)
    _assign(data.nearby[:count], contacts, LOST, PRESENT, 1.0, slots, data.order)
    vacant = 0
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        while vacant < contacts.size and contacts[vacant]["track"] != FREE:
            vacant += 1
        slot = vacant if vacant < contacts.size else _longest_away(contacts, part_of)
        slot_of[part] = slot
        part_of[slot] = part
        record = contacts[slot]
        record["track"] = PRESENT
        data.counters[0]["last_id"] += 1
        record["id"] = data.counters[0]["last_id"]
        record["parent"] = contacts[parent[part]]["id"] if parent[part] >= 0 else 0
        record["born_ns"] = now_ns
        record["cycles"] = 0
        record["event"] = BORN
    _disown(contacts, data.units.owner)


@jitable(inline=True)
def _match(load, model, now_ns, parts, pairs, contacts, data):
    """Assign a record to each cluster; returns how many records are in use."""
    units, slots = data.units, data.slots
    slots.part_of[:] = -1
    slots.slot_of[:parts] = -1
    in_use, freed = data.counters[0]["in_use"], False
    for slot in range(in_use):
        record = contacts[slot]
        record["event"] = 0
        if record["track"] == LOST and now_ns - record["seen_ns"] > model.gate.memory_ns:
            record["track"] = FREE
            freed = True
    if freed:
        _disown(contacts, units.owner)
    while in_use > 0 and contacts[in_use - 1]["track"] == FREE:
        in_use -= 1
    _assign(pairs, contacts, PRESENT, ABSORBED, QUIET, slots, data.order)
    unclaimed = 0
    for part in range(parts):
        unclaimed += slots.slot_of[part] < 0
    if unclaimed:
        _claim(load, model.graph, now_ns, parts, pairs, contacts, data)
    for part in range(parts):
        in_use = max(in_use, slots.slot_of[part] + 1)
    return in_use


@jitable(inline=True)
def identify(load, model, parts, data):
    """Match clusters with records; begin, continue and end contacts.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton.
    model, parts, data
        See `join`, and its results.
    """
    units, slots = data.units, data.slots
    now_ns, everyone = data.clock[0]["now_ns"], data.contacts[:-1]
    pairs = data.shared[: _share(load, units, parts, slots.mark, data.shared)]
    in_use = _match(load, model, now_ns, parts, pairs, everyone, data)
    data.counters[0]["in_use"] = in_use
    contacts = everyone[:in_use]
    data.counters[0]["ended"] = _end(model.gate.settle_ns, now_ns, pairs, contacts, data)
    for part in range(parts):
        record = contacts[slots.slot_of[part]]
        if record["track"] == LOST or record["track"] == ABSORBED:
            record["event"] |= RESUMED
        record["track"] = PRESENT
        record["into"] = -1
        record["seen_ns"] = now_ns
        record["cycles"] += 1
        record["begin"] = units.begin[part]
        record["end"] = units.begin[part + 1]
    represents = slots.mark
    represents[:in_use] = 0
    for slot in range(in_use):
        if contacts[slot]["track"] == ABSORBED:
            represents[contacts[slot]["into"]] = 1
    for part in range(parts):
        slot = slots.slot_of[part]
        _own(load, model.graph, units, slot, represents[slot] > 0, contacts)
