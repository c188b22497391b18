"""Identities of contacts: clusters are matched with the records of the cycle before.

Matching is by the load on common units. Each unit stores the record that last owned it. When two
contacts merge, the heavier one represents both and the units keep their owners, so that the parts
get their identities back when they separate.
"""

from __future__ import annotations

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
def keep_heaviest(load, units, parts, room, weight):
    """Keep the `room` heaviest clusters; the units of the others get label -1 and come last."""
    label, members, begin = units.label, units.members, units.begin
    old_members, old_end = units.queue, units.loaded  # free by now, used as scratch
    for part in range(parts):
        total = 0.0
        for at in range(begin[part], begin[part + 1]):
            total += load[members[at]]
            old_members[at] = members[at]
        weight[part] = total
        old_end[part] = begin[part + 1]
    for _ in range(room):
        best = 0
        for part in range(1, parts):
            if weight[part] > weight[best]:
                best = part
        weight[best] = -1.0  # kept
    stored, kept = 0, 0
    for wanted in (True, False):
        for part in range(parts):
            if (weight[part] < 0.0) != wanted:
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
def _assign(shared, parts, contacts, track, other, other_worth, slots):
    """Assign records in two states to clusters, one to one, by the largest common load.

    The load on units of a record in the second state is weighted by `other_worth`.
    """
    slot_of, part_of = slots.slot_of, slots.part_of
    while True:
        best, best_part, best_slot = 0.0, -1, -1
        for slot in range(contacts.size):
            now = contacts[slot]["track"]
            if part_of[slot] >= 0 or now not in (track, other):
                continue
            scale = 1.0 if now == track else other_worth
            for part in range(parts):
                if slot_of[part] < 0 and scale * shared[part, slot] > best:
                    best, best_part, best_slot = scale * shared[part, slot], part, slot
        if best_part < 0:
            return
        slot_of[best_part] = best_slot
        part_of[best_slot] = best_part


@jitable
def _share_nearby(load, graph, units, parts, slot_of, shared):
    """Common load including units that a record owned once, and neighbours of such units."""
    owner = units.owner
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        shared[part, :] = 0.0
        for at in range(units.begin[part], units.begin[part + 1]):
            i = units.members[at]
            if owner[i] >= 0:
                shared[part, owner[i]] += load[i]
            for near in range(graph.start[i], graph.start[i + 1]):
                if owner[graph.neighbour[near]] >= 0:
                    shared[part, owner[graph.neighbour[near]]] += NEARBY * load[i]


@jitable
def _free(slot, contacts, owner):
    contacts[slot]["track"] = FREE
    for i in range(owner.size):
        if owner[i] == slot:
            owner[i] = -1


@jitable
def _vacancy(contacts, owner, part_of):
    """A record for a new contact: a free one, else the one that was lost first."""
    oldest = -1
    for slot in range(contacts.size):
        track = contacts[slot]["track"]
        if track == FREE:
            return slot
        away = part_of[slot] < 0 and track != PRESENT
        if away and (oldest < 0 or contacts[slot]["seen_ns"] < contacts[oldest]["seen_ns"]):
            oldest = slot
    _free(oldest, contacts, owner)
    return oldest


@jitable
def _end(settle_ns, now_ns, parts, contacts, data):
    """End records that were present or absorbed and have no cluster; returns how many ended."""
    shared, slots = data.shared, data.slots
    count = 0
    for slot in range(contacts.size):
        record = contacts[slot]
        track = record["track"]
        if slots.part_of[slot] >= 0 or track not in (PRESENT, ABSORBED):
            continue
        into, most = -1, 0.0
        for part in range(parts):
            if shared[part, slot] > most:
                into, most = slots.slot_of[part], shared[part, slot]
        record["into"] = into
        if into < 0:
            slots.ended[count] = record["id"]
            count += 1
            record["track"] = LOST
        elif track == PRESENT:
            if contacts[into]["track"] == PRESENT:
                contacts[into]["event"] |= MERGED
            record["track"] = ABSORBED
            if record["seen_ns"] - record["born_ns"] < settle_ns:
                _free(slot, contacts, data.units.owner)
        if record["track"] == ABSORBED:
            record["seen_ns"] = now_ns
    return count


@jitable
def _absorbed_into(contacts, other, slot):
    return contacts[other]["track"] == ABSORBED and contacts[other]["into"] == slot


@jitable
def _own(load, graph, units, slot, contacts):
    """Set the owner of a contact's units: those of absorbed records keep it, new ones take a
    neighbour's."""
    label, owner, members = units.label, units.owner, units.members
    first, last = contacts[slot]["begin"], contacts[slot]["end"]
    absorbed = False
    for other in range(contacts.size):
        absorbed |= _absorbed_into(contacts, other, slot)
    if not absorbed:
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
def _claim(load, graph, now_ns, parts, contacts, data):
    """Assign clusters without a record: split from a contact, back from the lost, moved, or new."""
    shared, nearby, slots, owner = data.shared, data.nearby, data.slots, data.units.owner
    slot_of, part_of, parent = slots.slot_of, slots.part_of, slots.parent
    for part in range(parts):
        parent[part] = -1
        if slot_of[part] >= 0:
            continue
        most = 0.0
        for slot in range(contacts.size):
            if shared[part, slot] > most and part_of[slot] >= 0:
                most, parent[part] = shared[part, slot], slot
    _share_nearby(load, graph, data.units, parts, slot_of, nearby)
    for part in range(parts):
        if parent[part] >= 0:
            contacts[parent[part]]["event"] |= SPLIT
            nearby[part, :] = 0.0
    _assign(nearby, parts, contacts, LOST, PRESENT, 1.0, slots)
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        slot = _vacancy(contacts, owner, part_of)
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


@jitable(inline=True)
def _match(load, model, now_ns, parts, contacts, data):
    """Assign a record to each cluster; returns how many records are in use."""
    units, slots, shared = data.units, data.slots, data.shared
    slots.part_of[:] = -1
    slots.slot_of[:parts] = -1
    shared[:parts, :] = 0.0
    for part in range(parts):
        for at in range(units.begin[part], units.begin[part + 1]):
            i = units.members[at]
            if units.touching[i] and units.owner[i] >= 0:
                shared[part, units.owner[i]] += load[i]
    in_use = data.counters[0]["in_use"]
    for slot in range(in_use):
        record = contacts[slot]
        record["event"] = 0
        if record["track"] == LOST and now_ns - record["seen_ns"] > model.gate.memory_ns:
            _free(slot, contacts, units.owner)
    while in_use > 0 and contacts[in_use - 1]["track"] == FREE:
        in_use -= 1
    _assign(shared, parts, contacts[:in_use], PRESENT, ABSORBED, QUIET, slots)
    unclaimed = 0
    for part in range(parts):
        unclaimed += slots.slot_of[part] < 0
    if unclaimed:
        _claim(load, model.graph, now_ns, parts, contacts, data)
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
    in_use = _match(load, model, now_ns, parts, everyone, data)
    data.counters[0]["in_use"] = in_use
    contacts = everyone[:in_use]
    data.counters[0]["ended"] = _end(model.gate.settle_ns, now_ns, parts, contacts, data)
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
    for part in range(parts):
        _own(load, model.graph, units, slots.slot_of[part], contacts)
