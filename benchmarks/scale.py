"""Live skins from 64 to 1260 units: frames lost, late cycles, share of a core.

The product's own live loop, `skin.open` with what it does if not told otherwise (contacts, slip,
ambient field, one sweep of cross-talk), on as many buses as the check of a topology asks for, while
three contacts press and drag. `sockets`: a process of its own plays the units, each frame when the
wire would bring it, over datagram sockets of the loopback interface, read by the same system calls
as those of CAN. `process`: the frames of a cycle are there as soon as SYNC is sent; playing them is
not counted. `deadline` is `sockets` with one wake-up a cycle (`wait="deadline"`).

A frame is lost if the state of its cycle does not show the temperatures that stand in it: neither
the receiver's counters nor its flags are asked. Units send only when asked: the frames of a period
that the host left out, since it was not ready for it, are lost as well. A cycle is late if it was
left out, or closed without all its units; `late_share` is that over all periods. `held up` are the
frames of cycles which the units' process itself, held up by the machine, has not ended by 0.85 of
their period, and of those right after them, which do not wait for units that were late for long:
they are neither lost nor late, nor are periods that were left out between such cycles. `cpu` is
user and system time of the receiving process for a cycle, over the period: cycles left out make it
no smaller, and waiting makes it no larger.

Beside it what is published of another skin of 1260 cells; that machine and work are not these.
"""

from __future__ import annotations

import multiprocessing
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np

import skin as product
from benchmarks.scale_units import LAP, Units, most_rows, on_fewest_buses, play, simulate
from bus.cycle import ClosedBy
from bus.datagram import DatagramTransport
from bus.memory import MemoryTransport
from bus.transport import Transport
from skin.decode.decoder import Decoder
from skin.live import Wait
from topology import Topology

