"""Waiter: several buses received into one batch, in one of two ways to wait."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Literal

from bus.frame import FrameBatch
from bus.linux import has_batches
from bus.transport import Transport

__all__ = ["Waiter"]

_SHARE_NS = 1_000_000


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
        if self._drains:
            if wait_ns > 0:
                time.sleep(wait_ns * 1e-9)
            return self._drain(batch)
        if len(self._transports) == 1:
            return self._transports[0].receive(batch, wait_ns * 1e-9)
        taken = self._drain(batch)
        if taken or wait_ns <= 0:
            return taken
        if self._polled is not None:
            self._wait(self._polled, wait_ns)
            return self._drain(batch)
        return self._wait_in_turn(batch, wait_ns)

    def _drain(self, batch: FrameBatch) -> int:
        """Take what is there; the bus to start with changes, so that a full batch starves none."""
        taken = sum(transport.receive(batch) for transport in self._transports)
        self._transports.append(self._transports.pop(0))
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
