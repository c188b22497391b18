"""Do tests pass on a busy machine? ``python -m tests.house.under_load [--seed S] [TEST ...]``

Takes a random sample of all tests but the long ones and those on a vcan, or the tests named, and
runs each 20 times in one process, which has one processor, while a busy loop runs on every
processor. What only a fast machine shows fails here. Ends after so many seconds at the latest, and
says how much of the sample it has had time for.
"""

from __future__ import annotations

import argparse
import copy
import os
import random
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["busy", "collected", "main"]

ROOT = Path(__file__).parents[2]
TIMES, SAMPLE, SECONDS = 20, 40, 840.0
"""Of each test; tests; and of all together [assumed: a long run has a quarter of an hour]."""
REPEATED = "F3T_REPEATED"
"""Variable of the environment that says how often a test runs."""


@contextmanager
def busy() -> Iterator[None]:
    """Let a loop run on every processor, and this process and its children on one."""
    before = os.sched_getaffinity(0)
    loops = []
    for one in sorted(before):
        os.sched_setaffinity(0, {one})  # as the child has it
        loops.append(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
        for loop in loops:
            loop.kill()
            loop.wait()


def collected() -> list[str]:
    """All tests, each function once: its first variant stands for the others."""
    told = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "not long",
         "--ignore=tests/vcan"], cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    functions: dict[str, str] = {}
    for line in told.stdout.splitlines():
        if "::" in line:
            functions.setdefault(line.partition("[")[0], line)
    return list(functions.values())


def main(arguments: list[str] | None = None) -> int:
    """Run the sample; 1 where a test failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.house.under_load")
    parser.add_argument("tests", nargs="*", help="names as pytest has them; a sample if not given")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--count", type=int, default=SAMPLE, help="tests of the sample")
    parser.add_argument("--times", type=int, default=TIMES, help="runs of each")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of all together")
    given = parser.parse_args(arguments)
    chosen = given.tests
    if not chosen:
        everything = collected()
        count = min(given.count, len(everything))
        chosen = random.Random(given.seed).sample(everything, count)
        print(f"{count} of {len(everything)} tests, --seed {given.seed}", flush=True)
    ends, failed, done = time.monotonic() + given.seconds, [], 0
    with busy():
        for test in chosen:
            if time.monotonic() > ends:
                break
            try:
                told = repeated(test, given.times, max(ends - time.monotonic(), 1.0))
            except subprocess.TimeoutExpired:
                break
            done += 1
            print(f"{told.stdout.splitlines()[-1].strip('= ')}: {test}", flush=True)
            if told.returncode:
                failed.append(test)
                print(re.sub(r"(?m)^", "    ", told.stdout[-4000:]), flush=True)
    print(f"{done} of {len(chosen)} tests had time, {len(failed)} failed", flush=True)
    return bool(failed)


def repeated(test: str, times: int, seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a test so many times, up to the first failure."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider",
         "-p", "tests.house.under_load", "--durations=0", test],
        cwd=ROOT, env=os.environ | {REPEATED: str(times)}, timeout=seconds,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip


def pytest_collection_modifyitems(items: list) -> None:
    """As a plugin of pytest: run each test as often as `repeated` asks for."""
    items[:] = [copy.copy(item) for item in items for _ in range(int(os.environ[REPEATED]))]
    for item in items:
        item._initrequest()  # its fixtures are its own


if __name__ == "__main__":
    sys.exit(main())
