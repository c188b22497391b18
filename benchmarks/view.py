"""What the live view costs: its processor time, and what the cycle of the skin notices of it.

A pipeline with contacts and slip takes a cycle every 4 ms, from counts of simulated units of which
a quarter is pressed; a client is connected, tells its camera as a browser does, so that it is drawn
for, and discards what it gets; how many pictures that were is counted (`pictures_hz`). For spells
of a second by turns the view is fed, at 30 snapshots a second, or is not. Counted as the view's:
all processor time of its process while it is fed, and what the pipeline's loop spends on snapshots.
The time of a cycle has the snapshot in it. The client's own time, and the drawing of a browser, are
not counted.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from benchmarks.contact import plate
from benchmarks.skip import counts_of
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from skin.pipeline import Pipeline
from skin.sinks import Sink
from skin.state import State
from skin.view import View, show

SIZES = (64, 1000)
PRESSED = 0.25
PERIOD_S = 0.004
WARM = 250
"""Cycles before the first that counts: kernels are loaded, the client has the whole picture."""
CLIENT = """
import sys
from importlib.metadata import version
from threading import Thread
from msgspec import msgpack
from websockets.sync.client import connect
from zstandard import ZstdDecompressor

CAMERA = {"type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 2.0],
          "fov": 1.0, "near": 0.01, "far": 50.0, "image_height": 720, "image_width": 1280,
          "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0]}
pictures, came = 0, False

def tell():
    for _ in sys.stdin:
        print(pictures, flush=True)

Thread(target=tell, daemon=True).start()
with connect(sys.argv[1], subprotocols=["viser-v" + version("viser")], max_size=None) as socket:
    socket.send(msgpack.encode(CAMERA))
    for message in socket:
        size = int.from_bytes(message[8:16], "little")
        told = ZstdDecompressor().decompress(message[16:16 + size])
        pictures += b"batched_colors" in told
        if not came:
            came = True
            print("connected", flush=True)
"""
"""Counts windows of messages that have colours of units in them: those of a picture."""


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    spells = 3 if quick else 12
    sizes = {str(n): measure(n, spells) for n in SIZES}
    shares = {n: row["view_share"] + row["loop_share"] for n, row in sizes.items()}
    return {
        "view_cpu_share": shares,
        "cycle_p99_ratio": {n: row["with"]["p99_us"] / row["without"]["p99_us"]
                            for n, row in sizes.items()},
        "cycle_p50_ratio": {n: row["with"]["p50_us"] / row["without"]["p50_us"]
                            for n, row in sizes.items()},
        "sizes": sizes,
    }  # fmt: skip


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [
        "units   of a core: view, loop   cycle with: p50, p99 µs   without   snapshots, pictures/s"
    ]
    for n, row in figures["sizes"].items():
        lines.append(
            f"{n:>5}   {100 * row['view_share']:13.2f} %, {100 * row['loop_share']:.2f} %"
            f"   {row['with']['p50_us']:14.0f}, {row['with']['p99_us']:.0f}"
            f"   {row['without']['p50_us']:.0f}, {row['without']['p99_us']:.0f}"
            f"   {row['snapshots_hz']:.1f}, {row['pictures_hz']:.1f}"
        )
    return "\n".join(lines)


def measure(n: int, spells: int) -> dict:
    """One size, in spells of a second with and without the view."""
    skin = plate(-(-n // 40) * 40 if n % 40 == 0 else n)
    counts = counts_of(skin, PRESSED)
    pipeline = Pipeline(skin)
    pipeline.warmup()
    timing = SimpleNamespace(work_ns=0)
    source = SimpleNamespace(topology=skin, pipeline=pipeline, timing=timing)
    work: dict[str, list[float]] = {"with": [], "without": []}
    spent = {"view": 0.0, "loop": 0.0, "fed": 0.0}
    with show(source, port=0) as view, _client(view) as pictures:
        loop = _Loop(pipeline, counts, timing)
        loop.go(WARM)
        looks = _Timed(view, spent)
        pipeline.detach(view)
        taken, drawn = view.snapshots.taken, pictures()
        for spell in range(2 * spells):
            is_fed = spell % 2 == 0
            if is_fed:
                pipeline.attach(looks)
            began, used = time.monotonic(), _used_s(view)
            work["with" if is_fed else "without"] += loop.go(round(1.0 / PERIOD_S))
            if is_fed:
                pipeline.detach(looks)
                spent["fed"] += time.monotonic() - began
                spent["view"] += _used_s(view) - used
        taken, drawn = view.snapshots.taken - taken, pictures() - drawn
    return {
        "view_share": spent["view"] / spent["fed"],
        "loop_share": spent["loop"] / spent["fed"],
        "snapshots_hz": taken / spent["fed"],
        "pictures_hz": drawn / spent["fed"],
        **{side: _spread(np.array(values)) for side, values in work.items()},
    }


class _Loop:
    """Cycles, each of them not before its time; told is the work of each, microseconds."""

    def __init__(self, pipeline: Pipeline, counts: np.ndarray, timing: SimpleNamespace) -> None:
        self._pipeline, self._counts, self._timing = pipeline, counts, timing
        self._number = 0

    def go(self, cycles: int) -> list[float]:
        pipeline, work_us = self._pipeline, []
        due = time.monotonic()
        for _ in range(cycles):
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            self._number += 1
            pipeline.counts[:] = self._counts[self._number % len(self._counts)]
            pipeline.status[:] = 0
            began = time.perf_counter_ns()
            pipeline.state(self._cycle())
            self._timing.work_ns = time.perf_counter_ns() - began
            work_us.append(1e-3 * self._timing.work_ns)
        return work_us

    def _cycle(self) -> RawCycle:
        none = np.zeros(0)
        stamp_ns = 10**18 + round(1e9 * PERIOD_S) * self._number
        return RawCycle(self._number, stamp_ns, ClosedBy.COMPLETE, self._pipeline.counts, none,
                        self._pipeline.status, none, none, none, FrameCounters())  # fmt: skip


class _Timed(Sink):
    """What sees states for the view, timed."""

    inline = True

    def __init__(self, view: View, spent: dict[str, float]) -> None:
        self._view, self._spent = view, spent

    def state(self, state: State) -> None:
        began = time.perf_counter()
        self._view.state(state)
        self._spent["loop"] += time.perf_counter() - began


@contextmanager
def _client(view: View) -> Iterator[Callable[[], int]]:
    """A client that is connected, and discards; how many pictures it got so far."""
    address = view.address.replace("http", "ws")
    process = subprocess.Popen(
        [sys.executable, "-c", CLIENT, address],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    ask, told = process.stdin, process.stdout

    def pictures() -> int:
        print(file=ask, flush=True)
        return int(told.readline())

    try:
        assert told.readline() == "connected\n"
        yield pictures
    finally:
        process.terminate()
        process.wait()
        ask.close()
        told.close()


def _used_s(view: View) -> float:
    """Processor time of the view's process, all its threads."""
    fields = Path(f"/proc/{view.process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _spread(work_us: np.ndarray) -> dict[str, float]:
    p50, p99 = np.percentile(work_us, [50, 99])
    return {"p50_us": float(p50), "p99_us": float(p99), "cycles": work_us.size}
