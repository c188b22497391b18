"""Simulating: how many times faster than real time a scene plays, all non-idealities on.

A ball slides to and fro over a palm of 64 units and over a square of 1024: contact mechanics with
friction, creep and loops of the elastomer, heat, Halbach films with errors and neighbours, the
field of the Earth, noise, counters and converters, and the frames of every cycle at 250 Hz.
`real_time_factor` is of the time that passed, `cpu_real_time_factor` of the time that a processor
was given, which other work on the machine does not lengthen as much. `beyond_friction_n`, beside
the time, is by how much any unit's tangential force is above what friction can bear.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from skin.sim.node import SimulatedUnits
from skin.sim.scenes.fast import play
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import NonIdeal
from topology import Topology, load

SIZES = {64: 1, 1024: 4}
"""Units, and tiles of 8 x 8 units along each side of the square; a bus carries a tile."""

RATE_HZ = 250.0


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    seconds = 0.5 if quick else 10.0
    found: dict[str, object] = {"rate_hz": RATE_HZ, "sizes": {}}
    for n in SIZES:
        row = _measure(skin_of(n), seconds, repeats=1 if quick else 3)
        found["sizes"][str(n)] = row
        found[f"real_time_factor_{n}"] = row["everything"]["real_time_factor"]
    return found


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'units':>6}  {'non-idealities':<14}{'us/cycle':>10}{'x real time':>13}"
             f"{'by CPU':>8}{'frames/s':>11}{'beyond N':>10}"]  # fmt: skip
    for size, rows in figures["sizes"].items():
        for name, row in rows.items():
            lines.append(
                f"{size:>6}  {name:<14}{row['us_per_cycle']:>10.0f}{row['real_time_factor']:>13.1f}"
                f"{row['cpu_real_time_factor']:>8.1f}"
                f"{row['frames_per_s']:>11.0f}{row['beyond_friction_n']:>10.0e}"
            )
    return "\n".join(lines)


def skin_of(n: int) -> Topology:
    """A square skin of `n` units at 250 Hz, on CAN FD buses of 64 units each."""
    side = SIZES[n]
    lines = ["format = 1", f'name = "square-{n}"']
    for i in range(side * side):
        x_m, y_m = 0.096 * (i % side - (side - 1) / 2), 0.096 * (i // side - (side - 1) / 2)
        lines += [
            "[[buses]]", f'name = "bus{i}"', f'channel = "b{i}"', "data_bitrate = 5_000_000",
            f"cycle_rate_hz = {RATE_HZ}", "sync_id = 0x080",
            "[[patches]]", f'name = "tile{i}"', 'kind = "grid"', "rows = 8", "columns = 8",
            "pitch_m = 0.012", f'bus = "bus{i}"', 'layout = "f3t-fd64"', "first_id = 0x100",
            f"pose = {{ xyz_m = [{x_m}, {y_m}, 0.0] }}",
        ]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "square.toml"
        path.write_text("\n".join(lines), "utf-8")
        return load(path)


def _measure(topology: Topology, seconds: float, repeats: int) -> dict:
    script = load_scene("slide", topology)
    kinds = {"none": NonIdeal.only(), "everything": NonIdeal.everything()}
    found: dict[str, dict] = {}
    for name, non_ideal in kinds.items():
        times, busy = [], []
        for _ in range(repeats):
            scene = ScriptedScene(topology, replace(script, non_ideal=non_ideal))
            # the first cycle loads what is compiled
            play(SimulatedUnits(topology, scene, history=0), 1.0 / RATE_HZ)
            scene = ScriptedScene(topology, replace(script, non_ideal=non_ideal))
            nodes = SimulatedUnits(topology, scene, history=0)
            started, worked = time.perf_counter(), time.process_time()
            served, _ = play(nodes, seconds)
            times.append(time.perf_counter() - started)
            busy.append(time.process_time() - worked)
        took = float(np.median(times))
        found[name] = {
            "real_time_factor": seconds / took,
            "cpu_real_time_factor": seconds / float(np.median(busy)),
            "us_per_cycle": took / served.cycles * 1e6,
            "frames_per_s": served.frames / took,
            "beyond_friction_n": _beyond_friction_n(ScriptedScene(topology, script), seconds),
        }
    return found


def _beyond_friction_n(scene: ScriptedScene, seconds: float) -> float:
    """Largest excess of a tangential force over what friction bears; below 0 if there is none."""
    most = scene.script.bodies[0].friction
    worst = -np.inf
    for time_s in np.linspace(0.0, seconds, 100):
        fx, fy, fz = scene.at(float(time_s)).force
        worst = max(worst, float((np.hypot(fx, fy) - most * fz).max()))
    return worst
