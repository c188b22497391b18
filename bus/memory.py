"""MemoryTransport: a CAN bus within the process, for simulated units, tests and examples."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from bus.errors import BusClosedError
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.transport import Transport

__all__ = ["MemoryTransport"]


class _Channel:
    """State shared by the endpoints of one bus: their list, and the order of frames."""

    def __init__(self, name: str | None) -> None:
        self.name = name
        self.lock = threading.Lock()
        self.endpoints: list[MemoryTransport] = []

    def closed(self) -> BusClosedError:
        """The error of a closed end."""
        name = "" if self.name is None else f" {self.name!r}"
        return BusClosedError(f"memory bus{name}: closed at this end")


_channels: dict[str, _Channel] = {}
_channels_lock = threading.Lock()


class MemoryTransport(Transport):
    """One end of a bus within this process.

    Every end of a channel receives the frames of all others, in the same order. A frame whose
    `stamp_ns` is 0 gets the time at which it is sent; any other stamp is kept, for simulated time.
    There is no bit rate and no arbitration, and a frame always arrives.

    Parameters
    ----------
    channel : str
        Ends with the same name are on the same bus.
    index : int
        Written to `bus` of every received frame.
    capacity : int
        Capacity of the receive queue. As in a socket's queue, new frames are dropped when it is
        full, and counted in `ring_overflows`.

    Attributes
    ----------
    listener : callable, or None
        Replaces the queue: called with the records (a copy, shape (m,)) in the sender's thread,
        before its `send` returns. It may send in turn, so that simulated units answer a SYNC at
        once and in one thread.
    """

    keeps_stamps = True

    def __init__(self, channel: str, index: int = 0, capacity: int = 8192) -> None:
        super().__init__(index)
        with _channels_lock:
            shared = _channels.setdefault(channel, _Channel(channel))
            self._join(shared, capacity)

    @classmethod
    def pair(cls, index: int = 0, capacity: int = 8192) -> tuple[MemoryTransport, MemoryTransport]:
        """Two ends of a private bus without a name."""
        shared = _Channel(None)
        ends = cls.__new__(cls), cls.__new__(cls)
        for end in ends:
            Transport.__init__(end, index)
            end._join(shared, capacity)
        return ends

    def _join(self, shared: _Channel, capacity: int) -> None:
        self.listener: Callable[[np.ndarray], None] | None = None
        self._channel = shared
        self._ring = np.zeros(capacity, FRAME_DTYPE)
        self._first = self._waiting = 0
        self._arrival = threading.Condition(shared.lock)
        self._closed = False
        with shared.lock:
            shared.endpoints.append(self)

    @property
    def is_alone(self) -> bool:
        """Whether no other end of the bus is open."""
        with self._channel.lock:
            return len(self._channel.endpoints) < 2

    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`; see `Transport.receive`."""
        # The lock itself, not the condition: an exception that a signal raises within
        # Condition.__enter__, which is Python, would leave the lock held for ever.
        with self._channel.lock:
            if not self._waiting and not self._closed and timeout_s > 0 and batch.room:
                self._arrival.wait_for(lambda: self._waiting or self._closed, timeout_s)
            if self._closed:
                raise self._channel.closed()
            if not self._waiting:
                return 0
            straight = min(self._waiting, self._ring.size - self._first)
            taken = batch.extend(self._ring[self._first : self._first + straight])
            if taken == straight:
                taken += batch.extend(self._ring[: self._waiting - straight])
            self._first = (self._first + taken) % self._ring.size
            self._waiting -= taken
        self._counters.received += taken
        self._process_error_frames(batch.records[batch.count - taken : batch.count])
        return taken

    def send(self, records: np.ndarray) -> int:
        """Send frames to all other ends; all are accepted."""
        channel = self._channel
        listeners = []
        stamped = np.array(records, FRAME_DTYPE)
        stamped["stamp_ns"][stamped["stamp_ns"] == 0] = time.time_ns()
        stamped["origin"] = 0
        with channel.lock:
            if self._closed:
                raise channel.closed()
            for end in channel.endpoints:
                if end is self:
                    continue
                if end.listener is not None:
                    listeners.append(end)
                else:
                    end._queue(stamped)
        for end in listeners:
            heard = stamped.copy()
            heard["bus"] = end.index
            listener = end.listener
            if listener is not None:
                listener(heard)
        self._counters.sent += stamped.size
        return stamped.size

    def _queue(self, records: np.ndarray) -> None:
        taken = min(records.size, self._ring.size - self._waiting)
        start = (self._first + self._waiting) % self._ring.size
        straight = min(taken, self._ring.size - start)
        for place, part in ((start, records[:straight]), (0, records[straight:taken])):
            self._ring[place : place + part.size] = part
            self._ring["bus"][place : place + part.size] = self.index
        self._waiting += taken
        self._counters.ring_overflows += records.size - taken
        self._arrival.notify()

    def close(self) -> None:
        """Leave the bus; queued frames are lost, and a waiting `receive` ends."""
        with _channels_lock, self._channel.lock:
            if self._closed:
                return
            self._closed = True
            self._channel.endpoints.remove(self)
            self._arrival.notify_all()
            name = self._channel.name
            if name is not None and not self._channel.endpoints:
                del _channels[name]