SKINS = {"64": (8, 8), "256": (32, 8), "1260": (126, 10)}
"""Rows and columns."""
RATE_HZ = 250.0
FAST = "4 buses, 1 kHz"
FAST_RATE_HZ, FAST_BUSES, FAST_COLUMNS = 1000.0, 4, 5
WARM_S = 1.0
SAME_C = 1e-3
"""°C within which a temperature is the one that was sent; the noise is 0.05 °C."""
TARGET_SHARE = 0.5
WAYS = ("process", "sockets", "deadline")
PUBLISHED = (
    "TUM H1, 1260 cells at 250 Hz (315 000 packets/s): 2.7 cores and a quarter of the packets "
    "lost, clock-driven; 40 000 packets/s and 1.0 core, event-driven "
    "(Bergner, Dean-Leon, Guadarrama-Olvera, Cheng: Evaluation of a large scale event driven "
    "robot skin, IEEE Robotics and Automation Letters 4 (2019))"
)


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    seconds = 2.0 if quick else 20.0
    cases = {}
    skins = {name: on_fewest_buses(*shape, RATE_HZ) for name, shape in SKINS.items()}
    skins[FAST] = most_rows(FAST_COLUMNS, FAST_BUSES, FAST_RATE_HZ)
    for name, units_of in skins.items():
        units = simulate(units_of)
        rows = {way: measure(units_of, units, way, seconds) for way in WAYS}
        cases[name] = {
            "units": units_of.n,
            "buses": len(units_of.buses),
            "rate_hz": units_of.cycle_rate_hz,
            "frames_per_s": len(units_of.frames) * units_of.cycle_rate_hz,
            "ways": rows,
        }
    slow = [row for name in SKINS for row in cases[name]["ways"].values()]
    return {
        "lost_frames": sum(row["lost"] for row in slow),
        "late_share": sum(row["late"] for row in slow) / sum(row["periods"] for row in slow),
        "held_up_share": sum(row["held_up"] for row in slow) / sum(row["sent"] for row in slow),
        "cpu_share_1260": cases["1260"]["ways"]["sockets"]["cpu_share"],
        "target_cpu_share": TARGET_SHARE,
        "published": PUBLISHED,
        "cases": cases,
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [
        f"{'units':>6}{'buses':>7}{'Hz':>6}{'frames/s':>10}  {'way':<9}{'sent':>10}{'lost':>6}"
        f"{'held up':>9}{'periods':>9}{'left out':>9}{'late':>6}{'cpu %':>7}"
        f"{'cycle ms p50':>14}{'p99':>7}{'max':>7}{'work us p50':>13}{'p99':>7}"
    ]
    for case in figures["cases"].values():
        for way, row in case["ways"].items():
            cycle, work = row["cycle_ms"], row["work_us"]
            lines.append(
                f"{case['units']:>6}{case['buses']:>7}{case['rate_hz']:>6.0f}"
                f"{case['frames_per_s']:>10.0f}  {way:<9}{row['sent']:>10}{row['lost']:>6}"
                f"{row['held_up']:>9}{row['periods']:>9}{row['left_out']:>9}{row['late']:>6}"
                f"{100 * row['cpu_share']:>7.1f}"
                f"{cycle['p50']:>14.2f}{cycle['p99']:>7.2f}{cycle['max']:>7.1f}"
                f"{work['p50']:>13.0f}{work['p99']:>7.0f}"
            )
    lines += [
        f"lost at {RATE_HZ:g} Hz: {figures['lost_frames']} (target 0), late or left out: "
        f"{figures['late_share']:.1%} of periods, not judged as held up: "
        f"{figures['held_up_share']:.1%} of frames; 1260 units over sockets: "
        f"{100 * figures['cpu_share_1260']:.0f} % of a core "
        f"(target {100 * figures['target_cpu_share']:.0f} %)",
        f"published: {figures['published']}",
    ]
    return "\n".join(lines)


def measure(skin: Topology, units: Units, way: str, seconds: float) -> dict:
    """Run the live loop for some seconds.

    Parameters
    ----------
    skin : Topology
    units : Units
    way : str
        Of `WAYS`.
    seconds : float
        Time that is measured, after `WARM_S`.
    """
    warm, cycles = (round(s * skin.cycle_rate_hz) for s in (WARM_S, seconds))
    wait: Wait = "deadline" if way == "deadline" else "event"
    source = _in_process if way == "process" else _over_sockets
    with source(skin, units) as played:
        with product.open(skin, transports=played.ends, wait=wait) as live:
            seen = _watch(live, played, warm, cycles)
            sent, on_time = played.tell()
    return {**seen.figures, **judge(skin, units, seen, sent, on_time)}


def judge(skin: Topology, units: Units, seen: _Seen, sent: np.ndarray, on_time: np.ndarray) -> dict:
    """Frames that were sent, and those that no state shows: of them, and of periods left out.

    Parameters
    ----------
    seen : _Seen
    sent, on_time : ndarray, shape (cycles,), int
        Frames by cycle, as the units' process has counted them.
    """
    expected = Decoder(skin, {"temperature"})(units.counts).temperature
    same = np.abs(seen.temperature - expected[seen.number % LAP]) < SAME_C
    same &= ~np.isnan(seen.temperature)
    # what is not there counts as shown
    padded = np.concatenate([same, np.ones((same.shape[0], 1), bool)], axis=1)
    shown = padded[:, skin.frames.units].all(axis=-1).sum(axis=-1)
    count, frames = int(seen.number[-1]) + 1, len(skin.frames)
    sent, on_time = (_filled(counts, count) for counts in (sent, on_time))
    asked = np.flatnonzero(sent)
    punctual = on_time[asked] == frames
    held_up = np.ones(count, bool)
    held_up[asked[1:]] = ~(punctual[1:] & punctual[:-1])
    was_shown = np.zeros(count, np.int64)
    was_shown[seen.number] = shown
    window = slice(int(seen.number[0]), count)
    lost = np.where(held_up, 0, sent - was_shown)[window]
    judged = ~held_up[seen.number]
    own_fault = int(seen.left_out[judged].sum())
    return {
        "periods": seen.number.size + int(seen.left_out.sum()),
        "left_out": int(seen.left_out.sum()),
        "late": int((~seen.complete & judged).sum()) + own_fault,
        "sent": int(sent[window].sum()),
        "held_up": int(sent[window][held_up[window]].sum()),
        "lost": int(lost.sum()) + frames * own_fault,
    }


class _Seen:
    """What was seen of some cycles."""

    def __init__(self, cycles: int, n: int) -> None:
        self.number = np.zeros(cycles, np.int64)
        self.temperature = np.full((cycles, n), np.nan, np.float32)
        self.at_ns = np.zeros(cycles, np.int64)
        self.work_ns = np.zeros(cycles, np.int64)
        self.complete = np.zeros(cycles, bool)
        self.left_out = np.zeros(cycles, np.int64)  # periods before each
        self.figures: dict[str, object] = {}


def _watch(live: product.Skin, played: _Played, warm: int, cycles: int) -> _Seen:
    """Go through the cycles of a live skin."""
    seen = _Seen(cycles, live.topology.n)
    states = iter(live)
    for _ in range(warm):
        next(states)
    overruns, own_ns = live.timing.overruns, played.own_ns
    cpu = time.process_time_ns()
    for i in range(cycles):
        state = next(states)
        seen.at_ns[i] = time.perf_counter_ns()
        seen.number[i] = state.cycle
        seen.temperature[i] = state.units.temperature
        seen.work_ns[i] = live.timing.work_ns
        seen.complete[i] = state.closed_by is ClosedBy.COMPLETE
        seen.left_out[i] = live.timing.overruns - overruns
        overruns += seen.left_out[i]
    cpu = time.process_time_ns() - cpu - (played.own_ns - own_ns)
    apart_ms = 1e-6 * np.diff(seen.at_ns)
    seen.figures = {
        "cycles": cycles,
        "cpu_share": 1e-9 * cpu * live.topology.cycle_rate_hz / cycles,
        "cycle_ms": _spread(apart_ms),
        "work_us": _spread(1e-3 * seen.work_ns),
    }
    return seen


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "p50": float(np.median(values)),
        "p99": float(np.percentile(values, 99.0)),
        "max": float(values.max()),
    }


