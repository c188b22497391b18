"""The fault matrix over real CAN sockets."""

from tests.bus import fault_matrix


def test_socketcan_changes_nothing_in_the_matrix():
    rows = fault_matrix.matrix("socketcan", "vcan0")
    print(fault_matrix.table(rows, "SocketCAN, vcan0"))
    fault_matrix.check(rows)
    assert rows == fault_matrix.matrix("memory", "matrix")
