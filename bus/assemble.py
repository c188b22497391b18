"""Frames → cycles: which unit has said what, in which cycle, and what became of every frame.

Order of judgement. A frame is an error frame, a remote frame, one of no bus of the topology and so
foreign, a SYNC, an echo, a data frame of the topology (bus and identifier), a heartbeat, a
configuration frame, or foreign. A data frame of another length or kind than its layout's is short;
one that fails its CRC is counted as such; then its sequence number speaks. Every frame is counted
once. A SYNC counts also as an echo: in a log of the host that sent it, it is one.

With SYNC. A SYNC opens a cycle. Its 8-bit counter is unwrapped to the cycle's number, so that lost
SYNCs leave a gap in the numbers; the same counter on several buses is one cycle. The cycle closes
when all frames are in that it waits for, on the next SYNC, or at the deadline. It waits for the
frames of enabled units, but no longer for one that has not come for `stale_cycles` cycles; one
that comes back is waited for again from the next cycle on. Data carry the counter of their SYNC as
their sequence number, and belong to that cycle wherever they arrive: in another they are late.

With SYNC, but counts of their own (``sequence = "own"`` of their layout), or without sequence
numbers: data belong to the cycle in which they arrive, and are late after its end.

Without SYNC on any bus, a cycle ends each period: at ticks of the time stamps (for logs), or, from
the first call of `expire` on, of the caller's clock (live). The newest frame of each unit counts.
Since units and ticks are not in step, a unit that misses one cycle keeps its value one cycle long
and is late only then. A log's silence of more than `stale_cycles` is not filled with cycles.

Sequence numbers. A gap is counted as lost, less the frames that came but were not taken; half the
range or more is silence or a restart, not loss (of an echoed SYNC), or a step back (of a count).
The same number again is a repeat, and the first one holds. A step back is counted as late and
dropped, until the next number goes on from it: a restart. Other bytes under the same number, and
restart after restart, are evidence that two senders share an identifier; three pieces of it within
a few cycles flag the units DUPLICATE, two dozen cycles or more without any clear them.

Layouts of several frames. A set of units is whole when all its frames are in, of the same cycle
(with SYNC), or of the same sequence number and within half a period (without). A set that is not is
torn: its frames are counted so, its units flagged, and their last whole values kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np

from bus.compiled.aligned import zeros
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from bus.frame import FRAME_DTYPE
from topology import CHANNELS, Topology

__all__ = ["Assembler"]

_KINDS = tuple(field.name for field in fields(FrameCounters))
_CLOSED_BY = (None, ClosedBy.COMPLETE, ClosedBy.SYNC, ClosedBy.DEADLINE, ClosedBy.END)


class Assembler:
    """Frames in, cycles out.

    Parameters
    ----------
    topology : Topology
    stale_cycles : int
        Cycles without a reading after which a unit is STALE, and not waited for.
    deadline_s : float, optional
        Seconds from the opening of a cycle to its end by `expire`; 0.9 periods if not given.
    clock : callable
        Monotonic clock, in ns, that dates the opening of cycles for `expire`.

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
        from bus import kernels
        from bus.compiled.bound import direct
        from bus.table import FrameTable

        if stale_cycles < 1:
            raise ValueError(f"stale_cycles: must be at least 1; got {stale_cycles}")
        if deadline_s is not None and not deadline_s > 0:
            raise ValueError(f"deadline_s: must be above 0 s; got {deadline_s}")
        self._kernels = kernels
        self._feed, self._close = direct(kernels.feed), direct(kernels.close_cycle)
        self._clock = clock
        self._period_ns = max(1, round(1e9 / topology.cycle_rate_hz))
        self._silence_ns = (stale_cycles + 1) * self._period_ns
        seconds = 0.9 / topology.cycle_rate_hz if deadline_s is None else deadline_s
        self.deadline_ns = max(1, round(seconds * 1e9))

        table = FrameTable(topology)
        self._units = table.units
        self._memory = _memory(topology, table.tables, table.unit_group, stale_cycles)
        self._state = self._memory.state
        self._shown = kernels.Shown(
            counts=zeros((len(CHANNELS), topology.n), np.int16),
            valid=np.zeros(topology.n, bool),
            status=np.zeros(topology.n, np.uint16),
            age=np.full(topology.n, -1, np.int32),
            sequence=np.zeros(topology.n, np.uint8),
            fault_code=np.zeros(topology.n, np.uint8),
        )
        self._arrays = (table.tables, self._memory, self._shown)
        self._since_ns: int | None = None
        """On the clock: opening of the cycle, or start of the free-running one."""

    @property
    def counters(self) -> FrameCounters:
        """Frames by what became of them until now."""
        return FrameCounters(*self._memory.totals.tolist())

    @property
    def counts(self) -> np.ndarray:
        """Channels of the last cycle, shape (c, n), int16: the same array for every cycle."""
        return self._shown.counts

    @property
    def status(self) -> np.ndarray:
        """`Status` flags of the last cycle, shape (n,), uint16: the same array for every cycle."""
        return self._shown.status

    @property
    def pending(self) -> bool:
        """Whether a cycle is open: with SYNC, one that waits for frames; without, always."""
        return bool(self._state[self._kernels.OPEN])

    @property
    def waiting(self) -> int:
        """Frames that the open cycle waits for; 0 without SYNC."""
        return int(self._state[self._kernels.WAITING]) if self.pending else 0

    def by_frame(self, kind: str) -> np.ndarray:
        """Running totals of one kind (a name of `FrameCounters`) by frame of the topology.

        Returns
        -------
        ndarray, shape (f,), int64
            Order of `Topology.frames`. Kinds that no data frame can be of are 0.
        """
        return self._memory.tallies[:, _KINDS.index(kind)].copy()

    def by_unit(self, kind: str) -> np.ndarray:
        """Running totals of one kind of all frames that carry each unit.

        Returns
        -------
        ndarray, shape (n,), int64
        """
        frame, slot = np.nonzero(self._units >= 0)
        totals = np.zeros(self._shown.age.size, np.int64)
        np.add.at(totals, self._units[frame, slot], self.by_frame(kind)[frame])
        return totals

    def feed(self, frames: np.ndarray) -> Iterator[RawCycle]:
        """Take frames, in the order of the bus, and yield every cycle as it closes.

        Nothing is taken before the iterator asks for it: go through to its end. The arrays of a
        cycle are valid until the next one.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
            From all buses; the host's own SYNC among them.
        """
        if frames.dtype != FRAME_DTYPE or frames.ndim != 1:
            got = f"{frames.dtype} of shape {frames.shape}"
            raise ValueError(f"frames: must be FRAME_DTYPE of shape (m,); got {got}")
        kernels, state = self._kernels, self._state
        frames = np.ascontiguousarray(frames)
        views = kernels.as_words(frames), kernels.as_bytes(frames)
        row = 0
        while row < frames.size:
            number = state[kernels.NUMBER]
            row = self._feed(row, *views, *self._arrays)
            if state[kernels.NUMBER] != number and not state[kernels.FREE]:
                self._since_ns = self._clock()
            if state[kernels.CLOSED_BY]:
                yield self._cycle()

    def expire(self, now_ns: int) -> RawCycle | None:
        """Close the open cycle if its time is over.

        With SYNC that is the deadline; without, the end of the period, and if the caller was away
        for several, the number of the next cycle says so.

        Parameters
        ----------
        now_ns : int
            The assembler's clock.
        """
        kernels, state = self._kernels, self._state
        if state[kernels.FREE]:
            state[kernels.OWN_CLOCK] = 1
            if self._since_ns is None:
                self._since_ns = now_ns
            periods = (now_ns - self._since_ns) // self._period_ns
            if periods < 1:
                return None
            self._since_ns += periods * self._period_ns
            self._close(kernels.BY_DEADLINE, *self._arrays)
            state[kernels.NUMBER] += periods - 1
            return self._cycle()
        if not self.pending or now_ns - (self._since_ns or 0) < self.deadline_ns:
            return None
        self._close(kernels.BY_DEADLINE, *self._arrays)
        return self._cycle()

    def silence(self, now_ns: int) -> RawCycle | None:
        """Give a cycle without data if no SYNC has come for longer than `stale_cycles` periods.

        For a listener: so that units go STALE also where the host that sends SYNC falls silent,
        or has never been heard. Then once a period; without SYNC on any bus, and while a cycle is
        open, never.

        Parameters
        ----------
        now_ns : int
            The assembler's clock.
        """
        kernels, state = self._kernels, self._state
        if state[kernels.FREE] or self.pending:
            return None
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns < self._silence_ns:
            return None
        periods = (now_ns - self._since_ns - self._silence_ns) // self._period_ns + 1
        self._since_ns += periods * self._period_ns
        state[kernels.NUMBER] += periods
        state[kernels.STAMP] += periods * self._period_ns
        self._close(kernels.BY_DEADLINE, *self._arrays)
        return self._cycle()

    def flush(self) -> RawCycle | None:
        """Close what is open, at the end of a log or of a session; None if nothing is."""
        kernels, state = self._kernels, self._state
        if not self.pending or (state[kernels.FREE] and not state[kernels.BUSY]):
            return None
        self._close(kernels.BY_END, *self._arrays)
        return self._cycle()

    def _cycle(self) -> RawCycle:
        kernels, state, shown = self._kernels, self._state, self._shown
        return RawCycle(
            int(state[kernels.CLOSED_NUMBER]),
            int(state[kernels.CLOSED_STAMP]),
            _CLOSED_BY[state[kernels.CLOSED_BY]],
            *shown,
            self.counters,
        )