class _Played(ABC):
    """The host's ends of buses whose units are played.

    Attributes
    ----------
    ends : list of Transport
    own_ns : int
        Time of this process that went into playing.
    """

    def __init__(self, ends: list[Transport]) -> None:
        self.ends = ends
        self.own_ns = 0

    @abstractmethod
    def tell(self) -> tuple[np.ndarray, np.ndarray]:
        """Frames sent by cycle, and those of them that were sent on time."""


class _InProcess(_Played):
    """Units that answer SYNC at once, in the thread of the host."""

    def __init__(self, units: Units) -> None:
        pairs = [MemoryTransport.pair(index=i) for i in range(len(units.frames))]
        super().__init__([near for near, _ in pairs])
        self._sent: list[int] = []
        for bus, (_, far) in enumerate(pairs):
            far.listener = lambda records, bus=bus, far=far: self._answer(records, bus, far)
        self._frames = units.frames

    def _answer(self, records: np.ndarray, bus: int, far: MemoryTransport) -> None:
        started = time.thread_time_ns()
        sync = int(records["data"][0, 0])
        self._sent += [0] * ((sync - len(self._sent)) % LAP if bus == 0 else 0)
        if bus == 0:
            self._sent.append(0)
        self._sent[-1] += far.send(self._frames[bus][sync])
        self.own_ns += time.thread_time_ns() - started

    def tell(self) -> tuple[np.ndarray, np.ndarray]:
        """As of `_Played`."""
        return np.array(self._sent), np.array(self._sent)


class _OverSockets(_Played):
    """Units in a process of their own."""

    def __init__(self, ends: list[Transport], told) -> None:
        super().__init__(ends)
        self._told = told

    def tell(self) -> tuple[np.ndarray, np.ndarray]:
        """As of `_Played`; the units stop."""
        self._told.send(None)
        sent, on_time = self._told.recv()
        return np.array(sent), np.array(on_time)


def _filled(counts: np.ndarray, size: int) -> np.ndarray:
    """The first `size` of some counts, with zeros for what is not there."""
    return np.pad(counts, (0, max(0, size - counts.size)))[:size]


@contextmanager
def _in_process(skin: Topology, units: Units) -> Iterator[_Played]:
    yield _InProcess(units)


@contextmanager
def _over_sockets(skin: Topology, units: Units) -> Iterator[_Played]:
    socks = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in units.frames]
    others = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in units.frames]
    for sock in (*socks, *others):
        sock.bind(("127.0.0.1", 0))
    ports = [(far.getsockname()[1], near.getsockname()[1])
             for near, far in zip(socks, others, strict=True)]  # fmt: skip
    for near, far in zip(socks, others, strict=True):
        near.connect(far.getsockname())
        far.close()
    context = multiprocessing.get_context("spawn")
    told, teller = context.Pipe()
    player = context.Process(target=play, args=(skin, units.frames, ports, teller), daemon=True)
    with ExitStack() as stack:
        ends: list[Transport] = [
            stack.enter_context(DatagramTransport(sock, f"bus{i}", i))
            for i, sock in enumerate(socks)
        ]
        player.start()
        teller.close()
        stack.callback(player.join, 10.0)
        stack.callback(player.terminate)
        if not told.poll(60.0) or told.recv() is not True:
            raise RuntimeError("the units' process must be ready within 60 s; it was not")
        yield _OverSockets(ends, told)
