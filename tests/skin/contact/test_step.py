"""What one step returns, and what the detector of slip is given."""

import pytest

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.stream import ContactStream
from skin.errors import SkinError


def row_of(n, **options):
    """A row of units that do not lie side by side."""
    position = naive.grid(1, n)
    return ContactStream(
        position, naive.facing_down(n), 1e-4, *neighbour_graph(position, 0.001),
        **options,
    )  # fmt: skip


def take(stream, now_ns, *load):
    """Identities of the contacts of a cycle, oldest first."""
    stream.readings.force[2], stream.readings.force_sigma[:] = load, 0.01
    stream.step(now_ns)
    return [contact.id for contact in stream.now]


def test_a_step_shows_the_contacts_that_are_there_and_nothing_of_an_early_one():
    stream = row_of(3)
    assert take(stream, -5, 0, 0, 0) == []
    assert take(stream, 10, 1, 0, 0) == [1]
    assert take(stream, 20, 2, 0, 0) == [1]
    assert take(stream, 30, 2, 0, 1) == [1, 2]
    assert take(stream, 31, 1, 0, 2) == [1, 2]
    assert take(stream, 40, 0, 1, 2) == [2, 3]  # one went, another came
    for early in (40, 39, -1):
        before = stream.records.tobytes()
        with pytest.raises(SkinError, match="must be after the last one, 40"):
            take(stream, early, 0, 0, 0)
        assert stream.records.tobytes() == before
    assert take(stream, 41, 0, 1, 2) == [2, 3]
    assert take(stream, 50, 0, 1, 0) == [3]
    assert take(stream, 60, 0, 0, 0) == take(stream, 70, 0, 0, 0) == []


@pytest.mark.parametrize(
    ("want", "kernels"), [((), 1), (("wrench",), 2), (("contacts", "shocks"), 2), (("slip",), 3)]
)
def test_kernels_that_are_not_wanted_are_not_compiled(want, kernels):
    assert len(row_of(2, want=want).calls) == kernels
