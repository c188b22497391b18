"""A grasp on real AF_CAN sockets, decoded by a second process that knows only the topology file."""

import pytest

from tests.fixtures.grasp_served import bus_file, check_decoded, decoded_elsewhere


@pytest.mark.long
def test_another_process_decodes_the_grasp_from_vcan(tmp_path):
    check_decoded(*decoded_elsewhere(bus_file(tmp_path, "socketcan", "vcan0")))
