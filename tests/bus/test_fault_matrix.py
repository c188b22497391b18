"""The fault matrix on the transports of every machine; that on SocketCAN is in tests/vcan."""

import pytest

from tests.bus import fault_matrix


@pytest.fixture(scope="module")
def in_memory():
    return fault_matrix.matrix("memory", "matrix")


def test_every_fault_on_every_layout_is_counted_and_flagged(in_memory):
    print(fault_matrix.table(in_memory, "memory"))
    fault_matrix.check(in_memory)


def test_python_can_changes_nothing_in_the_matrix(in_memory):
    rows = fault_matrix.matrix("virtual", "matrix")
    print(fault_matrix.table(rows, "python-can, virtual"))
    fault_matrix.check(rows)
    assert rows == in_memory
