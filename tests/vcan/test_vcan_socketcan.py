"""The batch transport on real AF_CAN sockets: losses, faults, and the way back from them.

Faults are dictated to a serial adapter (slcan) at the far end of a pseudo-terminal: a real CAN
netdevice with a controller's states, a transmit queue of ten frames, and a bus that we hold.
"""

import contextlib
import fcntl
import os
import pty
import socket
import struct
import subprocess
import termios
import time
import tty

import can
import pytest
from links import ip, make, names

from bus import BusOpenError, FrameBatch
from bus.datagram import enlarge_queue
from bus.frame import CAN_ERR, ECHO, FD_BRS, FD_FDF
from bus.link import can_links, read_link
from bus.open import open_transport
from bus.socketcan import SocketCanTransport
from bus.state import BusState
from bus.wait import Waiter
from tests.bus.transport_contract import CHECKS, PATIENCE_S, numbered, numbers, receive
from tests.fixtures.bus import frame, join
from topology import Bus

N_SLCAN = 17


def on(channel, *, index=0, fd=True, bitrate=1_000_000):
    bus = Bus(
        name="main",
        interface="socketcan",
        channel=channel,
        bitrate=bitrate,
        data_bitrate=5_000_000 if fd else None,
    )
    return open_transport(bus, index)


class Adapter:
    """The far end of a serial CAN adapter: what it reports, and what it is told to send."""

    def __init__(self):
        before = set(os.listdir("/sys/class/net"))
        self.master, self._slave = pty.openpty()
        tty.setraw(self.master)
        tty.setraw(self._slave)
        try:
            fcntl.ioctl(self._slave, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        except OSError as error:
            pytest.skip(f"no slcan here: {error}")
        self.name = (set(os.listdir("/sys/class/net")) - before).pop()
        ip("link", "set", self.name, "up")

    def report(self, line):
        os.write(self.master, line.encode() + b"\r")

    def commands(self, count):
        """Take `count` commands, such as "send this frame", in the adapter's language."""
        text, end = b"", time.monotonic() + PATIENCE_S
        while text.count(b"\r") < count and time.monotonic() < end:
            text += os.read(self.master, 4096)
        return text.decode().split("\r")[:-1]

    def read(self, count):
        """Take `count` frames off the bus, as identifiers."""
        return [int(line[1:4], 16) for line in self.commands(count) if line[0] == "t"]

    def close(self):
        os.close(self._slave)
        os.close(self.master)


@pytest.fixture
def adapter():
    with contextlib.closing(Adapter()) as one:
        yield one


def until(transport, state, batch=None):
    """Receive until the bus is in a state."""
    batch = batch or FrameBatch(64)
    end = time.monotonic() + PATIENCE_S
    while transport.state is not state and time.monotonic() < end:
        transport.receive(batch, 0.05)
        if not batch.room:
            batch.clear()
    assert transport.state is state, list(map(str, transport.changes))


def until_told(transport, state):
    """Receive until a state, which may be over again, has been told of."""
    end = time.monotonic() + PATIENCE_S
    while state not in states(transport) and time.monotonic() < end:
        transport.receive(FrameBatch(64), 0.05)
    assert state in states(transport)


def states(transport):
    return [str(change.state) for change in transport.changes]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_transport_keeps_the_contract(check, link):
    with on(link, index=2) as near, on(link, index=3) as far:
        check(near, far)


def test_frames_of_python_can_and_of_ours_are_the_same(link):
    with can.Bus(interface="socketcan", channel=link, fd=True) as theirs, on(link) as ours:
        theirs.send(can.Message(arbitration_id=0x101, data=b"classic", is_extended_id=False))
        theirs.send(
            can.Message(
                arbitration_id=0x1ABCDE, data=bytes(48), is_fd=True, bitrate_switch=True
            )
        )  # fmt: skip
        heard = receive(ours, 2)
        assert heard["flags"].tolist() == [0, FD_FDF | FD_BRS]
        assert heard["length"].tolist() == [7, 48]
        assert abs(int(heard["stamp_ns"][0]) - time.time_ns()) < 60e9
        assert not heard["origin"].any()
        ours.send(heard)
        first, second = theirs.recv(PATIENCE_S), theirs.recv(PATIENCE_S)
        assert bytes(first.data) == b"classic"
        assert (second.arbitration_id, second.is_fd, second.bitrate_switch, second.dlc) == (
            0x1ABCDE, True, True, 48,
        )  # fmt: skip


def test_an_echo_that_is_asked_for_is_marked(link):
    with on(link) as near, on(link) as far:
        near._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 1)
        near.send(numbered(2))
        far.send(numbered(1, 9))
        assert receive(near, 3)["origin"].tolist() == [ECHO, ECHO, 0]


