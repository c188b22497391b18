"""Logs of the real candump: each way it writes is read as the frames that were sent."""

import shutil
import socket
import struct
import subprocess
import time

import pytest

from bus.frame import FD_FDF
from bus.logs import read_all, write
from tests.fixtures.logs import CANDUMP_FRAMES, CANDUMP_WAYS, check_candump
from tests.fixtures.patience import LONG_S

CLASSIC, FD = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Send all kinds of frames while candump records them in every way."""
    assert shutil.which("candump"), "no candump here: sudo apt-get install can-utils"
    folder = tmp_path_factory.mktemp("recorded")
    recorders = []
    for name, way in CANDUMP_WAYS.items():
        with (folder / f"{name}.log").open("w") as file:
            command = ["candump", "-n", str(len(CANDUMP_FRAMES)), *way, "vcan0,0:0,#FFFFFFFF"]
            recorders.append(subprocess.Popen(command, stdout=file))
    time.sleep(1)
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sender:
        sender.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        sender.bind(("vcan0",))
        for can_id, length, flags, data in CANDUMP_FRAMES:
            if flags:
                sender.send(FD.pack(can_id, length, flags & ~FD_FDF, data))
            else:
                sender.send(CLASSIC.pack(can_id, length, data))
    for recorder in recorders:
        assert recorder.wait(LONG_S) == 0
    return folder


@pytest.mark.parametrize("way", CANDUMP_WAYS)
def test_each_way_of_candump_is_read_as_what_was_sent(way, recorded):
    found = read_all(recorded / f"{way}.log")
    check_candump(found, way)
    assert abs(int(found["stamp_ns"][-1]) - time.time_ns()) < 600e9


@pytest.mark.parametrize("way", ["L", "L-x"])
def test_what_candump_wrote_is_written_again_byte_by_byte(way, recorded, tmp_path):
    copy = tmp_path / "copy.log"
    write(copy, read_all(recorded / f"{way}.log"), channels=["vcan0"], directed=way == "L-x")
    assert copy.read_bytes() == (recorded / f"{way}.log").read_bytes()
