"""Block: consecutive states of one skin as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bus.cycle import ClosedBy, FrameCounters
from skin.state import UNWANTED, Reading

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["CLOSED_BY", "Block"]

CLOSED_BY = tuple(ClosedBy)
"""Reasons for the end of a cycle, by the index in `Block.closed_by`."""


@dataclass(slots=True)
class Block:
    """t consecutive states; the arrays are its own. Quantities that are not wanted are None.

    Attributes
    ----------
    topology : Topology
    cycle : ndarray, shape (t,), int64
        SYNC number, unwrapped.
    stamp_ns : ndarray, shape (t,), int64
        Time stamp of the SYNC.
    units : Reading
        All units, every array with a leading axis t.
    coverage : ndarray, shape (t,), float64
        Fraction of the sensing area whose units are valid.
    closed_by : ndarray, shape (t,), uint8
        Reason for the end of the cycle: an index of `CLOSED_BY`.
    totals : ndarray, shape (t, 15), int64
        Counts of frames by outcome, running totals in the order of `FrameCounters`.
    overruns : ndarray, shape (t,), int64
    wrench, wrench_sigma : ndarray, shape (t, 6), float64
        Newton and newton metre, skin frame.
    centroid : ndarray, shape (t, 3), float64
        Metre, skin frame.
    centroid_covariance : ndarray, shape (t, 3, 3), float64
    contacts : ndarray, shape (k,), `skin.contact.record.CONTACT`
        Records of all contacts of all cycles, in order.
    contact_start : ndarray, shape (t + 1,), int64
        The contacts of cycle i are ``contacts[contact_start[i] : contact_start[i + 1]]``.
    contact_slot : ndarray, shape (k,), int32
        A number that each contact keeps while it lasts; another one may have it later.
    label : ndarray, shape (t, n), int32
        Contact of each unit, counted within its cycle, -1 for none.
    slip : ndarray, shape (t, n), int32
        `skin.contact.record.UnitSlip` of each unit.
    sampled_ns : ndarray, shape (t, n), int64
    untracked : ndarray, shape (t,), int64
        Contacts beyond the capacity.
    whole : ndarray, shape (t,), bool
        See `State`.
    counts : ndarray, shape (t, c, n), int16
        Of a skin with sensors of which nothing else is known (``counts_only``).
    """

    topology: Topology
    cycle: np.ndarray
    stamp_ns: np.ndarray
    units: Reading
    coverage: np.ndarray
    closed_by: np.ndarray
    totals: np.ndarray
    overruns: np.ndarray
    wrench: np.ndarray = UNWANTED
    wrench_sigma: np.ndarray = UNWANTED
    centroid: np.ndarray = UNWANTED
    centroid_covariance: np.ndarray = UNWANTED
    contacts: np.ndarray = UNWANTED
    contact_start: np.ndarray = UNWANTED
    contact_slot: np.ndarray = UNWANTED
    label: np.ndarray = UNWANTED
    slip: np.ndarray = UNWANTED
    sampled_ns: np.ndarray = UNWANTED
    whole: np.ndarray = UNWANTED
    untracked: np.ndarray = UNWANTED
    counts: np.ndarray = UNWANTED

    def __len__(self) -> int:
        return self.cycle.size

    def __repr__(self) -> str:
        first, last = self.cycle[[0, -1]].tolist() if len(self) else ("", "")
        parts = [f"{len(self)} cycles ({first} to {last}) of {self.topology.n} units"]
        if self.contacts is not None:
            parts.append(f"{self.contacts.size} contacts")
        return f"<Block: {', '.join(parts)}>"

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        parts = [self.units, self]
        arrays = [getattr(part, name) for part in parts for name in type(part).__slots__]
        return sum(one.nbytes for one in arrays if isinstance(one, np.ndarray))

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome, up to the last cycle."""
        return FrameCounters(*self.totals[-1].tolist())

    @property
    def contact_cycle(self) -> np.ndarray:
        """Index of the cycle of each contact, shape (k,), int64."""
        return np.repeat(np.arange(len(self)), np.diff(self.contact_start))

    @property
    def contact_of_units(self) -> np.ndarray:
        """Identity of each unit's contact, 0 for none; shape (t, n), int64."""
        ids = np.append(self.contacts["id"], 0)
        at = self.contact_start[:-1, np.newaxis] + self.label
        return np.where(self.label >= 0, ids[np.where(self.label >= 0, at, -1)], 0)
