"""What recording costs a cycle, how large its files are, and at which rate it loses nothing.

The same frames, of a ball that slides over 64 units, go through two pipelines by turns, cycle by
cycle: one alone, one that is recorded. `record_us_p50` is the difference of their medians. Beside
it stands what the recorder does alone (`recorder_us_p50`): frames and state copied into the ring.

For rates the recorded pipeline is given cycles at 1 kHz, 2 kHz, … for some seconds each, through a
clock that waits for nobody; `lost_frames` counts what was left out of the file at 1 kHz. Frames
that the machine was too late for count as well, since they come at once afterwards.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np

import skin
from bus.logs import buses_of, read
from skin.io.record.recorder import Recorder
from skin.pipeline import Pipeline
from skin.state import State
from topology import Topology

CYCLES = 500
RATES_HZ = (1000, 2000, 3000, 4000, 6000)


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    with tempfile.TemporaryDirectory() as folder:
        palm, batches = _batches(Path(folder))
        cost = _cost(palm, batches, Path(folder), rounds=3 if quick else 12)
        rates = {}
        for rate_hz in RATES_HZ[: 2 if quick else None]:
            rates[str(rate_hz)] = _at_rate(
                _at(palm, rate_hz), batches, Path(folder), rate_hz, 2.0 if quick else 6.0
            )
            if rates[str(rate_hz)]["lost_frames"]:
                break
    whole = [int(rate) for rate, row in rates.items() if not row["lost_frames"] and row["kept_up"]]
    return {
        **cost,
        "lost_frames": rates["1000"]["lost_frames"],
        "mb_per_minute_250_hz": 60 * 250 * rates["1000"]["bytes_a_cycle"] / 1e6,
        "mb_per_minute_1000_hz": 60 * 1000 * rates["1000"]["bytes_a_cycle"] / 1e6,
        "lossless_hz": max(whole, default=0),
        "units": palm.n,
        "rates": rates,
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [
        f"{figures['units']} units, a ball slides over them",
        f"a cycle alone {figures['plain_us_p50']:.1f} µs p50, recorded "
        f"{figures['recorded_us_p50']:.1f} µs: {figures['record_us_p50']:+.1f} µs; the recorder "
        f"alone {figures['recorder_us_p50']:.1f} µs",
        f"{figures['mb_per_minute_250_hz']:.0f} MB a minute at 250 Hz",
        f"{'Hz':>6}{'reached':>9}{'left out':>10}{'worker s/s':>12}{'B a cycle':>11}",
    ]
    lines += [
        f"{rate:>6}{row['reached_hz']:>9.0f}{row['lost_frames']:>10}{row['worker_share']:>12.2f}"
        f"{row['bytes_a_cycle']:>11.0f}"
        for rate, row in figures["rates"].items()
    ]
    return "\n".join(lines)


def _batches(folder: Path) -> tuple[Topology, list[list[np.ndarray]]]:
    """Frames of each cycle as a live skin hands them over: SYNC, then the answers."""
    log = folder / "run.log"
    with skin.open("palm", simulate="slide", pace=False, record=log) as palm:
        states: Iterator[State] = iter(palm)
        for _ in range(CYCLES):
            next(states)
        loaded = palm.topology
    frames = np.concatenate([b.frames.copy() for b in read(log, buses=buses_of(loaded, log))])
    at = np.flatnonzero(frames["id"] == loaded.sync_id)
    return loaded, [
        [frames[one : one + 1].copy(), frames[one + 1 : other].copy()]
        for one, other in pairwise(at)
    ]


@contextmanager
def _recorded(palm: Topology, file: Path) -> Iterator[tuple[Pipeline, Recorder]]:
    pipeline = Pipeline(palm)
    recorder = Recorder(file, pipeline)
    pipeline.sinks.attach(recorder)
    try:
        pipeline.warmup()
        yield pipeline, recorder
    finally:
        pipeline.sinks.stop()
        file.unlink()


def _cycle(pipeline: Pipeline, batches: list[np.ndarray]) -> State | None:
    state = None
    for batch in batches:
        for one in pipeline.feed(batch):
            state = one
    return state


def _cost(palm: Topology, cycles: list[list[np.ndarray]], folder: Path, rounds: int) -> dict:
    """Microseconds of a cycle, alone and recorded by turns, at about a kilohertz."""
    plain = Pipeline(palm)
    plain.warmup()
    spent: dict[str, list[float]] = {"plain": [], "recorded": [], "recorder": []}
    with _recorded(palm, folder / "cost.mcap") as (recorded, recorder):
        for turn in range(rounds):
            sides = [("plain", plain), ("recorded", recorded)]
            for k, batches in enumerate(cycles):
                for name, pipeline in sides[:: 1 if k % 2 else -1]:
                    started = time.perf_counter_ns()
                    state = _cycle(pipeline, batches)
                    took = time.perf_counter_ns() - started
                    if turn:  # the first one warms up
                        spent[name].append(1e-3 * took)
                    if pipeline is recorded and state is not None and turn and not k % 5:
                        started = time.perf_counter_ns()
                        for batch in batches:
                            recorder.frames(batch)
                        recorder.state(recorded.now)
                        spent["recorder"].append(1e-3 * (time.perf_counter_ns() - started))
                time.sleep(0.0005)
    p50 = {name: float(np.median(values)) for name, values in spent.items()}
    return {
        "record_us_p50": p50["recorded"] - p50["plain"],
        **{f"{name}_us_p50": value for name, value in p50.items()},
        "recorder_us_p99": float(np.percentile(spent["recorder"], 99)),
    }


def _at(palm: Topology, rate_hz: int) -> Topology:
    """The same skin at another rate, by which the recorder makes its ring."""
    return dataclasses.replace(palm, cycle_rate_hz=float(rate_hz))


def _at_rate(
    palm: Topology, cycles: list[list[np.ndarray]], folder: Path, rate_hz: int, seconds: float
) -> dict:
    """Feed cycles at a rate, whether or not anybody keeps up."""
    with _recorded(palm, folder / "rate.mcap") as (pipeline, recorder):
        total = round(rate_hz * seconds)
        before_s = recorder.report()["cpu_s"]
        started = time.monotonic()
        for k in range(total):
            wait = started + k / rate_hz - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            _cycle(pipeline, cycles[k % len(cycles)])
        took = time.monotonic() - started
        report = recorder.report()
    return {
        "lost_frames": report["lost_frames"],
        "lost_cycles": report["lost_cycles"],
        "reached_hz": total / took,
        "kept_up": total / took > 0.95 * rate_hz,
        "worker_share": (report["cpu_s"] - before_s) / took,
        "bytes_a_cycle": report["bytes"] / max(1, report["cycles"]),
    }
