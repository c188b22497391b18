"""Fault intervals of units: their flags, first and last cycle, begin and end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skin.arrow import Arrow
from skin.blocks.block import Block
from skin.state import INVALID, Status
from topology import Topology

__all__ = ["FaultIntervals"]

BITS = tuple(flag for flag in Status if flag & INVALID)


class FaultIntervals:
    """Builds the table of fault intervals of one log from its blocks, in order.

    Parameters
    ----------
    library : Arrow
    topology : Topology
    metadata : mapping of str to str
        Metadata of the table.
    """

    def __init__(self, library: Arrow, topology: Topology, metadata: Mapping[str, str]) -> None:
        self._library, self._topology, self._metadata = library, topology, dict(metadata)
        self._flags = np.zeros(topology.n, np.uint16)
        self._since = np.zeros((2, topology.n), np.int64)
        self._last = np.zeros(2, np.int64)

    def end(self) -> list[tuple[Any, ...]]:
        """The fault intervals that are open at the end of the log, as `pass_over`."""
        return [self._interval(i, *self._last) for i in np.flatnonzero(self._flags)]

    def pass_over(self, block: Block) -> list[tuple[Any, ...]]:
        """Fault intervals that end in a block: unit, begin, end, cycles of both, and the flags."""
        flags = block.units.status & np.uint16(int(INVALID))
        before = np.vstack([self._flags, flags[:-1]])
        rows = []
        for t, i in zip(*np.nonzero(flags != before), strict=True):
            if self._flags[i]:
                last = (block.cycle[t - 1], block.stamp_ns[t - 1]) if t else self._last
                rows.append(self._interval(i, *last))
            self._flags[i] = flags[t, i]
            self._since[:, i] = block.cycle[t], block.stamp_ns[t]
        self._last[:] = block.cycle[-1], block.stamp_ns[-1]
        return rows

    def _interval(self, unit: Any, cycle: Any, stamp_ns: Any) -> tuple[Any, ...]:
        flags = int(self._flags[unit])
        words = " ".join(str(flag.name) for flag in BITS if flags & flag)
        first_cycle, first_ns = self._since[:, unit].tolist()
        name = self._topology.unit_names[unit]
        return name, first_ns, int(stamp_ns), first_cycle, int(cycle), words

    def table(self, rows: list[tuple[Any, ...]]) -> Any:
        """Fault intervals as a table."""
        arrow = self._library.arrow
        kinds = {
            "unit": arrow.string(), "time": arrow.timestamp("ns"), "until": arrow.timestamp("ns"),
            "first_cycle": arrow.int64(), "last_cycle": arrow.int64(), "flags": arrow.string(),
        }  # fmt: skip
        columns = list(zip(*rows, strict=True)) if rows else [()] * len(kinds)
        arrays = [arrow.array(list(column), kind)
                  for column, kind in zip(columns, kinds.values(), strict=True)]  # fmt: skip
        return arrow.Table.from_arrays(
            arrays, schema=arrow.schema(list(kinds.items()), self._metadata)
        )
