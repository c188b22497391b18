"""The batch transport over loopback datagrams, which any kernel has; real CAN is in tests/vcan."""

import contextlib
import errno
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bus import BusClosedError, BusOpenError, FrameBatch, MemoryTransport
from bus.frame import CAN_EFF, CAN_ERR, ECHO, FD_FDF
from bus.linux import SO_RCVBUFFORCE, has_batches
from bus.open import open_transport
from bus.state import BusState, read_error_frame
from bus.wait import Waiter
from tests.bus.transport_contract import CHECKS, numbered, numbers, receive
from tests.fixtures.bus import frame, join
from topology import Bus

if not has_batches():
    pytest.skip("needs a 64-bit Linux", allow_module_level=True)

from bus import socketcan
from bus.datagram import DatagramTransport, enlarge_queue
from bus.link import can_links, read_link
from tests.fixtures.datagram import datagram_pair, sockets


@pytest.fixture
def pair():
    near, far = datagram_pair()
    with near, far:
        yield near, far


@pytest.fixture
def raw():
    """A plain socket and the transport that hears it."""
    plain, far = sockets()
    with plain, DatagramTransport(far, "far", 3) as transport:
        yield plain, transport


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_transport_keeps_the_contract(pair, check):
    check(*pair)


datagrams = st.one_of(
    st.binary(min_size=16, max_size=16), st.binary(min_size=72, max_size=72), st.binary(max_size=99)
)


@given(sent=st.lists(datagrams, min_size=1, max_size=8))
@example(sent=[b"\xff" * 16, b"\xff" * 72, b"", b"\xff" * 99])
def test_a_frame_of_any_content_is_received_within_its_bounds(sent):
    plain, far = sockets()
    with plain, DatagramTransport(far, "far", 200) as transport:
        for one in sent:
            plain.send(one)
        frames = receive(transport, len(sent), capacity=16)
        assert len(frames) == len(sent)
        for record, one in zip(frames, sent, strict=True):
            is_fd = len(one) >= 72
            assert record["length"] <= (64 if is_fd else 8)
            assert bool(record["flags"] & FD_FDF) == is_fd
            assert (record["bus"], record["origin"]) == (200, 0)
            if len(one) >= 16:
                assert record["id"] == int.from_bytes(one[:4], "little")
                payload = one[8:72]
                assert record["data"][: record["length"]].tobytes() == payload[: record["length"]]
        errors = sum(bool(record["id"] & CAN_ERR) for record in frames)
        assert transport.counters.error_frames == errors


def test_what_is_sent_is_left_as_it_was_and_may_be_of_any_layout(pair):
    near, far = pair
    records = numbered(8)
    records["origin"], records["bus"] = ECHO, 7
    records["data"][:, 4:] = 0xEE
    before = records.copy()
    records.flags.writeable = False
    assert near.send(records) == 8
    assert near.send(records[::-2]) == 4
    heard = receive(far, 12)
    assert records.tobytes() == before.tobytes()
    assert numbers(heard) == [*range(8), 7, 5, 3, 1]
    assert set(heard["bus"]) == {3}
    assert not heard["data"][:, 4:8].any()


@pytest.mark.parametrize("unread", [20_000])
def test_delivered_and_dropped_are_all_that_was_sent(unread):
    near, far = datagram_pair(queue_bytes=32_768)
    with near, far:
        sent = near.send(numbered(unread))
        assert sent == unread
        assert far.counters.queue_drops > 0, "counted before anything was read"
        batch = FrameBatch(unread)
        while far.receive(batch):
            pass
        assert batch.count + far.counters.queue_drops == sent
        near.send(numbered(5, unread))
        assert far.receive(batch, 1.0) == 5
        assert batch.count + far.counters.queue_drops == sent + 5
        near.send(numbered(unread))
        far.close()
        assert batch.count + far.counters.queue_drops < sent + 5 + unread
        kept = sent + 5 + unread - batch.count - far.counters.queue_drops
        assert 0 < kept <= far.queue_frames, "what waited when the end was closed"


