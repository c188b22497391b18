"""Survey: traffic on the buses of a topology, for a comparison with the expected one.

`bus.diagnose` turns a survey into findings. Memory is bounded for any traffic: frames are counted
by bus, identifier, length and kind; beyond the first few thousand kinds only the total is kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bus.assemble import Assembler
from bus.boards import Boards
from bus.cycle import FrameCounters, RawCycle
from bus.errors import BusClosedError
from bus.frame import CAN_ERR, CAN_RTR, ECHO, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.state import read_error_frame
from bus.status import Status
from bus.transport import Transport
from bus.wait import Waiter
from topology import Topology

__all__ = ["Heard", "Survey", "listen"]

MOST_KINDS = 4096
STALE_CYCLES = 5
_LONGEST_STEP_NS = 1_000_000_000
_WATCHED = (Status.FROZEN, Status.FAULT, Status.DUPLICATE)


@dataclass(frozen=True, slots=True)
class Heard:
    """A kind of received frame."""

    bus: int
    can_id: int
    length: int
    is_fd: bool


class Survey:
    """Traffic on the buses of a topology.

    Parameters
    ----------
    topology : Topology
    sends_sync : bool
        Whether this host sends SYNC; a SYNC of another node is then a fault.

    Attributes
    ----------
    cycles : int
        Cycles so far.
    heard : dict of Heard to int
        Frames of others, without error and remote frames.
    more_kinds : int
        Frames of kinds beyond those in `heard`.
    errors : list of dict of str to int
        Error frames of each bus by content, without those of a full controller.
    traffic, syncs : ndarray, shape (buses,), int64
        Frames of others, without error frames; SYNCs of all nodes.
    foreign_syncs : ndarray, shape (buses,), int64
        SYNCs of others.
    unsent : ndarray, shape (buses,), int64
        SYNCs of this host that a bus did not accept.
    flagged : dict of Status to ndarray, shape (n,), int64
        Cycles in which a unit had a flag.
    fault_code : ndarray, shape (n,), uint8
        Last fault reported by a unit.
    age, longest_age : ndarray, shape (n,), int64
        Cycles since the last reading, -1 for never; the longest silence that ended.
    boards : Boards
        Contents of heartbeats.
    listened_s : ndarray, shape (buses,)
        Listening time of each bus, in seconds, by the stamps of others' frames; steps back, and
        steps of more than a second, are left out.
    closed : str
        Why listening to a bus ended early; empty if it did not.
    """

    def __init__(self, topology: Topology, *, sends_sync: bool = False) -> None:
        self.topology = topology
        self.sends_sync = sends_sync
        self.cycles = 0
        self.heard: dict[Heard, int] = {}
        self.more_kinds = 0
        self.errors: list[dict[str, int]] = [{} for _ in topology.buses]
        self.traffic, self.syncs, self.foreign_syncs, self.unsent = np.zeros(
            (4, len(topology.buses)), np.int64
        )
        self.flagged = {flag: np.zeros(topology.n, np.int64) for flag in _WATCHED}
        self.fault_code = np.zeros(topology.n, np.uint8)
        self.age = np.full(topology.n, -1, np.int64)
        self.longest_age = np.zeros(topology.n, np.int64)
        self.boards = Boards(topology)
        self.listened_s = np.zeros(len(topology.buses))
        self.closed = ""
        self._assembler = Assembler(topology, stale_cycles=STALE_CYCLES)
        self._stamps_ns: dict[int, int] = {}
        self._words: dict[tuple[int, int, bytes], str] = {}

    @property
    def seconds(self) -> float:
        """Listening time, in seconds."""
        return float(self.listened_s.max())

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome."""
        return self._assembler.counters

    def by_frame(self, kind: str) -> np.ndarray:
        """Totals of one kind by frame of the topology; see `Assembler.by_frame`."""
        return self._assembler.by_frame(kind)

    def feed(self, frames: np.ndarray) -> None:
        """Take frames, in the order of the bus.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
            From all buses, including the host's own SYNC, which is marked as such (`ECHO`).
        """
        if not frames.size:
            return
        self.boards.hear(frames, self._time(frames))
        known = frames[frames["bus"] < len(self.topology.buses)]
        is_error = (known["id"] & np.uint32(CAN_ERR)) != 0
        self._hear_errors(known[is_error])
        self._hear(known[~is_error])
        for cycle in self._assembler.feed(frames):
            self._see(cycle)

    def expire(self, now_ns: int) -> None:
        """Close the open cycle at its deadline, or a silent one; for a live bus."""
        cycle = self._assembler.expire(now_ns) or self._assembler.silence(now_ns)
        if cycle is not None:
            self._see(cycle)

    def finish(self) -> None:
        """Close the open cycle."""
        cycle = self._assembler.flush()
        if cycle is not None:
            self._see(cycle)

    def _time(self, frames: np.ndarray) -> np.ndarray:
        """Time of each frame, in seconds of listening to its bus; 0 for this host's own.

        Per bus, since stamps may be of different clocks, and buses are read in turn.
        """
        came_s = np.zeros(frames.size)
        of_others = (frames["origin"] & ECHO) == 0
        for b in range(len(self.topology.buses)):
            here = np.flatnonzero(of_others & (frames["bus"] == b))
            if not here.size:
                continue
            stamps = frames["stamp_ns"][here]
            steps = np.diff(stamps, prepend=self._stamps_ns.get(b, int(stamps[0])))
            steps[(steps < 0) | (steps > _LONGEST_STEP_NS)] = 0
            came_s[here] = self.listened_s[b] + 1e-9 * np.cumsum(steps)
            self.listened_s[b] = came_s[here[-1]]
            self._stamps_ns[b] = int(stamps[-1])
        return came_s

    def _hear(self, frames: np.ndarray) -> None:
        own = (frames["origin"] & ECHO) != 0
        sync_id = self.topology.sync_id
        for b in range(len(self.topology.buses)):
            here = frames["bus"] == b
            self.traffic[b] += np.count_nonzero(here & ~own)
            if sync_id is not None:
                is_sync = here & (frames["id"] == sync_id)
                self.syncs[b] += np.count_nonzero(is_sync)
                self.foreign_syncs[b] += np.count_nonzero(is_sync & ~own)
        data = frames[~own & ((frames["id"] & np.uint32(CAN_RTR)) == 0)]
        is_fd = (data["flags"] & FD_FDF) != 0
        keys = (
            data["id"].astype(np.uint64)
            | data["length"].astype(np.uint64) << np.uint64(32)
            | is_fd.astype(np.uint64) << np.uint64(40)
            | data["bus"].astype(np.uint64) << np.uint64(48)
        )
        for key, count in zip(*(a.tolist() for a in np.unique(keys, return_counts=True)),
                              strict=True):  # fmt: skip
            kind = Heard(key >> 48, key & 0xFFFF_FFFF, (key >> 32) & 0xFF, bool(key >> 40 & 1))
            if kind in self.heard or len(self.heard) < MOST_KINDS:
                self.heard[kind] = self.heard.get(kind, 0) + count
            else:
                self.more_kinds += count

    def _hear_errors(self, frames: np.ndarray) -> None:
        for record in frames:
            key = (int(record["id"]), int(record["length"]), record["data"][:8].tobytes())
            words = self._words.get(key)
            if words is None:
                error = read_error_frame(record)
                words = "" if error.is_overflow else error.words
                if len(self._words) < MOST_KINDS:
                    self._words[key] = words
            if not words:  # a full controller is not an error of the bus; the assembler counts it
                continue
            kinds = self.errors[record["bus"]]
            words = words if words in kinds or len(kinds) < MOST_KINDS else "other errors"
            kinds[words] = kinds.get(words, 0) + 1

    def _see(self, cycle: RawCycle) -> None:
        self.cycles += 1
        for flag in self.flagged:
            self.flagged[flag] += (cycle.status & int(flag)) != 0
        reported = cycle.fault_code != 0
        self.fault_code[reported] = cycle.fault_code[reported]
        is_back = (cycle.age == 0) & (self.age > 0)
        self.longest_age[is_back] = np.maximum(self.longest_age, self.age)[is_back]
        self.age[:] = cycle.age


