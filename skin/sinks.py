"""Sinks: classes that receive the cycles of a skin next to its loop.

::

    class Peak(skin.Sink):
        newton = 0.0

        def state(self, state):
            self.newton = max(self.newton, float(abs(state.wrench[:3]).max()))

    with skin.open("palm") as palm:
        peak = palm.attach(Peak())

A sink defines methods for the events that it wants. A thread of its own calls them, so that a
slow disk or network costs the cycle only a copy of the state. Where a sink is too slow, events are
dropped and counted. One that raises is detached, and the logger "skin" reports why.

Recorder, publisher and live view are sinks that are called within the cycle
(`Sink.inline`): they copy into shared memory, and a process of their own does the work.
"""

from __future__ import annotations

import logging
import time
from enum import IntEnum
from queue import SimpleQueue
from threading import Lock, Thread, current_thread
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from skin.errors import OptionError, check_kind
from skin.worker import RingBuffer, Worker

if TYPE_CHECKING:
    from bus.cycle import FrameCounters
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["METHODS", "Attachable", "Ending", "Sink", "SinkReport", "Sinks", "WorkerSink"]

METHODS = ("frames", "closing", "moved", "state", "stop")
"""Methods of a sink."""
WAITING_S = 1.0
"""Time span of the states that may wait for a sink [assumed]."""
LEAST_WAITING = 8
LOOK_S = 0.5
"""Interval at which a sink checks its worker [assumed]."""
STOPS_S = 10.0
"""Timeout of a sink to process its backlog and stop [assumed]."""

_log = logging.getLogger("skin")


class Ending(IntEnum):
    """Reasons to end a cycle without a frame; the numbers of ``f3t_msgs/msg/CanFrames``."""

    EXPIRED = 1
    """Deadline: `Assembler.expire`."""
    SILENT = 2
    """No SYNC: `Assembler.silence`."""
    FLUSHED = 3
    """End of the log: `Assembler.flush`."""


class Sink:
    """Receives the cycles of a skin: derive from it, and define the methods you want.

    Attributes
    ----------
    inline : bool
        Whether methods are called within the cycle, which waits for them: for methods that return
        within microseconds. Their arguments are then the pipeline's own arrays, valid until they
        return. Otherwise a thread calls them, with copies that the sink owns.
    """

    inline = False

    def frames(self, frames: np.ndarray) -> None:
        """The pipeline is given frames of all buses, shape (m,), `bus.frame.FRAME_DTYPE`."""

    def closing(self, event: Ending, elapsed_ns: int) -> None:
        """A clock, or the end of a log, closes a cycle of age `elapsed_ns`; 0 where the first one
        begins. `frames` was called before; `state` follows."""

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Units have new poses from the next cycle on: shape (3, n), metre, and (3, 3, n)."""

    def state(self, state: State) -> None:
        """A cycle is decoded."""

    def stop(self) -> None:
        """The last call: the skin is closed, the log at its end, or the sink detached."""


AnySink = TypeVar("AnySink", bound=Sink)


class SinkReport(NamedTuple):
    """Status of a sink."""

    sink: Sink
    lost: int
    """Calls, or records, that were dropped because the sink was too slow."""
    failure: str | None
    """Why it failed before the loop ended; None if it did not."""


class Attachable:
    """Base of what sinks can be attached to: an open skin, a log, a replay.

    Attributes
    ----------
    pipeline : Pipeline
    """

    pipeline: Pipeline

    def attach(self, sink: AnySink) -> AnySink:
        """Attach a sink to all cycles to come, until the skin is closed or the log is at its end.

        May be called at any time, from any thread.

        Parameters
        ----------
        sink : Sink

        Returns
        -------
        Sink
            The same.

        Raises
        ------
        OptionError
            It is not a sink, has none of the methods, or is attached already.
        """
        self.pipeline.sinks.attach(sink)
        return sink

    def detach(self, sink: Sink) -> None:
        """Stop and detach a sink; does nothing where it is not attached."""
        self.pipeline.sinks.detach(sink)

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome, running totals."""
        return self.pipeline.assembler.counters

    @property
    def sinks(self) -> list[SinkReport]:
        """Every sink that was attached, with its losses and failure."""
        return self.pipeline.sinks.reports()


