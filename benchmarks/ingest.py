"""Frames from the kernel into arrays: the batch transport beside python-can, and a cycle's work.

Frames are queued first and then read, so that the figures are those of reading alone; the two
readers take turns, on the same frames. Where the machine has no vcan, the same runs in User-Mode
Linux: real CAN sockets, but system calls that cost some 20 µs each, which flatters whoever makes
few of them. So the figures over the loopback interface, on the machine's own kernel, stand beside
them: the same calls, with a datagram socket in place of CAN's.
"""

from __future__ import annotations

import gc
import importlib.util
import json
import multiprocessing
import socket
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

import can
import numpy as np
from can.interfaces.socketcan.socketcan import SocketcanBus

from bus.datagram import QUEUE_BYTES, DatagramTransport, enlarge_queue
from bus.errors import BusOpenError
from bus.frame import FD_FDF, FRAME_DTYPE, FrameBatch
from bus.link import can_links
from bus.linux import SO_TIMESTAMPNS
from bus.open import open_transport
from bus.wait import Waiter
from topology import Bus

ROOT = Path(__file__).parent.parent
UNITS, PERIOD_NS = 64, 1_000_000
QUEUED = 200
"""Frames read at a time: python-can leaves the receive buffer at its default, 278 frames."""


def run(quick: bool) -> dict[str, object]:
    """Measure; see `table` for what."""
    where, on_can = _on_can(quick)
    with _loopback() as ends:
        loopback = _side_by_side(*ends, rounds=10 if quick else 200)
    seconds = 1.0 if quick else 4.0
    cpu, latency, missing = {}, {}, {}
    for way in ("deadline", "event", "pythoncan"):
        cpu[way], late, missing[way] = _cycles(way, seconds)
        if late is not None:
            latency[way] = late
    return {
        "measured_on": where,
        **on_can,
        **{f"loopback_{name}": value for name, value in loopback.items()},
        "cycle_measured_on": "loopback datagrams",
        "cycle_cpu_percent_64_units_1khz": cpu,
        "cycle_latency_us_64_units_1khz": latency,
        "cycle_frames_missing": missing,
    }


def table(figures: dict[str, object]) -> str:
    """Show the figures."""
    lines = []
    for name, where in (("", figures["measured_on"]), ("loopback_", "loopback datagrams")):
        if f"{name}socketcan_frames_per_s" not in figures:
            lines.append(f"reading: {where}")
            continue
        get = {key[len(name) :]: value for key, value in figures.items() if key.startswith(name)}
        lines += [
            f"reading on {where}",
            f"  batch transport  {get['socketcan_frames_per_s']:>12,.0f} frames/s"
            f"  {get['socketcan_us_per_frame']:6.2f} µs a frame"
            f"  ({get['socketcan_fd64_us_per_frame']:.2f} at 64 B)",
            f"  python-can       {get['pythoncan_frames_per_s']:>12,.0f} frames/s"
            f"  {1e6 / get['pythoncan_frames_per_s']:6.2f} µs a frame",
            f"  ratio            {get['ingest_ratio']:>12.1f}"
            f"           frames missing or wrong: {get['frames_wrong']}",
        ]
    lines.append(f"64 units at 1 kHz on {figures['cycle_measured_on']}")
    for way, percent in figures["cycle_cpu_percent_64_units_1khz"].items():
        late = figures["cycle_latency_us_64_units_1khz"].get(way)
        waits = "" if late is None else f"   read {late:.0f} µs after a burst's last frame"
        lost = figures["cycle_frames_missing"][way]
        lines.append(f"  {way:<10} {percent:6.1f} % of a core   frames missing: {lost}{waits}")
    return "\n".join(lines)


