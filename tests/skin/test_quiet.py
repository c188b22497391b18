"""A loop that has settled gives the collector nothing to do, touches no fresh memory and logs
nothing: what would hold it up at times."""

from __future__ import annotations

import gc
import logging
from collections.abc import Iterator

import pytest

from bus.codec import Packer
from bus.frame import FrameBatch
from bus.memory import MemoryTransport
from skin.live import Skin
from skin.physics.elastic import Elastic
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.state import State
from tests.fixtures.live import over
from topology import load

resource = pytest.importorskip("resource")
if not hasattr(resource, "RUSAGE_THREAD"):
    pytest.skip("page faults of a thread are counted by Linux alone", allow_module_level=True)

SETTLED, CYCLES, ROUNDS = 700, 500, 3
"""Cycles in which zeros are taken, and two more windows of what is pressed; and those after, which
are looked at some times."""


def touched() -> Skin:
    """A palm in two corners of which something presses, on a bus within the process."""
    palm = load("palm")
    units, truth = UnitSimulator(palm, seed=1), Truth.at_rest(palm.n, 25.0)
    truth.depth_mm[[0, 1, 8, 9, 54, 55, 62, 63]] = 1.0
    truth.contact[:] = truth.depth_mm > 0.0
    truth.force[2] = Elastic(palm).normal(truth.depth_mm)
    packer, laps = Packer(palm), []
    for counter in range(256):
        batch = FrameBatch(len(palm.frames))
        packer(units.counts(truth), batch, sequence=counter)
        laps.append(batch.frames.copy())
    near, far = MemoryTransport.pair()
    far.listener = lambda frames: far.send(laps[int(frames["data"][0, 0])])
    return over(palm, [near], pace=False)


def test_a_settled_loop_leaves_nothing_to_the_collector_and_logs_nothing(caplog):
    with touched() as live, caplog.at_level(logging.DEBUG):
        states = iter(live)
        for _ in range(SETTLED):
            next(states)
        caplog.clear()
        # other threads collect, and a machine short of memory takes pages away: not each time
        found = [_disturbed(states) for _ in range(ROUNDS)]
    assert min(runs for runs, _ in found) == 0
    assert min(faults for _, faults in found) < CYCLES // 20
    assert caplog.records == []


def _disturbed(states: Iterator[State]) -> tuple[int, int]:
    """Runs of the collector and page faults of this thread in some cycles."""
    runs: list[str] = []

    def collects(phase: str, _: dict[str, int]) -> None:
        runs.append(phase)

    gc.collect()
    gc.callbacks.append(collects)
    try:
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        for _ in range(CYCLES):
            state = next(states)
            assert state.contacts
            assert state.units.force.shape == (3, 64)
        return len(runs), resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before
    finally:
        gc.callbacks.remove(collects)
