"""Skin: the open buses of a topology; who sends SYNC, and when."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from inspect import GEN_CLOSED, getgeneratorstate
from itertools import chain
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bus.configure import Command, pack
from bus.cycle import FrameCounters
from bus.errors import BusClosedError
from bus.frame import FrameBatch
from bus.logs import Recording
from bus.state import BusChange
from bus.transport import Transport
from bus.wait import Lull, Waiter
from skin.compiling import announcer
from skin.errors import SkinError
from skin.moving import Moving
from skin.pacing import sync_frames, sync_ns, wait_until
from skin.pipeline import Pipeline
from skin.state import State, Status, trouble

if TYPE_CHECKING:
    from skin.calibrate.background import Learning
    from skin.sim.node import Nodes

__all__ = ["Skin", "Sync", "Timing", "Wait"]

Sync = Literal["host", "bus"]
Wait = Literal["event", "drain"]


@dataclass
class Timing:
    """Where the time of the last cycle went, and how often the host was late."""

    work_ns: int = 0
    """Assembling, decoding and contacts of the last cycle, without waiting."""
    overruns: int = 0
    """SYNCs that could not be sent in time and were left out."""
    unsent: int = 0
    """SYNCs that a bus would not take: its cycle had no chance of an answer."""


class Skin(Moving):
    """An open skin; iterate over it for one `State` a cycle. Made by `skin.open`.

    Attributes
    ----------
    topology : Topology
    pipeline : Pipeline
        What turns frames into states.
    transports : list of Transport
        This host's end of each bus.
    timing : Timing
    nodes : Nodes or None
        The simulated units, where there are any.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        transports: list[Transport],
        *,
        sync: Sync = "host",
        wait: Wait = "event",
        pace: bool = True,
        nodes: Nodes | None = None,
        recording: Recording | None = None,
    ) -> None:
        self.topology = topology = pipeline.topology
        self.pipeline = pipeline
        self.transports = transports
        self.timing = Timing()
        self.nodes = nodes
        self._recording = recording
        self._batch = FrameBatch(4096)
        self._waiter = Waiter(transports, wait)
        self._pace = pace
        self._period_ns = round(1e9 / topology.cycle_rate_hz)
        self._lull, self._has_lull = Lull(self._period_ns), wait == "event"
        self._sends_sync = sync == "host" and topology.buses[0].sync_id is not None
        self._tells_time = all(bus.sync_id is not None for bus in topology.buses) and all(
            end.keeps_stamps for end in transports
        )
        self._sync_frames = sync_frames(topology)
        self._wire_ns = sync_ns(topology) if nodes is None else 0 * sync_ns(topology)
        self._started_ns, self._epoch_ns = time.monotonic_ns(), time.time_ns()
        self._number = 0
        self._cycles: Generator[State] | None = None
        self._iterating, self._closing = Lock(), RLock()
        self._closed = False
        self._is_watched, self._latest = False, None

    def __repr__(self) -> str:
        """The skin, and whether its units are simulated."""
        units = "simulated units" if self.simulated else "units"
        return f"<Skin {self.topology.name!r}: {self.topology.n} {units}>"

    @property
    def simulated(self) -> bool:
        """Whether the units are simulated ones that `skin.open` has attached: no force is real."""
        return self.nodes is not None

    @property
    def zeros(self) -> dict[str, Any]:
        """Zeros of this run: units ``tared`` in it, units that have those ``taken_up`` of the run
        before, and those ``refused`` so far, with the reason."""
        taken = self.pipeline.zeros
        return {"tared": [], "taken_up": [], "refused": {}} if taken is None else taken.report()

    @property
    def learning(self) -> Learning | None:
        """What learns the fields of neighbours, with ``learn=True``: has `report` and `save`."""
        return self.pipeline.learning

    @property
    def bus_changes(self) -> list[tuple[str, BusChange]]:
        """Changes of state of every bus so far, by its name: warnings, bus-off, unplugged, …"""
        pairs = zip(self.topology.buses, self.transports, strict=True)
        return [(bus.name, change) for bus, end in pairs for change in end.changes]

    @property
    def counters(self) -> FrameCounters:
        """Frames by what became of them, running totals."""
        return self.pipeline.counters

    @property
    def clocks(self) -> dict[str, dict[str, Any]]:
        """What stamps the frames of each bus, by its name: ``by``, "interface" where its driver
        does, else "kernel"; ``error_ns``, one sigma of the map from the interface's clock to the
        kernel's, and ``drift_ppm`` of it; how often one of them was set (``steps``)."""
        pairs = zip(self.topology.buses, self.transports, strict=True)
        own = {bus.name: end.clock for bus, end in pairs}
        return {name: c.report() if c and c.ready else {"by": "kernel"} for name, c in own.items()}

    def realtime_ns(self, stamp_ns: int) -> int:
        """A stamp of a cycle that this host has begun, as the system's clock has it now.

        `State.stamp_ns` and `State.sampled_ns` are of a clock that nobody sets: it begins with the
        system's and goes by the monotonic one, so that no step of the system's clock is in forces
        or contacts. Cameras and other programs stamp by the system's.
        """
        return stamp_ns + time.time_ns() - self._stamp_ns()

    def configure(self, command: Command, *, node: int = 0, value: int = 0) -> None:
        """Tell the boards on all buses to do something: tare, or answer every k-th SYNC only.

        Boards that answer seldom are late in the cycles between, which then wait for the
        deadline.

        Parameters
        ----------
        command : bus.configure.Command
        node : int
            Number of a board on its bus; 0 for all.
        value : int
            Of ``RATE``: every how manyth cycle.

        Raises
        ------
        ValueError
            No board can obey it.
        SkinError
            A bus would not take the frame; the others have it.
        """
        frame = pack(command, node, value)
        deaf = []
        for i, (bus, end) in enumerate(zip(self.topology.buses, self.transports, strict=True)):
            if not end.send(frame):
                deaf.append(bus.name)
            elif self._recording is not None:
                sent = frame.copy()
                sent["bus"], sent["stamp_ns"] = i, self._stamp_ns()
                self._recording.write(sent)
        if deaf:
            raise SkinError(f"configure: must be taken by every bus; got no room on {deaf}")

    def trouble(self, state: State) -> dict[str, Status]:
        """Units that must not be trusted in this state, and why, by unit name."""
        return trouble(self.topology, state.units.status)

    def latest(self) -> State | None:
        """A copy of the newest state, for threads beside the one that iterates; never waits.

        Whoever asks sees whole cycles only, and keeps what it was given. All that ask between two
        cycles are given the same copy. The first call lets the cycles that come be copied.

        Returns
        -------
        State or None
            None until a cycle has ended after the first call.
        """
        self._is_watched = True
        return self._latest

    def __enter__(self) -> Skin:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the buses; closing twice is fine.

        May be called from any thread: whoever iterates is at the end then, without an error.
        """
        self._closed = True
        with self._closing:
            announcer().finish()
            if self.nodes is not None:
                self.nodes.close()
            for transport in self.transports:
                transport.close()
            try:
                if self._recording is not None:
                    self._recording.close()
            finally:  # the log's disk may be full, that of the zeros is another
                self.pipeline.close()

    def __iter__(self) -> Iterator[State]:
        """One state a cycle; a later loop goes on where the one before has ended.

        Raises
        ------
        SkinError
            Another iterator is live.
        BusClosedError
            A bus is gone for good.
        """
        self.pipeline.warmup()
        return self._states()

    def _states(self) -> Iterator[State]:
        """States of the cycles, which outlive this iterator."""
        if not self._iterating.acquire(blocking=False):
            raise SkinError("iter(skin): must be the only live iterator of a skin; got a second")
        try:
            if self._cycles is None or getgeneratorstate(self._cycles) == GEN_CLOSED:
                self._cycles = self._host_cycles() if self._sends_sync else self._bus_cycles()
            first = next(self._cycles, None)
            announcer().finish()  # by now all has been compiled
            for state in () if first is None else chain((first,), self._cycles):
                if self._is_watched:
                    self._latest = state.copy()
                yield state
        except BusClosedError:
            if not self._closed:
                raise
        finally:
            self._iterating.release()

    def _host_cycles(self) -> Generator[State]:
        """This host sends SYNC: one cycle for each."""
        due = time.monotonic_ns()
        while not self._closed:
            if self._pace:
                due, skipped = wait_until(due, self._period_ns)
                self.timing.overruns += skipped
                self._number += skipped
            else:
                due = time.monotonic_ns()
            self._receive(0)  # who answers after the cycle was closed shall be waited for
            yield from self._feed(self._batch.frames)
            yield from self._feed(self._sync(self._number))
            self._number += 1
            yield from self._answers()
            due += self._period_ns

    def _answers(self) -> Iterator[State]:
        """Receive until the cycle is closed; sleep through arrivals that cannot complete it."""
        pipeline, lull = self.pipeline, self._lull
        asked_ns = heard_ns = time.monotonic_ns()
        until_ns = asked_ns + pipeline.assembler.deadline_ns
        looks, sleeps = 0, self._has_lull and lull.ns > 0
        while not self._closed and pipeline.pending:
            if sleeps and looks == 1:
                wait_until(min(asked_ns + lull.ns, until_ns), self._period_ns)
            now_ns = time.monotonic_ns()  # what has arrived by then is heard before time is up
            # units within this process have answered already
            self._receive(0 if sleeps and looks == 0 else until_ns - now_ns)
            looks, heard_ns = looks + 1, time.monotonic_ns()
            yield from self._feed(self._batch.frames)
            yield from self._timed(now_ns, pipeline.expire)
        if heard_ns < until_ns:
            lull.learn(heard_ns - asked_ns, slept_too_long=looks <= 1 + sleeps)

    def _bus_cycles(self) -> Generator[State]:
        """Somebody else sends SYNC, or nobody does: cycles come as they close."""
        while not self._closed:
            self._receive(self._period_ns)
            now_ns = time.monotonic_ns()  # a consumer that takes its time is no silence
            if len(self.transports) > 1:
                self._batch.merge()
            yield from self._feed(self._batch.frames)
            yield from self._timed(now_ns, self.pipeline.expire, self.pipeline.silence)

    def _sync(self, number: int) -> np.ndarray:
        """Send SYNC on every bus and return the frames, as a log would show them."""
        frames = self._sync_frames
        frames["data"][:, 0] = number & 0xFF
        frames["stamp_ns"] = self._stamp_ns() + self._wire_ns
        for i, transport in enumerate(self.transports):
            self.timing.unsent += 1 - transport.send(frames[i : i + 1])
        return frames

    def _stamp_ns(self) -> int:
        """Now, of a clock that nobody sets. Simulated units that need not wait live in a time of
        their own, a period a cycle, and so does a bus within this process, whose frames bear the
        stamps of the SYNCs that they answer."""
        if (self.simulated or self._tells_time) and not self._pace:
            return self._epoch_ns + self._number * self._period_ns
        return self._epoch_ns + time.monotonic_ns() - self._started_ns

    def _receive(self, wait_ns: int) -> None:
        """Fill the batch with what the buses have, waiting as the user chose."""
        self._batch.clear()
        self._waiter.receive(self._batch, wait_ns)

    def _feed(self, frames: np.ndarray) -> Iterator[State]:
        if self._recording is not None and frames.size:
            self._recording.write(frames)
        started = time.perf_counter_ns()
        for state in self.pipeline.feed(frames):
            self.timing.work_ns = time.perf_counter_ns() - started
            yield state
            started = time.perf_counter_ns()

    def _timed(self, now_ns: int, *ways: Callable[[int], State | None]) -> Iterator[State]:
        """The first state that one of `ways` to end a cycle gives at this time, if any does."""
        started = time.perf_counter_ns()
        for end in ways:
            state = end(now_ns)
            if state is not None:
                self.timing.work_ns = time.perf_counter_ns() - started
                yield state
                return
