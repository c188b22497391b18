"""The skins of `benchmarks.scale`, and a process that plays their units at the pace of the wire.

What units would answer to 256 SYNCs is simulated beforehand, and played over and over: three round
contacts that press and drag, noise and all. A frame goes when the last bit of its worst case would
have left the wire; the buses run beside each other, as the wires do. One system call sends the
frames that end at the same time, one on each bus: buses begin together, once all have had SYNC.
"""

from __future__ import annotations

import gc
import os
import socket
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np

import topology
from bus import mmsg
from bus.codec import Packer
from bus.compiled.jit import direct
from bus.datagram import DatagramTransport
from bus.frame import FRAME_DTYPE, FrameBatch, as_words
from skin.physics.elastic import Elastic
from skin.physics.halbach import FELT_M, HalbachField
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from topology import Topology, TopologyError
from topology.budget import SYNC_SIZE, frame_seconds

LAP = 256
"""Cycles that are played over and over: as many as the counter of SYNC counts."""
PITCH_M = 0.012
TOUCHES, TOUCH_M = 3, 0.03
"""Contacts at a time, and their radius."""
DEPTH_MM, SHEAR_MM = 1.0, 0.4
SPIN_NS = 100_000
"""Time before a frame is due from which its sender watches the clock without sleeping: a sleep ends
some 60 µs late [measured]."""
AT_ONCE = 32
"""Cycles that are simulated together."""


class Units(NamedTuple):
    """What is played.

    Attributes
    ----------
    frames : list of ndarray, shape (LAP, m), FRAME_DTYPE
        Of each bus, by the counter of SYNC.
    counts : ndarray, shape (LAP, c, n), int16
        What stands in them.
    """

    frames: list[np.ndarray]
    counts: np.ndarray


def strip(rows: int, columns: int, buses: int, rate_hz: float) -> Topology:
    """A flat skin, as long as it takes: one patch a bus, the rows shared as evenly as can be.

    Raises
    ------
    TopologyError
        The buses cannot carry that many units at that rate.
    """
    text = [f'format = 1\nname = "strip"\ncycle_rate_hz = {rate_hz}\nsync_id = 0x080']
    first = 0
    for bus, taken in enumerate(np.array_split(np.arange(rows), buses)):
        middle_m = (first + 0.5 * (taken.size - rows)) * PITCH_M
        first += taken.size
        text.append(
            f'[[buses]]\nname = "bus{bus}"\ninterface = "memory"\nbitrate = 1_000_000\n'
            "data_bitrate = 5_000_000\n"
            f'[[patches]]\nname = "p{bus}"\nkind = "grid"\nrows = {taken.size}\n'
            f'columns = {columns}\npitch_m = {PITCH_M}\nbus = "bus{bus}"\n'
            f"pose = {{ xyz_m = [0.0, {middle_m:.6f}, 0.0] }}\n"
            'model = "f3t-paper"\nlayout = "f3t-fd64"\nfirst_id = 0x100'
        )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "strip.toml")
        file.write_text("\n".join(text), encoding="utf-8")
        return topology.load(file)


def on_fewest_buses(rows: int, columns: int, rate_hz: float) -> Topology:
    """The same on as few buses as the check of a topology lets through."""
    for buses in range(1, rows + 1):
        try:
            return strip(rows, columns, buses, rate_hz)
        except TopologyError:
            continue
    raise ValueError(f"rate_hz: must let a bus carry a row of units; got {rate_hz:g}")


