"""The skins of `benchmarks.scale`, and a process that plays their units at the pace of the wire.

What units would answer to 256 SYNCs is simulated beforehand, and played over and over: three round
contacts that press and drag, noise and all. Over sockets a frame goes when the last bit of its
worst case would have left the wire; the buses run beside each other, as the wires do. Beyond four
buses it goes with those that follow it within a millisecond, as USB adapters hand them over: one
processor cannot make more system calls.
"""

from __future__ import annotations

import socket
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np

import topology
from bus.codec import Packer
from bus.datagram import DatagramTransport
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.transport import Transport
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
ON_TIME = 0.85
"""Periods after its SYNC by which a frame must have been sent; the host waits for 0.9."""
AT_ONCE = 32
"""Cycles that are simulated together."""
FEW_BUSES, BURST = 4, 6
"""Buses up to which frames go one by one; frames of a bus that go together beyond."""


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
    text = ['format = 1\nname = "strip"']
    first = 0
    for bus, taken in enumerate(np.array_split(np.arange(rows), buses)):
        middle_m = (first + 0.5 * (taken.size - rows)) * PITCH_M
        first += taken.size
        text.append(
            f'[[buses]]\nname = "bus{bus}"\ninterface = "memory"\nbitrate = 1_000_000\n'
            f"data_bitrate = 5_000_000\ncycle_rate_hz = {rate_hz}\nsync_id = 0x080\n"
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


class Player:
    """Answers SYNC with the frames of its counter, by a wire's pace, and counts what it has sent.

    Parameters
    ----------
    skin : Topology
    frames : list of ndarray
        As of `Units`.

    Attributes
    ----------
    sent, on_time : list of int
        Frames of each cycle, from the first SYNC on; those sent before `ON_TIME`.
    """

    def __init__(self, skin: Topology, frames: list[np.ndarray]) -> None:
        self._frames = frames
        bus = skin.buses[0]
        layout = skin.layouts[int(skin.frames.layout[0])]
        self._first_ns = round(1e9 * frame_seconds(SYNC_SIZE, False, bus))
        self._each_ns = round(1e9 * frame_seconds(layout.size, layout.fd, bus))
        self._on_time_ns = round(ON_TIME * 1e9 / bus.cycle_rate_hz)
        self._most = max(laps.shape[1] for laps in frames)
        self._burst = 1 if len(frames) <= FEW_BUSES else BURST
        self.sent: list[int] = []
        self.on_time: list[int] = []

    def answer(self, sync: int, stamp_ns: int, ends: list[Transport]) -> None:
        """Send the frames of a cycle, whose SYNC came at `stamp_ns`, the system's time."""
        self.skip(sync)
        sent = on_time = 0
        for first in range(0, self._most, self._burst):
            last = min(first + self._burst, self._most)
            due_ns = stamp_ns + self._first_ns + last * self._each_ns
            time.sleep(max(due_ns - time.time_ns(), 0) * 1e-9)
            some = sum(
                end.send(laps[sync, first:last])
                for end, laps in zip(ends, self._frames, strict=True)
            )
            sent += some
            on_time += some if time.time_ns() - stamp_ns < self._on_time_ns else 0
        self.sent.append(sent)
        self.on_time.append(on_time)

    def skip(self, sync: int) -> None:
        """Note that SYNCs before this one were left out."""
        missing = (sync - len(self.sent)) % LAP
        self.sent += [0] * missing
        self.on_time += [0] * missing


def play(
    skin: Topology, frames: list[np.ndarray], ends: list[tuple[int, int]], told: Connection
) -> None:
    """Answer SYNC over datagram sockets until told to stop; then tell what was sent.

    Parameters
    ----------
    skin, frames
        As of `Player`.
    ends : list of (int, int)
        Own port of each bus, and the host's, on this machine.
    told : Connection
        Told True when all is ready; says when to stop; told the frames sent and those sent on time,
        by cycle, in the end.
    """
    transports: list[Transport] = []
    for own, other in ends:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", own))
        sock.connect(("127.0.0.1", other))
        transports.append(DatagramTransport(sock, f"units at {own}"))
    player, heard = Player(skin, frames), FrameBatch(LAP)
    told.send(True)
    while not told.poll():
        heard.clear()
        transports[0].receive(heard, 0.1)
        for record in heard.frames:
            player.answer(int(record["data"][0]), int(record["stamp_ns"]), transports)
    told.send((player.sent, player.on_time))
    for transport in transports:
        transport.close()
