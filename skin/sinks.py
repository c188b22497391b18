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
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from queue import SimpleQueue
from threading import Lock, Thread, current_thread
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from skin.errors import OptionError, check_kind
from skin.worker import RingBuffer, Worker

if TYPE_CHECKING:
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
    """Deadline: `Pipeline.expire`."""
    SILENT = 2
    """No SYNC: `Pipeline.silence`."""
    FLUSHED = 3
    """End of the log: `Pipeline.flush`."""


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
        self.pipeline.attach(sink)
        return sink

    def detach(self, sink: Sink) -> None:
        """Stop and detach a sink; does nothing where it is not attached."""
        self.pipeline.detach(sink)

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
    live : tuple of Sink
        Those that are attached and have not failed.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz, self._lock = rate_hz, Lock()
        self._every: list[tuple[Sink, Sink]] = []  # as given, and as called
        self.live: tuple[Sink, ...] = ()
        self._failures: dict[int, str] = {}
        self._calls: dict[str, list[tuple[Sink, Callable[..., None]]]] = {}
        self._set(())

    def tell(self, method: str, *given: Any) -> None:
        """Call a method of all sinks that have it; one that raises is detached."""
        for sink, call in self._calls[method]:
            try:
                call(*given)
            except Exception as error:
                self._fail(sink, method, error)

    # -- attaching ---------------------------------------------------------------------------------

    def attach(self, sink: Sink) -> None:
        """See `Attachable.attach`."""
        check_kind("sink", sink, Sink)
        if not any(_has(sink, method) for method in METHODS):
            raise OptionError(
                f"sink: must have at least one of the methods {', '.join(METHODS)}; got "
                f"{_name(sink)} without any"
            )
        with self._lock:
            if any(given is sink for given, called in self._every if called in self.live):
                raise OptionError(f"sink: must be attached once; got {_name(sink)} again")
            called = sink if sink.inline else _Queued(sink, self._rate_hz, self._fail)
            self._every = [one for one in self._every if one[0] is not sink]
            self._every.append((sink, called))
            self._failures.pop(id(sink), None)
            self._set((*self.live, called))

    def detach(self, sink: Sink) -> None:
        """See `Attachable.detach`."""
        called = next((other for given, other in self._every if given is sink), None)
        if called is None:
            return
        if self._remove(called):
            self._stop(called)
        elif isinstance(called, _Queued):
            called.join()  # it has failed, and its thread may still stop it

    def stop(self) -> None:
        """Detach all, the last one first; each is stopped even if another fails. Those that have
        failed before have stopped, too, when this returns."""
        try:
            for sink, _ in reversed(self._every):
                self.detach(sink)
        finally:  # also after an interrupt
            if self.live:
                self.stop()

    def reports(self) -> list[SinkReport]:
        """See `Attachable.sinks`."""
        return [
            SinkReport(
                sink, int(getattr(called, "lost", 0)),
                self._failures.get(id(sink), getattr(called, "failure", None)),
            ) for sink, called in self._every
        ]  # fmt: skip

    def _set(self, live: tuple[Sink, ...]) -> None:
        """Replace the list of sinks; a call in progress finishes with the old one."""
        self.live = live
        self._calls = {
            method: [(sink, _call_of(sink, method)) for sink in live if _has(sink, method)]
            for method in METHODS
        }

    def _remove(self, called: Sink) -> bool:
        """Remove a sink from the list; False if it is not there."""
        with self._lock:
            if called not in self.live:
                return False
            self._set(tuple(sink for sink in self.live if sink is not called))
            return True

    def _stop(self, called: Sink) -> None:
        try:
            called.stop()
        except Exception as error:
            self._warn(called, "stop", error)

    def _fail(self, called: Sink, method: str, error: Exception) -> None:
        """A method has raised: detach its sink and continue the cycle."""
        is_first = self._remove(called)
        if is_first or method == "stop":
            self._warn(called, method, error)
        if is_first:
            self._stop(called)

    def _warn(self, called: Sink, method: str, error: Exception) -> None:
        sink = next(given for given, other in self._every if other is called)
        failure = (
            f"sink {_name(sink)}: {method}: must not raise; got {type(error).__name__}: {error} "
            "(it is detached, the run goes on)"
        )
        self._failures.setdefault(id(sink), failure)
        _log.warning("%s", failure, exc_info=error)


