"""The contract of a transport, as checks that every transport's tests run on pairs of its ends."""

import threading
import time

import numpy as np

from bus import BusClosedError, FrameBatch
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FD_BRS, FD_ESI, FD_FDF
from tests.fixtures.bus import frame, join

PATIENCE_S = 60.0


def numbered(count, first=0, can_id=0x123):
    """Make classic frames whose payload counts on from `first`."""
    return join(*(frame(can_id, (first + i).to_bytes(4, "little")) for i in range(count)))


def numbers(frames):
    """Read the payloads of `numbered` back."""
    return [int.from_bytes(record["data"][:4].tobytes(), "little") for record in frames]


def receive(end, count, capacity=4096):
    """Receive until `count` frames have come; fail after a long while."""
    batch = FrameBatch(capacity)
    until = time.monotonic() + PATIENCE_S
    while batch.count < count and time.monotonic() < until:
        end.receive(batch, PATIENCE_S / 10)
    return batch.frames


def content(records):
    """Everything of a frame but stamp and origin: identifier, length, flags, bus, bytes."""
    return [
        (
            int(record["id"]),
            int(record["length"]),
            int(record["flags"]),
            record["data"][: 0 if record["id"] & CAN_RTR else record["length"]].tobytes(),
        )
        for record in records
    ]


def check_order_and_number(near, far):
    """Frames arrive in the order they were sent, none twice, none missing."""
    for first in range(0, 200, 50):
        assert near.send(numbered(50, first)) == 50
    assert numbers(receive(far, 200)) == list(range(200))
    assert far.receive(FrameBatch(4)) == 0
    assert (near.counters.sent, far.counters.received) == (200, 200)


def check_every_kind_of_frame(near, far, *, fd=True, error=True):
    """Identifier, length, flags and bytes come through, remote and error frames with their bits."""
    sent = [
        frame(0x7FF, b"\x01"),
        frame(0x000, b""),
        frame(CAN_EFF | 0x1FFF_FFFF, bytes(range(8))),
        frame(CAN_EFF | 0x7F, b"short id, 29 bits"[:8]),
        frame(CAN_RTR | 0x123, b"\0\0\0"),
    ]
    if fd:
        sent += [
            frame(0x111, bytes(range(64)), flags=FD_FDF | FD_BRS),
            frame(0x112, bytes(range(12)), flags=FD_FDF | FD_ESI),
            frame(CAN_EFF | 0x113, b"", flags=FD_FDF),
        ]
    if error:
        sent += [frame(CAN_ERR | 0x004, b"\0\1\0\0\0\0\0\0")]
    assert near.send(join(*sent)) == len(sent)
    assert content(receive(far, len(sent))) == content(join(*sent))


def check_no_echo(near, far):
    """Frames that this end sent itself do not come back."""
    near.send(numbered(3))
    far.send(numbered(2, 100))
    assert numbers(receive(near, 2)) == [100, 101]
    assert numbers(receive(far, 3)) == [0, 1, 2]
    assert near.receive(FrameBatch(4), 0.05) == 0


def check_bus_index_and_stamp(near, far):
    """Every frame carries the index of its end, and the time at which it came."""
    before = time.time_ns()
    near.send(numbered(3))
    frames = receive(far, 3)
    after = time.time_ns()
    assert set(frames["bus"]) == {far.index}
    assert set(frames["origin"]) == {0}
    slack = 1_000_000_000  # the clocks of user and kernel may disagree, and stamps may be floats
    assert all(before - slack <= stamp <= after + slack for stamp in frames["stamp_ns"])
    assert all(np.diff(frames["stamp_ns"]) >= 0)


def check_small_batches(near, far):
    """A batch takes at most what fits; the rest waits for the next one."""
    near.send(numbered(10))
    batch = FrameBatch(4)
    came = []
    until = time.monotonic() + PATIENCE_S
    while len(came) < 10 and time.monotonic() < until:
        taken = far.receive(batch, PATIENCE_S / 10)
        assert taken == batch.count <= 4
        came += numbers(batch.frames)
        batch.clear()
    assert came == list(range(10))


def check_append(near, far):
    """Frames are appended after those that a batch holds already; a full batch takes none."""
    batch = FrameBatch(3)
    batch.append(0x55, b"first")
    near.send(numbered(3))
    until = time.monotonic() + PATIENCE_S
    while batch.room and time.monotonic() < until:
        far.receive(batch, PATIENCE_S / 10)
    assert content(batch.frames[:1]) == [(0x55, 5, 0, b"first")]
    assert numbers(batch.frames[1:]) == [0, 1]
    assert far.receive(batch, PATIENCE_S) == 0
    batch.clear()
    assert far.receive(batch, PATIENCE_S) == 1
    assert numbers(batch.frames) == [2]


def check_time_out(near, far):
    """`receive` waits as long as asked when nothing comes, and no longer when something does."""
    started = time.monotonic()
    assert far.receive(FrameBatch(1), 0.05) == 0
    assert time.monotonic() - started >= 0.04
    sender = threading.Timer(0.05, near.send, [numbered(1)])
    sender.start()
    started = time.monotonic()
    assert far.receive(FrameBatch(1), 6 * PATIENCE_S) == 1
    assert time.monotonic() - started < 3 * PATIENCE_S
    sender.join()


def check_sending_while_receiving(near, far):
    """One thread may send while another receives, at both ends."""
    came = {}

    def collect(name, end):
        came[name] = numbers(receive(end, 300))

    threads = [threading.Thread(target=collect, args=pair) for pair in (("n", near), ("f", far))]
    for thread in threads:
        thread.start()
    for first in range(0, 300, 10):
        near.send(numbered(10, first))
        far.send(numbered(10, first))
    for thread in threads:
        thread.join()
    assert came == {"n": list(range(300)), "f": list(range(300))}


def check_close(near, far):
    """A closed end says so; closing twice is fine; the other end lives on."""
    far.close()
    far.close()
    for use in (lambda: far.receive(FrameBatch(1)), lambda: far.send(numbered(1))):
        try:
            use()
        except BusClosedError:
            continue
        raise AssertionError("a closed transport must raise BusClosedError")
    assert near.send(numbered(1)) == 1
    assert near.receive(FrameBatch(1)) == 0


def check_close_ends_a_wait(near, far):
    """A thread that waits in `receive` hears that its end was closed."""
    outcome = []

    def wait():
        try:
            outcome.append(far.receive(FrameBatch(1), 6 * PATIENCE_S))
        except BusClosedError as error:
            outcome.append(error)

    thread = threading.Thread(target=wait)
    started = time.monotonic()
    thread.start()
    time.sleep(0.01)  # so that it waits already, most of the time
    far.close()
    thread.join()
    assert time.monotonic() - started < 3 * PATIENCE_S
    assert isinstance(outcome[0], BusClosedError)
    assert near.receive(FrameBatch(1)) == 0


def check_nothing_to_send(near, far):
    """An empty array is sent at once."""
    assert near.send(numbered(1)[:0]) == 0
    assert far.receive(FrameBatch(1), 0.01) == 0


CHECKS = (
    check_order_and_number,
    check_every_kind_of_frame,
    check_no_echo,
    check_bus_index_and_stamp,
    check_small_batches,
    check_append,
    check_time_out,
    check_sending_while_receiving,
    check_close,
    check_close_ends_a_wait,
    check_nothing_to_send,
)
