"""The contract of a transport, and the way from a topology's bus to one."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass

import numpy as np

from bus.clock import ClockModel
from bus.frame import CAN_ERR, FrameBatch
from bus.state import BusChange, BusState, read_error_frame

__all__ = ["Transport", "TransportCounters"]

CHANGES_KEPT = 256
"""Changes of state that a transport remembers; all of them are counted."""


@dataclass
class TransportCounters:
    """What a transport has counted since it was opened."""

    received: int = 0
    """Frames handed to the caller."""
    sent: int = 0
    """Frames given to the interface."""
    send_failures: int = 0
    """Frames that the interface would not take."""
    send_waits: int = 0
    """Times that `send` had to wait for room in the interface's transmit queue."""
    queue_drops: int = 0
    """Frames lost in the interface's or the socket's receive queue."""
    ring_overflows: int = 0
    """Frames lost in a ring of our own, because the caller did not read in time."""
    controller_overflows: int = 0
    """Times that the controller reported its own receive queue full; each lost a frame or more."""
    error_frames: int = 0
    """Error frames of the controller; counted in `received` too."""
    state_changes: int = 0
    """Changes of `Transport.state`."""
    reopenings: int = 0
    """Times that an interface came back after it was gone."""


class Transport(ABC):
    """One end of a CAN bus.

    Every transport keeps this contract, and one set of tests holds all of them to it:

    - frames arrive in the order of the bus, none twice, and a lost one is counted;
    - frames that this end sent itself do not come back;
    - error and remote frames come through with their bits set in `id`;
    - `receive` and `send` may be called from different threads, each from one;
    - every change of the bus's state that the interface tells of is in `changes`.

    Attributes
    ----------
    index : int
        Written to `bus` of every received frame.
    state : BusState
        How the bus is; as it was when last heard of, so `receive` must be called for news.
    changes : deque of BusChange
        The last CHANGES_KEPT changes of `state`, oldest first. The caller may take them out.
    clock : ClockModel or None
        From the interface's own clock to the kernel's, for interfaces that may have one.
    keeps_stamps : bool
        Whether frames arrive with the stamps that their senders gave them: simulated time passes
        through such a bus.
    """

    clock: ClockModel | None = None
    keeps_stamps: bool = False

    def __init__(self, index: int = 0) -> None:
        self.index = index
        self.state = BusState.ACTIVE
        self.changes: deque[BusChange] = deque(maxlen=CHANGES_KEPT)
        self._counters = TransportCounters()
        self._changing = threading.Lock()

    @property
    def counters(self) -> TransportCounters:
        """What has been counted since the transport was opened."""
        return self._counters

    def fileno(self) -> int:
        """Descriptor that `poll` can wait on for frames; -1 where there is none."""
        return -1

    @abstractmethod
    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`, at most as many as fit.

        Waits up to `timeout_s` seconds for the first one; what has arrived by then is taken
        without waiting for more.

        Returns
        -------
        int
            Number of frames appended; 0 after the time-out, or when `state` has changed.

        Raises
        ------
        BusClosedError
            The transport was closed, or its interface is gone.
        """

    @abstractmethod
    def send(self, records: np.ndarray) -> int:
        """Send frames, in order.

        Parameters
        ----------
        records : ndarray, shape (m,), FRAME_DTYPE

        Returns
        -------
        int
            Number of frames taken by the interface; the others are counted in `send_failures`.

        Raises
        ------
        BusClosedError
            The transport was closed, or its interface is gone.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the interface; closing twice is fine."""

    def _enter(self, state: BusState, reason: str, stamp_ns: int = 0) -> None:
        """Set `state`; a state that is new is noted, with the host's time if there is no stamp."""
        with self._changing:
            if state is self.state:
                return
            change = BusChange(stamp_ns or time.time_ns(), self.state, state, reason)
            self.changes.append(change)
            self._counters.state_changes += 1
            self.state = state

    def _hear(self, records: np.ndarray) -> None:
        """Read the error frames among received records, shape (m,), in the order of the bus.

        A controller that is off the bus receives nothing, so that a frame after its error frame
        tells that it is back.
        """
        previous = -1
        for i in np.flatnonzero(records["id"] & CAN_ERR):
            if i > previous + 1:
                self._hear_data(records[previous + 1])
            previous = i
            error = read_error_frame(records[i])
            self._counters.error_frames += 1
            self._counters.controller_overflows += error.is_overflow
            if error.state is not None:
                self._enter(error.state, error.words, int(records["stamp_ns"][i]))
        if previous + 1 < records.size:
            self._hear_data(records[previous + 1])

    def _hear_data(self, record: np.void) -> None:
        if self.state is BusState.BUS_OFF:
            self._enter(BusState.ACTIVE, "frames arrive again", int(record["stamp_ns"]))

    def __enter__(self) -> Transport:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
