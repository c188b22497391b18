"""Waiter: several buses received into one batch, in one of two ways to wait, or not yet at all."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Literal

from bus.frame import FrameBatch
from bus.linux import has_batches
from bus.state import BusState
from bus.transport import Transport

__all__ = ["Lull", "Waiter"]

_SHARE_NS = 1_000_000
_MARGIN_SHARE, _MARGIN_NS = 16, 200_000
"""By which a lull ends before cycles are complete: share of a period, but no less than that; a
sleep ends some 0.1 ms late [measured]."""
_LULL_NS = 20_000_000
"""Longest lull: whoever closes the buses waits for its end."""


class Waiter:
    """Receives from the transports of one skin.

    Parameters
    ----------
    transports : sequence of Transport
    wait : "event" or "drain"
        "event" wakes as soon as frames arrive: the least latency. "drain" sleeps through, then
        takes all that has arrived: the least work, one wake-up for the frames of a whole cycle.
    """

    def __init__(
        self, transports: Sequence[Transport], wait: Literal["event", "drain"] = "event"
    ) -> None:
        if wait not in ("event", "drain"):
            raise ValueError(f"wait: must be 'event' or 'drain'; got {wait!r}")
        self._transports = list(transports)
        self._first = 0
        self._drains = wait == "drain"
        self._polled = None
        if len(self._transports) > 1:
            descriptors = [transport.fileno() for transport in self._transports]
            if min(descriptors) >= 0 and has_batches():
                from bus import mmsg

                self._wait, self._polled = mmsg.wait, mmsg.pollfds(*descriptors)

    def receive(self, batch: FrameBatch, wait_ns: int) -> int:
        """Append the frames that have arrived, of all transports.

        Parameters
        ----------
        batch : FrameBatch
        wait_ns : int
            How long to wait: for the first frame ("event"), or in any case ("drain").

        Returns
        -------
        int
            Number of frames appended.

        Raises
        ------
        BusClosedError
            One of the transports was closed.
        """
        if self._drains and wait_ns > 0:
            time.sleep(wait_ns * 1e-9)
            wait_ns = 0
        if len(self._transports) == 1:
            return self._transports[0].receive(batch, wait_ns * 1e-9)
        if self._polled is None:
            taken = self._drain(batch)
            return taken if taken or wait_ns <= 0 else self._wait_in_turn(batch, wait_ns)
        if self._wait(self._polled, max(wait_ns, 0)) or wait_ns <= 0:
            return self._drain(batch, (self._polled[2:] >> 48).tolist())
        return self._drain(batch)  # one that was closed says so

    def _drain(self, batch: FrameBatch, ready: Sequence[int] | None = None) -> int:
        """Take what is there, of those that are `ready` or in trouble, of all if not given.

        The bus to start with changes, so that a full batch starves none.
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
                    return self._drain(batch)
                taken = transport.receive(batch, min(left, _SHARE_NS) * 1e-9)
                if taken:
                    return taken + self._drain(batch)


class Lull:
    """How long after its SYNC no cycle is complete yet: as long may a host sleep through arrivals.

    Learned from the cycles before, so that it holds for every bus, board and rate; it shrinks fast
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
        """Take in a cycle.

        Parameters
        ----------
        complete_ns : int
            When it was complete, after its SYNC.
        slept_too_long : bool
            Whether it was so already when the lull was over.
        """
        if slept_too_long:
            self.ns -= self.ns // 4
        else:
            most = min(complete_ns - self._margin_ns, _LULL_NS)
            self.ns = max(0, self.ns + (most - self.ns) // 8)
