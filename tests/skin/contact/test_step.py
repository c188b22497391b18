"""What one step returns, and what the detector of slip is given."""

import numpy as np
import pytest

import tests.naive.contact as naive
from skin.contact import step as module
from skin.contact.graph import neighbour_graph
from skin.contact.step import EARLY, SAME, Steps, step
from skin.contact.stream import ContactStream
from tests.fixtures.kernels import interpret_contacts


def row_of(n, **options):
    """A row of units that do not lie side by side."""
    position = naive.grid(1, n)
    return ContactStream(
        position, naive.facing_down(n), 1e-4, *neighbour_graph(position, 0.001), dtype="float64",
        **options,
    )  # fmt: skip


def take(stream, now_ns, *load, kernel=step):
    reading, data = stream.data.reading, stream.data
    reading.force[2], reading.force_sigma[:], data.clock["now_ns"] = load, 0.01, now_ns
    return kernel(stream.model, data)


def test_a_step_says_how_many_contacts_there_are_when_they_are_others():
    stream = row_of(3)
    assert take(stream, -5, 0, 0, 0) == SAME
    assert take(stream, 10, 1, 0, 0) == 1
    assert take(stream, 20, 2, 0, 0) == SAME
    assert take(stream, 30, 2, 0, 1) == 2
    assert take(stream, 31, 1, 0, 2) == SAME
    assert take(stream, 40, 0, 1, 2) == 2  # one went, another came
    for early in (40, 39, -1):
        before = stream.records.tobytes()
        assert take(stream, early, 0, 0, 0) == EARLY
        assert stream.records.tobytes() == before
    assert take(stream, 41, 0, 1, 2) == SAME
    assert take(stream, 50, 0, 1, 0) == 1
    assert take(stream, 60, 0, 0, 0) == 0
    assert take(stream, 70, 0, 0, 0) == SAME


def test_slip_is_told_the_seconds_since_the_cycle_before(monkeypatch):
    told = []
    monkeypatch.setattr(module, "detect_slip", lambda *given: told.append(given[:3]))
    interpret_contacts(monkeypatch)
    stream = row_of(2, want={"slip"})
    steps = Steps.of(stream.model, stream.data)
    for now_ns in (3_000_000, 7_000_000, 13_000_000):
        take(stream, now_ns, 1, 1, kernel=lambda *_: steps())
    counts, seconds, stamps = zip(*told, strict=True)
    assert counts == (2, 2, 2)
    assert seconds == pytest.approx([0.004, 0.004, 0.006])  # the first counts as one period
    assert stamps == (3_000_000, 7_000_000, 13_000_000)
    assert np.isfinite(stream.total.load)


@pytest.mark.parametrize("want", [(), ("wrench",), ("contacts", "shocks")])
def test_where_slip_is_not_wanted_its_kernel_is_not_compiled(want):
    stream = row_of(2, want=want)
    steps = Steps.of(stream.model, stream.data)
    assert steps.slip is None
    take(stream, 1, 1, 1, kernel=lambda *_: steps())
    assert steps.slips[0] == 0


def test_a_stamp_that_is_too_early_detects_no_slip_again(monkeypatch):
    told = []
    monkeypatch.setattr(module, "detect_slip", lambda *given: told.append(given[0]))
    interpret_contacts(monkeypatch)
    stream = row_of(2, want={"slip"})
    steps = Steps.of(stream.model, stream.data)
    for now_ns, load in ((5, 1), (5, 1), (4, 1), (6, 0)):
        take(stream, now_ns, load, 0, kernel=lambda *_: steps())
    assert told == [1]