def most_rows(columns: int, buses: int, rate_hz: float) -> Topology:
    """A strip with as many rows as its buses carry, the same on each."""
    found = strip(buses, columns, buses, rate_hz)
    try:
        while True:
            found = strip(found.n // columns + buses, columns, buses, rate_hz)
    except TopologyError:
        return found


def simulate(skin: Topology, seed: int = 1) -> Units:
    """What the units answer to `LAP` SYNCs; after the last the first follows without a jump."""
    simulator = UnitSimulator(skin, seed=seed, field=HalbachField(skin, reach_m=FELT_M))
    law, along = Elastic(skin), skin.position[1]
    middles = np.linspace(along.min(), along.max(), 2 * TOUCHES + 1)[1::2]
    away = np.hypot(skin.position[0], np.abs(along - middles[:, np.newaxis]).min(axis=0))
    bump = np.maximum(1.0 - (away / TOUCH_M) ** 2, 0.0)
    counts = np.empty((LAP, 6, skin.n), np.int16)
    for start in range(0, LAP, AT_ONCE):
        truths = []
        for turn in 2.0 * np.pi / LAP * np.arange(start, start + AT_ONCE):
            truth = Truth.at_rest(skin.n, 25.0)
            truth.depth_mm[:] = DEPTH_MM * bump * (1.0 + 0.2 * np.sin(turn))
            truth.contact[:] = truth.depth_mm > 0.0
            truth.displacement_mm[0] = SHEAR_MM * np.sin(turn) * truth.contact
            truth.force[2] = law.normal(truth.depth_mm)
            truths.append(truth)
        counts[start : start + AT_ONCE] = simulator.counts(Truth.stack(truths))
    return Units(_packed(skin, counts), counts)


def _packed(skin: Topology, counts: np.ndarray) -> list[np.ndarray]:
    packer, frames = Packer(skin), []
    for bus in range(len(skin.buses)):
        count = int(np.sum(skin.frames.bus == bus))
        laps, batch = np.empty((LAP, count), FRAME_DTYPE), FrameBatch(count)
        for cycle in range(LAP):
            batch.clear()
            packer(counts[cycle], batch, sequence=cycle, stamp_ns=0, bus=bus)
            laps[cycle] = batch.frames
        frames.append(laps)
    return frames


PLAYED = np.dtype(
    [
        ("sync_ns", np.int64),  # stamp of the first SYNC by the kernel; 0: none came
        ("wire_ns", np.int64),  # when the last frame was due
        ("left_ns", np.int64),  # just before it was handed to the kernel
        ("late_ns", np.int64),  # longest time by which a frame left after it was due
    ]
)
"""What the units did in a cycle; by the system's clock."""
NEVER_NS = 1 << 62


class Player:
    """Answers the SYNCs of all buses with the frames of their counter, at the pace of a wire.

    Parameters
    ----------
    skin : Topology
        The more frames a bus has, the earlier it stands.
    frames : list of ndarray
        As of `Units`.
    ports : list of int
        Of the host's end of each bus, on this machine.
    spin_ns : int
        As of `SPIN_NS`; 0 where the host needs the same processor.

    Attributes
    ----------
    played : list of tuple
        As of `PLAYED`, by cycle, from the first SYNC on.
    """

    def __init__(
        self, skin: Topology, frames: list[np.ndarray], ports: list[int], spin_ns: int
    ) -> None:
        self._first_ns = round(1e9 * frame_seconds(SYNC_SIZE, False, skin.buses[0]))
        self._each_ns = frame_ns(skin)
        most = frames[0].shape[1]
        self._ends = np.cumsum([sum(laps.shape[1] > k for laps in frames) for k in range(most)])
        turns = [laps[:, k] for k in range(most) for laps in frames if laps.shape[1] > k]
        self._laps = np.stack(turns, axis=1)
        self._buffers, self._names = _addressed(ports)
        self._send = direct(mmsg.send)
        self._spin_ns = spin_ns
        self.played: list[tuple[int, int, int, int]] = []

    def answer(self, counter: int, first_ns: int, last_ns: int, fd: int) -> None:
        """Send the frames of a cycle, whose SYNC came between these times, by a socket."""
        self.played += [(0, 0, 0, 0)] * ((counter - len(self.played)) % LAP)
        words, begin = as_words(self._laps[counter]), 0
        due_ns, worst_ns, left_ns = last_ns + self._first_ns, 0, 0
        for end in self._ends.tolist():
            due_ns += self._each_ns
            while (left_ns := time.time_ns()) < due_ns:
                time.sleep(1e-9 * max(due_ns - left_ns - self._spin_ns, 0))
            taken = self._send(fd, begin, end - begin, words, self._buffers)
            late_ns = time.time_ns() - due_ns if taken == end - begin else NEVER_NS
            worst_ns, begin = max(worst_ns, late_ns), end
        self.played.append((first_ns, due_ns, left_ns, worst_ns))


def frame_ns(skin: Topology) -> int:
    """Longest time of a frame of the units on the wire."""
    layout = skin.layouts[int(skin.frames.layout[0])]
    return round(1e9 * frame_seconds(layout.size, layout.fd, skin.buses[0]))


def _addressed(ports: list[int]) -> tuple[mmsg.Buffers, np.ndarray]:
    """Buffers whose messages go to these ports of this machine, one each, and the addresses, which
    must live as long."""
    kind = [("family", "<u2"), ("port", ">u2"), ("address", ">u4"), ("zero", "<u8")]
    names = np.zeros(len(ports), kind)  # struct sockaddr_in
    names["family"], names["port"], names["address"] = socket.AF_INET, ports, 0x7F00_0001
    buffers = mmsg.new_buffers()
    messages = buffers.messages[: len(ports)]
    messages["name"] = names.ctypes.data + names.itemsize * np.arange(len(ports))
    messages["name_size"] = names.itemsize
    return buffers, names


def play(
    skin: Topology, frames: list[np.ndarray], ports: list[int], sock: socket.socket,
    processor: int | None, told: Connection,
) -> None:  # fmt: skip
    """Answer SYNC until told to stop; then tell what was sent.

    Parameters
    ----------
    skin, frames, ports
        As of `Player`.
    sock : socket
        Of the units, to which all ends of the host are connected.
    processor : int or None
        The one that is for this process alone; None without one.
    told : Connection
        Told True when all is ready; says when to stop; told an array of `PLAYED` in the end.
    """
    if processor is not None:
        os.sched_setaffinity(0, {processor})
    player = Player(skin, frames, ports, 0 if processor is None else SPIN_NS)
    heard, syncs, counter, first_ns = FrameBatch(LAP), 0, -1, 0
    with DatagramTransport(sock, "the units") as end:
        gc.disable()
        told.send(True)
        while not told.poll():
            heard.clear()
            end.receive(heard, 0.1)
            for record in heard.frames:
                stamp_ns = int(record["stamp_ns"])
                if int(record["data"][0]) != counter:
                    syncs, counter, first_ns = 0, int(record["data"][0]), stamp_ns
                syncs += 1
                if syncs == len(ports):
                    player.answer(counter, first_ns, stamp_ns, end.fileno())
    told.send(np.array(player.played, PLAYED))
