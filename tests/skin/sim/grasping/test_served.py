"""Frames of a grasp over UDP, decoded by a second process that knows only the topology file."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from tests.fixtures.grasp_served import bus_file, check_decoded, decoded_elsewhere
from tests.fixtures.network import quiet_multicast

GROUP = "239.74.163.2"


@pytest.fixture
def port():
    """A port that nobody else uses; the test is skipped where there is no multicast."""
    with quiet_multicast():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("", 0))
            number = probe.getsockname()[1]
            loopback = socket.inet_aton("127.0.0.1")
            try:
                probe.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
                probe.sendto(b"", (GROUP, number))
            except OSError as error:
                pytest.skip(f"no multicast over the loopback interface of this machine: {error}")
        yield number


@pytest.mark.long
def test_another_process_decodes_the_grasp(tmp_path: Path, port: int) -> None:
    file = bus_file(tmp_path, "udp_multicast", GROUP, f"options = {{ port = {port} }}")
    check_decoded(*decoded_elsewhere(file))
