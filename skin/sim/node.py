"""Simulated nodes: units that answer SYNC, or send freely, with real frames on any transport."""

from __future__ import annotations

import math
import select
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from bus.codec import Packer
from bus.frame import ECHO, FrameBatch
from bus.heartbeat import FIRST_ID, LAYOUT, PERIOD_S, STATES, heartbeat_nodes
from bus.memory import MemoryTransport
from bus.transport import Transport
from skin.errors import OptionError, SkinError, shown
from skin.physics.halbach import FELT_M, HalbachField
from skin.sim.scenes.load import load_scene, open_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import SceneFile
from skin.sim.truth import Scene, Truth
from skin.sim.unit import UnitSimulator
from topology import Topology

__all__ = ["Heartbeats", "Served", "SimulatedUnits", "is_exact", "played"]

POLL_S = 0.05
"""Poll interval of a bus, for the stop flag."""
RECENT = 16
"""Cycles whose counts are stored for buses that lag."""
FIRMWARE_ID = 1
RUNNING = STATES.index("running")


@dataclass
class Served:
    """Totals of simulated units."""

    seconds: float = 0.0
    """Wall-clock time."""
    cycles: int = 0
    """Sampled cycles."""
    frames: int = 0
    """Frames sent."""
    send_failures: int = 0
    """Frames that the buses refused."""
    skipped: int = 0
    """Cycles of free-running units that were skipped because this machine was late."""


