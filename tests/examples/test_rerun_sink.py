"""The rerun sink of the examples, on a module that notes what it is given."""

from __future__ import annotations

import importlib.util
import itertools
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import skin

EXAMPLE = Path(__file__).parents[2] / "examples" / "rerun_sink.py"


class Stream:
    """In place of `rerun.RecordingStream`."""

    def __init__(self, application_id):
        self.calls, self.logged, self.time = [application_id], [], None

    def save(self, file):
        self.calls.append(("save", file))

    def set_time(self, timeline, *, timestamp):
        self.time = timeline, timestamp

    def log(self, path, what):
        self.logged.append((self.time, path, what))

    def flush(self):
        self.calls.append("flush")

    def disconnect(self):
        self.calls.append("disconnect")


@pytest.fixture
def example(monkeypatch):
    """The example's module."""
    stub = ModuleType("rerun")
    stub.RecordingStream = Stream
    for name in ("Points3D", "Arrows3D", "Scalars"):
        setattr(stub, name, lambda *given, **named: SimpleNamespace(given=given, **named))
    monkeypatch.setitem(sys.modules, "rerun", stub)
    spec = importlib.util.spec_from_file_location("rerun_sink", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_cycle_is_logged_at_its_time(example):
    with skin.open("strip", simulate="press", pace=False) as strip:
        sink = strip.attach(example.RerunSink(strip.topology, "run.rrd"))
        states = list(itertools.islice(strip, 300))
        at = strip.topology
    assert strip.sinks == [(sink, 0, None)]
    assert sink.stream.calls == ["f3t-skin", ("save", "run.rrd"), "flush", "disconnect"]
    paths = ["skin/units", "skin/forces", "skin/contacts", "force"]
    assert [path for _, path, _ in sink.stream.logged] == paths * len(states)
    assert any(state.contacts for state in states)
    for number, state in enumerate(states):
        logged = sink.stream.logged[4 * number : 4 * number + 4]
        units, forces, contacts, total = (what for _, _, what in logged)
        assert {time for time, _, _ in logged} == {("cycle", np.datetime64(state.stamp_ns, "ns"))}
        np.testing.assert_array_equal(units.given[0], at.position.T[state.units.valid])
        for k, i in enumerate(np.flatnonzero(state.units.valid)):
            newton = at.rotation[:, :, i] @ state.units.force[:, i]
            np.testing.assert_allclose(forces.vectors[k], 0.01 * newton, atol=1e-9)
        assert len(contacts.given[0]) == len(contacts.labels) == len(state.contacts)
        np.testing.assert_array_equal(total.given[0], state.wrench[:3])
