"""A bus of two ends over the loopback interface, for kernels that have no CAN."""

import socket

from bus.datagram import DatagramTransport


def sockets():
    """Make two connected datagram sockets."""
    ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for end in ends:
        end.bind(("127.0.0.1", 0))
    for end, other in zip(ends, reversed(ends), strict=True):
        end.connect(other.getsockname())
    return ends


def datagram_pair(**options):
    """Make two transports, each hearing the other; the second has index 3."""
    near, far = sockets()
    return (
        DatagramTransport(near, "near", 2, **options),
        DatagramTransport(far, "far", 3, **options),
    )
