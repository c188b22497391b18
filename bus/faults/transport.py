"""FaultyTransport: a transport that does to the frames of another what a script says."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from bus.faults.injector import Injector
from bus.faults.script import FaultScript, load_script
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.state import BusState
from bus.transport import Transport, TransportCounters
from topology import Topology

__all__ = ["FaultyTransport"]

_HOST_STATES = (BusState.DOWN, BusState.GONE)


class FaultyTransport(Transport):
    """A transport whose frames suffer the faults of a script.

    Parameters
    ----------
    inner : Transport
        Where frames come from and go to; closed with this one.
    script : FaultScript, str or Path
        The faults, or a file of them.
    seed : int, optional
        In place of the script's own.
    topology : Topology, optional
        The skin; `units`, `bus` and the kinds that write payloads need it. The transport is the
        bus of its `index`.
    direction : "receive" or "send"
        Which frames are hit: a host's end receives, the end of simulated units sends.
    clock : callable, optional
        Gives the time, in ns, by which the script goes: that of a scene, where units are
        simulated. If not given, the script goes by the stamps of the frames.

    Attributes
    ----------
    injected : dict of str to int
        How often each kind of the script has struck so far.

    Raises
    ------
    FaultScriptError
        The script cannot be used.
    """

    def __init__(
        self,
        inner: Transport,
        script: FaultScript | str | Path,
        seed: int | None = None,
        topology: Topology | None = None,
        *,
        direction: Literal["receive", "send"] = "receive",
        clock: Callable[[], int] | None = None,
    ) -> None:
        super().__init__(inner.index)
        if direction not in ("receive", "send"):
            raise ValueError(f"direction: must be 'receive' or 'send'; got {direction!r}")
        if not isinstance(script, FaultScript):
            script = load_script(script, topology)
        self.inner = inner
        self.clock, self.stamped_by = inner.clock, inner.stamped_by
        self.keeps_stamps = inner.keeps_stamps
        self._inject = Injector(script, seed, topology, index=inner.index, clock=clock)
        self._receives = direction == "receive"
        self._heard = FrameBatch(1024)
        self._pending = np.zeros(0, FRAME_DTYPE)

    @property
    def injected(self) -> dict[str, int]:
        """How often each kind of the script has struck so far."""
        return self._inject.injected

    @property
    def counters(self) -> TransportCounters:
        """This end's counts, with the losses that the inner transport knows of."""
        inner, own = self.inner.counters, self._counters
        own.send_waits, own.reopenings = inner.send_waits, inner.reopenings
        own.queue_drops, own.ring_overflows = inner.queue_drops, inner.ring_overflows
        return own

    def fileno(self) -> int:
        """-1: frames may wait here of which the inner descriptor does not know."""
        return -1

    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`; see `Transport.receive`."""
        until = time.monotonic() + timeout_s
        while not self._pending.size:
            self._heard.clear()
            left_s = max(until - time.monotonic(), 0.0) if batch.room else 0.0
            taken = self.inner.receive(self._heard, left_s)
            self._follow()
            if not taken:
                return 0
            frames = self._heard.frames
            self._pending = self._inject(frames) if self._receives else frames.copy()
        taken = batch.extend(self._pending)
        self._process_error_frames(self._pending[:taken])
        self._pending = self._pending[taken:]
        self._counters.received += taken
        return taken

    def send(self, records: np.ndarray) -> int:
        """Send frames, in order; a frame that a fault has swallowed counts as taken."""
        outgoing = records if self._receives else self._inject(records)
        refused = outgoing.size - self.inner.send(outgoing)
        self._follow()
        taken = max(records.size - refused, 0)
        self._counters.sent += taken
        self._counters.send_failures += records.size - taken
        return taken

    def close(self) -> None:
        """Close the inner transport."""
        self.inner.close()

    def _follow(self) -> None:
        """Enter what the inner transport knows without error frames: its interface came or went."""
        while self.inner.changes:
            change = self.inner.changes.popleft()
            if change.state in _HOST_STATES or change.previous in _HOST_STATES:
                self._enter(change.state, change.reason, change.stamp_ns)
