"""DatagramTransport: frames between a datagram socket and batches, many per system call."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time

import numpy as np

from bus import mmsg
from bus.clock import SEGMENT_NS, ClockModel
from bus.compiled.jit import direct
from bus.errors import BusClosedError
from bus.frame import FRAME_DTYPE, FrameBatch, as_words
from bus.linux import (
    RAW_HARDWARE,
    RX_HARDWARE,
    SO_MEMINFO,
    SO_RCVBUFFORCE,
    SO_RXQ_OVFL,
    SO_TIMESTAMPING,
    SO_TIMESTAMPNS,
)
from bus.state import BusState
from bus.transport import Transport, TransportCounters

__all__ = ["DatagramTransport", "enlarge_queue"]

_DROPS_IN_MEMINFO = 8
_FRAME_CHARGE = 768
"""Receive buffer that the kernel charges per frame, of any length."""

QUEUE_BYTES = 8 << 20
"""Requested receive buffer; the kernel doubles it. 20 000 frames, two seconds of a full bus."""
PATIENCE_S = 0.01
"""Longest wait of `send` for room in the transmit queue, after which it does not wait again until a
frame is accepted; ten frames of a full 1 Mbit/s bus go in 1.4 ms."""
_RETRY_S = 0.0002
_BUSY = (errno.ENOBUFS, errno.EAGAIN, errno.ENOMEM)
_UNSENDABLE = (errno.EINVAL, errno.EMSGSIZE)
_LOOK_NS = 50_000_000


class DatagramTransport(Transport):
    """Frames over a socket whose datagrams are `struct can_frame` or `struct canfd_frame`.

    `SocketCanTransport` is one; a pair of connected UDP sockets replaces a bus on kernels without
    CAN.

    Parameters
    ----------
    sock : socket
        Open and bound; closed with the transport.
    name : str
        For messages: bus, interface, channel.
    index : int
        Written to `bus` of every received frame.
    queue_bytes : int
        Requested receive buffer.

    Attributes
    ----------
    queue_frames : int
        Frames that fit into the granted receive buffer.
    clock : ClockModel
        From the interface's own clock to the kernel's, where the driver stamps frames; frames then
        have these stamps, which do not contain delays of the host.
    """

    def __init__(
        self,
        sock: socket.socket,
        name: str,
        index: int = 0,
        *,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        super().__init__(index)
        self.name = name
        self._socket = sock
        self._fd = sock.fileno()
        self._receive_many, self._send_many = direct(mmsg.receive), direct(mmsg.send)
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, RX_HARDWARE | RAW_HARDWARE)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        self.queue_frames = enlarge_queue(sock, queue_bytes) // _FRAME_CHARGE
        self._patience_s = PATIENCE_S
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._polled = mmsg.pollfds(self._fd, self._wake)
        self._incoming, self._outgoing = mmsg.new_buffers(), mmsg.new_buffers()
        self.clock = self._own_clock = ClockModel()
        self._stamped = self._incoming.clock["count"]
        self._learned_ns = 0
        # Re-entrant, so that a signal handler may close the transport on which its thread waits.
        self._receiving, self._sending = threading.RLock(), threading.RLock()
        self._records = np.zeros(0, FRAME_DTYPE)
        self._words = as_words(self._records)
        self._drops_seen = self._drops_heard = 0
        self._dropping = threading.RLock()
        self._is_stuck = self._is_closed = False
        self._looked_ns = 0

    @property
    def counters(self) -> TransportCounters:
        """Counters so far; drops are the kernel's current count."""
        with self._dropping:
            if not self._is_closed:
                size = 4 * (_DROPS_IN_MEMINFO + 1)
                memory = self._socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, size)
                self._count_drops(int.from_bytes(memory[-4:], "little"))
        return self._counters

    def fileno(self) -> int:
        """Descriptor for `poll`; it is constant until the transport is closed."""
        return self._fd

    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`; see `Transport.receive`.

        The kernel writes into the batch. Returns early, with 0, when the state of the bus changes.
        """
        with self._receiving:
            left_ns = int(min(timeout_s, 1e9) * 1e9)
            until = time.monotonic_ns() + left_ns if left_ns > 0 else 0
            while not self._is_closed:
                before = self._counters.state_changes
                is_troubled = self.state is not BusState.ACTIVE
                taken = self._receive(batch, min(left_ns, _LOOK_NS) if is_troubled else left_ns)
                if is_troubled:
                    self._poll_link_state()
                if taken or not batch.room or until == 0:
                    return taken
                left_ns = until - time.monotonic_ns()
                if left_ns <= 0 or self._counters.state_changes != before:
                    return 0
        raise self._closed()

    def _receive(self, batch: FrameBatch, wait_ns: int) -> int:
        if batch.records is not self._records:
            self._records, self._words = batch.records, as_words(batch.records)
        into, first = self._incoming, batch.count
        taken = self._receive_many(
            self._fd, self._polled, wait_ns, first, batch.room, self.index, self._words, into
        )
        drops, failure, errors = into.report.item()
        batch.count = first + taken
        self._counters.received += taken
        if self._stamped[0]:
            self._learn_clock()
        if drops != self._drops_heard:
            self._drops_heard = drops
            with self._dropping:
                self._count_drops(drops)
            self._poll_link_state()  # an error frame may be among the lost ones
        if errors or self.state is BusState.BUS_OFF:
            self._process_error_frames(batch.records[first : batch.count])
        if failure:
            self._fail(failure)
        return taken

    def _learn_clock(self) -> None:
        """Pass the pair of stamps to the clock model, once a segment is over."""
        now_ns = time.monotonic_ns()
        if now_ns - self._learned_ns < SEGMENT_NS:
            return
        self._learned_ns = now_ns
        seen, clock = self._incoming.clock[0], self._own_clock
        clock.learn(int(seen["stamp"]), int(seen["late"]))
        seen["origin"], seen["offset"], seen["drift"] = (
            clock.origin_ns,
            clock.offset_ns,
            clock.drift,
        )
        seen["is_mapped"], seen["count"] = clock.ready, 0

    def send(self, records: np.ndarray) -> int:
        """Send frames, in order; see `Transport.send`.

        Waits for room in the transmit queue (ENOBUFS) while frames are accepted. A frame that the
        interface cannot carry, such as CAN FD on a classic bus, is counted and dropped.
        """
        words = as_words(np.ascontiguousarray(records, FRAME_DTYPE))
        total, at, sent, waiting_since = len(words), 0, 0, 0.0
        out = self._outgoing
        with self._sending:
            while at < total and not self._is_closed:
                taken = self._send_many(self._fd, at, total - at, words, out)
                at += taken
                sent += taken
                failure = int(out.report["errno"][0])
                if taken:
                    self._is_stuck, waiting_since = False, 0.0
                elif failure in _BUSY:
                    now = time.monotonic()
                    waiting_since = waiting_since or now
                    self._is_stuck |= now - waiting_since >= self._patience_s
                    if self._is_stuck or self.state is BusState.BUS_OFF:
                        break
                    self._counters.send_waits += 1
                    time.sleep(_RETRY_S)
                elif failure in _UNSENDABLE:
                    at += 1
                elif failure != errno.EINTR:
                    self._fail(failure)
                    break
            self._counters.sent += sent
            self._counters.send_failures += total - sent
            if self._is_closed:
                raise self._closed()
            if self.state is not BusState.ACTIVE:
                self._poll_link_state()
        return sent

    def close(self) -> None:
        """Close the socket; may be called twice; a waiting `receive` ends."""
        _ = self.counters  # the kernel's last count of drops
        with self._dropping:
            if self._is_closed:
                return
            self._is_closed = True
        os.eventfd_write(self._wake, 1)
        with self._receiving, self._sending, self._dropping:
            self._socket.close()
            os.close(self._wake)
            self._fd = -1

    def _closed(self) -> BusClosedError:
        return BusClosedError(f"{self.name}: closed at this end")

    def _count_drops(self, total: int) -> None:
        # A frame has the count of its arrival, which may be older than the last one read.
        fresh = (total - self._drops_seen) & 0xFFFF_FFFF
        if fresh < 1 << 31:
            self._counters.queue_drops += fresh
            self._drops_seen = total

    def _fail(self, number: int) -> None:
        """Handle an error of the socket; on a plain socket frames are just refused."""

    def _poll_link_state(self) -> None:
        """Check the interface, at most every _LOOK_NS."""
        now = time.monotonic_ns()
        if now - self._looked_ns >= _LOOK_NS:
            self._looked_ns = now
            self._look()

    def _look(self) -> None:
        """Update `state` from the interface; a plain socket has none."""


def enlarge_queue(sock: socket.socket, wanted: int) -> int:
    """Set the receive buffer to `wanted` bytes or the limit; returns the actual size."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, wanted)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted)
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
