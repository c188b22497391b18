"""The first start on a machine: seconds until the first state, with an empty cache of kernels.

A process opens the simulated palm with all that `skin.open` does by default, and ends with its
first state: once alone, and once with a second process that compiles, too; then both are done
again with the cache that the first has left. Processor time is given next to the time on the clock,
as others may use the machine: with free cores the first state takes about as long as the busiest
process computes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

FIRST = """
import json, resource, sys, threading, time
began = time.perf_counter()
from bus.compiled import cache, pool

assert pool.processors() >= 1  # what is replaced is what the pool asks
pool.processors = lambda: int(sys.argv[1])
compiling, kernels = [], {}

def begun(name):
    if threading.current_thread() is threading.main_thread():
        compiling.append([name, time.process_time(), 0.0])

def done(name):
    if threading.current_thread() is threading.main_thread():
        name, since, within = compiling.pop()
        took = time.process_time() - since
        kernels[name] = kernels.get(name, 0.0) + took - within
        if compiling:
            compiling[-1][2] += took

import skin

options = json.loads(sys.argv[2])
with cache.watch(begun, done):
    with skin.open("palm", simulate=True, pace=False, **options) as palm:
        next(iter(palm))
        seconds = time.perf_counter() - began
        own = time.process_time()
for thread in threading.enumerate():
    if thread is not threading.current_thread():
        thread.join(60.0)  # the other process ends
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({
    "seconds": seconds, "cpu_s": own, "other_cpu_s": used.ru_utime + used.ru_stime,
    "kernels": kernels,
}))
"""
QUICK = {"want": ["temperature"]}
SHOWN = 12
"""Kernels of the table, those that take longest."""


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    options = QUICK if quick else {}
    found = {}
    for count in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            cold, warm = (_first(count, options, folder) for _ in range(2))
        found[str(count)] = cold | {"warm_s": warm["seconds"], "warm_cpu_s": warm["cpu_s"]}
    alone, both = found["1"], found["2"]
    return {
        "seconds": {count: row["seconds"] for count, row in found.items()},
        "cpu_s": {count: row["cpu_s"] + row["other_cpu_s"] for count, row in found.items()},
        "busiest_cpu_s": max(both["cpu_s"], both["other_cpu_s"]),
        "warm_s": min(row["warm_s"] for row in found.values()),
        "warm_cpu_s": min(row["warm_cpu_s"] for row in found.values()),
        "kernels": dict(sorted(alone["kernels"].items(), key=lambda one: -one[1])),
        "load": os.getloadavg()[0],
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    seconds, cpu_s = figures["seconds"], figures["cpu_s"]
    lines = [
        f"first state from an empty cache: {seconds['1']:.1f} s in one process "
        f"({cpu_s['1']:.1f} s of a processor), {seconds['2']:.1f} s in two ({cpu_s['2']:.1f} s, "
        f"the busiest {figures['busiest_cpu_s']:.1f} s); load of the machine {figures['load']:.1f}",
        f"from a full one: {figures['warm_s']:.2f} s ({figures['warm_cpu_s']:.2f} s)",
        "seconds of a processor by kernel, in one process:",
    ]
    rows = [*figures["kernels"].items()]
    lines += [f"  {seconds:6.2f}  {name}" for name, seconds in rows[:SHOWN]]
    rest = sum(seconds for _, seconds in rows[SHOWN:])
    return "\n".join([*lines, f"  {rest:6.2f}  {max(len(rows) - SHOWN, 0)} others"])


def _first(count: int, options: dict, folder: str) -> dict:
    """What a start in so many processes reports."""
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", FIRST, str(count), json.dumps(options)], check=True, text=True,
        stdout=subprocess.PIPE, cwd=root, env=os.environ | {"NUMBA_CACHE_DIR": folder},
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])
