"""Assembler: frames in, cycles out, by the rules of `bus.assemble`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np

from bus.assemble.memory import (
    BY_COMPLETE,
    BY_DEADLINE,
    BY_END,
    Memory,
    Shown,
    new_memory,
    new_shown,
)
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from bus.frame import FRAME_DTYPE, views
from bus.table import FrameTable, Tables
from topology import Topology

__all__ = ["Assembler"]

_KINDS = tuple(field.name for field in fields(FrameCounters))
_CLOSED_BY = tuple(ClosedBy)
"""By what closed a cycle, a BY_… of the kernels, less `BY_COMPLETE`."""


class Assembler:
    """Frames in, cycles out.

    Parameters
    ----------
    topology : Topology
    stale_cycles : int
        Cycles without a reading after which a unit is STALE, and no longer awaited.
    deadline_s : float, optional
        Seconds from the opening of a cycle to its end by `expire`; 0.9 periods if not given.
    clock : callable
        Monotonic clock, in ns, for the opening time of cycles.

    Attributes
    ----------
    deadline_ns : int
        The deadline, from the opening of a cycle.

    Raises
    ------
    LayoutError
        A layout of the topology cannot be unpacked.
    """

    def __init__(
        self,
        topology: Topology,
        *,
        stale_cycles: int = 5,
        deadline_s: float | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if stale_cycles < 1:
            raise ValueError(f"stale_cycles: must be at least 1; got {stale_cycles}")
        if deadline_s is not None and not 0 < deadline_s < float("inf"):
            raise ValueError(f"deadline_s: must be above 0 s and finite; got {deadline_s}")
        self._clock = clock
        self._period_ns = max(1, round(1e9 / topology.cycle_rate_hz))
        self._silence_ns = (stale_cycles + 1) * self._period_ns
        seconds = 0.9 / topology.cycle_rate_hz if deadline_s is None else deadline_s
        self.deadline_ns = max(1, round(seconds * 1e9))

        table = FrameTable(topology)
        self._memory = new_memory(topology, table, stale_cycles)
        self._state = self._memory.state[0]
        self._shown = new_shown(topology.n)
        self._arrays = (table.tables, self._memory, self._shown)
        names = "closed_by", "closed_number", "closed_stamp"
        self._closed_by, self._number, self._stamp = (
            self._memory.state[name].data for name in names
        )  # fmt: skip
        self._cycle = *self._shown[:-2], self._memory.totals, *self._shown[-2:]
        self._since_ns: int | None = None

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome so far."""
        return FrameCounters(*self._memory.totals.tolist())

    @property
    def totals(self) -> np.ndarray:
        """The same as an array, in the order of `FrameCounters`, int64: always the same array."""
        return self._memory.totals

    @property
    def since_ns(self) -> int | None:
        """On the clock: opening of the cycle, or start of the free-running one; None before."""
        return self._since_ns

    @property
    def counts(self) -> np.ndarray:
        """Channels of the last cycle, shape (c, n), int16: the same array for every cycle."""
        return self._shown.counts

    @property
    def status(self) -> np.ndarray:
        """`Status` flags of the last cycle, shape (n,), uint16: the same array for every cycle."""
        return self._shown.status

    @property
    def sampled_ns(self) -> np.ndarray:
        """`RawCycle.sampled_ns` of the last cycle: the same array for every cycle."""
        return self._shown.sampled_ns

    def calls(self) -> list[tuple[Any, ...]]:
        """The kernels of a cycle, with arguments of their types."""
        from bus.assemble.cycles import close_cycle
        from bus.assemble.feed import feed

        frames = views(np.zeros(1, FRAME_DTYPE))
        return [(feed, 0, frames, *self._arrays), (close_cycle, BY_END, *self._arrays)]

    @cached_property
    def _kernels(self) -> tuple[Callable[..., Any], ...]:
        """The same as calls from here: loaded, or compiled, by the first frame."""
        from bus.compiled.jit import direct

        return tuple(direct(*call) for call in self.calls())

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first frame is not late."""
        _ = self._kernels

    def _close(self, by: int) -> RawCycle:
        """The cycle that is open, closed by a BY_… of the kernels."""
        self._kernels[1](by, *self._arrays)
        return self.cycle()

    @property
    def arrays(self) -> tuple[Tables, Memory, Shown]:
        """Arguments of the kernels of `bus.assemble.feed` after the frames."""
        return self._arrays

    @property
    def pending(self) -> bool:
        """Whether a cycle is open: with SYNC, one that awaits frames; without, always."""
        return bool(self._state["is_open"])

    @property
    def waiting(self) -> int:
        """Frames that the open cycle awaits; 0 without SYNC."""
        return int(self._state["waiting"]) if self.pending else 0

    def by_frame(self, kind: str) -> np.ndarray:
        """Running totals of one kind (a name of `FrameCounters`) by frame of the topology.

        Returns
        -------
        ndarray, shape (f,), int64
            Order of `Topology.frames`. Kinds that do not apply to data frames are 0.
        """
        return self._memory.tallies[:, _KINDS.index(kind)].copy()

    def feed(self, frames: np.ndarray) -> Iterator[RawCycle]:
        """Take frames, in the order of the bus, and yield every cycle as it closes.

        Consume the whole iterator: frames are taken only as it advances. The arrays of a cycle are
        valid until the next one.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
            From all buses, including the host's own SYNC.
        """
        if frames.dtype != FRAME_DTYPE or frames.ndim != 1:
            got = f"{frames.dtype} of shape {frames.shape}"
            raise ValueError(f"frames: must be FRAME_DTYPE of shape (m,); got {got}")
        state = self._state
        frames = np.ascontiguousarray(frames)
        rows, feed = views(frames), self._kernels[0]
        row = 0
        while row < frames.size:
            number = state["number"]
            row = feed(row, rows, *self._arrays)
            if state["number"] != number and not state["is_free"]:
                self._since_ns = self._clock()
            if self._closed_by[0]:
                yield self.cycle()

    def expire(self, now_ns: int) -> RawCycle | None:
        """Close the open cycle if its deadline has passed.

        Without SYNC, its period; if the caller was away for several periods, the number of the next
        cycle counts them.

        Parameters
        ----------
        now_ns : int
            The assembler's clock.
        """
        state = self._state
        if state["is_free"]:
            state["has_clock"] = 1
            if self._since_ns is None:
                self._since_ns = now_ns
            periods = (now_ns - self._since_ns) // self._period_ns
            if periods < 1:
                return None
            self._since_ns += periods * self._period_ns
            self._kernels[1](BY_DEADLINE, *self._arrays)
            state["number"] += periods - 1
            return self.cycle()
        if not self.pending or now_ns - (self._since_ns or 0) < self.deadline_ns:
            return None
        return self._close(BY_DEADLINE)

    def silence(self, now_ns: int) -> RawCycle | None:
        """Return a cycle without data if no SYNC has come for longer than `stale_cycles` periods.

        For a listener: so that units go STALE also where the host that sends SYNC falls silent, or
        was never heard. Then once a period; never without SYNC on any bus, nor while a cycle is
        open.

        Parameters
        ----------
        now_ns : int
            The assembler's clock.
        """
        state = self._state
        if state["is_free"] or self.pending:
            return None
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns < self._silence_ns:
            return None
        periods = (now_ns - self._since_ns - self._silence_ns) // self._period_ns + 1
        self._since_ns += periods * self._period_ns
        state["number"] += periods
        state["stamp"] += periods * self._period_ns
        return self._close(BY_DEADLINE)

    def flush(self) -> RawCycle | None:
        """Close the open cycle, at the end of a log or of a session; None if none is."""
        state = self._state
        if not self.pending or (state["is_free"] and not state["is_busy"]):
            return None
        return self._close(BY_END)

    def cycle(self) -> RawCycle:
        """The cycle that closed last; for callers of the kernels."""
        by = _CLOSED_BY[self._closed_by[0] - BY_COMPLETE]
        return RawCycle(self._number[0], self._stamp[0], by, *self._cycle)