class Sinks:
    """The sinks of a pipeline.

    Parameters
    ----------
    rate_hz : float
        Cycles a second: sets how many states may wait for a sink.

    Attributes
    ----------
    live : tuple
        Those that are attached and have not failed.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz, self._lock = rate_hz, Lock()
        self._every: list[_Attached] = []
        self.live: tuple[_Attached, ...] = ()

    def tell(self, method: str, *given: Any) -> None:
        """Call a method of all sinks that have it; one that raises is detached."""
        for attached in self.live:
            if method in attached.methods:
                attached.tell(method, given)

    def attach(self, sink: Sink) -> None:
        """See `Attachable.attach`."""
        check_kind("sink", sink, Sink)
        name = type(sink).__name__
        if not _methods(sink):
            raise OptionError(
                f"sink: must have at least one of the methods {', '.join(METHODS)}; got {name} "
                "without any"
            )
        with self._lock:
            if any(attached.sink is sink for attached in self.live):
                raise OptionError(f"sink: must be attached once; got {name} again")
            made = _Attached(sink, self) if sink.inline else _Queued(sink, self, self._rate_hz)
            self._every = [*(one for one in self._every if one.sink is not sink), made]
            self.live = (*self.live, made)

    def detach(self, sink: Sink) -> None:
        """See `Attachable.detach`."""
        for attached in self._every:
            if attached.sink is sink:
                if self.remove(attached):
                    attached.stop()
                attached.join()  # one that has failed: its thread may still stop it

    def stop(self) -> None:
        """Detach all, the last one first; each is stopped even if another fails. Those that have
        failed before have stopped, too, when this returns."""
        try:
            for attached in reversed(self._every):
                self.detach(attached.sink)
        finally:  # also after an interrupt
            if self.live:
                self.stop()

    def reports(self) -> list[SinkReport]:
        """See `Attachable.sinks`."""
        return [SinkReport(one.sink, one.lost, one.failure) for one in self._every]

    def remove(self, attached: _Attached) -> bool:
        """Remove a sink from the list, while a call in progress finishes with the old one; False
        if it is not there."""
        with self._lock:
            found = attached in self.live
            self.live = tuple(one for one in self.live if one is not attached)
            return found


class _Attached:
    """A sink whose methods are called within the cycle."""

    def __init__(self, sink: Sink, sinks: Sinks) -> None:
        self.sink, self._sinks = sink, sinks
        self.methods = _methods(sink)
        self._failure: str | None = None

    @property
    def lost(self) -> int:
        """As of `SinkReport`."""
        return int(getattr(self.sink, "lost", 0))

    @property
    def failure(self) -> str | None:
        """As of `SinkReport`."""
        own: str | None = getattr(self.sink, "failure", None)
        return self._failure or own

    def tell(self, method: str, given: tuple[Any, ...]) -> None:
        """Call a method."""
        self._call(method, given)

    def stop(self) -> None:
        """Stop the sink, once it is removed."""
        self._call("stop", ())

    def join(self) -> None:
        """Wait until the sink has stopped."""

    def _call(self, method: str, given: tuple[Any, ...]) -> bool:
        """Call a method; one that raises is the last but `stop`."""
        try:
            getattr(self.sink, method)(*given)
        except Exception as error:
            is_first = self._sinks.remove(self)
            if is_first or method == "stop":
                failure = (
                    f"sink {self._name}: {method}: must not raise; got {type(error).__name__}: "
                    f"{error} (it is detached, the run goes on)"
                )
                self._failure = self._failure or failure
                _log.warning("%s", failure, exc_info=error)
            if is_first:
                self.stop()
            return False
        return True

    @property
    def _name(self) -> str:
        return type(self.sink).__name__


class _Queued(_Attached):
    """A sink that its own thread calls."""

    def __init__(self, sink: Sink, sinks: Sinks, rate_hz: float) -> None:
        super().__init__(sink, sinks)
        self._rate_hz = rate_hz
        self._most = max(LEAST_WAITING, round(WAITING_S * rate_hz))
        self._waiting: SimpleQueue[tuple[str, tuple[Any, ...]] | None] = SimpleQueue()
        self._left_out, self._left_behind = 0, False
        self._thread = Thread(target=self._run, name=f"sink {self._name}", daemon=True)
        self._thread.start()

    @property
    def lost(self) -> int:
        """Calls that were left out."""
        return self._left_out

    def tell(self, method: str, given: tuple[Any, ...]) -> None:
        """Let a method wait for its call, with copies of what it is given."""
        if self._waiting.qsize() < self._most:
            own = tuple(one.copy() if hasattr(one, "copy") else one for one in given)
            self._waiting.put((method, own))
            return
        self._left_out += 1
        if self._left_out == 1:
            self._say_lost("so far")

    def stop(self) -> None:
        """Let the sink process its backlog, and stop it."""
        self._waiting.put(None)
        self.join()
        if self._left_out:
            self._say_lost("in all")

    def join(self) -> None:
        """Wait until the sink has stopped, at most `STOPS_S` and once; does not wait where its own
        thread asks."""
        if current_thread() is not self._thread and not self._left_behind:
            self._thread.join(STOPS_S)
            self._left_behind = self._thread.is_alive()
            if self._left_behind:
                _log.warning("sink %s: must stop within %g s; still runs with a backlog of %d "
                             "calls", self._name, STOPS_S, self._waiting.qsize())  # fmt: skip

    def _say_lost(self, when: str) -> None:
        _log.warning("sink %s: must keep up with %g cycles a second; left out %d calls %s",
                     self._name, self._rate_hz, self._left_out, when)  # fmt: skip

    def _run(self) -> None:
        is_fine = True
        while (call := self._waiting.get()) is not None:
            is_fine = is_fine and self._call(*call)
        self._call("stop", ())


class WorkerSink(Sink):
    """A sink whose work is done by a process; within the cycle it only copies records into a ring.

    Parameters
    ----------
    name : str
        Used in messages.
    pipeline : Pipeline
        The pipeline that it will be attached to.

    Attributes
    ----------
    lost : int
        Records dropped because the ring was full.
    look_at : float
        Time of the next check of the process, `time.monotonic`.
    failure : str or None
        Why the process ended before the loop; None if it did not.
    """

    inline = True

    def __init__(self, name: str, pipeline: Pipeline) -> None:
        self.name, self.pipeline = name, pipeline
        self.lost, self._reported = 0, 0
        self.failure: str | None = None
        self.look_at = 0.0

    def start(
        self, module: str, ring: RingBuffer, request: dict[str, Any], first: str, niceness: int = 5
    ) -> dict[str, Any]:
        """Start the process; returns its answer to the first command, or raises the error with
        which it refuses the request."""
        self._worker = Worker(module, ring, request, niceness)
        try:
            return self._worker.ask(first)
        except BaseException:
            self._worker.close()
            raise

    @property
    def process_id(self) -> int:
        """Of the process."""
        return self._worker.process_id

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._worker.status is None

    def look(self) -> None:
        """Check every `LOOK_S` whether the process runs and keeps up; otherwise log it to the
        logger "skin"."""
        now = time.monotonic()
        if now < self.look_at or self.failure is not None:
            return
        self.look_at = now + LOOK_S
        if not self.alive:
            self.fail()
            return
        if self.lost >= max(1, 2 * self._reported):  # not at every check
            self._reported = self.lost
            _log.warning("%s: must keep up with %g cycles a second; left out %s so far",
                         self.name, self.pipeline.topology.cycle_rate_hz,
                         self.described_loss())  # fmt: skip

    def fail(self) -> None:
        """The process has ended; the loop continues."""
        self.failure = self.described_end(self._worker.status or 0)
        _log.warning("%s", self.failure)

    def close(self) -> None:
        """Detach, and end the process after its backlog; may be called twice."""
        self.pipeline.sinks.detach(self)
        self._worker.close()

    def described_loss(self) -> str:
        """Records dropped so far, as text."""
        return f"{self.lost} states"

    def described_end(self, status: int) -> str:
        """Why the process ended, by its exit status."""
        return f"{self.name}: worker exited early (status {status})"


def _methods(sink: Sink) -> set[str]:
    """Methods that a sink defines."""
    return {name for name in METHODS if getattr(type(sink), name) is not getattr(Sink, name)}