def listen(
    survey: Survey,
    transports: Sequence[Transport],
    seconds: float,
    *,
    sync: Literal["host", "bus"] = "host",
    clock: Callable[[], int] = time.monotonic_ns,
) -> None:
    """Feed a survey from live buses.

    Ends early where a bus closes, which the survey records.

    Parameters
    ----------
    survey : Survey
    transports : sequence of Transport
        One for each bus of the survey's topology, in order.
    seconds : float
        Duration.
    sync : "host" or "bus"
        Who sends SYNC: this host, at the cycle rate, or another node.
    clock : callable
        Monotonic clock, in ns.
    """
    skin, batch, waiter = survey.topology, FrameBatch(4096), Waiter(transports)
    period_ns = round(1e9 / skin.cycle_rate_hz)
    sends = sync == "host" and skin.sync_id is not None
    survey.sends_sync = sends
    counter, now = 0, clock()
    due = now
    end = now + round(seconds * 1e9)
    try:
        while now < end:
            if sends and now >= due:
                syncs, is_taken = _send_sync(skin, transports, counter)
                survey.unsent += ~is_taken
                survey.feed(syncs[is_taken])
                counter += 1
                due = max(due + period_ns, now)
            wait_ns = min(end, due if sends else now + period_ns) - clock()
            batch.clear()
            waiter.receive(batch, wait_ns)
            if len(transports) > 1:
                batch.merge()
            survey.feed(batch.frames)
            now = clock()
            survey.expire(now)
    except BusClosedError as error:
        survey.closed = str(error)
    survey.finish()


def _send_sync(
    skin: Topology, transports: Sequence[Transport], counter: int
) -> tuple[np.ndarray, np.ndarray]:
    """Send SYNC on every bus; returns it as the host's own frames, and the buses that accepted
    it."""
    frames = np.zeros(len(skin.buses), FRAME_DTYPE)
    frames["stamp_ns"], frames["length"], frames["origin"] = time.time_ns(), 1, ECHO
    frames["data"][:, 0] = counter & 0xFF
    is_taken = np.zeros(frames.size, bool)
    for i, transport in enumerate(transports):
        frames[i]["id"], frames[i]["bus"] = skin.sync_id, i
        is_taken[i] = transport.send(frames[i : i + 1])
    return frames, is_taken
