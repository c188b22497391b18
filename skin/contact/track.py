"""Contacts with identities that last: through motion, merging and splitting."""

from __future__ import annotations

import numpy as np

from skin.contact.cluster_kernels import COUNTERS, SLOT_ROWS, UNIT_ROWS, find_contacts
from skin.contact.clusters import KEEP_SIGMA, START_SIGMA, packed_graph
from skin.contact.records import CONTACT
from skin.errors import SkinError

__all__ = ["Tracker"]

PRESENT_COUNT, UNTRACKED, ENDED, _, TOUCHING_UNITS, _ = range(COUNTERS)


class Tracker:
    """Find contacts cycle by cycle and keep their identities; nothing is allocated in a cycle.

    A contact is the same as long as it shares units with itself a cycle ago. Where two contacts
    grow together, the heavier speaks for both; when they part, both are themselves again. Where one
    splits, the heavier part stays itself. A contact that is lost and returns to its place within
    `memory_s` is the same contact.

    Parameters
    ----------
    neighbour_start, neighbour_index : ndarray, shape (n + 1,) and (m,)
        Neighbour graph in compressed rows, as in `Topology`.
    start_sigma, keep_sigma : float
        Gate of the normal load and its hysteresis, see `contact_clusters`.
    capacity : int
        Contacts that can be told apart; of more than that, the lightest have no identity and are
        counted in `untracked`.
    memory_s : float
        How long a lost contact can return.
    settle_s : float
        How old a contact must be to outlive being absorbed by another.
    records : ndarray, shape (2 capacity,), CONTACT, optional
        Where to keep the records.

    Attributes
    ----------
    label : ndarray, shape (n,), int32
        Contact of each unit, counted along `present`; -1 for none.
    contacts : ndarray, shape (s,), CONTACT
        Records of all identities; those in contact are ``contacts[present]``.
    present : ndarray, shape (k,), int32
        Records of the contacts, oldest first.
    ended : ndarray, int64
        Identities that ended in this cycle.
    """

    def __init__(
        self,
        neighbour_start: np.ndarray,
        neighbour_index: np.ndarray,
        *,
        start_sigma: float = START_SIGMA,
        keep_sigma: float = KEEP_SIGMA,
        capacity: int = 16,
        memory_s: float = 0.1,
        settle_s: float = 0.2,
        records: np.ndarray | None = None,
    ) -> None:
        n = np.size(neighbour_start) - 1
        if not 0.0 < keep_sigma <= start_sigma:
            raise SkinError(
                "keep_sigma, start_sigma: must be 0 < keep_sigma <= start_sigma; "
                f"got {keep_sigma} and {start_sigma}"
            )
        if capacity < 1:
            raise SkinError(f"capacity: must be at least 1; got {capacity}")
        slots = 2 * capacity
        self.contacts = np.zeros(slots, CONTACT) if records is None else records
        self.counters = np.zeros(COUNTERS + slots, np.int64)
        self.units = np.zeros((len(UNIT_ROWS), n + 1), np.int32)
        self.kind, self.label, self.members, _, _, owner, _, self.slip, _ = self.units[:, :n]
        owner[:] = -1
        self.label[:] = -1
        self.slots = np.zeros((len(SLOT_ROWS), slots), np.int32)
        self.graph = packed_graph(n, neighbour_start, neighbour_index)
        self.gate = np.array([start_sigma, keep_sigma, 1e9 * memory_s, 1e9 * settle_s])
        self.shared = np.zeros((capacity, slots))

    @property
    def present(self) -> np.ndarray:
        """Records of the contacts, oldest first."""
        return self.slots[0, : self.counters[PRESENT_COUNT]]

    @property
    def ended(self) -> np.ndarray:
        """Identities that ended in this cycle."""
        return self.counters[COUNTERS:][: self.counters[ENDED]]

    @property
    def untracked(self) -> int:
        """Contacts beyond the capacity in this cycle."""
        return int(self.counters[UNTRACKED])

    @property
    def touching_units(self) -> int:
        """Units in contact in this cycle, those of contacts beyond the capacity included."""
        return int(self.counters[TOUCHING_UNITS])

    def units_of(self, record: int) -> np.ndarray:
        """Units of a contact, by its record."""
        return self.members[self.contacts["begin"][record] : self.contacts["end"][record]]

    def update(self, load: np.ndarray, sigma: np.ndarray, valid: np.ndarray, now_ns: int) -> int:
        """Take the next cycle.

        Parameters
        ----------
        load, sigma : ndarray, shape (n,) or (3, n), float32 or float64
            Newton, normal load, positive when pressed, and its one-sigma; of three rows the last.
        valid : ndarray, shape (n,), bool
        now_ns : int
            Time stamp of the cycle, not before the last one.

        Returns
        -------
        int
            Number of contacts.
        """
        if load.ndim == 1:
            load, sigma = load[np.newaxis], sigma[np.newaxis]
        return find_contacts(
            load, sigma, load, sigma, valid, self.graph, self.gate, now_ns,
            self.units, self.slots, self.shared, self.contacts, self.counters,
        )  # fmt: skip
