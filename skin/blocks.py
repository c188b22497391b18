"""Blocks: many consecutive states of one skin as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.cycle import ClosedBy, FrameCounters
from skin.contact.record import CONTACT
from skin.decode.arrays import Results, rows_of
from skin.state import UNWANTED, Reading, arrays_in, valid_share

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State
    from topology import Topology

__all__ = ["CLOSED_BY", "Block", "blocks_of"]

CLOSED_BY = tuple(ClosedBy)
"""Reasons for the end of a cycle, by the index in `Block.closed_by`."""
BLOCK_BYTES = 16 << 20
"""Bytes of a block [assumed: a part of a laptop's third-level cache]."""
MOST_CYCLES, LEAST_CYCLES = 4096, 16
MOST_CONTACTS = 2
"""Contacts a cycle, on average, beyond which a block ends sooner [assumed]."""


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
        Contact of each unit, counted within its cycle; -1 for none, -2 for one beyond the
        capacity.
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
        arrays = *arrays_in(self).values(), *arrays_in(self.units).values()
        return sum(one.nbytes for one in arrays)

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


def blocks_of(
    states: Iterable[State], pipeline: Pipeline, most: int | None = None
) -> Iterator[Block]:
    """The states of an iterator as blocks, of its pipeline's own arrays.

    Parameters
    ----------
    states : iterable of State
        The next one is asked for when that before is copied.
    pipeline : Pipeline
        That the states come from.
    most : int, optional
        Maximum cycles of a block; by default a block has some megabytes.
    """
    now, decoder = pipeline.now, pipeline.decoder
    sources = arrays_in(now)
    if pipeline.topology.counts_only.any():
        sources["counts"] = pipeline.counts
    size = sum(one.nbytes for one in (*decoder.shown, *sources.values()))
    capacity = int(np.clip(BLOCK_BYTES // size, LEAST_CYCLES, MOST_CYCLES))
    capacity = capacity if most is None else max(1, min(most, capacity))
    coming = iter(states)
    while block := _block_of(coming, pipeline, sources, capacity):
        yield block


def _block_of(
    states: Iterator[State], pipeline: Pipeline, sources: dict[str, np.ndarray], capacity: int
) -> Block | None:
    """The next states, so many at most; None where there are no more."""
    now, decoder, topology = pipeline.now, pipeline.decoder, pipeline.topology
    out = Results(topology.n, decoder.dtype, (capacity,))
    found: dict[str, Any] = {
        name: np.empty((capacity, *one.shape), one.dtype) for name, one in sources.items()
    }
    copies = [
        *zip(out.arrays, decoder.shown, strict=True),
        *((found[name], one) for name, one in sources.items()),
    ]
    heads, contacts = list[tuple[Any, ...]](), _Contacts(pipeline)
    for t, _ in enumerate(states):
        for copy, one in copies:
            copy[t] = one
        closed_by = CLOSED_BY.index(now.closed_by)
        heads.append((now.cycle, now.stamp_ns, now.overruns, closed_by, now.whole, now.untracked))
        contacts.take()
        if t + 1 == capacity or contacts.count > MOST_CONTACTS * capacity:
            break
    if not heads:
        return None
    count = len(heads)
    cycle, stamp_ns, overruns, closed_by, whole, untracked = map(np.array, zip(*heads, strict=True))
    units = out.reading(rows_of(decoder.plan.quantities, sigma="sigma" in decoder.want))
    units.topology = topology
    for name, one in arrays_in(units).items():
        setattr(units, name, one[:count])
    found = {name: one[:count] for name, one in found.items()} | contacts.found()
    if now.whole is not None:
        found |= {"whole": whole, "untracked": untracked}
    return Block(
        topology=topology, cycle=cycle, stamp_ns=stamp_ns, units=units,
        coverage=valid_share(topology, units.valid), closed_by=closed_by.astype(np.uint8),
        overruns=overruns, **found,
    )  # fmt: skip


class _Contacts:
    """Copies of the records of contacts, cycle by cycle; none where they are not wanted."""

    def __init__(self, pipeline: Pipeline) -> None:
        self.count, self._ends, self._parts, self._slots = 0, [0], [], []
        self._of = stream = pipeline.contacts if pipeline.lists_contacts else None
        if stream is not None:
            # as bytes: numpy copies records field by field, which takes many times as long
            self._bytes = stream.records.view(np.uint8).reshape(-1, CONTACT.itemsize)
            self._present, self._found = stream.data.slots["present"], stream.data.cycle["present"]

    def take(self) -> None:
        """Copy those of the cycle."""
        if self._of is None:
            return
        if found := int(self._found[0]):
            slots = self._present[:found].copy()
            self._parts.append(self._bytes[slots])
            self._slots.append(slots)
            self.count += found
        self._ends.append(self.count)

    def found(self) -> dict[str, np.ndarray]:
        """Arrays of a block."""
        if self._of is None:
            return {}
        none, slots = np.empty((0, CONTACT.itemsize), np.uint8), np.empty(0, np.int32)
        return {
            "contacts": np.concatenate([none, *self._parts]).reshape(-1).view(CONTACT),
            "contact_start": np.array(self._ends, np.int64),
            "contact_slot": np.concatenate([slots, *self._slots]).astype(np.int32),
        }
