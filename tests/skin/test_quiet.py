"""A loop that has settled gives the collector nothing to do, touches no fresh memory and logs
nothing: what would hold it up at times."""

from __future__ import annotations

import gc
import logging

import pytest

import skin
from benchmarks.scale_units import on_fewest_buses, simulate
from bus.memory import MemoryTransport
from skin.live import Skin

resource = pytest.importorskip("resource")
if not hasattr(resource, "RUSAGE_THREAD"):
    pytest.skip("page faults of a thread are counted by Linux alone", allow_module_level=True)

SETTLED, CYCLES = 700, 500
"""Cycles in which zeros are taken, and two more windows of what is pressed; and those after."""


def touched() -> Skin:
    """Forty units under three contacts, on a bus within the process."""
    topology = on_fewest_buses(8, 5, 250.0)
    units = simulate(topology)
    near, far = MemoryTransport.pair()
    far.listener = lambda frames: far.send(units.frames[0][int(frames["data"][0, 0])])
    return skin.open(topology, transports=[near], pace=False)


def test_a_settled_loop_leaves_nothing_to_the_collector_and_logs_nothing(caplog):
    runs = []

    def collects(phase, info):
        runs.append((phase, info["generation"]))

    with touched() as live, caplog.at_level(logging.DEBUG):
        states = iter(live)
        for _ in range(SETTLED):
            next(states)
        caplog.clear()
        gc.collect()
        gc.callbacks.append(collects)
        try:
            faults = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
            for _ in range(CYCLES):
                state = next(states)
                assert state.contacts
                assert state.units.force.shape == (3, 40)
            faults = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - faults
        finally:
            gc.callbacks.remove(collects)
    assert runs == []
    assert caplog.records == []
    assert faults < CYCLES // 20
