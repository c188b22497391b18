"""Contacts with identities that persist through motion, merging and splitting.

A contact keeps its identity while it has units in common with itself a cycle before. When two
contacts merge, the heavier one represents both; when they part, both get their identities back.
When one splits, the heavier part keeps the identity, as does a contact that is lost and soon
returns to its place.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.cluster import join_python
from skin.contact.identity import identify, keep_heaviest
from skin.contact.model import ContactData
from skin.contact.record import BORN, BRIDGE, OPEN, RESUMED

__all__ = ["Tracker", "find_contacts"]


@jitable
def _order(parts, before, contacts, slots, units):
    """Contacts by age: `present` holds their records, `label` of a unit counts along it.

    Of the `before` contacts of the last cycle it has the order already, and new ones come in that
    of their identities: only those that are back are sorted in.
    """
    present = slots.present
    stored = 0
    for k in range(before):
        present[stored] = present[k]
        stored += slots.part_of[present[k]] >= 0
    for part in range(parts):
        slot = slots.slot_of[part]
        if not contacts[slot]["event"] & (BORN | RESUMED):
            continue
        at = stored
        while at > 0 and contacts[present[at - 1]]["id"] > contacts[slot]["id"]:
            present[at] = present[at - 1]
            at -= 1
        present[at] = slot
        stored += 1
    for k in range(parts):
        record = contacts[present[k]]
        for at in range(record["begin"], record["end"]):
            units.label[units.members[at]] = k


@jitable(inline=True)
def find_contacts(model, data):
    """Find the contacts of one cycle, at ``data.clock["now_ns"]``.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
        `units` (but for `slip`), `slots`, `counters` and the identities of `contacts` are written.

    Returns
    -------
    int
        Number of contacts.
    """
    units, counters = data.units, data.counters[0]
    parts = join_python(model, data)
    counters["touching_units"] = units.begin[parts]
    if parts == 0 and counters["present"] == 0:
        counters["ended"] = 0
        counters["untracked"] = 0
        units.touching[:] = 0
        return 0
    load = data.reading.force[2]
    room = data.slots.before.size
    counters["untracked"] = max(0, parts - room)
    if parts > room:
        parts = keep_heaviest(load, parts, room, data)
    identify(load, model, parts, data)
    _order(parts, counters["present"], data.contacts, data.slots, units)
    for i in range(units.kind.size):
        bridge = units.kind[i] == BRIDGE
        units.touching[i] = (units.kind[i] == OPEN) | (bridge & (units.label[i] >= 0))
        units.label[i] = -1 if bridge else units.label[i]
    counters["present"] = parts
    return parts


class Tracker:
    """Identities of contacts from `find_contacts`: a view of its data.

    Attributes
    ----------
    kind : ndarray, shape (n,), int32
        `UnitKind` of each unit.
    label : ndarray, shape (n,), int32
        Contact of each unit, counted along `present`; -1 for none.
    contacts : ndarray, shape (s,), CONTACT
        Records of all identities; those in contact are ``contacts[present]``.
    """

    def __init__(self, data: ContactData) -> None:
        self.data = data
        self.kind, self.label = data.units.kind, data.units.label
        self.contacts = data.contacts[:-1]

    @property
    def present(self) -> np.ndarray:
        """Records of the contacts, oldest first; shape (k,), int32."""
        return self.data.slots.present[: self.data.counters["present"][0]]

    @property
    def ended(self) -> np.ndarray:
        """Identities that ended in this cycle; int64."""
        return self.data.slots.ended[: self.data.counters["ended"][0]]

    @property
    def untracked(self) -> int:
        """Contacts beyond the capacity in this cycle."""
        return int(self.data.counters["untracked"][0])

    @property
    def touching_units(self) -> int:
        """Units in contact in this cycle, those of contacts beyond the capacity included."""
        return int(self.data.counters["touching_units"][0])

    def units_of(self, record: int) -> np.ndarray:
        """Units of a contact, by its record."""
        first, last = self.contacts["begin"][record], self.contacts["end"][record]
        return self.data.units.members[first:last]
