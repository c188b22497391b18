"""A worker process next to the live loop, and the ring buffer in shared memory that feeds it.

Work that must not delay a cycle (recording, publishing, the live view) has a process of its own,
since a thread would share the interpreter's lock. The loop copies a record into the ring and
continues; it never waits. Requests and answers go over a pipe, as JSON. When the loop's process
ends, for any reason, the pipe closes and the worker ends. The ring buffer is unnamed memory, so
that nothing is left behind.

::

    loop     WorkerSink ─► RingBuffer
    worker   RingBuffer ─► serve ─► Service
"""

from __future__ import annotations

import json
import mmap
import os
import select
import subprocess
import sys
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from skin.errors import SkinError

__all__ = ["RingBuffer", "Service", "Worker", "WorkerEnd", "run"]

AT_ONCE = 64
"""Most records that a worker takes, and frees, together [assumed]."""
LINE = 64
"""Bytes of a cache line: the counters of writer and reader have one each."""
LONGEST_S = 60.0
"""Timeout of an answer [assumed: a worker imports and compiles before its first]."""
SHORT = 8192
"""Longest command in bytes: one that a writable pipe takes whole [derived: it is writable with
three quarters of its buffer free]."""
ENDS_S = 10.0
"""Timeout of a worker to end, once asked to [assumed]."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
"""Variables that set the number of threads of linear algebra libraries. They are limited in a
worker unless the user has set them, since the threads would start before its priority is
lowered."""


class RingBuffer:
    """Records from one process to another: a single writer, a single reader, neither waits.

    Parameters
    ----------
    dtype : dtype
        Of a record; without objects.
    slots : int
        Capacity in records.
    fd : int, optional
        Descriptor of memory from the other process; new memory if not given.

    Raises
    ------
    SkinError
        The system has not enough memory.
    """

    def __init__(self, dtype: np.dtype[Any], slots: int, fd: int | None = None) -> None:
        self.dtype, self.slots = np.dtype(dtype), slots
        size = 2 * LINE + slots * self.dtype.itemsize
        try:
            self.fd = os.memfd_create("f3t-skin ring") if fd is None else fd
            if fd is None:
                os.ftruncate(self.fd, size)
            memory = mmap.mmap(self.fd, size)
        except OSError as error:
            raise SkinError(f"ring buffer: must be {size} bytes of memory; got {error}") from error
        self._written = np.frombuffer(memory, np.int64, 1)
        self._read = np.frombuffer(memory, np.int64, 1, offset=LINE)
        self._records = np.frombuffer(memory, self.dtype, slots, offset=2 * LINE)
        self._barrier = Lock()

    def close(self) -> None:
        """Close the descriptor, once the other process has it; may be called twice. The memory is
        freed when neither side uses it."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    @property
    def waiting(self) -> int:
        """Records written and not yet read."""
        return int(self._written[0] - self._read[0])

    @property
    def records(self) -> np.ndarray:
        """All records, shape (slots,): for a writer that fills in fields; see `claim`."""
        return self._records

    def claim(self) -> int | None:
        """Index of the next free record, to be filled in; None where the ring is full. The reader
        sees it after `publish`."""
        written = int(self._written[0])
        if written - int(self._read[0]) >= self.slots:
            return None
        return written % self.slots

    def publish(self) -> None:
        """Pass the claimed record to the reader."""
        with self._barrier:  # the record is in memory before it is counted
            self._written[0] += 1

    def unread(self) -> np.ndarray:
        """Unread records, oldest first, shape (m,), as views: up to the end of the memory; those
        that wrap around come with the next call, after `release`."""
        with self._barrier:
            written, read = int(self._written[0]), int(self._read[0])
        first = read % self.slots
        return self._records[first : first + min(written - read, self.slots - first)]

    def release(self, count: int) -> None:
        """Free the oldest `count` records."""
        with self._barrier:
            self._read[0] += count