def test_an_interface_that_goes_down_and_up_is_followed(link):
    with on(link) as near, on(link) as far:
        descriptor = far.fileno()
        near.send(numbered(1))
        receive(far, 1)
        ip("link", "set", link, "down")
        until(far, BusState.DOWN)
        assert near.send(numbered(3)) == 0
        assert near.state is BusState.DOWN
        assert near.counters.send_failures == 3
        assert far.receive(FrameBatch(1), 0.01) == 0
        ip("link", "set", link, "up")
        until(far, BusState.ACTIVE)
        until(near, BusState.ACTIVE)
        near.send(numbered(2, 10))
        assert numbers(receive(far, 2)) == [10, 11]
        assert states(far) == states(near) == ["down", "error-active"]
        assert f"remedy: sudo ip link set {link} mtu 72 up" in far.changes[0].reason
        assert (far.fileno(), far.counters.reopenings) == (descriptor, 0)


def test_an_interface_that_was_down_for_a_moment_is_noticed(link):
    with on(link) as far:
        ip("link", "set", link, "down")
        ip("link", "set", link, "up")
        until_told(far, "down")
        until(far, BusState.ACTIVE)
        assert states(far) == ["down", "error-active"]


def test_an_interface_that_is_unplugged_and_plugged_in_again_is_heard_again(link):
    with on(link, index=5) as far:
        descriptor = far.fileno()
        for round_ in range(1, 3):
            ip("link", "delete", link)
            until(far, BusState.GONE)
            assert far.send(numbered(2)) == 0
            assert far.receive(FrameBatch(1), 0.01) == 0
            make(link, up=False)
            until(far, BusState.DOWN)
            ip("link", "set", link, "up")
            until(far, BusState.ACTIVE)
            with on(link) as near:
                near.send(join(frame(0x100, b"a"), frame(0x333, b"b"), frame(0x101, b"c")))
                near.send(frame(CAN_ERR | 0x4, b"\0\x01"))
                heard = receive(far, 4)
                assert heard["id"].tolist() == [0x100, 0x333, 0x101, CAN_ERR | 0x4]
                assert set(heard["bus"]) == {5}
                assert far.send(numbered(1)) == 1
                assert numbers(receive(near, 1)) == [0]
            assert far.counters.reopenings == round_
        assert far.fileno() == descriptor
        assert states(far).count("gone") == 2
        assert "unplugged or deleted" in str(far.changes[1]) + str(far.changes[0])


def test_an_interface_that_was_away_for_a_moment_is_heard_again(link):
    with on(link) as far:
        ip("link", "delete", link)
        make(link)
        until_told(far, "gone")
        until(far, BusState.ACTIVE)
        assert far.counters.reopenings == 1
        with on(link) as near:
            near.send(numbered(1))
            assert numbers(receive(far, 1)) == [0]


def test_sending_alone_finds_the_way_back_too(link):
    with on(link) as near:
        ip("link", "delete", link)
        assert near.send(numbered(1)) == 0
        assert near.state is BusState.GONE
        make(link)
        end = time.monotonic() + PATIENCE_S
        while near.send(numbered(1)) == 0 and time.monotonic() < end:
            time.sleep(0.01)
        assert near.state is BusState.ACTIVE


