"""The first start on a machine: seconds until the first state, with an empty cache of kernels.

A process opens the simulated palm with all that `skin.open` does by default, and ends with its
first state: once with one process that compiles, once with two; then both are done again with the
cache that the first has left. Processor time is given next to the time on the clock, as others may
use the machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

FIRST = """
import json, resource, sys, time
began = time.perf_counter()
from bus.compiled import warm

assert warm.processors() >= 1  # what is replaced is what is asked
warm.processors = lambda: int(sys.argv[1])
import skin

with skin.open("palm", simulate=True, pace=False, **json.loads(sys.argv[2])) as palm:
    next(iter(palm))
    seconds, own = time.perf_counter() - began, time.process_time()
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"seconds": seconds, "cpu_s": own, "other_cpu_s": used.ru_utime + used.ru_stime}))
"""
QUICK = {"want": ["temperature"]}


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    options = QUICK if quick else {}
    found = {}
    for count in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            cold, warm = (_first(count, options, folder) for _ in range(2))
        found[str(count)] = cold | {"warm_s": warm["seconds"], "warm_cpu_s": warm["cpu_s"]}
    return {
        "seconds": {count: row["seconds"] for count, row in found.items()},
        "cpu_s": {count: row["cpu_s"] + row["other_cpu_s"] for count, row in found.items()},
        "warm_s": min(row["warm_s"] for row in found.values()),
        "warm_cpu_s": min(row["warm_cpu_s"] for row in found.values()),
        "load": os.getloadavg()[0],
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    seconds, cpu_s = figures["seconds"], figures["cpu_s"]
    return "\n".join([
        f"first state from an empty cache: {seconds['1']:.1f} s with one process that compiles "
        f"({cpu_s['1']:.1f} s of a processor), {seconds['2']:.1f} s with two ({cpu_s['2']:.1f} s); "
        f"load of the machine {figures['load']:.1f}",
        f"from a full one: {figures['warm_s']:.2f} s ({figures['warm_cpu_s']:.2f} s)",
    ])  # fmt: skip


def _first(count: int, options: dict, folder: str) -> dict:
    """What a start in so many processes reports."""
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", FIRST, str(count), json.dumps(options)], check=True, text=True,
        stdout=subprocess.PIPE, cwd=root, env=os.environ | {"NUMBA_CACHE_DIR": folder},
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])
