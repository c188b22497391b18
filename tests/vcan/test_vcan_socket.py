"""What the kernel's CAN does, by plain sockets, python-can and can-utils: none of our own code.

These hold the ground that the transports are built on, and tell a fault of ours from one of the
machine's.
"""

import shutil
import socket
import struct
import subprocess
import time
from pathlib import Path

import can
import pytest

CLASSIC = struct.Struct("=IB3x8s")
FD = struct.Struct("=IBB2x64s")
BRS, FDF = 1, 4
ERROR_FRAME, BUS_OFF = 0x2000_0000, 0x40
CAN_RAW_ERR_FILTER = 2  # a name that the socket module of some builds lacks


@pytest.fixture
def connect():
    """Open raw CAN FD sockets on an interface; they close with the test."""
    sockets = []

    def connect(name):
        one = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        sockets.append(one)
        one.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        one.settimeout(10)
        one.bind((name,))
        return one

    yield connect
    for one in sockets:
        one.close()


def run(program, *arguments):
    """Find a can-utils program by name and run it to its end."""
    assert shutil.which(program), f"no {program} here: sudo apt-get install can-utils"
    return subprocess.run([program, *arguments], check=True, capture_output=True, timeout=30)


@pytest.mark.parametrize("length", range(9))
def test_a_classic_frame_arrives_as_sent(connect, length, link):
    sender, receiver = connect(link), connect(link)
    sent = CLASSIC.pack(0x100 + length, length, bytes(range(1, length + 1)))
    sender.send(sent)
    assert receiver.recv(FD.size) == sent


@pytest.mark.parametrize("length", [0, 8, 12, 16, 20, 24, 32, 48, 64])
def test_an_fd_frame_arrives_as_sent(connect, length, link):
    sender, receiver = connect(link), connect(link)
    data = bytes(range(1, length + 1)).ljust(64, b"\0")
    sender.send(FD.pack(0x123, length, BRS, data))
    received = receiver.recv(FD.size + 1)
    assert len(received) == FD.size
    can_id, got, flags, payload = FD.unpack(received)
    assert (can_id, got, payload) == (0x123, length, data)
    assert flags & ~FDF == BRS  # FDF is the kernel's to set, and only newer ones do


def test_a_sender_does_not_hear_itself_but_a_neighbour_socket_does(connect, link):
    sender, receiver = connect(link), connect(link)
    sender.send(CLASSIC.pack(0x101, 1, b"\1"))
    receiver.recv(FD.size)
    sender.setblocking(False)
    with pytest.raises(BlockingIOError):
        sender.recv(FD.size)


def test_a_bus_does_not_hear_the_other(connect, link):
    other, receiver = connect("vcan1"), connect(link)
    sender = connect(link)
    other.send(CLASSIC.pack(0x101, 1, b"\1"))
    sender.send(CLASSIC.pack(0x102, 1, b"\2"))
    assert CLASSIC.unpack(receiver.recv(FD.size))[0] == 0x102


def test_an_error_frame_reaches_only_who_asked_for_errors(connect, link):
    sender, plain, asking = connect(link), connect(link), connect(link)
    asking.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, BUS_OFF)
    sender.send(CLASSIC.pack(ERROR_FRAME | BUS_OFF, 8, bytes(8)))
    sender.send(CLASSIC.pack(0x100, 1, b"\1"))
    assert CLASSIC.unpack(plain.recv(FD.size))[0] == 0x100
    assert CLASSIC.unpack(asking.recv(FD.size))[0] == ERROR_FRAME | BUS_OFF


@pytest.mark.parametrize(
    ("text", "data", "is_fd", "is_brs"),
    [
        ("100#0102030405060708", bytes(range(1, 9)), False, False),
        ("100#", b"", False, False),
        ("6FF##1" + bytes(range(64)).hex(), bytes(range(64)), True, True),
        ("080##0" + "AB" * 16, b"\xab" * 16, True, False),
    ],
    ids=["classic", "empty", "fd-brs", "fd"],
)
def test_what_cansend_sends_arrives_at_python_can(text, data, is_fd, is_brs, link):
    with can.Bus(interface="socketcan", channel=link, fd=True) as bus:
        run("cansend", link, text)
        message = bus.recv(10)
    assert message is not None
    assert message.arbitration_id == int(text[:3], 16)
    assert (bytes(message.data), message.is_fd, message.bitrate_switch) == (data, is_fd, is_brs)
    assert not message.is_error_frame


def test_candump_records_what_is_sent(connect, link):
    sender = connect(link)
    assert shutil.which("candump"), "no candump here: sudo apt-get install can-utils"
    command = ["candump", "-L", "-n", "3", link]
    listeners = _listeners(link)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as candump:
        try:
            _wait_until(lambda: _listeners(link) > listeners)
            sender.send(CLASSIC.pack(0x100, 8, bytes(range(8))))
            sender.send(CLASSIC.pack(0x7E0, 0, b""))
            sender.send(FD.pack(0x6FF, 12, BRS, bytes(range(12)).ljust(64, b"\0")))
            recorded, _ = candump.communicate(timeout=30)
        finally:
            candump.kill()
    stamps, names, frames = zip(*(line.split() for line in recorded.splitlines()), strict=True)
    assert list(stamps) == sorted(stamps)
    assert set(names) == {link}
    assert frames[:2] == ("100#0001020304050607", "7E0#")
    head, payload = frames[2].split("##")
    assert (head, int(payload[0], 16) & ~FDF) == ("6FF", BRS)
    assert bytes.fromhex(payload[1:]) == bytes(range(12))


def _listeners(name):
    """Count the kernel's receivers of every frame of an interface."""
    lines = Path("/proc/net/can/rcvlist_all").read_text().splitlines()
    return sum(line.split()[:1] == [name] for line in lines)


def _wait_until(is_true):
    for _ in range(1000):
        if is_true():
            return
        time.sleep(0.01)
    pytest.fail("waited for ten seconds in vain")
