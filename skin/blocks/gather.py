"""Gathers states into blocks, by copying the arrays of their pipeline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skin.blocks.block import CLOSED_BY, Block
from skin.contact.record import CONTACT, Flag
from skin.state import UNWANTED, Reading, if_wanted

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Gather"]

BLOCK_BYTES = 16 << 20
"""Bytes of a block [assumed: a part of a laptop's third-level cache]."""
MOST_CYCLES, LEAST_CYCLES = 4096, 16
READING = "reading."
FLAGS = "flags of the total"
UNTRACKED = "contacts beyond the capacity"


class Gather:
    """Fills blocks with the states of one pipeline.

    Parameters
    ----------
    pipeline : Pipeline
    most : int, optional
        Maximum cycles of a block.

    Attributes
    ----------
    count, contact_count : int
        Cycles and contacts in the current block.
    most_contacts : int
        Of one cycle.
    sources : dict of str to ndarray
        Arrays that are copied each cycle; they stay the same.
    rows : dict of str to ndarray
        Their destinations, with a leading axis of cycles.
    """

    def __init__(self, pipeline: Pipeline, most: int | None = None) -> None:
        self._pipeline = pipeline
        self.sources = _sources(pipeline)
        self._lists = pipeline.lists_contacts
        self._present = np.zeros(0, np.int32)
        if pipeline.contacts is not None:
            self._present = pipeline.contacts.data.slots["present"]
        row_bytes = sum(array.nbytes for array in self.sources.values()) + 64
        capacity = int(np.clip(BLOCK_BYTES // row_bytes, LEAST_CYCLES, MOST_CYCLES))
        self.capacity = capacity if most is None else max(1, min(most, capacity))
        self.most_contacts = pipeline.contact_capacity if self._lists else 0
        self.contact_capacity = 2 * self.capacity + self.most_contacts if self._lists else 0
        topology = pipeline.topology
        self._area_share = topology.area / topology.area.sum()
        self._renew()

    def _renew(self) -> None:
        """Allocate arrays for the next block."""
        t = self.capacity
        self.count = self.contact_count = 0
        self.rows = {
            name: np.empty((t, *array.shape), array.dtype) for name, array in self.sources.items()
        }
        self.cycle, self.stamp_ns, self.overruns = np.empty((3, t), np.int64)
        self.closed_by = np.empty(t, np.uint8)
        self.contact_start = np.zeros(t + 1, np.int64)
        self.contacts = np.empty(self.contact_capacity, CONTACT)
        self.contact_slot = np.empty(self.contact_capacity, np.int32)

    @property
    def is_full(self) -> bool:
        """Whether there may be no room for another cycle."""
        room = self.contact_capacity - self.contact_count
        return self.count == self.capacity or room < self.most_contacts

    def add(self, state: State) -> None:
        """Copy a state of the pipeline."""
        t, k = self.count, self.contact_count
        for name, array in self.sources.items():
            self.rows[name][t] = array
        self.cycle[t], self.stamp_ns[t] = state.cycle, state.stamp_ns
        self.overruns[t] = state.overruns
        self.closed_by[t] = CLOSED_BY.index(state.closed_by)
        for slot, contact in zip(self._present, if_wanted(state, "contacts") or (), strict=False):
            self.contacts[k], self.contact_slot[k] = contact.record, slot
            k += 1
        self.count, self.contact_count = t + 1, k
        self.contact_start[t + 1] = k

    def block(self) -> Block | None:
        """The gathered block, which owns its arrays; None if it is empty."""
        t = self.count
        if not t:
            return None
        rows = {name: array[:t] for name, array in self.rows.items()}
        read = {
            name[len(READING) :]: rows.pop(name) for name in [*rows] if name.startswith(READING)
        }
        shown: dict[str, Any] = {name: read.get(name, UNWANTED) for name in Reading.__slots__}
        units = Reading(**shown)
        listed = {}
        if (flags := rows.pop(FLAGS, None)) is not None:
            listed["whole"] = flags[:, 0] & int(Flag.UNSEEN) == 0
        if (untracked := rows.pop(UNTRACKED, None)) is not None:
            listed["untracked"] = untracked[:, 0]
        if self._lists:
            listed["contacts"] = self.contacts[: self.contact_count].copy()
            listed["contact_start"] = self.contact_start[: t + 1]
            listed["contact_slot"] = self.contact_slot[: self.contact_count].copy()
        block = Block(
            topology=self._pipeline.topology, cycle=self.cycle[:t], stamp_ns=self.stamp_ns[:t],
            units=units, coverage=self._coverage(units.valid), closed_by=self.closed_by[:t],
            overruns=self.overruns[:t], **listed, **rows,
        )  # fmt: skip
        self._renew()
        return block

    def _coverage(self, valid: np.ndarray) -> np.ndarray:
        """Computed as in `Pipeline.state`, for the same bits."""
        coverage = np.ones(len(valid))
        for t in np.flatnonzero(~valid.all(axis=1)):
            coverage[t] = float(self._area_share.dot(valid[t]))
        return coverage


def _sources(pipeline: Pipeline) -> dict[str, np.ndarray]:
    """Arrays of a pipeline's states, which stay the same."""
    reading = pipeline.decoder.reading
    found = {f"{READING}{name}": getattr(reading, name) for name in Reading.__slots__}
    found |= pipeline.shown
    if pipeline.contacts is not None and pipeline.contacts.model.settings["total"][0]:
        found[FLAGS] = pipeline.contacts.records["flags"][-1:]
        found[UNTRACKED] = pipeline.contacts.data.cycle["untracked"]
    found |= {
        "totals": pipeline.assembler.totals,
        "sampled_ns": pipeline.assembler.sampled_ns,
    }
    if pipeline.topology.counts_only.any():
        found["counts"] = pipeline.counts
    return {name: array for name, array in found.items() if array is not None}
