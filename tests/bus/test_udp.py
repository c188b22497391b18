"""CAN over UDP multicast on this host: own frames do not come back, those of others all come.

Nothing leaves the machine: see tests/fixtures/network.py.
"""

import socket
import subprocess
import sys

import pytest

from bus import BusOpenError, FrameBatch
from bus.pythoncan import PythonCanTransport
from tests.bus import transport_contract
from tests.bus.transport_contract import CHECKS, numbered, numbers, receive
from tests.fixtures.network import quiet_multicast
from topology import Bus

GROUP = "239.74.163.2"
LOOPBACK = socket.inet_aton("127.0.0.1")


@pytest.fixture(autouse=True)
def quiet():
    with quiet_multicast():
        yield


@pytest.fixture
def port():
    """A port that nobody else uses; the test is skipped where there is no multicast."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        number = probe.getsockname()[1]
        try:
            probe.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, LOOPBACK)
            probe.sendto(b"", (GROUP, number))
        except OSError as error:
            pytest.skip(f"no multicast over the loopback interface of this machine: {error}")
    return number


def open_end(port, index=0, group=GROUP):
    bus = Bus(
        name="air", interface="udp_multicast", channel=group, data_bitrate=5_000_000,
        options={"port": port},
    )  # fmt: skip
    return PythonCanTransport(bus, index)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_transport_keeps_the_contract(check, port):
    with open_end(port, 1) as near, open_end(port, 3) as far:
        if check is transport_contract.check_every_kind_of_frame:
            check(near, far, fd=True)
        else:
            check(near, far)


OTHER = """
import sys
from bus import FrameBatch
from tests.bus.transport_contract import numbers, numbered, receive
from tests.bus.test_udp import open_end
from tests.fixtures.network import is_permitted, over_loopback
from contextlib import nullcontext

# where a network namespace is permitted, this process has that of its parent
with nullcontext() if is_permitted() else over_loopback(), open_end(int(sys.argv[1])) as end:
    end.send(numbered(1, 255))
    heard = receive(end, 40)
    end.send(numbered(40, 100))
    assert end.receive(FrameBatch(1), 0.1) == 0
    print(numbers(heard))
"""


def test_two_processes_hear_each_other_and_not_themselves(port):
    with open_end(port) as end:
        command = [sys.executable, "-c", OTHER, str(port)]
        environment = {"PYTHONPATH": ":".join(filter(None, sys.path))}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as other:
            assert numbers(receive(end, 1)) == [255], "it is there"
            assert end.send(numbered(40)) == 40
            assert numbers(receive(end, 40)) == list(range(100, 140))
            assert end.receive(FrameBatch(1), 0.1) == 0
            assert other.stdout.read().strip() == str(list(range(40)))
        assert other.returncode == 0
        assert end.counters.received == 41


def test_the_channel_must_be_a_group():
    with pytest.raises(BusOpenError, match=r"a multicast group as the channel, such as 239\.74"):
        PythonCanTransport(Bus(name="air", interface="udp_multicast", channel="vcan0"))
