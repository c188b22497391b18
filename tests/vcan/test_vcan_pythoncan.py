"""The adapter of python-can keeps the contract on a real CAN socket too."""

import can
import pytest

from bus.pythoncan import PythonCanTransport
from tests.bus.transport_contract import CHECKS, numbered, numbers, receive
from topology import Bus

BUS = Bus(name="main", interface="socketcan", channel="vcan0", data_bitrate=5_000_000)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_adapter_keeps_the_contract(check):
    with PythonCanTransport(BUS, 2) as near, PythonCanTransport(BUS, 3) as far:
        check(near, far)


def test_the_queue_is_larger_than_the_default_and_frames_of_other_programs_are_no_echo():
    with can.Bus("vcan0", interface="socketcan", fd=True) as plain:
        default = plain.socket.getsockopt(1, 8)  # SOL_SOCKET, SO_RCVBUF
    with PythonCanTransport(BUS) as near, PythonCanTransport(BUS) as far:
        assert far.receive_buffer_bytes > default
        assert far.fileno() >= 0
        near.send(numbered(2000))
        assert numbers(receive(far, 2000)) == list(range(2000))
