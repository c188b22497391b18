"""Recorded logs to Parquet: `skin decode` beside the usual script, on the same logs.

The logs are of a simulated skin of 64 units at 250 Hz that a sphere presses and slides over, again
and again: 14 CAN FD frames a cycle. The usual script reads them with python-can, decodes them with
cantools and the DBC file of the skin, and writes one table a message with pyarrow: counts as
physical values, without loss, validity, forces or contacts. Each runs in a process of its own, both
on one processor for the ratio, after a short log that compiles and imports what they need.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import resource
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import can
import numpy as np

import topology
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.memory import MemoryTransport
from bus.pythoncan import to_message
from skin.io.bulk import decode_logs
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene
from tests.fixtures.logs import read_all, write

SKIN, SCENE = "palm", "slide"
ROUND = 1280
"""Cycles of the scene; a multiple of the 256 that a SYNC counts."""
PERIOD_NS, START_NS = 4_000_000, 1_700_000_000_000_000_000
HOUR_CYCLES = 900_000
FORMATS = {"candump": "log", "blf": "blf"}


def run(quick: bool) -> dict[str, Any]:
    """Measure; see `table` for what."""
    scene = _scene_frames()
    short, long = (8, 12) if quick else (96, 704)
    figures: dict[str, Any] = {"units": topology.load(SKIN).n}
    with TemporaryDirectory(dir=os.environ.get("BULK_FOLDER")) as name:
        folder = Path(name)
        for kind, suffix in FORMATS.items():
            few, log = folder / f"few.{suffix}", folder / f"short.{suffix}"
            _write_log(few, scene, 1)
            _write_log(log, scene, short)
            figures |= _side_by_side(kind, few, log, folder)
        log = folder / "long.log"
        _write_log(log, scene, long)
        figures |= _long(log, folder)
    return figures


def table(figures: dict[str, Any]) -> str:
    """Show the figures."""
    lines = [f"{'log':<9}{'frames/s, one core':>20}{'usual script':>14}{'ratio':>8}{'by CPU':>8}"]
    lines += [
        f"{kind:<9}{figures[f'{kind}_frames_per_s']:>20,.0f}"
        f"{figures[f'{kind}_script_frames_per_s']:>14,.0f}{figures[f'{kind}_ratio']:>8.1f}"
        f"{figures[f'{kind}_cpu_ratio']:>8.1f}"
        for kind in FORMATS
    ]
    lines.append(
        f"a log of {figures['long_frames']:,} frames ({figures['long_minutes']:.0f} minutes of "
        f"{figures['units']} units): {figures['long_s']:.1f} s, one process, "
        f"{figures['peak_gib']:.2f} GiB; an hour: {figures['hour_s']:.0f} s"
    )
    return "\n".join(lines)


# -- logs ------------------------------------------------------------------------------------------


def _scene_frames() -> np.ndarray:
    """Frames of one round of the scene, SYNC and answers."""
    loaded = topology.load(SKIN)
    near, far = MemoryTransport.pair()
    SimulatedUnits(loaded, open_scene(SCENE, loaded)).attach([far])
    batch, parts = FrameBatch(4096), []
    for cycle in range(ROUND):
        sync = np.zeros(1, FRAME_DTYPE)
        sync["id"], sync["length"], sync["data"][0, 0] = loaded.sync_id, 1, cycle & 0xFF
        near.send(sync)
        batch.clear()
        near.receive(batch)
        frames = np.concatenate([sync, batch.frames])
        frames["stamp_ns"] = START_NS + cycle * PERIOD_NS + 100_000 * np.arange(frames.size)
        frames["origin"] = 0
        parts.append(frames)
    return np.concatenate(parts)


def _write_log(path: Path, scene: np.ndarray, rounds: int) -> None:
    """Write the scene so many times."""

    def parts() -> Iterator[np.ndarray]:
        for k in range(rounds):
            frames = scene.copy()
            frames["stamp_ns"] += k * ROUND * PERIOD_NS
            yield frames

    if path.suffix == ".log":
        write(path, parts())
        return
    with can.BLFWriter(path) as writer:
        for record in itertools.chain.from_iterable(parts()):
            message = to_message(record)
            message.channel = int(record["bus"])
            writer(message)


# -- what is measured ------------------------------------------------------------------------------


def _side_by_side(kind: str, few: Path, short: Path, folder: Path) -> dict[str, Any]:
    """One format: product and the usual script, each on one processor."""
    ours, frames = _apart(_decode, few, short, folder / f"{kind}-alone", True)
    script, few_frames = _apart(_usual_script, few, few, folder / f"{kind}.parquet", True)
    each = {name: script[name] / few_frames * frames for name in ("s", "cpu_s")}
    return {
        f"{kind}_frames_per_s": frames / ours["s"],
        f"{kind}_script_frames_per_s": few_frames / script["s"],
        f"{kind}_cpu_ratio": each["cpu_s"] / ours["cpu_s"],
        f"{kind}_ratio": each["s"] / ours["s"],
    }


def _long(log: Path, folder: Path) -> dict[str, Any]:
    """A long log in one process: time, and most memory."""
    few = folder / "few.log"
    taken, frames = _apart(_decode, few, log, folder / "long-out", False)
    cycles = frames / (read_all(few).size / ROUND)
    return {
        "long_frames": frames, "long_s": taken["s"],
        "long_minutes": cycles * PERIOD_NS / 60e9, "peak_gib": taken["gib"],
        "hour_s": taken["s"] * HOUR_CYCLES / cycles,
    }  # fmt: skip


def _apart(work, few: Path, log: Path, out: Path, pinned: bool) -> tuple[dict[str, float], int]:
    """Do it in a process of its own: time, most memory, and frames."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_timed, work, few, log, out, pinned).result()


def _timed(work, few: Path, log: Path, out: Path, pinned: bool) -> tuple[dict[str, float], int]:
    if pinned:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    work(few, out.with_name(f"warm-{out.name}"))
    begun, cpu = time.perf_counter(), time.process_time()
    frames = work(log, out)
    seconds, cpu_s = time.perf_counter() - begun, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 2**30
    return {"s": seconds, "cpu_s": cpu_s, "gib": peak}, frames


def _decode(log: Path, out: Path) -> int:
    """The product; frames."""
    (report,) = decode_logs(SKIN, [log], out)["logs"]
    assert not report["faults"], report["faults"]
    return sum(report["counters"].values())


def _usual_script(log: Path, out: Path) -> int:
    """Python-can, cantools and pyarrow; frames."""
    import can
    import cantools
    import pyarrow
    import pyarrow.parquet

    from bus.dbc import dbc_text

    loaded = topology.load(SKIN)
    database = cantools.database.load_string(dbc_text(loaded), "dbc")
    rows: dict[int, list[dict[str, Any]]] = {}
    frames = 0
    with can.LogReader(log) as reader:
        for message in reader:
            frames += 1
            try:
                values = database.decode_message(
                    message.arbitration_id, message.data, decode_choices=False
                )
            except KeyError:
                continue
            values["time"] = message.timestamp
            rows.setdefault(message.arbitration_id, []).append(values)
    for number, found in rows.items():
        pyarrow.parquet.write_table(
            pyarrow.Table.from_pylist(found), out.with_name(f"{number}-{out.name}"),
            compression="zstd",
        )  # fmt: skip
    return frames
