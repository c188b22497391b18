"""What a recording keeps when a process is killed, at any moment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import skin
from skin.io.messages.definitions import STATE, decode
from skin.io.record.container import RecordedFile
from tests.fixtures.cases import long_after_first
from tests.fixtures.patience import LONG_S

pytest.importorskip("mcap", reason="mcap is not installed")

ROOT = str(Path(__file__).parents[4])
LOOP = """
import sys, time
import skin
with skin.open("strip", simulate=True, record=sys.argv[1]) as strip:
    print(strip.recorder._worker._process.pid, flush=True)
    for state in strip:
        print(state.cycle, time.monotonic_ns(), flush=True)
"""
LOST_NS = 1_000_000_000
MOMENTS = np.random.default_rng(11).uniform(0.3, 3.0, 20).tolist()
"""Seconds after the first cycle."""


def killed(file, moment_s, whom):
    """Run a loop until a moment after its first cycle, and kill it, its worker or both; the cycles
    that it has told, with their times, and when that was."""
    told = file.with_suffix(".txt")
    with told.open("wb") as out:
        loop = subprocess.Popen(
            [sys.executable, "-c", LOOP, str(file)], stdout=out,
            env=os.environ | {"PYTHONPATH": ROOT},
        )  # fmt: skip
    while len(lines(told)) < 2:
        assert loop.poll() is None
        time.sleep(0.01)
    worker = int(lines(told)[0])
    time.sleep(moment_s)
    at_ns = time.monotonic_ns()
    for pid in {"loop": [loop.pid], "worker": [worker], "both": [worker, loop.pid]}[whom]:
        os.kill(pid, signal.SIGKILL)
    if whom == "worker":
        count = len(lines(told))
        until = time.monotonic() + LONG_S
        while len(lines(told)) < count + 300 and loop.poll() is None:
            assert time.monotonic() < until, "the loop stands still"
            time.sleep(0.05)
        assert loop.poll() is None, "the loop has ended with its worker"
        loop.kill()
    loop.wait()
    _gone(worker)
    return [tuple(map(int, line.split())) for line in lines(told)[1:]], at_ns


def lines(file):
    """Lines of a file that are whole."""
    return file.read_text().split("\n")[:-1]


def _gone(pid):
    """Wait until a process that is no child of ours has ended."""
    until = time.monotonic() + LONG_S
    while Path(f"/proc/{pid}/stat").exists():
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        if state == "Z":
            return
        assert time.monotonic() < until
        time.sleep(0.02)


def cycles_in(file):
    """Cycles of the states that can be read, and what is damaged."""
    recorded = RecordedFile(file)
    found = [decode(*one).cycle for one in recorded.messages((STATE,))]
    return found, recorded.damage


@pytest.mark.long
def test_a_loop_goes_on_without_its_worker(tmp_path):
    check_killed(tmp_path / "run.mcap", MOMENTS[4], "worker")


@long_after_first(
    ("moment_s", "whom"),
    [
        pytest.param(moment, whom, marks=[pytest.mark.long] if k or whom == "both" else [])
        for k, moment in enumerate(MOMENTS)
        for whom in ("loop", "both")
    ],
)
def test_whenever_a_process_is_killed_the_file_lacks_less_than_a_second(moment_s, whom, tmp_path):
    check_killed(tmp_path / "run.mcap", moment_s, whom)


def check_killed(file, moment_s, whom):
    told, at_ns = killed(file, moment_s, whom)
    found, damage = cycles_in(file)
    shown = [cycle for cycle, _ in told]
    assert found == sorted(set(found))
    if whom == "loop":
        assert set(shown) <= set(found)
        assert damage == []
    else:
        kept = {cycle for cycle, when_ns in told if when_ns < at_ns - LOST_NS}
        assert kept <= set(found)
    replay = skin.replay(file)
    count = sum(1 for _ in replay)
    assert count == replay.same == len(found)