def on_vcan(rounds: int) -> dict[str, object]:
    """Compare the two readers on vcan0 of this kernel."""
    bus = Bus(name="ingest", interface="socketcan", channel="vcan0", data_bitrate=5_000_000)
    with ExitStack() as stack:
        near = stack.enter_context(open_transport(bus))
        ours = stack.enter_context(open_transport(bus))
        theirs = stack.enter_context(can.Bus(interface="socketcan", channel="vcan0", fd=True))
        return _side_by_side([near], ours, theirs, rounds)


def _on_can(quick: bool) -> tuple[str, dict[str, object]]:
    """Compare on a real vcan: this machine's, or a guest kernel's; say where, or why not."""
    rounds = 10 if quick else 200
    if any(link.name == "vcan0" for link in can_links()):
        try:
            return "vcan", on_vcan(rounds)
        except BusOpenError as error:
            return f"no vcan: {error}", {}
    guest = _guest()
    if guest is None:
        return "no vcan here, nor the tests' guest kernel", {}
    if reason := guest.unavailable():
        return reason, {}
    code = (
        f"import json; from benchmarks import ingest; print(json.dumps(ingest.on_vcan({rounds})))"
    )
    output, console = guest.run_program([sys.executable, "-c", code], ROOT)
    if not output:
        return f"no vcan in User-Mode Linux: {console.strip()[-300:]}", {}
    return "vcan in User-Mode Linux", json.loads(output)


