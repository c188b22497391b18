"""The adapter of python-can on a real CAN socket."""

import can

from bus.pythoncan import PythonCanTransport
from tests.bus.transport_contract import numbered, numbers, receive
from topology import Bus


def on(channel, index=0):
    bus = Bus(name="main", interface="socketcan", channel=channel, data_bitrate=5_000_000)
    return PythonCanTransport(bus, index)


def test_the_queue_is_larger_than_the_default_and_frames_of_other_programs_are_no_echo(link):
    with can.Bus(link, interface="socketcan", fd=True) as plain:
        default = plain.socket.getsockopt(1, 8)  # SOL_SOCKET, SO_RCVBUF
    with on(link) as near, on(link) as far:
        assert far._can.socket.getsockopt(1, 8) > default
        assert far.fileno() >= 0
        near.send(numbered(2000))
        assert numbers(receive(far, 2000)) == list(range(2000))