class Heartbeats:
    """The heartbeats of simulated boards, spread evenly over each second.

    Parameters
    ----------
    topology : Topology
    """

    def __init__(self, topology: Topology) -> None:
        self._rate_hz = topology.cycle_rate_hz
        self._period = max(1, round(PERIOD_S * self._rate_hz))
        self._nodes = [heartbeat_nodes(topology, bus) for bus in range(len(topology.buses))]

    def append(self, cycle: int, batch: FrameBatch, *, bus: int, stamp_ns: int = 0) -> int:
        """Append the heartbeats that are due in a cycle; return how many."""
        first = cycle % self._period
        due = self._nodes[bus][first :: self._period]
        uptime_s = min(int(cycle / self._rate_hz), 0xFFFF)
        for node in due:
            serial = ((bus & 0xFF) << 8) | node
            data = LAYOUT.pack(RUNNING, uptime_s, FIRMWARE_ID, serial, 0, 0)
            batch.append(FIRST_ID + node, data, stamp_ns=stamp_ns, bus=bus)
        return len(due)

    def most(self, bus: int) -> int:
        """Largest number of heartbeats of one cycle."""
        return -(-len(self._nodes[bus]) // self._period)


class SimulatedUnits:
    """All units of a topology, with their boards, on all its buses.

    Cycle `c` is the instant c / cycle rate of the scene, on every bus; on a bus with SYNC it is the
    unwrapped counter of the SYNC. All data frames of a bus answer a SYNC, in the order of their
    priority, with its counter as their sequence number; a count of the board's own leaves out
    cycles without a SYNC.

    Parameters
    ----------
    topology : Topology
    scene : Scene, optional
        What happens to the skin; "demo" if not given. It may have its own `units`; otherwise they
        have Halbach films with cross-talk.
    seed : int
        Seed of the noise.
    """

    def __init__(self, topology: Topology, scene: Scene | None = None, *, seed: int = 0) -> None:
        self.topology = topology
        self.scene = scene or open_scene("demo", topology, seed=seed)
        self.units = getattr(self.scene, "units", None) or UnitSimulator(
            topology, seed=seed, field=HalbachField(topology, reach_m=FELT_M)
        )
        self.served = Served()
        self._packer = Packer(topology)
        self._heartbeats = Heartbeats(topology)
        self._cycle = self._first = -1
        self._counts: dict[int, np.ndarray] = {}
        # the first instant, whichever cycle it is: compiles the kernels of scene and units
        self._truth = self.scene.at(0.0)
        self.units.quantities(
            self._truth.depth_mm, self._truth.displacement_mm, self._truth.temperature,
            self._truth.film_temperature, self._truth.hall_temperature,
        )  # fmt: skip
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._failures: list[Exception] = []
        self._sent = [-1] * len(topology.buses)
        self._left_out = [0] * len(topology.buses)
        own = np.array([layout.sequence == "own" for layout in topology.layouts])
        frames = topology.frames
        self._counts_own = [own[frames.layout[frames.bus == bus]]
                            for bus in range(len(topology.buses))]  # fmt: skip
        self._synced = topology.sync_id is not None

    # -- truth -------------------------------------------------------------------------------------

    @property
    def truth(self) -> Truth:
        """Truth of the latest cycle."""
        if self._cycle < 0:
            raise SkinError("truth: must be asked for after the first cycle; got none yet")
        with self._lock:
            return self._truth.copy()

    def time_ns(self, bus: int = 0) -> int:
        """Time of the scene at the latest cycle of a bus, by which its faults are scheduled."""
        return round(1e9 * self._sent[bus] / self.topology.cycle_rate_hz)

    @property
    def ends_s(self) -> float:
        """When the scene is over, in its time, second; infinite for one without an end."""
        ends_s: float = getattr(self.scene, "ends_s", math.inf)
        return ends_s

    # -- frames ------------------------------------------------------------------------------------

    def respond(self, records: np.ndarray, out: FrameBatch, bus: int = 0) -> int:
        """Append the answers to every SYNC among `records`; returns the number of frames.

        Parameters
        ----------
        records : ndarray, shape (m,), FRAME_DTYPE
            Frames of one bus.
        out : FrameBatch
            Output; the answers have the stamp of their SYNC. IndexError if it is full.
        bus : int
            Index of the bus.
        """
        count = out.count
        for record in records[self._is_heard(records)]:
            with self._lock:
                cycle = self._unwrapped(int(record["data"][0]), bus)
                if self._sent[bus] >= 0:
                    self._left_out[bus] += cycle - self._sent[bus] - 1
                self._append(cycle, out, bus, int(record["stamp_ns"]))
        return out.count - count

    def tick(self, cycle: int, out: FrameBatch, bus: int = 0, stamp_ns: int = 0) -> int:
        """Append the frames of a cycle of free-running units; returns their number."""
        count = out.count
        with self._lock:
            self._append(cycle, out, bus, stamp_ns)
        return out.count - count

    def _is_heard(self, records: np.ndarray) -> np.ndarray:
        """Mask of SYNCs of others."""
        if not self._synced:
            return np.zeros(records.size, bool)
        heard = (records["id"] == self.topology.sync_id) & (records["length"] >= 1)
        return heard & ((records["origin"] & ECHO) == 0)

    def _unwrapped(self, counter: int, bus: int) -> int:
        """Cycle of a SYNC counter: the next one of its bus, which may be behind another bus."""
        newest, last = self._cycle, self._sent[bus]
        if newest < 0:
            return counter
        if last < 0:  # closest to the cycle of the other buses
            return newest - 128 + (counter - newest + 128) % 256
        cycle = last + (counter - last) % 256
        # a bus that was silent while the counter wrapped
        return cycle + max(0, newest - cycle) // 256 * 256

    def _append(self, cycle: int, out: FrameBatch, bus: int, stamp_ns: int) -> None:
        if cycle > self._cycle:
            self._sample(cycle)
        # of a cycle that all buses skipped the scene is past: the latest counts
        counts, first = self._counts.get(cycle, self._counts[self._cycle]), out.count
        self._packer(counts, out, sequence=cycle & 0xFF, stamp_ns=stamp_ns, bus=bus)
        if self._left_out[bus] and self._counts_own[bus].any():
            again, own = self.batch(bus), self._counts_own[bus]
            sequence = (cycle - self._left_out[bus]) & 0xFF
            self._packer(counts, again, sequence=sequence, stamp_ns=stamp_ns, bus=bus)
            out.frames[first:][own] = again.frames[own]
        self._sent[bus] = cycle
        since = max(0, cycle - self._first)
        self._heartbeats.append(since, out, bus=bus, stamp_ns=stamp_ns)

    def _sample(self, cycle: int) -> None:
        """Advance the scene to a cycle, and take its counts."""
        if self._first < 0:
            self._first = cycle
        else:
            self._truth = self.scene.at((cycle - self._first) / self.topology.cycle_rate_hz)
        self._cycle = cycle
        self.served.cycles += 1
        self._counts[cycle] = self.units.counts(self._truth)
        if len(self._counts) > RECENT:
            del self._counts[next(iter(self._counts))]

    def batch(self, bus: int) -> FrameBatch:
        """A batch with room for one cycle of a bus."""
        data = int(np.sum(self.topology.frames.bus == bus))
        return FrameBatch(data + self._heartbeats.most(bus))

    # -- buses -------------------------------------------------------------------------------------

    def attach(self, transports: Sequence[MemoryTransport]) -> None:
        """Answer on in-process buses, in the thread that sends SYNC, before `send` returns.

        There is no waiting and no other thread, so a skin runs at full speed. On buses without SYNC
        the units send at the cycle rate, from a thread of their own, until `close`.
        `transports` are the units' end of each bus, in order.
        """
        self._check(transports)
        self._stop = threading.Event()
        for bus, transport in enumerate(transports):
            if self._synced:
                transport.listener = partial(self._answer, transport, self.batch(bus), bus)
            else:
                self._start(self.topology.buses[bus].name, self._send_freely, transport, bus)

    def in_process(self) -> list[Transport]:
        """Attach to new buses within the process; returns the host's end of each."""
        pairs = [MemoryTransport.pair(index=i) for i in range(len(self.topology.buses))]
        self.attach([far for _, far in pairs])
        return [near for near, _ in pairs]

    def serve(
        self,
        transports: Sequence[Transport],
        *,
        seconds: float | None = None,
        stop: threading.Event | None = None,
        watch: Callable[[Served], None] | None = None,
    ) -> Served:
        """Answer SYNC, or send at the cycle rate, on any buses, until stopped.

        Parameters
        ----------
        transports : sequence of Transport
            The units' end of each bus, in order. One thread serves those that can be polled, so
            that no answer waits for a thread switch; each other bus, and each without SYNC, has a
            thread of its own.
        seconds : float, optional
            Duration.
        stop : threading.Event, optional
            Set by the caller to stop earlier, and by this method at the end.
        watch : callable, optional
            Called with the totals so far, about once a second.

        Returns
        -------
        Served
            Totals since the units were created.

        Raises
        ------
        BusClosedError, SkinError
            A bus is closed or unplugged; not as many transports as buses.
        """
        self._check(transports)
        self._stop = stop or threading.Event()
        started = time.monotonic()
        try:
            together = []
            for bus, transport in enumerate(transports):
                name = self.topology.buses[bus].name
                if not self._synced:
                    self._start(name, self._send_freely, transport, bus)
                elif transport.fileno() < 0 or len(transports) == 1:
                    self._start(name, self._listen, transport, bus)
                else:
                    together.append((transport, bus))
            if together:
                self._start("several buses", self._listen_to_all, together)
            self._wait(started, seconds, watch)
        finally:
            self.close()
            self.served.seconds += time.monotonic() - started
        if self._failures:
            raise self._failures.pop()
        return self.served

    def close(self) -> None:
        """Stop all threads; may be called twice."""
        self._stop.set()
        threads, self._threads = self._threads, []
        for thread in threads:
            thread.join()

    def _wait(
        self, started: float, seconds: float | None, watch: Callable[[Served], None] | None
    ) -> None:
        end = math.inf if seconds is None else started + seconds
        reported = started
        while (now := time.monotonic()) < end and not self._stop.wait(min(POLL_S, end - now)):
            if watch is not None and now - reported >= 1.0:
                reported = now
                watch(self.served)

    def _check(self, transports: Sequence[Transport]) -> None:
        expected = len(self.topology.buses)
        if len(transports) != expected:
            raise SkinError(
                f"transports: must be one for each of {expected} buses; got {len(transports)}"
            )

    def _start(self, where: str, work: Callable[..., None], *what: object) -> None:
        def guarded() -> None:
            try:
                work(*what)
            except Exception as error:
                self._failures.append(error)
                self._stop.set()

        thread = threading.Thread(target=guarded, name=f"units on {where}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _answer(self, transport: Transport, out: FrameBatch, bus: int, records: np.ndarray) -> None:
        for i in np.flatnonzero(self._is_heard(records)):
            out.clear()
            self.respond(records[i : i + 1], out, bus)
            self._send(transport, out)

    def _send(self, transport: Transport, out: FrameBatch) -> None:
        taken = transport.send(out.frames)
        with self._lock:
            self.served.frames += taken
            self.served.send_failures += out.count - taken

    def _listen(self, transport: Transport, bus: int) -> None:
        heard, out = FrameBatch(256), self.batch(bus)
        while not self._stop.is_set():
            heard.clear()
            if transport.receive(heard, POLL_S):
                self._answer(transport, out, bus, heard.frames)

    def _listen_to_all(self, ends: Sequence[tuple[Transport, int]]) -> None:
        heard, arrival = FrameBatch(256), select.poll()
        for transport, _ in ends:
            arrival.register(transport.fileno(), select.POLLIN)
        outs = [self.batch(bus) for _, bus in ends]
        while not self._stop.is_set():
            taken = 0
            for (transport, bus), out in zip(ends, outs, strict=True):
                heard.clear()
                if transport.receive(heard):
                    taken += heard.count
                    self._answer(transport, out, bus, heard.frames)
            if not taken and arrival.poll(1e3 * POLL_S):
                # a bus with an error is always ready, without frames
                self._stop.wait(0.0)

    def _send_freely(self, transport: Transport, bus: int) -> None:
        heard, out = FrameBatch(256), self.batch(bus)
        rate_hz = self.topology.cycle_rate_hz
        cycle, started = 0, time.monotonic()
        while True:
            ahead_s = started + cycle / rate_hz - time.monotonic()
            if self._stop.wait(max(0.0, ahead_s)):
                return
            late = int(-ahead_s * rate_hz)
            if late > 0:
                cycle += late
                with self._lock:
                    self.served.skipped += late
            out.clear()
            self.tick(cycle, out, bus)
            self._send(transport, out)
            cycle += 1
            heard.clear()
            transport.receive(heard)  # nothing is asked of them: their queue stays empty


def played(topology: Topology, scene: Any, seed: int | None = None) -> Scene:
    """What simulated units play: True for "demo", a name, a file, a loaded scene, or one with
    ``at``; a scene file with its own seed if none is given.

    Raises
    ------
    OptionError
        `scene` is not one.
    topology.TopologyError
        There is no such file, or it cannot be played.
    """
    if scene is True or isinstance(scene, str | Path):
        scene = load_scene("demo" if scene is True else scene, topology)
    if isinstance(scene, SceneFile):
        return ScriptedScene(topology, scene if seed is None else replace(scene, seed=seed))
    if not hasattr(scene, "at"):
        expected = "True, a scene, or the name or file of one"
        raise OptionError(f"simulate: must be {expected}; got {shown(scene)}")
    return scene


def is_exact(scene: Any) -> bool:
    """Whether the constants of a scene's units equal the parameters of the topology: it has no
    errors of fabrication."""
    script = getattr(scene, "script", None)
    return not (isinstance(script, SceneFile) and script.non_ideal.fabrication)
