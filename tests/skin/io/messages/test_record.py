"""The record of a cycle, against numpy field by field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skin
from skin.io.messages.record import RecordWriter, record_dtype
from tests.naive.record import fill


@pytest.fixture(scope="module")
def run():
    """An open skin, and a state of it with a contact."""
    with skin.open("strip", simulate="press", pace=False) as live:
        yield live, next(one.copy() for one in live if np.nanmax(one.units.force[2]) > 1.0)


def double(state):
    units = state.units
    return replace(state, units=replace(units, force=units.force.astype(float)), whole=False)


def unwanted(state):
    units = replace(state.units, temperature=None, force_sigma=None, test_ratio=None)
    return replace(state, units=units, wrench=None, contacts=None, label=None, whole=None)


@pytest.mark.parametrize("changed", [lambda state: state, double, unwanted])
def test_a_state_stands_in_its_record_as_numpy_would_copy_it(run, changed):
    live, state = run[0], changed(run[1])
    dtype = record_dtype(live.topology, 16)
    found, expected = np.ones(3, dtype), np.zeros(1, dtype)
    writer = RecordWriter(found, live.pipeline, live.transports)
    writer.look()
    writer.state(1, state, lost_cycles=3, lost_frames=5)
    fill(expected, state)
    count = int(expected["contact_count"][0])
    assert found["contacts"][1, :count].tolist() == expected["contacts"][0, :count].tolist()
    for name in {*dtype.names} & {*NAMES}:
        np.testing.assert_array_equal(found[name][1], expected[name][0], name)
    assert found[["lost_cycles", "lost_frames", "bus_states"]][1].tolist() == (3, 5, [0])
    assert found[["cycle", "overruns"]][0].tolist() == (1, 1)  # other records stay


NAMES = ("stamp_ns", "cycle", "whole", "untracked", "contact_count", "counters", "wrench", "force",
         "force_sigma", "temperature", "test_ratio", "contact", "status")  # fmt: skip