def _memory(topology, tables, unit_group, stale_cycles):
    """An assembler's memory before the first frame."""
    from bus import kernels as k

    n, frames, sets = topology.n, len(topology.frames), len(tables.parts)
    state = np.zeros(k.STATE_SIZE, np.int64)
    syncs = np.full((len(topology.buses), 3), -1, np.int64)
    for b, bus in enumerate(topology.buses):
        if bus.sync_id is not None:
            syncs[b, k.SYNC_IDENTIFIER] = bus.sync_id
    is_free = all(bus.sync_id is None for bus in topology.buses)
    state[[k.FREE, k.OPEN]] = is_free
    state[[k.NUMBER, k.SYNCED]] = 0 if is_free else -1
    state[k.STAMP] = -1 if is_free else 0
    state[k.PERIOD] = max(1, round(1e9 / topology.cycle_rate_hz))
    state[k.STALE_CYCLES] = stale_cycles
    sources = np.zeros((frames, k.SOURCE_COLUMNS), np.int64)
    sources[:, [k.HEARD, k.BACK, k.TAKEN_AT]] = -1
    set_memory = np.zeros((sets, k.SET_COLUMNS), np.int64)
    set_memory[:, [k.KEY, k.WHOLE_AT, k.TORN_AT]] = -1
    units = np.zeros((k.UNIT_ROWS, n), np.int64)
    units[k.SEEN_AT] = -1
    units[k.FROZEN_AFTER] = topology.parameters["frozen_cycles"]
    units[k.ENABLED] = topology.enabled
    units[k.SET] = unit_group
    return k.Memory(
        state=state,
        syncs=syncs,
        sources=sources,
        last=np.zeros((frames, 64), np.uint8),
        sets=set_memory,
        units=units,
        totals=np.zeros(k.KINDS, np.int64),
        tallies=np.zeros((frames, k.KINDS), np.int64),
        gathered=np.zeros(len(CHANNELS) * n, np.int16),
        gathered_codes=np.zeros(n, np.uint8),
        staged=np.zeros(len(CHANNELS) * n, np.int16),
        staged_codes=np.zeros(n, np.uint8),
        staged_sequence=np.zeros(n, np.uint8),
    )
