"""Recorded logs to Parquet: `skin decode` beside the usual script, on the same logs.

The logs are of a simulated skin of 64 units at 250 Hz that a sphere presses and slides over, again
and again: 14 CAN FD frames a cycle. The usual script reads them with python-can, decodes them with
cantools and the DBC file of the skin, and writes one table a message with pyarrow: counts as
physical values, without loss, validity, forces or contacts; `skin decode` is measured with
temperature and force alone as well. Each runs in a process of its own, both on one processor for
the ratio, after a short log that compiles and imports what they need. Times on processors, of all
threads together, do not know who else keeps the machine busy. Two processes and one decode four
short logs and four longer ones: the difference is without the start of the processes.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import topology
from bus.frame import ECHO, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.logs import read_all, write
from bus.memory import MemoryTransport
from skin.io.bulk import WANT, decode_logs
from skin.options import Options
from skin.pipeline import Pipeline
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene
from skin.sinks import Ending

SKIN, SCENE = "palm", "slide"
ROUND = 1280
"""Cycles of the scene; a multiple of the 256 that a SYNC counts."""
PERIOD_NS, START_NS = 4_000_000, 1_700_000_000_000_000_000
HOUR_CYCLES = 900_000
FORMATS = {"candump": "log", "blf": "blf", "mf4": "mf4"}


def run(quick: bool) -> dict[str, Any]:
    """Measure; see `table` for what."""
    scene = _scene_frames()
    rounds = {"few": 1, "mf4": 4 if quick else 8, "short": 16 if quick else 96,
              "long": 24 if quick else 704}  # fmt: skip
    figures: dict[str, Any] = {"units": topology.load(SKIN).n, "processors": os.cpu_count()}
    with TemporaryDirectory(dir=os.environ.get("BULK_FOLDER")) as name:
        folder = Path(name)
        figures["equal_to_live"] = _equal_to_live(folder, scene)
        for kind, suffix in FORMATS.items():
            short = folder / f"short.{suffix}"
            few = folder / f"few.{suffix}"
            lengths = {few: rounds["few"], short: rounds["mf4" if kind == "mf4" else "short"]}
            if not all(_write_log(path, scene, count) for path, count in lengths.items()):
                figures[f"{kind}_frames_per_s"] = None
                continue
            figures |= _side_by_side(kind, few, short, folder)
        log = folder / "long.log"
        _write_log(log, scene, rounds["long"])
        figures |= _long(log, folder)
        log.unlink()
        figures |= _scaling(scene, rounds["short"] // 2, folder)
    return figures


def table(figures: dict[str, Any]) -> str:
    """Show the figures."""
    lines = [
        f"{'log':<9}{'frames/s':>12}{'one core':>12}{'usual script':>14}{'ratio':>8}{'by CPU':>8}"
        f"{'forces':>8}{'by CPU':>8}"
    ]
    for kind in FORMATS:
        if figures.get(f"{kind}_frames_per_s") is None:
            lines.append(f"{kind:<9} no library that writes it")
            continue
        lines.append(
            f"{kind:<9}{figures[f'{kind}_frames_per_s']:>12,.0f}"
            f"{figures[f'{kind}_one_core_frames_per_s']:>12,.0f}"
            f"{figures[f'{kind}_script_frames_per_s']:>14,.0f}{figures[f'{kind}_ratio']:>8.1f}"
            f"{figures[f'{kind}_cpu_ratio']:>8.1f}"
            f"{figures[f'{kind}_force_ratio']:>8.1f}{figures[f'{kind}_force_cpu_ratio']:>8.1f}"
        )
    lines += [
        f"a log of {figures['long_frames']:,} frames ({figures['long_minutes']:.0f} minutes of "
        f"{figures['units']} units): {figures['long_s']:.1f} s, one process, "
        f"{figures['long_frames_per_s']:,.0f} frames/s, {figures['peak_gib']:.2f} GiB; an hour: "
        f"{figures['hour_s']:.0f} s, {figures['hour_cpu_s']:.0f} s on processors",
        f"four logs: one process {figures['one_process_s']:.1f} s "
        f"({figures['one_process_cpu_s']:.1f} s on processors), two "
        f"{figures['two_process_s']:.1f} s ({figures['two_process_cpu_s']:.1f} s), their start "
        f"{figures['start_s']:.1f} s ({figures['start_cpu_s']:.1f} s): "
        f"{figures['scaling']:.2f} times as fast, without their start "
        f"{figures['scaling_rate']:.2f} times; load {figures['load']:.1f}",
        f"equal to live, value by value: {figures['equal_to_live']}",
    ]
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


def _write_log(path: Path, scene: np.ndarray, rounds: int) -> bool:
    """Write the scene so many times; False where no library writes this kind."""

    def parts():
        for k in range(rounds):
            frames = scene.copy()
            frames["stamp_ns"] += k * ROUND * PERIOD_NS
            yield frames

    if path.suffix == ".mf4":
        return _write_mf4(path, parts())
    write(path, parts())
    return True


def _write_mf4(path: Path, parts) -> bool:
    """Write by python-can, as its loggers do."""
    import can

    try:
        writer = can.Logger(path)
    except Exception:  # python-can raises what the library that lacks makes of it
        return False
    with writer:
        for frames in parts:
            for one in frames:
                size = int(one["length"])
                writer.on_message_received(can.Message(
                    timestamp=one["stamp_ns"] * 1e-9, arbitration_id=int(one["id"]),
                    is_extended_id=False, is_fd=bool(one["flags"] & FD_FDF), dlc=size,
                    data=one["data"][:size].tobytes(), channel=0,
                    is_rx=not one["origin"] & ECHO,
                ))  # fmt: skip
    return True


# -- what is measured ------------------------------------------------------------------------------


def _side_by_side(kind: str, few: Path, short: Path, folder: Path) -> dict[str, Any]:
    """One format: product on all processors and on one, and the usual script on one."""
    free, _ = _apart(_decode, few, short, folder / f"{kind}-free", False)
    alone, frames = _apart(_decode, few, short, folder / f"{kind}-alone", True)
    force, _ = _apart(_decode_forces, few, short, folder / f"{kind}-force", True)
    script, few_frames = _apart(_usual_script, few, few, folder / f"{kind}.parquet", True)
    each = {name: script[name] / few_frames * frames for name in ("s", "cpu_s")}
    return {
        f"{kind}_frames": frames,
        f"{kind}_frames_per_s": frames / free["s"],
        f"{kind}_one_core_frames_per_s": frames / alone["s"],
        f"{kind}_script_frames_per_s": few_frames / script["s"],
        f"{kind}_cpu_ratio": each["cpu_s"] / alone["cpu_s"],
        f"{kind}_ratio": each["s"] / alone["s"],
        f"{kind}_force_cpu_ratio": each["cpu_s"] / force["cpu_s"],
        f"{kind}_force_ratio": each["s"] / force["s"],
    }


def _long(log: Path, folder: Path) -> dict[str, Any]:
    """A long log in one process: time, and most memory."""
    few = folder / "few.log"
    taken, frames = _apart(_decode, few, log, folder / "long-out", False)
    cycles = frames / (_round_frames(few) / ROUND)
    return {
        "long_frames": frames, "long_s": taken["s"], "long_frames_per_s": frames / taken["s"],
        "long_minutes": cycles * PERIOD_NS / 60e9, "peak_gib": taken["gib"],
        "hour_s": taken["s"] * HOUR_CYCLES / cycles,
        "hour_cpu_s": taken["cpu_s"] * HOUR_CYCLES / cycles,
    }  # fmt: skip


def _round_frames(few: Path) -> float:
    """Frames of one round of the scene, by the log of few."""
    return float(read_all(few).size)


def _scaling(scene: np.ndarray, rounds: int, folder: Path) -> dict[str, Any]:
    """Four logs, by one process and by two: elapsed, and on processors; see `run`."""
    wall: dict[tuple[int, int], float] = {}
    cpu: dict[tuple[int, int], float] = {}
    for length in (1, rounds):
        logs = []
        for k in range(4):
            shifted = scene.copy()
            shifted["stamp_ns"] += k * 3600 * 10**9
            logs.append(folder / f"log{length}-{k}.log")
            _write_log(logs[-1], shifted, length)
        for jobs in (1, 2):
            begun, begun_cpu = time.perf_counter(), _cpu_s()
            with ExitStack() as pools:
                context = multiprocessing.get_context("spawn")
                pool = ProcessPoolExecutor(jobs, context) if jobs > 1 else None
                if pool is not None:
                    pools.enter_context(pool)
                out = folder / f"jobs{jobs}-{length}"
                report = decode_logs(SKIN, logs, out, executor=pool)
            wall[jobs, length] = time.perf_counter() - begun
            cpu[jobs, length] = _cpu_s() - begun_cpu
            assert not report["failed"], report["faults"]
    one, two = (wall[jobs, rounds] - wall[jobs, 1] for jobs in (1, 2))
    return {
        "one_process_s": wall[1, rounds], "two_process_s": wall[2, rounds],
        "one_process_cpu_s": cpu[1, rounds], "two_process_cpu_s": cpu[2, rounds],
        "start_s": wall[2, 1], "start_cpu_s": cpu[2, 1], "load": os.getloadavg()[0],
        "scaling": wall[1, rounds] / wall[2, rounds], "scaling_rate": one / two,
    }  # fmt: skip


def _cpu_s() -> float:
    """Time on processors so far, of this process and of those that it has ended."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)


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