def test_one_bus_that_fails_does_not_silence_the_other(link):
    with on(link, index=0) as near0, on("vcan1", index=1) as near1, on("vcan1") as far1:
        waiter, batch = Waiter([near0, near1]), FrameBatch(64)
        ip("link", "delete", link)
        end = time.monotonic() + PATIENCE_S
        while near0.state is not BusState.GONE and time.monotonic() < end:
            waiter.receive(batch, 20_000_000)
        far1.send(numbered(3))
        while batch.count < 3 and time.monotonic() < end:
            waiter.receive(batch, 20_000_000)
        assert numbers(batch.frames) == [0, 1, 2]
        assert set(batch.frames["bus"]) == {1}
        make(link)
        while near0.state is not BusState.ACTIVE and time.monotonic() < end:
            waiter.receive(batch, 20_000_000)
        with on(link) as far0:
            batch.clear()
            far0.send(numbered(1, 7))
            far1.send(numbered(1, 8))
            while batch.count < 2 and time.monotonic() < end:
                waiter.receive(batch, 20_000_000)
        assert sorted(zip(batch.frames["bus"], numbers(batch.frames), strict=True)) == [
            (0, 7),
            (1, 8),
        ]


def test_fd_frames_on_a_classic_interface_are_left_out_and_counted():
    name = next(names)
    make(name, mtu=16)
    try:
        with on(name, fd=False) as near, on(name, fd=False) as far:
            sent = join(numbered(2), frame(0x1, bytes(12), flags=FD_FDF), numbered(1, 2))
            assert near.send(sent) == 3
            assert numbers(receive(far, 3)) == [0, 1, 2]
            assert near.counters.send_failures == 1
    finally:
        ip("link", "delete", name)


def test_the_controller_s_states_reach_the_user(adapter):
    with on(adapter.name, fd=False) as bus:
        for line, state in (
            ("sw100000", BusState.WARNING),
            ("sp130000", BusState.PASSIVE),
            ("sa000000", BusState.ACTIVE),
            ("sw000097", BusState.WARNING),
            ("sb256256", BusState.BUS_OFF),
        ):
            adapter.report(line)
            until(bus, state)
        assert states(bus) == [
            "error-warning", "error-passive", "error-active", "error-warning", "bus-off",
        ]  # fmt: skip
        assert f"remedy: sudo ip link set {adapter.name} type can restart" in str(bus.changes[-1])
        stamps = [change.stamp_ns for change in bus.changes]
        assert stamps == sorted(stamps)
        started = time.monotonic()
        assert bus.send(numbered(20)) < 20, "nothing goes to a bus that is off"
        assert time.monotonic() - started < PATIENCE_S / 2


@pytest.mark.parametrize("way", ["restart", "frames", "down and up"])
def test_a_bus_that_was_off_comes_back(adapter, way):
    with on(adapter.name, fd=False) as bus:
        batch = FrameBatch(8)
        adapter.report("sb256256")
        until(bus, BusState.BUS_OFF)
        if way == "restart":
            adapter.report("sa000000")
        elif way == "frames":
            adapter.report("sa000000")
            adapter.report("t1013112233")
        else:
            ip("link", "set", adapter.name, "down")
            until(bus, BusState.DOWN)
            ip("link", "set", adapter.name, "up")
        until(bus, BusState.ACTIVE, batch)
        adapter.report("t7773445566")
        end = time.monotonic() + PATIENCE_S
        while 0x777 not in batch.frames["id"] and time.monotonic() < end:
            bus.receive(batch, 0.1)
        assert 0x777 in batch.frames["id"]
        assert bus.state is BusState.ACTIVE


def test_a_state_that_a_bus_had_before_is_known_from_the_start(adapter):
    with on(adapter.name, fd=False) as first:
        adapter.report("sp130000")
        until(first, BusState.PASSIVE)
        with on(adapter.name, fd=False) as second:
            assert second.state is BusState.PASSIVE
            assert "state when opened" in str(second.changes[0])


