"""Gathers states into blocks, by copying the arrays of their pipeline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skin.blocks.block import CLOSED_BY, Block
from skin.contact.record import CONTACT
from skin.owned import Layout
from skin.state import UNWANTED, Reading, valid_share

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Gather"]

BLOCK_BYTES = 16 << 20
"""Bytes of a block [assumed: a part of a laptop's third-level cache]."""
MOST_CYCLES, LEAST_CYCLES = 4096, 16
READING = "reading."
CLOSED_BY_INDEX = {reason: index for index, reason in enumerate(CLOSED_BY)}


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
    """

    def __init__(self, pipeline: Pipeline, most: int | None = None) -> None:
        self._pipeline, self._contacts = pipeline, pipeline.contacts
        self._lists = pipeline.lists_contacts
        wholes = pipeline.decoder.shown
        if self._contacts is not None:
            wholes = *wholes, self._contacts.records[-1:], self._contacts.data.cycle
        self._layout = layout = Layout(_sources(pipeline), wholes)
        capacity = int(np.clip(BLOCK_BYTES // layout.size, LEAST_CYCLES, MOST_CYCLES))
        self._capacity = capacity if most is None else max(1, min(most, capacity))
        self._most_contacts = pipeline.contact_capacity if self._lists else 0
        self._room = 2 * self._capacity + self._most_contacts if self._lists else 0
        if self._lists and self._contacts is not None:
            data = self._contacts.data
            self._records = data.contacts.view(np.uint8).data
            self._present, self._found = data.slots["present"], data.cycle["present"]
        self._rows = memoryview(bytearray(self._capacity * layout.size))
        self._listed = memoryview(bytearray(self._room * CONTACT.itemsize))
        self._renew()

    def _renew(self) -> None:
        """Begin the next block."""
        self.count = self.contact_count = 0
        self._heads: list[tuple[int, int, int, int]] = []
        self._slots: list[int] = []
        self._ends = [0]

    @property
    def is_full(self) -> bool:
        """Whether there may be no room for another cycle."""
        room = self._room - self.contact_count
        return self.count == self._capacity or room < self._most_contacts

    def add(self, state: State) -> None:
        """Copy a state of the pipeline."""
        size, t = self._layout.size, self.count
        self._rows[t * size : (t + 1) * size] = self._layout.copy()
        closed_by = CLOSED_BY_INDEX[state.closed_by]
        self._heads.append((state.cycle, state.stamp_ns, state.overruns, closed_by))
        if self._lists:
            each, k = CONTACT.itemsize, self.contact_count
            slots = self._present[: self._found[0]].tolist()
            for slot in slots:
                record = self._records[slot * each : (slot + 1) * each]
                self._listed[k * each : (k + 1) * each] = record
                k += 1
            self._slots += slots
            self.contact_count = k
            self._ends.append(k)
        self.count = t + 1

    def block(self) -> Block | None:
        """The gathered block, which owns its arrays; None if it is empty."""
        t = self.count
        if not t:
            return None
        cycle, stamp_ns, overruns, closed_by = np.array(self._heads, np.int64).T.copy()
        found = self._layout.rows(self._rows, t)
        shown: dict[str, Any] = {
            name: found.pop(READING + name, UNWANTED) for name in Reading.__slots__
        }
        units = Reading(**shown)
        if "whole" in found:
            found["whole"] = found["whole"][:, 0].astype(bool)
            found["untracked"] = found["untracked"][:, 0]
        if self._lists:
            k = self.contact_count
            found["contacts"] = np.frombuffer(self._listed, CONTACT, k).copy()
            found["contact_start"] = np.array(self._ends, np.int64)
            found["contact_slot"] = np.array(self._slots, np.int32)
        block = Block(
            topology=self._pipeline.topology, cycle=cycle, stamp_ns=stamp_ns, units=units,
            coverage=self._coverage(units.valid), closed_by=closed_by.astype(np.uint8),
            overruns=overruns, **found,
        )  # fmt: skip
        self._renew()
        return block

    def _coverage(self, valid: np.ndarray) -> np.ndarray:
        """Computed as in `State.coverage`, for the same bits."""
        coverage = np.ones(len(valid))
        for t in np.flatnonzero(~valid.all(axis=1)):
            coverage[t] = valid_share(self._pipeline.topology, valid[t])
        return coverage


def _sources(pipeline: Pipeline) -> dict[str, np.ndarray]:
    """Arrays of a pipeline's states, which stay the same."""
    reading = pipeline.decoder.reading
    found = {f"{READING}{name}": getattr(reading, name) for name in Reading.__slots__}
    found |= pipeline.shown
    if pipeline.contacts is not None and pipeline.contacts.model.settings["total"][0]:
        cycle = pipeline.contacts.data.cycle
        found["whole"], found["untracked"] = cycle["whole"], cycle["untracked"]
    found |= {
        "totals": pipeline.assembler.totals,
        "sampled_ns": pipeline.assembler.sampled_ns,
    }
    if pipeline.topology.counts_only.any():
        found["counts"] = pipeline.counts
    return {name: array for name, array in found.items() if array is not None}