def _decode_forces(log: Path, out: Path) -> int:
    """The product, with what the usual script has; frames."""
    return _decode(log, out, want=("temperature", "force"))


def _decode(log: Path, out: Path, **options: Any) -> int:
    """The product; frames."""
    (report,) = decode_logs(SKIN, [log], out, **options)["logs"]
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


def _equal_to_live(folder: Path, scene: np.ndarray) -> bool:
    """Whether the tables hold what a live pipeline shows, bit by bit."""
    import pyarrow.parquet

    log = folder / "live.log"
    _write_log(log, scene, 1)
    loaded = topology.load(SKIN)
    decode_logs(loaded, [log], folder / "live")
    found = pyarrow.parquet.read_table(folder / "live" / "cycles")
    loads = pyarrow.parquet.read_table(folder / "live" / "contacts")["load"].to_numpy()
    pipeline = Pipeline(loaded, Options(want=WANT))
    force = np.stack([
        [found[f"{name}.{axis}"].to_numpy() for name in loaded.unit_names]
        for axis in ("fx", "fy", "fz")
    ])  # fmt: skip
    wrench = np.stack([found[f"wrench.{axis}"].to_numpy() for axis in ("fx", "fy", "fz")])
    count = at = 0
    states = pipeline.feed(read_all(log))
    for state in states:
        same = force[:, :, count].tobytes() == np.ascontiguousarray(state.units.force).tobytes()
        same &= wrench[:, count].tobytes() == state.wrench[:3].tobytes()
        for contact in state.contacts:
            same &= bool(loads[at] == contact.load)
            at += 1
        if not same:
            return False
        count += 1
    last = pipeline.end(Ending.FLUSHED)
    return count + (last is not None) == found.num_rows
