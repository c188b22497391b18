"""The interface of a transport."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bus.clock import ClockModel
from bus.frame import CAN_ERR, FrameBatch
from bus.state import BusChange, BusState, read_error_frame

__all__ = ["Transport", "TransportCounters"]

CHANGES_KEPT = 256
"""Stored changes of state; all of them are counted."""


@dataclass
class TransportCounters:
    """Counters of a transport since it was opened."""

    received: int = 0
    """Frames received."""
    sent: int = 0
    """Frames accepted by the interface."""
    send_failures: int = 0
    """Frames refused by the interface."""
    send_waits: int = 0
    """Waits of `send` for room in the interface's transmit queue."""
    queue_drops: int = 0
    """Frames lost in the interface's or the socket's receive queue."""
    ring_overflows: int = 0
    """Frames lost in a ring buffer of this process, because they were not read in time."""
    controller_overflows: int = 0
    """Reports of a full receive queue in the controller; each lost a frame or more."""
    error_frames: int = 0
    """Error frames of the controller; counted in `received` too."""
    state_changes: int = 0
    """Changes of `Transport.state`."""
    reopenings: int = 0
    """Times that an interface came back after it was gone."""


class Transport(ABC):
    """One end of a CAN bus.

    Every transport has these properties, which one set of tests checks:

    - frames arrive in the order of the bus, none twice, and a lost one is counted;
    - frames that this end sent itself do not come back;
    - error and remote frames come through with their bits set in `id`;
    - `receive` and `send` may be called from different threads, each from one;
    - every change of the bus's state that the interface reports is in `changes`.

    Attributes
    ----------
    index : int
        Written to `bus` of every received frame.
    state : BusState
        State of the bus as last reported, so `receive` must be called for news.
    changes : deque of BusChange
        The last CHANGES_KEPT changes of `state`, oldest first. The caller may remove them.
    clock : ClockModel or None
        From the interface's own clock to the kernel's, for interfaces that may have one.
    stamped_by : str
        What stamps frames otherwise: "kernel", or "host", when they are read.
    keeps_stamps : bool
        Whether frames arrive with the stamps of their senders: such a bus carries simulated time.
    """

    clock: ClockModel | None = None
    stamped_by: Literal["kernel", "host"] = "kernel"
    keeps_stamps: bool = False

    def __init__(self, index: int = 0) -> None:
        self.index = index
        self.state = BusState.ACTIVE
        self.changes: deque[BusChange] = deque(maxlen=CHANGES_KEPT)
        self._counters = TransportCounters()
        self._changing = threading.Lock()

    @property
    def counters(self) -> TransportCounters:
        """Counters since the transport was opened."""
        return self._counters

    def fileno(self) -> int:
        """Descriptor for `poll`; -1 if there is none."""
        return -1

    @abstractmethod
    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`, at most as many as fit.

        Waits up to `timeout_s` seconds for the first one; further ones are taken without waiting.

        Returns
        -------
        int
            Number of frames appended; 0 after the timeout, or when `state` has changed.

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
            Number of frames accepted by the interface; the others are counted in `send_failures`.

        Raises
        ------
        BusClosedError
            The transport was closed, or its interface is gone.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the interface; may be called twice."""

    def _enter(self, state: BusState, reason: str, stamp_ns: int = 0) -> None:
        """Set `state`; a change is recorded, with the host's time if there is no stamp."""
        with self._changing:
            if state is self.state:
                return
            change = BusChange(stamp_ns or time.time_ns(), self.state, state, reason)
            self.changes.append(change)
            self._counters.state_changes += 1
            self.state = state

    def _process_error_frames(self, records: np.ndarray) -> None:
        """Process the error frames among received records, shape (m,), in the order of the bus.

        A controller in bus-off receives nothing, so a frame after its error frame shows that it is
        back.
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
