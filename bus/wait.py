"""Waiter: receives several buses into one batch, by event or without waiting."""

from __future__ import annotations

import time
from collections.abc import Sequence

from bus.frame import FrameBatch
from bus.linux import has_batches
from bus.state import BusState
from bus.transport import Transport

__all__ = ["IdleWindow", "Waiter"]

_SHARE_NS = 1_000_000
_MARGIN_SHARE, _MARGIN_NS = 16, 200_000
"""Margin by which a lull ends before cycles are complete: a fraction of a period, with a lower
bound; a sleep ends some 0.1 ms late [measured]."""
_LULL_NS = 20_000_000
"""Longest lull, which limits the delay of closing the buses."""


class Waiter:
    """Receives from the transports of one skin.

    Parameters
    ----------
    transports : sequence of Transport
    """

    def __init__(self, transports: Sequence[Transport]) -> None:
        self._transports = list(transports)
        self._first = 0
        self._polled = None
        if len(self._transports) > 1:
            descriptors = [transport.fileno() for transport in self._transports]
            if min(descriptors) >= 0 and has_batches():
                from bus import mmsg

                self._wait, self._polled = mmsg.wait, mmsg.pollfds(*descriptors)

    def receive(self, batch: FrameBatch, wait_ns: int) -> int:
        """Append the frames that have arrived, from all transports.

        Parameters
        ----------
        batch : FrameBatch
        wait_ns : int
            How long to wait for the first frame.

        Returns
        -------
        int
            Number of frames appended.

        Raises
        ------
        BusClosedError
            One of the transports was closed.
        """
        if len(self._transports) == 1:
            return self._transports[0].receive(batch, wait_ns * 1e-9)
        if self._polled is None:
            taken = self._receive_ready(batch)
            return taken if taken or wait_ns <= 0 else self._wait_in_turn(batch, wait_ns)
        if self._wait(self._polled, max(wait_ns, 0)) or wait_ns <= 0:
            return self._receive_ready(batch, (self._polled[2:] >> 48).tolist())
        return self._receive_ready(batch)  # a closed one raises

    def _receive_ready(self, batch: FrameBatch, ready: Sequence[int] | None = None) -> int:
        """Take waiting frames, from transports that are `ready` or have an error, from all if not
        given.

        The first bus changes, so that a full batch starves none.
        """
        self._first = (self._first + 1) % len(self._transports)
        taken = 0
        for i in range(self._first - len(self._transports), self._first):
            transport = self._transports[i]
            if ready is None or ready[i] or transport.state is not BusState.ACTIVE:
                taken += transport.receive(batch)
        return taken

    def _wait_in_turn(self, batch: FrameBatch, wait_ns: int) -> int:
        """Wait without descriptors: a millisecond for each bus in turn."""
        until = time.monotonic_ns() + wait_ns
        while True:
            for transport in self._transports:
                left = until - time.monotonic_ns()
                if left <= 0:
                    return self._receive_ready(batch)
                taken = transport.receive(batch, min(left, _SHARE_NS) * 1e-9)
                if taken:
                    return taken + self._receive_ready(batch)


class IdleWindow:
    """Time after SYNC in which no cycle is complete yet: a host may sleep through arrivals.

    Learned from earlier cycles, so that it holds for every bus, board and rate; it shrinks fast
    where frames come sooner, and grows slowly.

    Parameters
    ----------
    period_ns : int
        Of the cycles.

    Attributes
    ----------
    ns : int
        Nanoseconds; 0 until cycles have shown that there is a lull.
    """

    def __init__(self, period_ns: int) -> None:
        self.ns = 0
        self._margin_ns = max(period_ns // _MARGIN_SHARE, _MARGIN_NS)

    def learn(self, complete_ns: int, slept_too_long: bool) -> None:
        """Process a cycle.

        Parameters
        ----------
        complete_ns : int
            Time from its SYNC to its completion.
        slept_too_long : bool
            Whether it was complete before the lull was over.
        """
        if slept_too_long:
            self.ns -= self.ns // 4
        else:
            most = min(complete_ns - self._margin_ns, _LULL_NS)
            self.ns = max(0, self.ns + (most - self.ns) // 8)