def test_a_user_without_privileges_gets_what_the_system_allows_all():
    class Unprivileged(socket.socket):
        def setsockopt(self, level, option, value):
            if option == SO_RCVBUFFORCE:
                raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
            super().setsockopt(level, option, value)

    with Unprivileged(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        allowed = int(Path("/proc/sys/net/core/rmem_max").read_text())
        assert enlarge_queue(sock, 1 << 30) == 2 * allowed


def test_a_signal_interrupts_a_waiting_receive(pair):
    class Interrupted(Exception):
        pass

    def interrupt(*_):
        raise Interrupted

    previous = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    try:
        with pytest.raises(Interrupted):
            pair[1].receive(FrameBatch(1), 60.0)
    finally:
        signal.signal(signal.SIGALRM, previous)


def test_the_handler_of_a_signal_may_close_what_its_thread_waits_for(pair):
    previous = signal.signal(signal.SIGALRM, lambda *_: pair[1].close())
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    try:
        with pytest.raises(BusClosedError):
            pair[1].receive(FrameBatch(1), 60.0)
    finally:
        signal.signal(signal.SIGALRM, previous)


@pytest.fixture
def answers(pair, monkeypatch):
    """What the interface answers to `send` in turn: frames it takes, or an errno; then ENOBUFS."""
    near, _ = pair
    real, answers = near._send_many, []

    def send(fd, first, count, words, buffers):
        answer = answers.pop(0) if answers else -errno.ENOBUFS
        if answer > 0:
            return real(fd, first, min(count, answer), words, buffers)
        buffers.report["errno"] = -answer
        return 0

    monkeypatch.setattr(near, "_send_many", send)
    return answers


def test_a_full_transmit_queue_is_waited_for(pair, answers):
    near, far = pair
    near._patience_s = 60.0
    busy = -errno.ENOBUFS
    answers.extend([2, busy, busy, 1, -errno.EINTR, busy, 3])
    assert near.send(numbered(6)) == 6
    assert numbers(receive(far, 6)) == list(range(6))
    assert (near.counters.send_waits, near.counters.send_failures) == (3, 0)


def test_a_stuck_transmitter_is_waited_for_once_until_it_goes_again(pair, answers):
    near, _ = pair
    answers.extend([1])
    assert near.send(numbered(3)) == 1
    waits = near.counters.send_waits
    assert waits > 0
    for _ in range(3):
        assert near.send(numbered(2)) == 0
    assert near.counters.send_waits == waits
    assert near.counters.send_failures == 2 + 6
    near._patience_s = 60.0
    answers.extend([1, -errno.ENOBUFS, 1])
    assert near.send(numbered(2)) == 2
    assert near.counters.send_waits == waits + 1


def test_a_frame_that_cannot_be_sent_does_not_hold_up_the_others(pair, answers):
    near, far = pair
    answers.extend([1, -errno.EINVAL, 2])
    assert near.send(numbered(4)) == 3
    assert numbers(receive(far, 3)) == [0, 2, 3]
    assert near.counters.send_failures == 1


def error_frame(classes, data=b"", stamp_ns=0):
    return frame(CAN_ERR | classes, data, stamp_ns=stamp_ns)


ERRORS = {
    "warning": (0x204, "000400000000 0064", BusState.WARNING),
    "passive": (0x204, "002400000000 0064", BusState.PASSIVE),
    "both": (0x4, "000c", BusState.WARNING),
    "active": (0x204, "0040000000000000", BusState.ACTIVE),
    "bus-off": (0x40, "", BusState.BUS_OFF),
    "restarted": (0x100, "", BusState.ACTIVE),
    "overflow": (0x4, "0001", None),
    "no acknowledgement": (0xA8, "0000000019000000", None),
    "nothing": (0x0, "", None),
    "short": (0x204, "00", None),
}


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_frame_tells_the_state(name):
    classes, data, state = ERRORS[name]
    error = read_error_frame(error_frame(classes, bytes.fromhex(data))[0])
    assert error.state == state
    assert error.is_overflow == (name == "overflow")
    assert error.words


@given(identifier=st.integers(0, CAN_ERR - 1), data=st.binary(max_size=64), extra=st.booleans())
def test_an_error_frame_of_any_content_has_words(identifier, data, extra):
    record = frame(CAN_ERR | identifier | (CAN_EFF if extra else 0), data, flags=FD_FDF)[0]
    assert read_error_frame(record).words


def test_every_change_of_state_reaches_the_user_once(pair):
    near, far = pair
    warning, passive = b"\0\x08\0\0\0\0\x64\0", b"\0\x20\0\0\0\0\x82\0"
    near.send(
        join(
            error_frame(0x204, warning),
            error_frame(0x204, warning),
            numbered(2),
            error_frame(0x204, passive),
            error_frame(0x40),
            error_frame(0x100),
            error_frame(0x40),
            numbered(1, 2),
            error_frame(0x40),
        )
    )
    frames = receive(far, 10)
    assert [change.state for change in far.changes] == [
        "error-warning", "error-passive", "bus-off", "error-active", "bus-off", "error-active",
        "bus-off",
    ]  # fmt: skip
    assert far.state is BusState.BUS_OFF
    assert far.changes[0].previous is BusState.ACTIVE
    assert far.changes[0].stamp_ns == frames["stamp_ns"][0]
    assert far.changes[5].stamp_ns == frames["stamp_ns"][8]
    assert "100 transmit and 0 receive errors" in str(far.changes[0])
    assert far.changes[5].reason == "frames arrive again"
    assert (far.counters.state_changes, far.counters.error_frames) == (7, 7)
    near.send(numbered(1))
    receive(far, 1)
    assert far.state is BusState.ACTIVE


@pytest.fixture(params=["datagram", "memory", "mixed"])
def two_buses(request):
    """Two buses by their far ends, and the near ends as a skin has them."""
    make = {
        "datagram": [datagram_pair, datagram_pair],
        "memory": [MemoryTransport.pair, MemoryTransport.pair],
        "mixed": [MemoryTransport.pair, datagram_pair],
    }
    pairs = [kind() for kind in make[request.param]]
    with contextlib.ExitStack() as stack:
        for pair in pairs:
            for end in pair:
                stack.enter_context(end)
        yield [far for far, _ in pairs], [near for _, near in pairs]


def test_a_waiter_takes_the_frames_of_all_buses(two_buses):
    far, near = two_buses
    waiter, batch = Waiter(near), FrameBatch(64)
    for first in (0, 10, 20):
        for end in far:
            end.send(numbered(5, first))
        while batch.count < 10:
            assert waiter.receive(batch, 20_000_000)
        assert sorted(numbers(batch.frames)) == sorted([*range(first, first + 5)] * 2)
        batch.clear()
    assert waiter.receive(batch, 1_000_000) == 0


@pytest.mark.parametrize("which", [0, 1])
def test_an_event_wakes_the_waiter_whatever_bus_it_comes_on(two_buses, which):
    far, near = two_buses
    batch = FrameBatch(64)
    sender = threading.Timer(0.05, far[which].send, [numbered(1)])
    started = time.monotonic()
    sender.start()
    assert Waiter(near).receive(batch, 60_000_000_000) == 1
    assert time.monotonic() - started < 30
    sender.join()


def test_a_full_batch_starves_no_bus(two_buses):
    far, near = two_buses
    waiter, seen = Waiter(near), set()
    for _ in range(4):
        for end in far:
            end.send(numbered(4))
        batch = FrameBatch(2)
        waiter.receive(batch, 0)
        seen |= {id(near[i]) for i in range(2) if near[i].counters.received}
    assert len(seen) == 2


def test_links_are_read_from_the_kernel():
    lo = read_link("lo")
    assert (lo.name, lo.is_can, lo.controller, lo.bitrate) == ("lo", False, None, None)
    assert lo.index == socket.if_nametoindex("lo")
    assert read_link("no-such-link") is None
    assert read_link("") is None
    assert read_link("a name of more than fifteen") is None
    assert all(link.is_can for link in can_links())


def test_options_are_refused():
    bus = Bus(name="main", interface="socketcan", channel="can0", options={"queue_bytes": 1})
    with pytest.raises(BusOpenError, match="bus 'main': options: must be none for socketcan; got"):
        open_transport(bus)


def test_a_kernel_without_can_is_named(monkeypatch):
    def no_can(*_):
        raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))

    monkeypatch.setattr(socketcan.socket, "socket", no_can)
    with pytest.raises(BusOpenError) as caught:
        open_transport(Bus(name="main", interface="socketcan", channel="can0"))
    assert str(caught.value) == (
        "bus 'main': socketcan can0: this kernel has no CAN; remedy: sudo modprobe can-raw (on the "
        "host, if this is a container), or another interface in the topology, such as 'memory'"
    )