def _guest():
    """Load the tests' guest kernel, where the tests are."""
    path = ROOT / "tests" / "vcan" / "guest.py"
    if not path.exists():
        return None
    spec = importlib.util.spec_from_file_location("guest", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class _LoopbackBus(SocketcanBus):
    """python-can's own reader over a socket that is there already."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket, self.channel, self._bcm_sockets = sock, "loopback", {}
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        can.BusABC.__init__(self, channel=self.channel)

    def _apply_filters(self, filters) -> None:
        self._is_filtered = True


def _sockets() -> list[socket.socket]:
    ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for end in ends:
        end.bind(("127.0.0.1", 0))
    for end, other in zip(ends, reversed(ends), strict=True):
        end.connect(other.getsockname())
    return ends


@contextmanager
def _loopback():
    """Senders, the batch transport and python-can, each pair over sockets of its own."""
    with ExitStack() as stack:
        (near, far), (near_too, far_too) = _sockets(), _sockets()
        senders = [
            stack.enter_context(DatagramTransport(end, "near", queue_bytes=4096))
            for end in (near, near_too)
        ]
        ours = stack.enter_context(DatagramTransport(far, "far"))
        yield senders, ours, stack.enter_context(_LoopbackBus(far_too))


def _side_by_side(senders, ours, theirs, rounds: int) -> dict[str, object]:
    """Read the same frames by both, in turn; medians over the rounds."""
    batch = FrameBatch(QUEUED)
    times: dict[str, list[float]] = {"ours": [], "theirs": [], "fd64": []}
    wrong = 0
    for classic in (_records(QUEUED, 8), _records(QUEUED, 64)):
        for _ in range(rounds):
            for sender in senders:
                sender.send(classic)
            batch.clear()
            gc.disable()
            started = time.perf_counter()
            while batch.count < QUEUED and ours.receive(batch):
                pass
            ended = time.perf_counter()
            times["fd64" if classic["length"][0] == 64 else "ours"].append(ended - started)
            wrong += QUEUED - batch.count + _wrong(batch.frames, classic[: batch.count])
            messages = []
            started = time.perf_counter()
            while len(messages) < QUEUED and (message := theirs.recv(0)) is not None:
                messages.append(message)
            ended = time.perf_counter()
            gc.enable()
            if classic["length"][0] == 8:
                times["theirs"].append(ended - started)
                wrong += QUEUED - len(messages)
    each = {name: 1e6 * median(taken) / QUEUED for name, taken in times.items()}
    return {
        "socketcan_frames_per_s": 1e6 / each["ours"],
        "socketcan_us_per_frame": each["ours"],
        "socketcan_fd64_us_per_frame": each["fd64"],
        "pythoncan_frames_per_s": 1e6 / each["theirs"],
        "ingest_ratio": each["theirs"] / each["ours"],
        "frames_wrong": int(wrong),
    }


def _records(count: int, length: int) -> np.ndarray:
    records = np.zeros(count, FRAME_DTYPE)
    records["id"], records["length"] = 0x100 + np.arange(count) % UNITS, length
    records["flags"] = FD_FDF if length > 8 else 0
    records["data"][:, :length] = np.arange(count * length).reshape(count, length) % 251
    return records


def _wrong(heard: np.ndarray, sent: np.ndarray) -> int:
    """Frames that differ in identifier, length or data from what was sent."""
    differs = (heard["id"] != sent["id"]) | (heard["length"] != sent["length"])
    length = int(sent["length"][0]) if sent.size else 0
    differs |= (heard["data"][:, :length] != sent["data"][:, :length]).any(axis=1)
    return int(differs.sum())


def _cycles(way: str, seconds: float) -> tuple[float, float | None, int]:
    """Read bursts of 64 frames a millisecond from another process.

    Returns
    -------
    percent : float
        Of a core, over the time of the bursts: user and system time of the reading thread.
    latency_us : float or None
        Median time from a burst's last frame in the kernel to its being read; of our own readers.
    missing : int
        Frames that were sent and not read.
    """
    sink, source = _sockets()
    port, target = source.getsockname()[1], sink.getsockname()[1]
    source.close()
    context = multiprocessing.get_context("spawn")
    bursts = round(seconds * 1e9 / PERIOD_NS)
    sender = context.Process(target=_send_bursts, args=(port, target, bursts))
    sender.start()
    try:
        read = _read_by_pythoncan if way == "pythoncan" else _read_by_waiter
        cpu, wall, late, frames = read(sink, way, bursts * UNITS)
    finally:
        sender.join()
    return 100 * cpu / wall, 1e6 * median(late) if late else None, bursts * UNITS - frames


def _send_bursts(port: int, target: int, bursts: int) -> None:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", port))
    sock.connect(("127.0.0.1", target))
    records = _records(UNITS, 8)
    with DatagramTransport(sock, "sender") as out:
        out.send(records[:0])
        due = time.monotonic_ns() + PERIOD_NS
        for _ in range(bursts):
            time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
            out.send(records)
            due += PERIOD_NS


def _read_by_waiter(sock: socket.socket, way: str, expected: int):
    with DatagramTransport(sock, "reader") as transport:
        waiter, batch = Waiter([transport], way), FrameBatch(4096)
        frames, late = transport.receive(batch, 60.0), []
        cpu, started = time.thread_time(), time.monotonic_ns()
        due = started + PERIOD_NS
        while frames < expected:
            batch.clear()
            wait = due - time.monotonic_ns() if way == "deadline" else 1_000_000_000
            taken = waiter.receive(batch, wait)
            if way == "deadline":
                due += PERIOD_NS
                if due - started > (expected // UNITS + 1000) * PERIOD_NS:
                    break
            elif not taken:
                break
            frames += taken
            if taken and frames % UNITS == 0:
                late.append((time.time_ns() - int(batch.frames["stamp_ns"][-1])) * 1e-9)
        wall = (time.monotonic_ns() - started) * 1e-9
        return time.thread_time() - cpu, wall, late, frames


def _read_by_pythoncan(sock: socket.socket, way: str, expected: int):
    enlarge_queue(sock, QUEUE_BYTES)
    with _LoopbackBus(sock) as bus:
        frames = int(bus.recv(60.0) is not None)
        cpu, started = time.thread_time(), time.monotonic()
        ended = started
        while frames < expected and bus.recv(1.0) is not None:
            frames += 1
            if frames % UNITS == 0:
                ended = time.monotonic()
        return time.thread_time() - cpu, ended - started, [], frames