class Worker:
    """The loop's side of a worker.

    Parameters
    ----------
    module : str
        Run as ``python -m module``; it starts with `WorkerEnd()`.
    ring : RingBuffer
        Its descriptor is closed here, since the worker has a copy.
    request : dict
        The worker's task, as JSON.
    niceness : int
        Increment of the worker's niceness.
    """

    def __init__(
        self, module: str, ring: RingBuffer, request: dict[str, Any], niceness: int = 5
    ) -> None:
        *_, room, name = module.split(".")
        self._name, self._lock = room if name == "process" else name, Lock()
        self._pipe, theirs = Pipe()
        root = str(Path(__file__).parents[1])
        paths = filter(None, (root, os.environ.get("PYTHONPATH")))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, str(theirs.fileno()), str(ring.fd)],
                pass_fds=(theirs.fileno(), ring.fd),
                env=ONE_THREAD | os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C interrupts only the loop, which ends the worker
            )
        ring.close()
        first = {
            "dtype": ring.dtype.descr, "slots": ring.slots, "nice": niceness, "request": request
        }  # fmt: skip
        self._pipe.send_bytes(_packed(first))

    @property
    def process_id(self) -> int:
        """Of the worker's process."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status of the worker, None while it runs; minus the signal that ended it."""
        return self._process.poll()

    def ask(self, command: str, timeout_s: float = LONGEST_S, **values: Any) -> dict[str, Any]:
        """Send a command and wait for the answer.

        Raises
        ------
        SkinError
            The worker has ended, does not answer in time, or answers with an ``error``.
        """
        with self._lock:
            try:
                if not self._is_writable(timeout_s):
                    raise TimeoutError("timed out")
                self._pipe.send_bytes(_packed({"command": command} | values))
                if not self._pipe.poll(timeout_s):
                    raise TimeoutError("timed out")
                line = self._pipe.recv_bytes()
            except (EOFError, BrokenPipeError, ConnectionResetError):
                line = b""
            except BaseException as error:  # an interrupt, too
                self._process.kill()  # a late answer would be read as that of the next command
                if not isinstance(error, OSError):
                    raise
                raise SkinError(f"{self._name}: must answer {command!r}; got {error}") from error
        if not line:
            raise SkinError(f"{self._name}: must answer {command!r}; worker exited early "
                            f"(status {self._process.wait(ENDS_S)})")  # fmt: skip
        answer = json.loads(line)
        if "error" in answer:
            raise SkinError(answer["error"])
        return answer

    def send(self, command: str, **values: Any) -> bool:
        """Send a command without an answer; never waits. False where the worker cannot take it: it
        has ended or has a backlog."""
        line = _packed({"command": command} | values)
        with self._lock:
            try:
                if len(line) > SHORT or not self._is_writable(0.0):
                    return False
                self._pipe.send_bytes(line)
            except OSError:
                return False
        return True

    def close(self, timeout_s: float = ENDS_S) -> None:
        """End the worker after its backlog; may be called twice."""
        with self._lock:
            self._pipe.close()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _is_writable(self, timeout_s: float) -> bool:
        """Whether the worker can be sent something within this time."""
        return bool(select.select([], [self._pipe], [], timeout_s)[1])


class WorkerEnd:
    """The worker's side, made from the arguments of its process.

    Attributes
    ----------
    ring : RingBuffer
    request : dict
        As given to `Worker`.
    ended : bool
        The loop has closed its side or has ended: process the backlog, and end.
    """

    def __init__(self) -> None:
        at, memory = (int(text) for text in sys.argv[1:])
        self._pipe: Connection[Any, Any] = Connection(at)
        self.ended = False
        first = self.command(None)
        if first is None:
            raise SystemExit(0)  # the loop ended before its first command
        os.nice(first["nice"])
        dtype = np.dtype(
            [(name, kind, *map(tuple, shape)) for name, kind, *shape in first["dtype"]]
        )
        self.ring = RingBuffer(dtype, first["slots"], memory)
        self.request: dict[str, Any] = first["request"]

    def command(self, timeout_s: float | None = 0.0) -> dict[str, Any] | None:
        """The next command, or None at the timeout; None as timeout waits for ever."""
        if self.ended or not self._pipe.poll(timeout_s):
            return None
        try:
            return json.loads(self._pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            self.ended = True
            return None

    def answer(self, **values: Any) -> None:
        """Answer the command; an ``error`` is raised in the loop's process."""
        try:
            self._pipe.send_bytes(_packed(values))
        except OSError:
            self.ended = True


class Service:
    """Work of a worker; `serve` calls it.

    Attributes
    ----------
    commands : mapping of str to callable
        Commands of the loop, by name: each gets the values of the command and returns the answer,
        or None for a command without one.
    rest_s : float
        Interval at which an empty ring is polled.
    reads_to_end : bool
        Whether the backlog is processed after the loop has ended.
    is_done : bool
        To be set to end the worker before the loop.
    """

    commands: Mapping[str, Callable[..., dict[str, Any] | None]]
    rest_s = 0.02
    reads_to_end = True
    is_done = False

    def take(self, records: np.ndarray) -> None:
        """Records of the loop, oldest first, shape (m,), as views."""
        raise NotImplementedError

    def look(self) -> None:
        """Called at each poll of the ring."""

    def rests_s(self, waiting: int) -> float:
        """Timeout of the next command, with so many unread records."""
        return 0.0 if waiting else self.rest_s

    def stop(self) -> None:
        """The loop has ended."""


def serve(end: WorkerEnd, service: Service) -> None:
    """Take records and execute commands until the loop has ended."""
    ring, known = end.ring, service.commands
    while not service.is_done:
        ended = end.ended  # before its last records are read
        _read(ring, service, AT_ONCE)
        service.look()
        given = end.command(0.0 if ended else service.rests_s(ring.waiting))
        if given is not None:
            _read(ring, service, ring.waiting)
            if (name := given.pop("command")) not in known:
                end.answer(error=f"command: must be one of {', '.join(known)}; got {name!r}")
            elif (answer := known[name](**given)) is not None:
                end.answer(**answer)
        elif ended and not (service.reads_to_end and ring.waiting):
            service.stop()
            return


def _read(ring: RingBuffer, service: Service, most: int) -> None:
    """Pass unread records to a service, so many at most."""
    while most > 0 and (records := ring.unread()[: min(most, AT_ONCE)]).size:
        most -= records.size
        service.take(records)
        ring.release(records.size)


def run(make: Callable[[WorkerEnd], Service]) -> None:
    """Run the process of a worker.

    Parameters
    ----------
    make : callable
        Makes the service for `WorkerEnd.request`; a `SkinError` is the answer to the first command.
    """
    end = WorkerEnd()
    try:
        service = make(end)
    except SkinError as error:
        if end.command(None) is not None:
            end.answer(error=str(error))
        sys.exit(1)
    serve(end, service)


def _packed(message: dict[str, Any]) -> bytes:
    return json.dumps(message, allow_nan=False).encode()
