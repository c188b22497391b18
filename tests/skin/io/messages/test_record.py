"""The record of a cycle, against numpy field by field."""

from __future__ import annotations

import numpy as np
import pytest

import skin
from skin.io.messages.record import RecordWriter, record_dtype
from tests.naive.record import fill


@pytest.mark.parametrize(
    "options", [{}, {"dtype": "float64"}, {"want": {"force"}}, {"want": {"force", "sigma"}}]
)
def test_a_state_stands_in_its_record_as_numpy_would_copy_it(options):
    """The pipeline's own state, and one that has other arrays."""
    how = skin.Options(**options)
    with skin.open("strip", simulate="press", pace=False, options=how) as live:
        kept = next(state for state in live if np.nanmax(state.units.force[2]) > 1.0).copy()
        kept.units.force[:] = 7.0
        kept.whole = False
        dtype = record_dtype(live.topology, 16)
        found, expected = np.zeros(3, dtype), np.zeros((3, 1), dtype)
        writer = RecordWriter(found, live.pipeline, live.transports)
        writer.look()
        for at, state in ((0, live.pipeline.now), (1, kept)):
            writer.state(at, state, lost_cycles=3, lost_frames=5)
            fill(expected[at], state)
    same = set(dtype.names) - {"overruns", "lost_cycles", "lost_frames", "bus_lost", "bus_states"}
    for name in same:
        np.testing.assert_array_equal(found[name], expected[name][:, 0], name)
    assert found[["lost_cycles", "lost_frames", "bus_states"]][0].tolist() == (3, 5, [0])