class _Queued(Sink):
    """A sink that its own thread calls.

    Parameters
    ----------
    sink : Sink
    rate_hz : float
        Cycles a second.
    fail : callable
        Called with this object, the name of the method that has raised, and the exception.
    """

    inline = True

    def __init__(self, sink: Sink, rate_hz: float, fail: Callable[..., None]) -> None:
        self.sink, self._rate_hz, self._fail = sink, rate_hz, fail
        self._most = max(LEAST_WAITING, round(WAITING_S * rate_hz))
        self._waiting: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._ended = self._left_behind = False
        self.lost = 0
        self._thread = Thread(target=self._run, name=f"sink {_name(sink)}", daemon=True)
        self._thread.start()

    def put(self, method: str, *given: Any) -> None:
        """Let a method wait for its call, with copies of what it is given."""
        if self._has_room():
            own = [one.copy() if hasattr(one, "copy") else one for one in given]
            self._waiting.put(partial(self._call, method, *own))

    def stop(self) -> None:
        """Let the sink process its backlog, and stop it."""
        self._waiting.put(None)
        self.join()
        if self.lost:
            self._say_lost("in all")

    def join(self) -> None:
        """Wait until the sink has stopped, at most `STOPS_S` and once; does not wait where its own
        thread asks."""
        if current_thread() is not self._thread and not self._left_behind:
            self._thread.join(STOPS_S)
            self._left_behind = self._thread.is_alive()
            if self._left_behind:
                _log.warning("sink %s: must stop within %g s; still runs with a "
                             "backlog of %d calls", _name(self.sink), STOPS_S,
                             self._waiting.qsize())  # fmt: skip

    def _has_room(self) -> bool:
        """Whether one more call may wait; otherwise it is dropped."""
        if self._waiting.qsize() < self._most:
            return True
        self.lost += 1
        if self.lost == 1:
            self._say_lost("so far")
        return False

    def _say_lost(self, when: str) -> None:
        _log.warning("sink %s: must keep up with %g cycles a second; left out %d calls %s",
                     _name(self.sink), self._rate_hz, self.lost, when)  # fmt: skip

    def _call(self, method: str, *given: Any) -> None:
        try:
            getattr(self.sink, method)(*given)
        except Exception as error:
            self._ended = True
            self._fail(self, method, error)

    def _run(self) -> None:
        while (call := self._waiting.get()) is not None:
            if not self._ended:
                call()
        if _has(self.sink, "stop"):
            self._call("stop")


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
    missed : int
        Records dropped because the ring was full.
    look_at : float
        Time of the next check of the process, `time.monotonic`.
    failure : str or None
        Why the process ended before the loop; None if it did not.
    """

    inline = True

    def __init__(self, name: str, pipeline: Pipeline) -> None:
        self.name, self.pipeline = name, pipeline
        self.missed, self._reported = 0, 0
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
        return self._worker.alive

    def look(self) -> None:
        """Check every `LOOK_S` whether the process runs and keeps up; otherwise log it to the
        logger "skin"."""
        now = time.monotonic()
        if now < self.look_at or self.failure is not None:
            return
        self.look_at = now + LOOK_S
        if not self._worker.alive:
            self.fail()
            return
        lost = self.left_out()
        if lost >= max(1, 2 * self._reported):  # not at every check
            self._reported = lost
            _log.warning("%s: must keep up with %g cycles a second; left out %s so far",
                         self.name, self.pipeline.topology.cycle_rate_hz,
                         self.described_loss())  # fmt: skip

    def fail(self) -> None:
        """The process has ended; the loop continues."""
        self.failure = self.described_end(self._worker.status or 0)
        _log.warning("%s", self.failure)

    def close(self) -> None:
        """Detach, and end the process after its backlog; may be called twice."""
        self.pipeline.detach(self)
        self._worker.close()

    @property
    def lost(self) -> int:
        """What `SinkReport.lost` counts."""
        return self.missed

    def left_out(self) -> int:
        """Records dropped so far."""
        return self.missed

    def described_loss(self) -> str:
        """The same as text."""
        return f"{self.missed} states"

    def described_end(self, status: int) -> str:
        """Why the process ended, by its exit status."""
        return f"{self.name}: worker exited early (status {status})"


def _has(sink: Sink, method: str) -> bool:
    """Whether a sink defines a method."""
    own = sink.sink if isinstance(sink, _Queued) else sink
    return getattr(type(own), method) is not getattr(Sink, method)


def _call_of(sink: Sink, method: str) -> Callable[..., None]:
    """How a method of a sink is called within the cycle."""
    if isinstance(sink, _Queued):
        return partial(sink.put, method)
    call: Callable[..., None] = getattr(sink, method)
    return call


def _name(sink: Sink) -> str:
    return type(sink).__name__
