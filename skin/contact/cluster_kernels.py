"""All compiled code of finding contacts: gate, connected units, identities.

One call a cycle. Units above the gate are joined along the neighbour graph; the parts are matched
with the contacts of the cycle before by the load on the units that they share.

Each unit remembers the record that last owned it. When two contacts grow together, the heavier one
speaks for both and the units keep their owners, so that the parts find their identities again when
they separate. The constants are this file's own: a cached kernel does not see another file change.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = [
    "COUNTERS",
    "SLOT_ROWS",
    "UNIT_ROWS",
    "find_contacts",
    "find_contacts_python",
    "join",
    "join_python",
]

COUNTERS = 6
PRESENT_COUNT, UNTRACKED, ENDED, NEXT_ID, TOUCHING_UNITS, IN_USE = range(6)
"""Rows of `counters`, and how many: contacts now; parts beyond the capacity; ended now; last id;
units in contact now; records from here on are free."""

UNIT_ROWS = KIND, LABEL, MEMBERS, BEGIN, TOUCHING, OWNER, QUEUE, SLIP, LOADED = range(9)
"""Rows of `units`: what it is now; its contact, counted along PRESENT, -1; units of the contacts,
one contact after another; where each contact begins there; in contact, as far as is known; record
that last owned the unit, -1; scratch; kept by slip_kernels; units above the gate, in order."""
SLOT_ROWS = PRESENT_SLOTS, SLOT_OF, PART_OF = range(3)
"""Rows of `slots`: records of the contacts; record of each part, and back."""

FREE, PRESENT, ABSORBED, LOST = range(4)
BORN, RESUMED, MERGED, SPLIT = 1, 2, 4, 8
QUIET = 0.25
"""An absorbed contact speaks for itself again when its load outweighs the other's fourfold, or when
they part: who speaks does not change with every squeeze."""
OUT, OPEN, BRIDGE, SILENT = range(4)
"""Kinds of units: no contact; above the gate; silent, but in contact when last heard; silent."""


@register_jitable
def _gate(load, sigma, valid, keep_sigma, touching, kind):
    """Sort units into kinds by their normal load, return how many are open."""
    above = 0
    for i in range(load.size):
        told = valid[i] & np.isfinite(load[i]) & (sigma[i] >= 0.0)
        unheard = BRIDGE if touching[i] else SILENT
        loaded = OPEN if load[i] > keep_sigma * sigma[i] else OUT
        kind[i] = loaded if told else unheard
        above += told & (loaded == OPEN)
    return above


@register_jitable
def _list_loaded(force, force_sigma, moved, moved_sigma, touching, kind, loaded):
    """List the open units; returns how many. Any other number that is none makes one silent.

    Of units that are not loaded nobody asks for the shear.
    """
    count = 0
    for i in range(force.shape[1]):
        loaded[count] = i
        count += kind[i] == OPEN
    listed, count = count, 0
    for at in range(listed):
        i = loaded[at]
        told = True
        for row in range(force.shape[0]):
            told &= np.isfinite(force[row, i]) & np.isfinite(force_sigma[row, i])
        for row in range(moved.shape[0]):
            told &= np.isfinite(moved[row, i]) & np.isfinite(moved_sigma[row, i])
        if told:
            loaded[count] = i
            count += 1
        else:
            kind[i] = BRIDGE if touching[i] else SILENT
    return count


@register_jitable
def _join(
    load, sigma, start, index, start_sigma, touching, kind, label, queue, members, begin, loaded
):
    """Parts that are connected and have a unit that starts a contact or was in one; their number.

    Silent units join their neighbours and belong to nothing.
    """
    parts = 0
    for first in loaded:
        if kind[first] != OPEN or label[first] >= 0:
            continue
        label[first] = parts
        queue[0] = first
        head, tail, stored = 0, 1, begin[parts]
        kept = False
        while head < tail:
            i = queue[head]
            head += 1
            if kind[i] == OPEN:
                members[stored] = i
                stored += 1
                kept |= touching[i] or load[i] > start_sigma * sigma[i]
            for at in range(start[i], start[i + 1]):
                j = index[at]
                if (kind[j] == OPEN or kind[j] == BRIDGE) and label[j] < 0:
                    label[j] = parts
                    queue[tail] = j
                    tail += 1
        if kept:
            parts += 1
            begin[parts] = stored
        else:
            for at in range(tail):
                i = queue[at]
                kind[i] = OUT if kind[i] == OPEN else SILENT
                label[i] = -1
    return parts


@register_jitable
def _lighten(load, label, members, begin, parts, room):
    """Keep the `room` heaviest parts; the units of the others get label -1 and come last."""
    weight = np.empty(parts)
    for part in range(parts):
        total = 0.0
        for at in range(begin[part], begin[part + 1]):
            total += load[members[at]]
        weight[part] = total
    keep = np.zeros(parts, np.bool_)
    for _ in range(room):
        best = -1
        for part in range(parts):
            if not keep[part] and (best < 0 or weight[part] > weight[best]):
                best = part
        keep[best] = True
    old_members, old_begin = members[: begin[parts]].copy(), begin[: parts + 1].copy()
    stored, kept = 0, 0
    for wanted in (True, False):
        for part in range(parts):
            if keep[part] != wanted:
                continue
            for at in range(old_begin[part], old_begin[part + 1]):
                members[stored] = old_members[at]
                label[members[stored]] = kept if wanted else -1
                stored += 1
            if wanted:
                kept += 1
                begin[kept] = stored
    return kept


@register_jitable
def _assign(shared, parts, contacts, worth, other_worth, state, other, slot_of, part_of):
    """Give records in two states to parts, one to one, the largest shared load first.

    The load on the units of a record counts as much as its state is worth.
    """
    while True:
        best, best_part, best_slot = 0.0, -1, -1
        for slot in range(contacts.size):
            if part_of[slot] >= 0:
                continue
            track = contacts[slot]["track"]
            if track not in (state, other):
                continue
            scale = worth if track == state else other_worth
            for part in range(parts):
                if slot_of[part] < 0 and scale * shared[part, slot] > best:
                    best, best_part, best_slot = scale * shared[part, slot], part, slot
        if best_part < 0:
            return
        slot_of[best_part] = best_slot
        part_of[best_slot] = best_part


@register_jitable
def _nearby(load, start, index, owner, members, begin, parts, slot_of, shared):
    """Shared load with units that a record owned once, and with neighbours of such units."""
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        shared[part, :] = 0.0
        for at in range(begin[part], begin[part + 1]):
            i = members[at]
            if owner[i] >= 0:
                shared[part, owner[i]] += load[i]
            for near in range(start[i], start[i + 1]):
                if owner[index[near]] >= 0:
                    shared[part, owner[index[near]]] += 1e-3 * load[i]


@register_jitable
def _free(slot, contacts, owner):
    contacts[slot]["track"] = FREE
    for i in range(owner.size):
        if owner[i] == slot:
            owner[i] = -1


@register_jitable
def _vacancy(contacts, owner, part_of):
    """A record for a new contact: a free one, else the one that has been away longest."""
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


@register_jitable
def _part_ways(parts, contacts, shared, settle_ns, slot_of, part_of, now_ns, owner, ended):
    """Records that were present or absorbed and have no part of their own; how many ended."""
    count = 0
    for slot in range(contacts.size):
        record = contacts[slot]
        track = record["track"]
        if part_of[slot] >= 0 or track not in (PRESENT, ABSORBED):
            continue
        into, most = -1, 0.0
        for part in range(parts):
            if shared[part, slot] > most:
                into, most = slot_of[part], shared[part, slot]
        record["into"] = into
        if into < 0:
            ended[count] = record["id"]
            count += 1
            record["track"] = LOST
        elif track == PRESENT:
            if contacts[into]["track"] == PRESENT:
                contacts[into]["event"] |= MERGED
            record["track"] = ABSORBED
            if record["seen_ns"] - record["born_ns"] < settle_ns:
                _free(slot, contacts, owner)
        if record["track"] == ABSORBED:
            record["seen_ns"] = now_ns
    return count


@register_jitable
def _own(load, start, index, label, owner, members, first, last, slot, contacts):
    """Units of a part take an owner: those of absorbed records keep it, new ones ask around."""
    absorbed = False
    for other in range(contacts.size):
        absorbed |= contacts[other]["track"] == ABSORBED and contacts[other]["into"] == slot
    if not absorbed:
        for at in range(first, last):
            owner[members[at]] = slot
        return
    for at in range(first, last):
        i = members[at]
        mine = owner[i]
        if mine == slot:
            continue
        if mine >= 0 and contacts[mine]["track"] == ABSORBED and contacts[mine]["into"] == slot:
            continue
        best, heaviest = slot, 0.0
        for near in range(start[i], start[i + 1]):
            j = index[near]
            there = owner[j]
            if label[j] != label[i] or there < 0 or not load[j] > heaviest:
                continue
            if there == slot or (
                contacts[there]["track"] == ABSORBED and contacts[there]["into"] == slot
            ):
                best, heaviest = there, load[j]
        owner[i] = best


@register_jitable
def _claim(
    load, start, index, now_ns, owner, members, begin, parts, shared, slot_of, part_of,
    contacts, counters,
):  # fmt: skip
    """Parts without a record: split from a contact, back from the lost, moved on, or new."""
    parent = np.full(parts, -1)
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        most = 0.0
        for slot in range(contacts.size):
            if shared[part, slot] > most and part_of[slot] >= 0:
                most, parent[part] = shared[part, slot], slot
    nearby = shared.copy()
    _nearby(load, start, index, owner, members, begin, parts, slot_of, nearby)
    for part in range(parts):
        if parent[part] >= 0:
            contacts[parent[part]]["event"] |= SPLIT
            nearby[part, :] = 0.0
    _assign(nearby, parts, contacts, 1.0, 1.0, LOST, PRESENT, slot_of, part_of)
    for part in range(parts):
        if slot_of[part] >= 0:
            continue
        slot = _vacancy(contacts, owner, part_of)
        slot_of[part] = slot
        part_of[slot] = part
        record = contacts[slot]
        record["track"] = PRESENT
        counters[NEXT_ID] += 1
        record["id"] = counters[NEXT_ID]
        record["parent"] = contacts[parent[part]]["id"] if parent[part] >= 0 else 0
        record["born_ns"] = now_ns
        record["cycles"] = 0
        record["event"] = BORN


@register_jitable
def _identify(
    load, start, index, memory_ns, settle_ns, now_ns,
    touching, owner, label, members, begin, parts, shared, slot_of, part_of,
    contacts, ended, counters,
):  # fmt: skip
    """Match parts with records; begin, carry on and end contacts."""
    part_of[:] = -1
    slot_of[:parts] = -1
    shared[:parts, :] = 0.0
    for part in range(parts):
        for at in range(begin[part], begin[part + 1]):
            i = members[at]
            if touching[i] and owner[i] >= 0:
                shared[part, owner[i]] += load[i]
    in_use = counters[IN_USE]
    for slot in range(in_use):
        record = contacts[slot]
        record["event"] = 0
        if record["track"] == LOST and now_ns - record["seen_ns"] > memory_ns:
            _free(slot, contacts, owner)
    while in_use > 0 and contacts[in_use - 1]["track"] == FREE:
        in_use -= 1
    _assign(
        shared, parts, contacts[:in_use], 1.0, QUIET, PRESENT, ABSORBED, slot_of, part_of
    )  # fmt: skip
    unclaimed = 0
    for part in range(parts):
        unclaimed += slot_of[part] < 0
    if unclaimed:
        _claim(
            load, start, index, now_ns, owner, members, begin, parts, shared, slot_of, part_of,
            contacts, counters,
        )  # fmt: skip
    for part in range(parts):
        in_use = max(in_use, slot_of[part] + 1)
    counters[IN_USE] = in_use
    used = contacts[:in_use]
    counters[ENDED] = _part_ways(
        parts, used, shared, settle_ns, slot_of, part_of, now_ns, owner, ended
    )
    for part in range(parts):
        record = contacts[slot_of[part]]
        if record["track"] == LOST or record["track"] == ABSORBED:
            record["event"] |= RESUMED
        record["track"] = PRESENT
        record["into"] = -1
        record["seen_ns"] = now_ns
        record["cycles"] += 1
        record["begin"] = begin[part]
        record["end"] = begin[part + 1]
    for part in range(parts):
        _own(
            load, start, index, label, owner, members, begin[part], begin[part + 1],
            slot_of[part], used,
        )  # fmt: skip


@register_jitable
def _order(parts, contacts, slot_of, label, members, present):
    """Contacts by age: `present` holds their records, `label` of a unit counts along it."""
    for k in range(parts):
        slot = slot_of[k]
        at = k
        while at > 0 and contacts[present[at - 1]]["id"] > contacts[slot]["id"]:
            present[at] = present[at - 1]
            at -= 1
        present[at] = slot
    for k in range(parts):
        record = contacts[present[k]]
        for at in range(record["begin"], record["end"]):
            label[members[at]] = k


@register_jitable
def join_python(
    force, force_sigma, moved, moved_sigma, valid, graph, start_sigma, keep_sigma, units
):
    """Find the connected units above the gate; parameters as in `find_contacts_python`.

    Returns
    -------
    int
        Number of parts. Units of part k are ``members[begin[k]:begin[k + 1]]``, `members` and
        `begin` being rows of `units`; the row LABEL is the part of each unit, -1.
    """
    load, sigma = force[force.shape[0] - 1], force_sigma[force.shape[0] - 1]
    n = load.size
    kind, label, touching, loaded = units[KIND], units[LABEL], units[TOUCHING], units[LOADED]
    above = _gate(load, sigma, valid, keep_sigma, touching, kind)
    label[:] = -1
    units[BEGIN, 0] = 0
    if above > 0:
        above = _list_loaded(force, force_sigma, moved, moved_sigma, touching, kind, loaded)
    if above == 0:
        return 0
    return _join(
        load, sigma, graph[: n + 1], graph[n + 1 :], start_sigma, touching, kind, label,
        units[QUEUE], units[MEMBERS], units[BEGIN], loaded[:above],
    )  # fmt: skip


def find_contacts_python(
    force, force_sigma, moved, moved_sigma, valid, graph, settings, now_ns, units, slots, shared,
    contacts, counters,
):  # fmt: skip
    """Find the contacts of one cycle; see the head of this file.

    What differs only in meaning shares an array: each array that is passed costs time.

    Parameters
    ----------
    force, force_sigma : ndarray, shape (r, n)
        Newton; the last row is the normal load of the units, positive when pressed, and its
        one-sigma.
    moved, moved_sigma : ndarray, shape (q, n)
        These must be numbers, too, where a unit is loaded.
    valid : ndarray, shape (n,), bool
    graph : ndarray, shape (n + 1 + m,), int32
        Neighbour graph: starts of the rows, then the neighbours.
    settings : ndarray, shape (4,), float64
        What starts a contact and what a unit in a contact must exceed, in sigmas; how long a lost
        contact can return and how old one must be to survive being absorbed, nanoseconds.
    now_ns : int
    units : ndarray, shape (9, n + 1), int32
        Rows as in `UNIT_ROWS`; TOUCHING and OWNER are kept from call to call.
    slots : ndarray, shape (3, s), int32
        Rows as in `SLOT_ROWS`; PRESENT holds the records of the contacts, oldest first.
    shared : ndarray, shape (s // 2, s), float64
        Scratch.
    contacts : ndarray, shape (s,), CONTACT
        The records, kept.
    counters : ndarray, shape (6 + s,), int64
        Rows as in `COUNTERS`, kept; then the identities that ended in this cycle.

    Returns
    -------
    int
        Number of contacts.
    """
    load = force[force.shape[0] - 1]
    n = load.size
    start, index = graph[: n + 1], graph[n + 1 :]
    kind, label, members, begin = units[KIND], units[LABEL], units[MEMBERS], units[BEGIN]
    touching, owner = units[TOUCHING], units[OWNER]
    slot_of, part_of, present = slots[SLOT_OF], slots[PART_OF], slots[PRESENT_SLOTS]
    ended = counters[COUNTERS:]
    parts = join_python(
        force, force_sigma, moved, moved_sigma, valid, graph, settings[0], settings[1], units
    )
    counters[TOUCHING_UNITS] = begin[parts]
    if parts == 0 and counters[PRESENT_COUNT] == 0:
        counters[ENDED] = 0
        counters[UNTRACKED] = 0
        touching[:] = 0
        return 0
    room = contacts.size // 2
    counters[UNTRACKED] = max(0, parts - room)
    if parts > room:
        parts = _lighten(load, label, members, begin, parts, room)
    _identify(
        load, start, index, settings[2], settings[3], now_ns,
        touching, owner, label, members, begin, parts, shared, slot_of, part_of,
        contacts, ended, counters,
    )  # fmt: skip
    _order(parts, contacts, slot_of, label, members, present)
    for i in range(n):
        bridge = kind[i] == BRIDGE
        touching[i] = (kind[i] == OPEN) | (bridge & (label[i] >= 0))
        label[i] = -1 if bridge else label[i]
    counters[PRESENT_COUNT] = parts
    return parts


OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
find_contacts = njit(**OPTIONS)(find_contacts_python)
join = njit(**OPTIONS)(join_python)