def test_a_change_whose_error_frame_was_lost_is_found_out(adapter):
    with on(adapter.name, fd=False) as bus:
        enlarge_queue(bus._socket, 4096)
        for _ in range(4):
            for i in range(16):
                adapter.report(f"t{i:03x}0")
        end = time.monotonic() + PATIENCE_S
        while not bus.counters.queue_drops and time.monotonic() < end:
            adapter.report("t1000")
        adapter.report("sp130000")
        while read_link(adapter.name).controller is not BusState.PASSIVE:
            time.sleep(0.01)
        assert bus.state is BusState.ACTIVE
        batch = FrameBatch(8)
        while bus.state is BusState.ACTIVE and time.monotonic() < end:
            adapter.report("t1000")
            batch.clear()
            bus.receive(batch, 0.05)
        assert bus.state is BusState.PASSIVE
        assert str(bus.changes[0]).endswith(f"reported by {adapter.name}")


def test_a_full_controller_is_counted(adapter):
    with on(adapter.name, fd=False) as bus:
        adapter.report("e1o")
        receive(bus, 1)
        assert bus.counters.controller_overflows == 1
        assert bus.state is BusState.ACTIVE


def test_an_adapter_that_is_pulled_out_is_gone(adapter):
    with on(adapter.name, fd=False) as bus:
        adapter.close()
        try:
            until(bus, BusState.GONE)
            assert bus.send(numbered(1)) == 0
        finally:
            adapter.master, adapter._slave = pty.openpty()


def said(channel, fd=True, **settings):
    bus = Bus(
        name="main", interface="socketcan", channel=channel,
        data_bitrate=5_000_000 if fd else None, **settings,
    )  # fmt: skip
    with pytest.raises(BusOpenError) as caught:
        SocketCanTransport(bus).close()
    return str(caught.value)


def test_an_interface_that_is_not_there_is_answered_with_those_that_are():
    message = said("vcan00")
    assert message.startswith(
        "bus 'main': channel: must be a CAN interface of this machine; got 'vcan00'; there is "
    )
    assert "vcan0, vcan1" in message
    assert message.endswith("nearest: vcan0")
    assert said("").startswith("bus 'main': channel: must be a CAN interface")
    assert "got 'lo', which is no CAN interface" in said("lo")
    assert [link.name for link in can_links()][:2] == ["vcan0", "vcan1"]


def test_an_interface_that_is_not_ready_is_answered_with_the_command(link):
    ip("link", "set", link, "down")
    assert said(link) == (
        f"bus 'main': {link}: must be up; got down; remedy: sudo ip link set {link} mtu 72 up"
    )
    ip("link", "set", link, "mtu", "16", "up")
    assert said(link) == (
        f"bus 'main': {link}: must be set up for CAN FD (mtu 72); got mtu 16; remedy: "
        f"sudo ip link set {link} down && sudo ip link set {link} mtu 72 up"
    )


def test_a_controller_at_another_bit_rate_is_answered_before_it_disturbs_the_bus(adapter):
    ip("link", "set", adapter.name, "down")
    assert said(adapter.name, fd=False).endswith(
        f"remedy: sudo ip link set {adapter.name} up type can bitrate 1000000 restart-ms 100"
    )
    ip("link", "set", adapter.name, "type", "can", "bitrate", "500000")
    with subprocess.Popen(["ip", "link", "set", adapter.name, "up"]):
        assert adapter.commands(3) == ["C", "S6", "O"]  # the adapter must take what it is told
    assert read_link(adapter.name).bitrate == 500_000
    message = said(adapter.name, fd=False)
    assert message.startswith(f"bus 'main': bitrate: must be 500000 as on {adapter.name}, or ")
    assert "got 1000000; remedy: sudo ip link set" in message
    with on(adapter.name, fd=False, bitrate=500_000):
        pass
